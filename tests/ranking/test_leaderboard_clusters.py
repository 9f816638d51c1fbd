"""A shape is one cluster, however many sensors, seeds and devices it was met with: simulated, and by hand."""

import json

import numpy as np
import pandas as pd
import pytest
from boards import ranks, row, rows

from bench.ranking.leaderboard import leaderboard
from bench.ranking.overview import overview
from bench.ranking.selection import pool

METHODS = 8
SIGMAS = (0.5, 0.3, 0.1)  # of the logarithms: what a shape adds for all methods, and for each one, and chance
TRUTH = np.exp(sum(s**2 for s in SIGMAS) / 2)


def simulated(rng, shapes, sensors, seeds, tables):
    """Rows of equally good methods with log-normal scores; every table is a metric of its own."""
    shape = rng.normal(size=(shapes, 1, 1, 1, tables))
    own = rng.normal(size=(shapes, 1, 1, METHODS, tables))
    chance = rng.normal(size=(shapes, sensors, seeds, METHODS, tables))
    scores = np.exp(SIGMAS[0] * shape + SIGMAS[1] * own + SIGMAS[2] * chance).reshape(-1, tables)
    places = np.indices((shapes, sensors, seeds, METHODS)).reshape(4, -1)
    names = [f"t{i:04d}" for i in range(tables)]
    frame = pd.DataFrame(scores, columns=[f"score.{name}" for name in names])
    frame["case"], frame["sensor"] = [
        [f"{word}{i:02d}" for i in p] for word, p in zip(("c", "s"), places, strict=False)
    ]
    frame["seed"], frame["method"] = places[2], [f"m{i}" for i in places[3]]
    same = {k: v for k, v in row().items() if k not in frame and k != "parameters"}
    directions = json.dumps(dict.fromkeys(names, "lower"))
    return frame.assign(**same, parameters=None).assign(status="ok", message="", directions=directions)


def share_of_right(board):
    """How many intervals hold the true mean, and how many rank intervals are not wide enough for equal methods."""
    covered = (board["ci_low"] <= TRUTH) & (board["ci_high"] >= TRUTH)
    wrong = (board["rank_low"] > 1) | (board["rank_high"] < METHODS)
    return covered.mean(), wrong.mean()


@pytest.mark.parametrize(("shapes", "sensors", "seeds"), [(8, 1, 1), (8, 3, 2), (17, 1, 1), (17, 3, 1)])
def test_pooled_intervals_hold_as_often_as_promised(shapes, sensors, seeds):
    # The methods of a table share its shapes: 800 tables tell 93 % to 0.7 points, and 5 % to 0.5.
    board = leaderboard(simulated(np.random.default_rng(shapes), shapes, sensors, seeds, tables=800), by="task")
    assert len(board) == 800 * METHODS
    covered, wrong = share_of_right(board)
    assert covered >= 0.92
    assert wrong <= 0.06


def clear(sensors="abc", seeds=(0, 1), shapes="pqrs", dataset="bumps"):
    """Two methods whose difference is the same on all shapes but for their luck there."""
    luck = dict(zip("pqrs", (1.0, 1.4, 0.8, 1.2), strict=True))
    return [
        row(method, case, seed, {"d": value * luck[case] ** power}, sensor=sensor, dataset=dataset)
        for method, value, power in (("best", 1.0, 1), ("other", 1.1, 2))
        for case in shapes
        for sensor in sensors
        for seed in seeds
    ]


@pytest.mark.parametrize("by", ["task", "dataset", "tag", "dataset,tag"])
def test_what_is_repeated_on_the_same_shapes_makes_nothing_surer(by):
    """Rows of other sensors and seeds that say the same leave the intervals as they are."""
    columns = ["method", "mean", "ci_low", "ci_high", "rank_low", "rank_high"]
    once = leaderboard(rows(*clear(sensors="a", seeds=(0,))), by=by)
    often = leaderboard(rows(*clear()), by=by)
    pd.testing.assert_frame_equal(once[columns], often[columns])
    assert (often["planned"] == 6 * once["planned"]).all()


def test_pooled_by_hand():
    """The interval of the mean over units is that of the shapes' means."""
    rng = np.random.default_rng(3)
    records = clear()
    for record in records:
        record["score.d"] *= np.exp(0.1 * rng.normal())
    frame = rows(*records)
    board = leaderboard(frame, by="task")
    means = frame.groupby(["method", "case"])["score.d"].mean().reset_index(name="score.d")
    alone = leaderboard(rows(*(row(m, c, 0, {"d": v}) for m, c, v in means.itertuples(index=False))))
    for column in ("mean", "ci_low", "ci_high"):
        assert board[column].to_numpy() == pytest.approx(alone[column].to_numpy())


def test_one_shape_under_three_sensors_says_nothing_of_others():
    board = leaderboard(rows(*clear(shapes="p", seeds=(0,))), by="task")
    assert board[["ci_low", "ci_high"]].isna().all().all()
    assert ranks(board) == {"best": (1, 2), "other": (1, 2)}


def test_equal_ids_of_two_datasets_are_two_shapes():
    """Also of one dataset with other parameters."""
    both = clear(shapes="p", seeds=(0,)) + clear(shapes="p", seeds=(0,), dataset="bumps[degree=20]")
    assert leaderboard(rows(*both), by="task")["ci_low"].notna().all()
    assert leaderboard(rows(*both), by="dataset")["ci_low"].isna().all()


def test_the_first_column_of_a_view_across_groups_counts_shapes():
    """So do its groups: several sensors of one shape in a challenge tag are one cluster."""
    once, often = overview(rows(*clear(sensors="a", seeds=(0,))), "tag"), overview(rows(*clear()), "tag")
    columns = ["method", "metric", "mean", "ci_low", "ci_high", "rank_low", "rank_high"]
    pd.testing.assert_frame_equal(once[columns], often[columns])


def test_measured_tags_make_groups_and_kinds_where_enough_shapes_are_of_one():
    of = ["sharp,gear"] * 4 + ["sharp,chair"] * 2
    frame = pd.DataFrame([row("a", f"c{k}", 0, {"m": 1.0}, tags=tags) for k, tags in enumerate(of)])
    assert dict(pool(frame, "tag").groupby("dataset").size()) == {"gear": 4, "sharp": 6}
    frame["tags"] = ["chair"] * 3 + ["gear"] * 3
    assert dict(pool(frame, "tag").groupby("dataset").size()) == {"untagged": 6}
