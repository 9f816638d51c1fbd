"""Two results beside each other: closed forms, an independent test, false alarms, and what is new, gone or failed."""

from __future__ import annotations

import io
import math

import numpy as np
import pandas as pd
import pytest
from boards import row, rows, table
from scipy.stats import ttest_1samp

from bench.errors import UsageError
from bench.ranking.compared import compared
from bench.ranking.report.compared import FORMATS, render_compared
from bench.ranking.statistics import beyond


def side(
    change=0.0,
    *,
    shapes=8,
    methods=("a", "b"),
    better="lower",
    factor=None,
    seed=0,
    seconds=1.0,
    cpu=None,
    scale=1.0,
    **options,
):
    """Rows whose scores are those of seed 0 times ``scale``, of method ``a`` by the share ``change`` larger."""
    rng = np.random.default_rng(seed)
    options |= {"seconds": seconds, "cpu_seconds": seconds if cpu is None else cpu}
    made = []
    for method in methods:
        for shape in range(shapes):
            score = scale * float(np.exp(np.random.default_rng([shape, len(method)]).normal()))
            score *= 1 + change if method == "a" else 1
            score *= 1 if factor is None else np.exp(rng.normal(scale=factor))
            made.append(row(method, f"s{shape}", 0, {"d": score}, worst={"d": 100.0}, better=better, **options))
    return rows(*made)


def enumerated(values):
    """The values of as many shapes, as ``table`` takes them."""
    return {(f"s{shape}", 0): value for shape, value in enumerate(values)}


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


@pytest.mark.parametrize(("change", "scale"), [(0.05, 1.0), (0.5, 1.0), (3.0, 1.0), (0.05, 1e-6)])
def test_a_change_of_all_scores_is_said_as_it_is(change, scale):
    found = compared(side(scale=scale), side(change, scale=scale))
    assert line(found)["change"] == pytest.approx(change)
    assert (line(found)["verdict"], line(found, "b")["verdict"]) == ("worse", "same")
    back = line(compared(side(change, scale=scale), side(scale=scale)))
    assert back["verdict"] == "better" and back["change"] == pytest.approx(1 / (1 + change) - 1)


def test_what_is_higher_the_better_is_worse_when_it_falls():
    found = compared(side(better="higher"), side(-0.1, better="higher"))
    assert line(found)["verdict"] == "worse"
    assert line(compared(side(better="higher"), side(0.1, better="higher")))["verdict"] == "better"


def test_the_threshold_decides():
    assert line(compared(side(), side(0.05), worse=0.1))["verdict"] == "same"
    assert line(compared(side(), side(0.05), worse=0.049))["verdict"] == "worse"
    assert line(compared(side(), side(1.0), worse=1.01))["verdict"] == "same"
    assert line(compared(side(), side(1.0), worse=0.99))["verdict"] == "worse"


def test_the_same_rows_are_the_same():
    found = compared(side(), side())
    assert set(found.quality["verdict"]) == {"same"} and (found.quality["change"] == 0).all()
    one = compared(side(shapes=1), side(shapes=1))  # nothing is significant of one shape, but that it is the same
    assert set(one.quality["verdict"]) == {"same"}
    open_ = line(compared(side(shapes=1), side(0.5, shapes=1)))
    assert open_["verdict"] == "open" and np.isnan([open_["low"], open_["high"]]).all()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("options", [{"scale": 0.0}, {"change": 1e-12}])
def test_perfect_scores_and_rounding_are_no_change(options):
    found = compared(side(**options | {"change": 0.0}), side(**options))
    assert (found.quality["change"] == 0).all() and set(found.quality["verdict"]) == {"same"}


def test_ups_and_downs_are_not_the_same():
    """The mean is 0 up to rounding, and the interval is wide."""
    now = [1.5, 1 / 1.5, 1.5, 1 / 1.5]
    found = line(compared(*(table({"a": enumerated(v)}) for v in ([1.0] * 4, now))))
    assert found["change"] == pytest.approx(0, abs=1e-9) and found["verdict"] == "open"


