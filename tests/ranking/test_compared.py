"""Two results beside each other: closed forms, an independent test, false alarms, and what is new, gone or failed."""

from __future__ import annotations

import io

import numpy as np
import pandas as pd
import pytest
from boards import row, rows
from scipy.stats import ttest_1samp

from bench.errors import UsageError
from bench.ranking.compared import compared
from bench.ranking.report.compared import FORMATS, render_compared
from bench.ranking.statistics import beyond


def side(
    change=0.0, *, shapes=8, methods=("a", "b"), better="lower", factor=None, seed=0, seconds=1.0, cpu=None, **options
):
    """Rows whose scores are those of seed 0, of method ``a`` by the share ``change`` larger."""
    rng = np.random.default_rng(seed)
    options |= {"seconds": seconds, "cpu_seconds": seconds if cpu is None else cpu}
    made = []
    for method in methods:
        for shape in range(shapes):
            score = float(np.exp(np.random.default_rng([shape, len(method)]).normal()))
            score *= 1 + change if method == "a" else 1
            score *= 1 if factor is None else np.exp(rng.normal(scale=factor))
            made.append(row(method, f"s{shape}", 0, {"d": score}, worst={"d": 100.0}, better=better, **options))
    return rows(*made)


def line(found, method="a", what="quality"):
    (one,) = (one for one in getattr(found, what).to_dict("records") if one["method"] == method)
    return one


# --- statistics -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bound", [0.0, 0.02, -0.3])
def test_beyond_is_scipys_test_for_equal_clusters(bound):
    values = np.random.default_rng(1).normal(0.1, 0.2, (9, 5))
    _, low, high, p = beyond(values, np.ones_like(values), bound)
    expected = ttest_1samp(values, bound, alternative="greater")
    np.testing.assert_allclose(p, expected.pvalue)
    interval = ttest_1samp(values, bound).confidence_interval(0.95)
    np.testing.assert_allclose((low, high), (interval.low, interval.high))


def test_the_familywise_rate_of_false_alarms():
    """Forty true null hypotheses at the boundary in each of 300 comparisons: an alarm in 5 % of them at most."""
    alarms = 0
    for seed in range(300):
        rng = np.random.default_rng(seed)
        values = rng.normal(0.02, 0.05, (8, 40))
        p = beyond(values, np.ones_like(values), 0.02)[3]
        alarms += bool((p <= 0.05 / 40).any())
    assert alarms <= 300 * 0.05 + 3 * (300 * 0.05 * 0.95) ** 0.5


# --- quality ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("change", [0.05, 0.5, 3.0])
def test_a_change_of_all_scores_is_said_as_it_is(change):
    found = compared(side(), side(change))
    assert line(found)["change"] == pytest.approx(change)
    assert (line(found)["verdict"], line(found, "b")["verdict"]) == ("worse", "same")
    back = line(compared(side(change), side()))
    assert back["verdict"] == "better" and back["change"] == pytest.approx(1 / (1 + change) - 1)


def test_what_is_higher_the_better_is_worse_when_it_falls():
    found = compared(side(better="higher"), side(-0.1, better="higher"))
    assert line(found)["verdict"] == "worse"
    assert line(compared(side(better="higher"), side(0.1, better="higher")))["verdict"] == "better"


def test_the_threshold_decides():
    assert line(compared(side(), side(0.05), worse=0.1))["verdict"] == "same"
    assert line(compared(side(), side(0.05), worse=0.049))["verdict"] == "worse"


def test_the_same_rows_are_the_same():
    found = compared(side(), side())
    assert set(found.quality["verdict"]) == {"same"} and (found.quality["change"] == 0).all()
    one = compared(side(shapes=1), side(shapes=1))  # nothing is significant of one shape, but that it is the same
    assert set(one.quality["verdict"]) == {"same"}
    assert line(compared(side(shapes=1), side(0.5, shapes=1)))["verdict"] == "open"


def test_noise_of_a_method_that_is_not_repeatable_raises_no_alarm():
    alarms = 0
    for seed in range(8):
        found = compared(side(factor=0.1, seed=2 * seed), side(factor=0.1, seed=2 * seed + 1))
        alarms += (found.quality["verdict"] == "worse").any()
    assert alarms <= 1  # while half of them have a mean that is worse by the threshold


def test_identical_lines_do_not_dilute_the_others():
    many = tuple(f"m{i}" for i in range(60))
    then, now = (side(change, methods=("a", *many), factor=None) for change in (0.0, 0.04))
    rng = np.random.default_rng(0)
    now.loc[now["method"] == "a", "score.d"] *= np.exp(rng.normal(scale=0.008, size=8))
    assert line(compared(then, now))["verdict"] == "worse"


