"""Write the table of what is known of other shapes that `detailbench recommend` shows beside its own ranking.

usage: python scripts/recommend_priors.py FILE RESULTS...

RESULTS are folders of the sweeps of docs/which-method.md (experiment=breadth and experiment=outliers). For each sensor
the table has the mean error of each method that reconstructs, over all shapes, and what is measured of the sensor's
clouds of train shapes: bench/recommend/priors.json is FILE.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bench.plan.choice import Choice
from bench.plugins.registry import load_plugins
from bench.recommend.scan import State, state_of
from bench.results.store import Results
from bench.sweep.composition import resolved

if TYPE_CHECKING:
    import pandas as pd

FAMILIES = ("bumps", "cad", "superquadrics", "tpms", "vases", "plates", "branches", "statues")
METRIC, OF_OUTLIERS = "score.surface_distance_mean", "score.chamfer_l1_mean"  # as in docs/which-method.md


def main() -> None:
    """Read the results, measure the clouds, write the table."""
    import pandas as pd

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("results", nargs="+")
    args = parser.parse_args()
    load_plugins([])
    rows = pd.concat([Results(folder).rows() for folder in args.results])
    rows = rows[rows["task"] == "reconstruct"]
    states = {sensor: measured(sensor) for sensor in sorted(rows["sensor"].unique())}
    args.file.write_text(json.dumps(table(rows, states), indent=1) + "\n")


def measured(sensor: str) -> State:
    """The mean state of a sensor's clouds, over the first train shape of each of :data:`FAMILIES`."""
    found = []
    for family in FAMILIES:
        values = resolved([f"dataset={family}", f"sensor={sensor}", "task=reconstruct"])
        kinds = {kind: Choice.of(kind, values[kind]).build() for kind in ("dataset", "sensor", "task")}
        recipe = next(kinds["task"].recipes(kinds["dataset"], kinds["sensor"], split="train", count=1, seed=0))
        found.append(state_of(recipe.build().input["cloud"])[0])
    return State(*np.mean(found, axis=0).tolist())


def table(rows: pd.DataFrame, states: Mapping[str, State]) -> list[dict[str, Any]]:
    """A line for each sensor: mean errors of the methods, in thousandths of the radius, least first."""
    lines = []
    for sensor, mine in rows.groupby("sensor"):
        metric = OF_OUTLIERS if "outliers" in sensor else METRIC
        errors = mine[mine["method"] != "identity"].groupby("method")[metric].mean().sort_values() * 1e3
        lines.append(
            {
                "sensor": sensor,
                "shapes": int(mine[["dataset", "case"]].drop_duplicates().shape[0]),
                "metric": metric.removeprefix("score."),
                "state": {name: round(value, 3) for name, value in states[sensor]._asdict().items()},
                "errors": {name: float(f"{value:.3g}") for name, value in errors.items()},
            }
        )
    return lines


if __name__ == "__main__":
    main()
