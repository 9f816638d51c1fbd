"""The notes of tables on learned methods: how long each was trained, on what, and which weights it has."""

import math

import pytest
from boards import row, rows

from bench.ranking.leaderboard import leaderboard
from bench.ranking.report.table import LEARNED
from bench.ranking.report.tables import tables
from bench.ranking.report.trained import sentence, trained

TRAINING = {
    "method": "mpu",
    "weights": "3f2ab1c0ffee",
    "weights_from": "trained",
    "train_seconds": 1260.0,
    "train_device": "cuda",
    "train_data": "fbm, noisy",
    "train_cases": 1040,
    "train_steps": 20_000,
}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({}, "trained for 21 min (20,000 steps) on cuda on 1,040 train shapes of fbm, noisy; weights 3f2ab1."),
        ({"train_steps": None}, "trained for 21 min on cuda on 1,040 train shapes of fbm, noisy; weights 3f2ab1."),
        ({"train_steps": 0, "train_cases": math.nan, "train_data": ""}, "trained for 21 min on cuda; weights 3f2ab1."),
        (
            {"train_steps": 9, "train_cases": None},
            "trained for 21 min (9 steps) on cuda of fbm, noisy; weights 3f2ab1.",
        ),
        (
            {"weights_from": "shipped", "train_device": "", "train_data": None, "train_steps": None},
            "with weights that come with it, trained for 21 min on an unknown device on 1,040 train shapes; "
            "weights 3f2ab1.",
        ),
        ({"train_seconds": None}, "its training is not known."),
        ({"train_seconds": math.nan, "weights_from": "file"}, "with weights of a file, its training is not known."),
    ],
)
def test_what_is_said_of_one_training(changes, said):
    assert sentence([TRAINING | changes]) == sentence([TRAINING | changes] * 3) == f"mpu: {said}"


@pytest.mark.parametrize(
    ("seconds", "time"),
    [
        ((1260.0, 120.0, 7200.0), "2 min to 2 h"),
        ((1260.0, 1261.0, 1262.0), "21 min"),  # the same in words
        ((1260.0, None, 120.0), "2 min to 21 min"),
        ((1260.0, 120.0), "2 min to 21 min"),
    ],
)
def test_of_several_trainings_the_range_is_given(seconds, time):
    n = len(seconds)
    names = ("bbbbbbbb", "aaaaaaaa", "cccccccc")[:n]
    made = [TRAINING | {"weights": w, "train_seconds": s} for w, s in zip(names, seconds, strict=True)]
    assert sentence(made) == (
        f"mpu: {n} trainings, each for {time} (20,000 steps) on cuda on 1,040 train shapes of fbm, noisy; "
        f"weights {', '.join(('aaaaaa', 'bbbbbb', 'cccccc')[:n])}."
    )


def learned(case, scores, **changes):
    return row(case=case, scores=scores, **TRAINING | changes)


def test_learned_methods_are_marked_and_the_others_not():
    others = [row("poisson", case, 0, {"d": 2.0}, weights="") for case in "ab"]
    made = rows(*(learned(case, {"d": 1.0}) for case in "ab"), *others)
    assert [(key[4], text) for key, text in trained(made).items()] == [("mpu", sentence([TRAINING]))]
    (table,) = tables(leaderboard(made), made)
    assert set(table.methods) == {f"mpu {LEARNED}", "poisson"}
    assert [note for note in table.notes if note.startswith(LEARNED)] == [f"{LEARNED} {sentence([TRAINING])}"]


def test_rows_without_weights_have_no_note():
    made = rows(row("poisson", "a", 0, {"d": 1.0}))
    assert (
        trained(None) == trained(made) == trained(made.assign(weights=None)) == trained(made.assign(weights="")) == {}
    )


def test_a_method_that_failed_on_another_machine_before_it_had_weights_is_marked_too():
    made = rows(
        learned("a", {"d": 1.0}, host="h1"), row("mpu", "b", 0, None, host="h2"), row("poisson", "a", 0, {"d": 2.0})
    )
    (table,) = tables(leaderboard(made), made)
    assert f"mpu {LEARNED}" in table.methods and f"{LEARNED} {sentence([TRAINING])}" in table.notes
