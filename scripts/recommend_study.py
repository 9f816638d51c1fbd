"""How well `detailbench recommend` agrees with the truth, on shapes whose surface is known.

usage: python scripts/recommend_study.py FOLDER [--which train|test|real|all] [--points 3000] [--methods A,B,...]

Each case is a shape of a dataset seen by a sensor. It is subsampled to --points, and recommended for without a look at
the truth; then the mesh that each method made of the whole subsample is scored by chamfer_l1_mean against the true
surface. What was found is stored in FOLDER, a file for each case, and is not computed again. The table that is printed
has Spearman's rank correlation of the two rankings, the true rank of the method in first place, and how often a method
that was called significantly better was truly worse. A case takes about half a minute of one core.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import rankdata, spearmanr

from bench.plan.choice import Choice
from bench.plan.limits import Limits
from bench.plugins.registry import load_plugins
from bench.recommend.candidates import candidates
from bench.recommend.recommendation import as_json, recommend
from bench.recommend.scan import scan_of
from bench.recommend.trials import Setup
from bench.sweep.composition import resolved

# Quick ones of every kind: smooth and interpolating, too coarse (depth 5), and beside the points (alpha_wrap_plain).
METHODS = (
    "poisson[depth=5],poisson[depth=6],poisson,apss[resolution=100],rimls[resolution=80],ball_pivoting,alpha_shape,"
    "alpha_wrap,alpha_wrap_plain,advancing_front,chain[steps=[statistical_outlier,advancing_front]]"
)
CASES = {
    "train": (
        "bumps:noisy cad:noisy cad:scanned:1 knots:no_normals vases:with_holes superquadrics:clean "
        "branches:density_gradient tpms:outliers fractals:outliers humanoids:mvs_cloud bumps:with_holes "
        "furniture:with_holes tpms:with_holes furniture:scanned knots:mvs_cloud statues:mvs_cloud"
    ),
    "test": (
        "bumps:scanned cad:noisy supershapes:outliers fbm:no_normals blobs:with_holes tpms:clean knots:noisy "
        "smooth_csg:density_gradient plates:scanned branches:noisy humanoids:outliers statues:no_normals"
    ),
    "real": (
        "real:noisy:0 real:scanned:3 real:no_normals:9 real:clean:12 real:with_holes:15 real:density_gradient:18 "
        "real:outliers:6 real:mvs_cloud:27 real:noisy:21 real:scanned:24"
    ),
}
SAMPLES = 30_000  # of the true surface
WORST = 2 / 3  # of the ranks: the worst third begins after it
CLEARLY = 1.05  # times the error: truly worse by so much is more than chance


def main() -> int:
    """Run what is not stored, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--which", choices=[*CASES, "all"], default="all")
    parser.add_argument("--points", type=int, default=3000)
    parser.add_argument("--methods", default=METHODS, help="as of detailbench recommend")
    args = parser.parse_args()
    load_plugins([])
    args.folder.mkdir(parents=True, exist_ok=True)
    for which in CASES if args.which == "all" else [args.which]:
        rows = [_stored(args, which, word) for word in CASES[which].split()]
        _show(which, rows)
    return 0


def _stored(args: argparse.Namespace, which: str, word: str) -> dict[str, Any]:
    file = args.folder / f"{which}-{word.replace(':', '-')}.json"
    if not file.exists():
        print(f"{which} {word}", file=sys.stderr, flush=True)
        file.write_text(json.dumps(study(which, word, args.points, args.methods), indent=1))
    return json.loads(file.read_text())


def study(which: str, word: str, points: int, methods: str) -> dict[str, Any]:
    """One case: what is recommended, and the truth."""
    dataset, sensor, *index = word.split(":")
    case = _case(dataset, sensor, "train" if which == "train" else "test", int(index[0]) if index else 0)
    scan = scan_of(case.id, case.input["cloud"], case.frame, points, 0)
    found = recommend([scan], candidates(methods, "reconstruct"), Setup(limit=Limits(seconds=120.0)))
    metric = Choice.of("metric", {"_name_": "chamfer_l1_mean"}).build()
    truth = {
        candidate.label: metric.score(trial.meshes[0], case)["chamfer_l1_mean"]
        for candidate, trial in zip(found.candidates, found.trials[0], strict=True)
        if trial.meshes is not None
    }
    return as_json(found) | {"case": word, "sensor": sensor, "truth": truth}


def _case(dataset: str, sensor: str, split: str, index: int) -> Any:
    from bench.geometry.comparison import set_samples

    values = resolved([f"dataset={dataset}", f"sensor={sensor}", "task=reconstruct"])
    kinds = {kind: Choice.of(kind, values[kind]).build() for kind in ("dataset", "sensor", "task")}
    recipes = kinds["task"].recipes(kinds["dataset"], kinds["sensor"], split=split, count=index + 1, seed=0)
    case = list(recipes)[index].build()
    set_samples(case, SAMPLES)
    return case


def verdicts(row: dict[str, Any]) -> dict[str, float]:
    """What the truth says of one recommendation."""
    ranking, truth = row["ranking"], row["truth"]
    errors = np.array([truth[entry["method"]] for entry in ranking])
    ranks = rankdata(errors)
    low, high = np.array([entry["rank"] for entry in ranking]).T
    significantly = high[:, None] < low
    return {
        "rho": float(spearmanr([entry["score"] for entry in ranking], errors)[0]),
        "first": float(ranks[0]),
        "of": len(ranking),
        "excess": float(errors[0] / errors.min()),
        "tied": int((low == 1).sum()),
        "sure": int(significantly.sum()),
        "wrong": int((significantly & (errors[:, None] > errors)).sum()),
        "clearly": int((significantly & (errors[:, None] > CLEARLY * errors)).sum()),
    }


def _show(which: str, rows: list[dict[str, Any]]) -> None:
    columns = ("case", "rank correlation", "first", "true rank of it", "its error / least", "tied")
    print(f"\n{which}\n\n| {' | '.join(columns)} | significantly better |")
    print("| --- | --: | --- | --: | --: | --: | --: |")
    found = [verdicts(row) for row in rows]
    for row, v in zip(rows, found, strict=True):
        sure = f"{v['sure']} pairs, {v['wrong']} wrong"
        name = row["ranking"][0]["method"]
        rank = f"{v['first']:g} of {v['of']}"
        print(f"| {row['case']} | {v['rho']:.2f} | {name} | {rank} | {v['excess']:.2f} | {v['tied']} | {sure} |")
    mean = np.mean([v["rho"] for v in found])
    worst = sum(v["first"] > WORST * v["of"] for v in found)
    sure, wrong, clearly = (sum(v[key] for v in found) for key in ("sure", "wrong", "clearly"))
    print(
        f"\nmean rank correlation {mean:.2f}; {worst} of {len(rows)} have a method of the worst third in first place;"
    )
    print(
        f"of {sure} pairs that are called significantly ordered, {wrong} are wrong, {clearly} of them by more than 5 %."
    )
    sensors = sorted({row["sensor"] for row in rows})
    means = {s: np.mean([v["rho"] for row, v in zip(rows, found, strict=True) if row["sensor"] == s]) for s in sensors}
    print("by sensor: " + ", ".join(f"{sensor} {value:.2f}" for sensor, value in means.items()))


if __name__ == "__main__":
    sys.exit(main())