@pytest.mark.parametrize(
    ("shapes", "factors"),
    [
        (1, [1.0, 1.1, 1.3]),  # with one shape, seeds are the units of the interval
        (2, [1.0, 1.2, 1.1, 1.1]),
        (2, [1.0, 1.2, 1.1, 3.0]),  # which is wider than all that a ratio may be
        (3, [1.0, 1.1, 1.2, 1.2, 1.3, 1.1]),
    ],
)
def test_the_interval_is_students_over_shapes(shapes, factors):
    keys = [(f"s{i}", seed) for i in range(shapes) for seed in range(len(factors) // shapes)]
    now = dict(zip(keys, factors, strict=True))
    found = line(compared(table({"a": dict.fromkeys(keys, 1.0)}), table({"a": now})))
    relative = np.array([2 * (factor - 1) / (factor + 1) for factor in factors])
    clusters = relative if shapes == 1 else relative.reshape(shapes, -1).mean(axis=1)
    ends = ttest_1samp(clusters, 0).confidence_interval(0.95)
    wanted = [-1.0 if end <= -2 else math.inf if end >= 2 else (2 + end) / (2 - end) - 1 for end in ends]
    assert (found["shapes"], found["units"]) == (shapes, len(factors))
    assert [found["low"], found["high"]] == pytest.approx(wanted)


def test_the_means_are_over_what_both_solved():
    then, now = [1.0, 2.0, 3.0, 4.0, None, 6.0], [3.0, 2.0, None, 4.0, 5.0, math.nan]
    found = line(compared(*(table({"a": enumerated(values)}, worst={"d": 9.0}) for values in (then, now))))
    assert (found["then"], found["now"]) == (pytest.approx(7 / 3), 3.0)


def test_fewer_than_four_shapes_are_noted():
    few, four = ([side(methods=(m,), shapes=n) for m, n in pairs] for pairs in ([("a", 3), ("b", 4)], [("a", 4)]))
    few, four = (pd.concat(parts, ignore_index=True) for parts in (few, four))
    assert [note for note in compared(few, few).notes if "fewer than four shapes" in note][0].startswith("1 of 2 ")
    assert not any("fewer than four shapes" in note for note in compared(four, four).notes)


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


def test_metrics_are_those_that_both_have_or_that_are_named():
    def of(*methods, **extra):
        scores = {"a": {"d": 1.0}, "b": {"d": 1.0, "n": 2.0} | extra}
        return rows(*(row(method, f"s{i}", 0, scores[method]) for method in methods for i in range(4)))

    def lines(found):
        return found.quality[["metric", "method"]].to_numpy().tolist()

    then, now = of("b", "a"), of("b", "a", later=1.0)
    for metric in (None, "*"):
        assert lines(compared(then, now, metric=metric)) == [["d", "a"], ["d", "b"], ["n", "b"]]  # "a" has no n
    assert lines(compared(then, now, metric="n")) == [["n", "b"]]
    for metric in ("later", "m"):
        with pytest.raises(UsageError, match=f"no result has metric '{metric}'"):
            compared(then, now, metric=metric)


def test_lines_are_in_the_order_of_tasks_and_methods():
    both = pd.concat([side(task=task, methods=("b", "a")) for task in ("upsample", "denoise")], ignore_index=True)
    found = compared(both, both)
    for lines in (found.quality, found.speed):
        order = [["denoise", "a"], ["denoise", "b"], ["upsample", "a"], ["upsample", "b"]]
        assert lines[["task", "method"]].to_numpy().tolist() == order


# --- cases ------------------------------------------------------------------------------------------------------------


def test_failed_solved_new_and_gone():
    then = side(methods=("a", "b", "old"))
    now = pd.concat([side(methods=("new",), shapes=5), side(methods=("a", "b"))], ignore_index=True)
    now.loc[(now["method"] == "a") & (now["case"] == "s3"), ["status", "message"]] = "timeout", "stopped"
    then.loc[(then["method"] == "b") & (then["case"] == "s1"), "status"] = "error"
    found = compared(then, now)
    assert found.failed[["method", "case", "message_now"]].to_numpy().tolist() == [["a", "s3", "stopped"]]
    assert found.solved[["method", "case"]].to_numpy().tolist() == [["b", "s1"]]
    assert found.new[["method", "cases"]].to_numpy().tolist() == [["new", 5]]
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


@pytest.mark.parametrize("dated", [True, False])
def test_of_several_results_of_one_case_the_latest_counts(dated):
    """Two machines ran all cases, and the later result stands first: without dates, the last one counts."""
    late, early = (side(change, host=str(change), finished=f"2024-01-0{day}") for change, day in ((0.5, 2), (0.1, 1)))
    both = pd.concat([late, early], ignore_index=True)
    found = compared(side(), both if dated else both.drop(columns="finished"))
    assert found.pairs == 16 and line(found)["change"] == pytest.approx(0.5 if dated else 0.1)


def test_records_with_other_ingredients_are_named_once():
    then, now = side(), side()
    now.loc[now["method"] == "a", ["cell", "fingerprint"]] = "other", "g"
    assert compared(then, now).changed == (("c", "f", "other", "g"),)


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
    for references in ((0.0, 0.01), (0.01, 0.0)):  # a clock that did not tick
        then, now = (side(seconds=s, reference_seconds=r) for s, r in zip((2.0, 3.0), references, strict=True))
        found = line(compared(then, now), what="speed")
        assert found["ratio"] == pytest.approx(1.5) and not found["normalised"]


def test_a_faster_machine_does_not_hide_a_slower_method():
    then = side(seconds=2.0, reference_seconds=0.01)
    found = line(compared(then, side(seconds=1.5, reference_seconds=0.005)), what="speed")
    assert found["normalised"] and found["ratio"] == pytest.approx(1.5) and found["verdict"] == "slower"


def test_calls_without_a_time_are_left_out():
    then, now = side(seconds=2.0), side(seconds=3.0)
    then.loc[0, "seconds"] = now.loc[1, "seconds"] = 0.0
    found = line(compared(then, now), what="speed")
    assert found["units"] == 6
    assert [found[name] for name in ("ratio", "low", "high")] == pytest.approx([1.5] * 3)


def test_time_of_a_busy_machine_is_not_the_method_s():
    busy = side(seconds=9.0, cpu=2.0)
    assert line(compared(side(seconds=2.0), busy), what="speed")["ratio"] == pytest.approx(1)
    for options in ({"threads": 2}, {"device": "cuda"}):
        found = compared(side(seconds=2.0, **options), side(seconds=9.0, cpu=2.0, **options))
        assert line(found, what="speed")["ratio"] == pytest.approx(4.5)
    container = compared(side(seconds=2.0, cpu=0.01), side(seconds=9.0, cpu=0.01))
    assert (line(container, what="speed")["time"], line(container, what="speed")["verdict"]) == ("wall", "slower")
    # It is the share of the wall time that tells a container, however long the calls are.
    for seconds, cpu, time in ((20.0, 0.5, "wall"), (0.2, 0.1, "processor")):
        same = side(seconds=seconds, cpu=cpu)
        assert line(compared(same, same), what="speed")["time"] == time


@pytest.mark.parametrize(("most", "verdict"), [(1.1, "open"), (1.2, "open"), (1.3, "slower")])
def test_a_few_calls_that_had_to_wait_make_no_method_slower(most, verdict):
    """Ten of 21 took five times as long: the mean is significantly larger by a fifth, the median is not."""
    then, now = side(seconds=2.0, shapes=21, methods=("a",)), side(seconds=2.0, shapes=21, methods=("a",))
    for name in ("seconds", "cpu_seconds"):
        now[name] *= np.where(np.arange(21) < 11, most, 5.0)
    found = line(compared(then, now), what="speed")
    assert found["ratio"] == pytest.approx(most) and found["low"] > 1.2 and found["verdict"] == verdict


def test_short_calls_are_not_judged():
    assert line(compared(side(seconds=0.01), side(seconds=0.04)), what="speed")["verdict"] == "short"
    assert line(compared(side(seconds=0.01), side(seconds=0.05)), what="speed")["verdict"] == "slower"


# --- formats ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("format", FORMATS)
def test_formats_have_all_lines(format):
    text = render_compared(compared(side(), side(0.05)), format)
    assert "worse" in text and "seconds" in text
    if format == "csv":
        frame = pd.read_csv(io.StringIO(text))
        assert len(frame) == 4 and frame["change"].max() == pytest.approx(0.05)


def test_the_csv_has_the_speed_as_a_change():
    found = compared(side(seconds=2.0, reference_seconds=0.01), side(0.05, seconds=3.0, reference_seconds=0.01))
    back = pd.read_csv(io.StringIO(render_compared(found, "csv")))
    speed = back[back["metric"] == "seconds"]
    assert (speed[["then", "now"]] == [2.0, 3.0]).all(axis=None) and speed["normalised"].all()
    assert speed[["change", "low", "high"]].to_numpy() == pytest.approx(0.5)
    assert back.loc[back["metric"] == "d", "change"].tolist() == pytest.approx([0.05, 0.0])


def printed(found, **options):
    """The tables as printed: under each title the lines, by the columns, and the notes."""
    tables = {}
    for text in render_compared(found, "markdown", **options).split("### ")[1:]:
        title, head, _, *others = filter(None, text.splitlines())
        cells = [[cell.strip() for cell in text.strip("|").split("|")] for text in (head, *others) if text[0] == "|"]
        notes = [text.removeprefix("- ") for text in others if text.startswith("- ")]
        tables[title] = ([dict(zip(cells[0], line, strict=True)) for line in cells[1:]], notes)
    return tables


def test_a_line_has_its_numbers_in_their_columns():
    then, now = (table({"a": enumerated([k, 4 * k] * 2), "b": enumerated([2.0] * 4)}) for k in (1.0, 1.5))
    options = {"method": "a", "metric": "d", "shapes": "4", "verdict": "worse"}
    quality = {"then": "2.5", "now": "3.75", "change": "+50.0% [+50.0%, +50.0%]"}
    found = compared(then, now.assign(seconds=3.0, cpu_seconds=3.0))
    tables = printed(found)
    lines, notes = tables["quality: 8 pairs of cases"]
    assert lines == [quality | options] and notes[0] == "1 more line the same."
    same = {"method": "b", "then": "2", "now": "2", "change": "+0.0% [+0.0%, +0.0%]", "verdict": "same"}
    lines, notes = printed(found, full=True)["quality: 8 pairs of cases"]
    assert lines == [quality | options, options | same] and "the same." not in notes[0]
    assert "the same." not in printed(compared(then, then), full=True)["quality: 8 pairs of cases"][1][0]
    times = {"then (s)": "1", "now (s)": "3", "change": "+200.0% [+200.0%, +200.0%]", "time": "processor"}
    times |= {"normalised": "no", "pairs": "4", "verdict": "slower"}
    assert tables["speed"][0] == [{"method": name} | times for name in "ab"]
    told = (rows.assign(reference_seconds=0.01) for rows in (then, now))
    assert {line["normalised"] for line in printed(compared(*told))["speed"][0]} == {"yes"}


@pytest.mark.parametrize(
    ("then", "now", "wanted"),
    [
        ([1.0], [1.5], ("1", "1.5", "+50.0%")),  # one shape: no interval
        ([1.0] * 2, [10.9] * 2, ("1", "10.9", "+990.0% [+990.0%, +990.0%]")),
        ([1.0] * 2, [11.5] * 2, ("1", "11.5", "> 1000% [> 1000%, > 1000%]")),
        ([0.0] * 2, [1.0] * 2, ("0", "1", "> 1000% [> 1000%, > 1000%]")),
        ([1.0, None], [None, 1.0], ("-", "-", "+0.0% [-100.0%, > 1000%]")),  # no case that both solved
    ],
)
def test_what_is_unknown_or_too_large_is_printed_as_such(then, now, wanted):
    found = compared(*(table({"a": enumerated(values)}, worst={"d": 10.0}) for values in (then, now)))
    ((line,), notes) = next(iter(printed(found).values()))
    assert "the same." not in notes[0]
    assert (line["then"], line["now"], line["change"]) == wanted


@pytest.mark.parametrize(
    "changes",
    [
        {"": {}, "train": {"split": "train"}, "cuda, 2 threads": {"device": "cuda", "threads": 2}},
        {"denoise": {"task": "denoise"}, "upsample, 4 threads": {"task": "upsample", "threads": 4}},
    ],
)
def test_lines_say_how_they_were_run_if_not_as_usual(changes):
    parts = [side(methods=("a",), shapes=1, variant="k=1,n=2", **change) for change in changes.values()]
    both = pd.concat(parts, ignore_index=True)
    wanted = [f"a (k=1, n=2) · {words}" if words else "a (k=1, n=2)" for words in changes]
    for lines, _ in printed(compared(both, both), full=True).values():
        assert sorted(line["method"] for line in lines) == sorted(wanted)


def test_a_speed_that_nobody_knows_has_no_table():
    failed = side(shapes=2, methods=("a",)).assign(status="error")
    assert list(printed(compared(failed, side(shapes=2, methods=("a",))))) == [
        "quality: 2 pairs of cases",
        "solved now, failed then",
    ]


def test_a_long_list_is_cut_and_says_how_much_is_left():
    then = side(shapes=12, methods=("a",), variant="k=1").assign(sensor="", message="m" * 300)
    now = then.assign(status="timeout")
    now.loc[0, "message"] = None
    found = compared(then, now)
    lines, notes = printed(found)["failed now, solved then"]
    where = {"method": "a (k=1)", "case": "bumps s0", "sensor": "-", "seed": "0", "message": "timeout:"}
    assert len(lines) == 10 and lines[0] == where and notes == ["and 2 more: --full"]
    assert lines[1] == where | {"case": "bumps s1", "message": "timeout: " + "m" * 191}
    lines, notes = printed(found, full=True)["failed now, solved then"]
    assert len(lines) == 12 and not notes
    other = side(shapes=1, methods=("b",))
    found = printed(compared(pd.concat([then, other]), pd.concat([other, side(shapes=3, methods=("c",))])))
    where = {"task": "reconstruct", "dataset": "bumps"}
    assert found["gone: missing now"][0] == [where | {"method": "a (k=1)", "sensor": "-", "cases": "12"}]
    assert found["new: missing then"][0] == [where | {"method": "c", "sensor": "samples", "cases": "3"}]
