"""The table of a tuning sweep: which parameters are best on the train split, by one rule.

    for m in $(ls conf/experiment | sed -n 's/^tune_\\(.*\\).yaml/\\1/p'); do
        detailbench run experiment=tune_$m results=results/tuning hydra/launcher=joblib hydra.launcher.n_jobs=2
    done
    python docs/tuning.py results/tuning

The rule: the smallest geometric mean of one metric over all cases (so that each case counts by ratio, whatever its
scale), among the variants that solved all of them. The metric is p2f_mean where points are moved, chamfer_l1_mean where
what is missing must count: surfaces, added points, and the removal of outliers.
"""

from __future__ import annotations

import argparse

import numpy as np
import pandas as pd

from bench.results.store import Results

METRIC = {"reconstruct": "chamfer_l1_mean", "upsample": "chamfer_l1_mean", "denoise": "p2f_mean"}
REMOVERS = ("statistical_outlier", "radius_outlier")


def variants(rows: pd.DataFrame, metric: str) -> pd.DataFrame:
    """One line per variant: solved, planned, and the geometric and arithmetic mean of the metric."""
    lines = []
    for variant, part in rows.groupby("variant"):
        score = part.loc[part["status"] == "ok", f"score.{metric}"].to_numpy(dtype=float)
        lines.append(
            {
                "variant": variant or "(the defaults)",
                "solved": len(score),
                "planned": len(part),
                "geometric": float(np.exp(np.log(score).mean())) if len(score) else np.nan,
                "mean": float(score.mean()) if len(score) else np.nan,
                "seconds": float(part["seconds"].median()),
            }
        )
    return pd.DataFrame(lines)


def main() -> None:
    """Print a Markdown table of the best variants of each method, and where its defaults stand."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", nargs="+")
    parser.add_argument("--best", type=int, default=3, help="how many variants to show of each method")
    args = parser.parse_args()
    rows = pd.concat([Results(folder).rows() for folder in args.results], ignore_index=True)
    print("| method | task | metric (1e-3) | variant | place | geometric mean | mean | solved | seconds |")
    print("| --- | --- | --- | --- | --- | --: | --: | --: | --: |")
    for (method, task), part in rows.groupby(["method", "task"]):
        metric = "chamfer_l1_mean" if method in REMOVERS else METRIC[task]
        table = variants(part, metric)
        table["complete"] = table["solved"] == table["planned"].max()
        table = table.sort_values(["complete", "geometric"], ascending=[False, True]).reset_index(drop=True)
        shown = table.index < args.best
        shown |= (table["variant"] == "(the defaults)").to_numpy()
        for place, line in table[shown].iterrows():
            figures = f"{1e3 * line['geometric']:.2f} | {1e3 * line['mean']:.2f}"
            print(
                f"| {method} | {task} | {metric} | {line['variant']} | {place + 1} of {len(table)} | {figures} | "
                f"{line['solved']}/{line['planned']} | {line['seconds']:.2f} |"
            )


if __name__ == "__main__":
    main()
