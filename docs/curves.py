"""Scores against the severity of sensors, as curves: a line for each method, its interval over shapes in colour.

    detailbench run experiment=figure_3_11 results=results/figure_3_11
    python docs/curves.py results/figure_3_11 docs/figure_3_11.png --score even_chamfer_l2_sum

Sensors whose inputs have as many points as most form the curve over noise (as measured), all clean ones that over the
number of points.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from bench.ranking.report.labels import label
from bench.results.store import Results

CLEAN = 1e-4  # RMS error below which an input has no noise


def curves(rows: pd.DataFrame, by: str, score: str) -> dict[str, pd.DataFrame]:
    """For each method the mean of a score and half its 95 % interval over shapes, by a column."""
    found = {}
    for name, part in rows.groupby("line"):
        grouped = part.groupby(by)[f"score.{score}"]
        half = 1.96 * grouped.std() / np.sqrt(grouped.count())
        found[name] = pd.DataFrame({"mean": grouped.mean(), "half": half})
    return found


def draw(axes: plt.Axes, found: dict[str, pd.DataFrame], title: str) -> None:
    """One diagram."""
    for name, line in found.items():
        axes.plot(line.index, line["mean"], marker="o", label=name)
        axes.fill_between(line.index, line["mean"] - line["half"], line["mean"] + line["half"], alpha=0.2)
    axes.set_xlabel(title)
    axes.locator_params(axis="x", nbins=5)


def main() -> None:
    """Read the results, draw both diagrams, print the numbers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results")
    parser.add_argument("picture", type=Path)
    parser.add_argument("--score", default="even_chamfer_l2_sum")
    args = parser.parse_args()
    rows = Results(args.results).rows()
    rows = rows[rows["status"] == "ok"]
    # A line for each method with its parameters: with which sensor it was trained is not among them.
    own = ("," + rows["variant"]).str.split(",weights=").str[0].str[1:]
    rows = rows.assign(line=[label(m, v) for m, v in zip(rows["method"], own, strict=True)])
    usual = rows["input.points"].mode()[0]
    level = rows.groupby("sensor")["input.rms"].transform("median").round(4)
    rows = rows.assign(noise=level)
    over_noise = curves(rows[rows["input.points"] == usual], "noise", args.score)
    over_points = curves(rows[rows["noise"] < CLEAN], "input.points", args.score)
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), sharey=True)
    draw(left, over_noise, "noise of the input, RMS, in radii")
    draw(right, over_points, "points of the input")
    right.invert_xaxis()
    left.set_ylabel(args.score)
    left.set_ylim(bottom=0)  # both have one axis, as far as the higher of the two
    left.legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(args.picture, dpi=120)
    for title, found in (("noise", over_noise), ("points", over_points)):
        table = pd.DataFrame({name: 1000 * line["mean"] for name, line in found.items()})
        print(f"{args.score} (1e-3) by {title}\n{table.round(3).to_string()}")


if __name__ == "__main__":
    main()
