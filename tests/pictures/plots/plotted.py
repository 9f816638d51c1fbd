"""Scores of three methods for the tests of plots."""

import json

import numpy as np
import pandas as pd
from records import row

from bench.pictures.plots.scores import scores_of

METHODS = ("apss", "jet", "rimls")
DIRECTIONS = json.dumps({"p2f_mean": "lower", "fscore@0.01": "higher", "genus": "reference"})


def made_rows(cases=6, sensors=("noisy", "clean"), failing=(), seed=0):
    """Rows of three methods; ``failing`` are (method, case) that raised."""
    rng = np.random.default_rng(seed)
    rows = []
    for number, method in enumerate(METHODS):
        for sensor in sensors:
            for case in range(cases):
                error = (1 + number) * rng.lognormal(0, 0.8) * 1e-3
                line = row(case, method=method, sensor=sensor, seconds=1.0 + number, peak_rss_mb=300.0 - 100 * number)
                line |= {"cell": f"{number:012x}", "directions": DIRECTIONS, "host": "h"}
                line |= {"score.p2f_mean": error, "score.fscore@0.01": 1 / (1 + 1e3 * error), "score.genus": number}
                line |= {"floor.genus": 0.0, "worst.p2f_mean": 0.5}
                if (method, case) in failing:
                    line |= {"status": "error", "message": "no"}
                    line |= {name: None for name in line if name.startswith("score.")}
                rows.append(line)
    return pd.DataFrame(rows)


def scores(rows=None, metric="p2f_mean", **options):
    return scores_of(made_rows() if rows is None else rows, [], metric=metric, **options)