# --- cases ------------------------------------------------------------------------------------------------------------


def test_failed_solved_new_and_gone():
    then, now = side(methods=("a", "b", "old")), side(methods=("a", "b", "new"))
    now.loc[(now["method"] == "a") & (now["case"] == "s3"), ["status", "message"]] = "timeout", "stopped"
    then.loc[(then["method"] == "b") & (then["case"] == "s1"), "status"] = "error"
    found = compared(then, now)
    assert found.failed[["method", "case", "message_now"]].to_numpy().tolist() == [["a", "s3", "stopped"]]
    assert found.solved[["method", "case"]].to_numpy().tolist() == [["b", "s1"]]
    assert found.new[["method", "cases"]].to_numpy().tolist() == [["new", 8]]
    assert found.gone[["method", "cases"]].to_numpy().tolist() == [["old", 8]]
    assert line(found)["change"] > 0.1  # a failure counts as the worst output
    text = render_compared(found)
    assert all(
        word in text for word in ("failed now, solved then", "timeout: stopped", "new: missing then", "gone: missing")
    )


def test_results_without_a_common_case_are_refused():
    with pytest.raises(UsageError, match="no case in common"):
        compared(side(methods=("a",)), side(methods=("b",)))
    with pytest.raises(UsageError, match="no result has method"):
        compared(side(), side(), method="c")


def test_other_machines_and_more_seeds_pair_all_the_same():
    found = compared(side(), side(host="other"))
    assert found.pairs == 16 and not len(found.new)


# --- speed ------------------------------------------------------------------------------------------------------------


def test_the_speed_of_the_machine_is_taken_out():
    then = side(seconds=2.0, reference_seconds=0.01)
    found = compared(then, side(seconds=3.0, reference_seconds=0.015))
    assert line(found, what="speed")["ratio"] == pytest.approx(1) and line(found, what="speed")["normalised"]
    slower = compared(then, side(seconds=4.5, reference_seconds=0.015))
    assert line(slower, what="speed")["ratio"] == pytest.approx(1.5)
    assert line(slower, what="speed")["verdict"] == "slower"
    assert line(compared(then, side(seconds=1.0, reference_seconds=0.01)), what="speed")["verdict"] == "faster"


def test_rows_without_a_reference_are_compared_as_they_are_and_it_is_reported():
    found = compared(side(seconds=2.0), side(seconds=3.0, reference_seconds=0.015))
    assert line(found, what="speed")["ratio"] == pytest.approx(1.5) and not line(found, what="speed")["normalised"]
    assert "Not normalised" in render_compared(found)


def test_time_of_a_busy_machine_is_not_the_method_s():
    busy = side(seconds=9.0, cpu=2.0)
    assert line(compared(side(seconds=2.0), busy), what="speed")["ratio"] == pytest.approx(1)
    for options in ({"threads": 2}, {"device": "cuda"}):
        found = compared(side(seconds=2.0, **options), side(seconds=9.0, cpu=2.0, **options))
        assert line(found, what="speed")["ratio"] == pytest.approx(4.5)
    container = compared(side(seconds=2.0, cpu=0.01), side(seconds=9.0, cpu=0.01))
    assert (line(container, what="speed")["time"], line(container, what="speed")["verdict"]) == ("wall", "slower")


@pytest.mark.parametrize(("most", "verdict"), [(1.1, "open"), (1.3, "slower")])
def test_a_few_calls_that_had_to_wait_make_no_method_slower(most, verdict):
    """Ten of 21 took five times as long: the mean is significantly larger by a fifth, the median is not."""
    then, now = side(seconds=2.0, shapes=21, methods=("a",)), side(seconds=2.0, shapes=21, methods=("a",))
    for name in ("seconds", "cpu_seconds"):
        now[name] *= np.where(np.arange(21) < 11, most, 5.0)
    found = line(compared(then, now), what="speed")
    assert found["ratio"] == pytest.approx(most) and found["low"] > 1.2 and found["verdict"] == verdict


def test_short_calls_are_not_judged():
    assert line(compared(side(seconds=0.01), side(seconds=0.04)), what="speed")["verdict"] == "short"


# --- formats ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("format", FORMATS)
def test_formats_have_all_lines(format):
    text = render_compared(compared(side(), side(0.05)), format)
    assert "worse" in text and "seconds" in text
    if format == "csv":
        frame = pd.read_csv(io.StringIO(text))
        assert len(frame) == 4 and frame["change"].max() == pytest.approx(0.05)
