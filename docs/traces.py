"""Error against time of iterative methods, from the traces in their results.

    detailbench run -m method=idf,siren method.traces=8 method.seconds=60 limit.seconds=240 dataset=multiscale \\
        results=results/traces
    python docs/traces.py results/traces traces.png --metric p2f_mean

(with matplotlib, which comes with the extra `render`)

A line is the geometric mean over the cases, thin lines are the cases; the last point is the result itself, at the time
that the call took.
"""

from __future__ import annotations

import argparse
import json
import math

import matplotlib
import numpy as np

from bench.results.store import Results

matplotlib.use("Agg")
import matplotlib.pyplot as plt


def curves(folder: str, metric: str) -> dict[str, list[np.ndarray]]:
    """For each method, a (points, 2) array of seconds and errors for each case that was solved."""
    found: dict[str, list[np.ndarray]] = {}
    key = f"score.{metric}"
    results = Results(folder)
    newest = results.rows()[["cell", "fingerprint"]].drop_duplicates()
    records = [results.read(cell, fingerprint) for cell, fingerprint in newest.itertuples(index=False)]
    # Cell by cell, because rows that are read all at once have no traces.
    for row in (row for record in records if record for row in record.rows if row["status"] == "ok"):
        if not isinstance(row.get("trace"), str):
            continue
        points = [(t["seconds"], t[key]) for t in json.loads(row["trace"]) if t.get(key) is not None]
        points.append((row["seconds"], row[key]))
        label = f"{row['method']} ({row['variant']})" if row["variant"] else row["method"]
        found.setdefault(label, []).append(np.array(points))
    return found


def draw(found: dict[str, list[np.ndarray]], metric: str, path: str) -> None:
    """Both axes logarithmic where the scores allow it."""
    figure, axis = plt.subplots(figsize=(7, 4.6), layout="constrained")
    for i, (label, lines) in enumerate(sorted(found.items())):
        color = f"C{i % 10}"
        for line in lines:
            axis.plot(*line.T, color=color, alpha=0.25, linewidth=0.8)
        begin, end = max(line[0, 0] for line in lines), min(line[-1, 0] for line in lines)
        if end > begin:
            seconds = np.geomspace(max(begin, 1e-3), end, 40)
            mean = np.exp(
                np.mean(
                    [np.interp(seconds, line[:, 0], np.log(np.maximum(line[:, 1], 1e-12))) for line in lines], axis=0
                )
            )
            axis.plot(seconds, mean, color=color, linewidth=2.2, label=f"{label}: {len(lines)} cases")
    axis.set_yscale("log")
    axis.set_xlabel("seconds of the method's clock")
    axis.set_ylabel(metric)
    axis.grid(alpha=0.3, which="both")
    axis.legend(fontsize=8)
    figure.savefig(path, dpi=110)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", help="a folder of results with traces")
    parser.add_argument("picture", help="the PNG to write")
    parser.add_argument("--metric", default="p2f_mean", help="a score that the traces have")
    args = parser.parse_args()
    found = curves(args.results, args.metric)
    if not found:
        raise SystemExit(f"{args.results}: no solved case has a trace with {args.metric}; run with method.traces=8")
    draw(found, args.metric, args.picture)
    for label, lines in sorted(found.items()):
        last = [line[-1, 1] for line in lines if math.isfinite(line[-1, 1])]
        print(f"{label}: {len(lines)} cases, {metric_mean(last):.3g} at the end")
    print(args.picture)


def metric_mean(values: list[float]) -> float:
    """The geometric mean."""
    return float(np.exp(np.mean(np.log(np.maximum(values, 1e-12))))) if values else math.nan


if __name__ == "__main__":
    main()
