"""Two orders of the methods side by side: known orders, an independent tau, coverage, and who is to blame."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from boards import row, rows
from scipy.stats import kendalltau, ttest_1samp

from bench.cli import main
from bench.errors import UsageError
from bench.ranking.agreement import RANK, Agreement, Scores, Tau, agreement, compare, family_of, places, tau_b
from bench.ranking.report import FORMATS
from bench.ranking.report.agreement import render_agreement
from bench.ranking.selection import CONTENDER

METHODS = "abcde"


def results(orders: dict[str, str], shapes: int = 8, sensors=("clean", "noisy"), seed: int = 0, **options):
    """Rows in which each dataset orders the methods as a word has them, best first, significantly."""
    rng = np.random.default_rng(seed)
    return rows(
        *(
            row(method, f"{dataset}-{case}", 0, {"d": size * 2.0**place}, dataset=dataset, sensor=sensor, **options)
            for dataset, order in orders.items()
            for case in range(shapes)
            for sensor in sensors
            for size in (float(np.exp(rng.normal())),)
            for place, method in enumerate(order)
        )
    )


def one(frame: pd.DataFrame, other: str = "real", **options):
    (found,) = agreement(frame, other, **options)
    return found


def whole(found):
    return next(tau for tau in found.taus if tau.part == "all")


# --- tau --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("k", "values"), [(4, 3), (7, 4), (9, 50)])
def test_tau_b_is_scipys_also_with_ties(k, values):
    rng = np.random.default_rng(k)
    a, b = rng.integers(1, values, (2, 200, k)).astype(float)
    expected = [kendalltau(x, y, variant="b").statistic for x, y in zip(a, b, strict=True)]
    assert tau_b(a, b) == pytest.approx(expected, nan_ok=True)


def test_tau_by_hand():
    a = np.array([1.0, 2, 3, 4])
    assert tau_b(a, a) == 1 and tau_b(a, a[::-1]) == -1
    assert tau_b(a, np.array([1.0, 2, 4, 3])) == pytest.approx(4 / 6)
    assert tau_b(a, np.array([1.0, 1, 2, 3])) == pytest.approx(5 / np.sqrt(6 * 5))
    assert tau_b(a, a * (1 + 1e-12 * np.array([9, -9, 9, -9]))) == 1  # rounding
    for size in (1e-6, 1.0, -1e6):  # a difference in rounding is a tie, one of a tenth is none however small
        b = size * np.array([1.0, 1 + 1e-12, 1.1, 1.3])
        assert np.sign(size) * tau_b(a, b) == pytest.approx(5 / np.sqrt(6 * 5))
    assert tau_b(a, np.array([0.0, 0, 1, 2])) == pytest.approx(5 / np.sqrt(6 * 5))


def test_places_share_a_tie():
    assert places(np.array([3.0, 1.0, 2.0, 1.0 + 1e-13, 9.0])).tolist() == [4, 1, 3, 1, 5]
    assert places(np.full(3, 0.0)).tolist() == [1, 1, 1]
    assert places(1e-6 * np.array([1.1, 1.0, 1.0 + 1e-13])).tolist() == [3, 1, 1]
    assert places(1e6 * np.array([1.1, 1.0, 1.0 + 1e-13])).tolist() == [3, 1, 1]


@pytest.mark.parametrize(
    ("order", "tau", "agree", "reverse"), [("abcde", 1, 10, 0), ("edcba", -1, 0, 10), ("abced", 0.8, 9, 1)]
)
def test_sure_orders_give_an_interval_of_one_point(order, tau, agree, reverse):
    found = whole(one(results({"cad": "abcde", "real": order})))
    assert found.tau == pytest.approx(tau)
    assert (found.low, found.high) == pytest.approx((tau, tau))
    assert (found.spread_low, found.spread_high) == pytest.approx((tau, tau))
    assert (found.agree, found.reverse, found.open) == (agree, reverse, 0)
    assert (found.shapes, found.shapes_other) == (8, 8)


def test_a_tie_is_no_disagreement():
    frame = results({"cad": "abc", "real": "abc"}, sensors=("clean",))
    same = (frame["method"] == "c") & (frame["dataset"] == "cad")
    frame.loc[same, "score.d"] = frame.loc[(frame["method"] == "b") & (frame["dataset"] == "cad"), "score.d"].to_numpy()
    found = one(frame)
    assert whole(found).tau == pytest.approx(2 / np.sqrt(6))
    assert found.methods["place_1"].tolist() == [1, 2, 2]
    assert whole(found).open == 1 and (whole(found).low, whole(found).high) == pytest.approx((1 / 3, 1))
    assert found.reversed == ()


@pytest.mark.filterwarnings("error")
def test_methods_that_all_score_alike_have_no_order():
    """As on whether a surface is closed."""
    frame = results({"cad": "abc", "real": "abc"})
    frame.loc[frame["dataset"] == "real", "score.d"] = 1.0
    found = one(frame)
    assert np.isnan([whole(found).tau, whole(found).spread_low, whole(found).spread_high]).all()
    assert found.halves == pytest.approx((1, np.nan), nan_ok=True)
    assert (whole(found).low, whole(found).high, whole(found).open) == (-1, 1, 3) and found.reversed == ()
    assert found.methods["place_2"].tolist() == [1, 1, 1]


def order_of(first: np.ndarray, second: np.ndarray, level: float = 0.95):
    """Tau of two sets of one unit a shape."""
    rng = np.random.default_rng(1)
    sides = (Scores(values, np.arange(len(values))) for values in (first, second))
    return compare(*sides, rng, level, part="all", name="all", without=False)


def test_what_follows_from_significant_comparisons_is_significant():
    """Relative differences saturate: those of a and c vary more, for their mean, than those of their neighbours."""
    ratios = np.tile([199.0, 7 / 13], 13)[:, None]  # relative differences of 0.99 and -0.3
    first = ratios ** np.arange(3)
    second = np.ones_like(ratios) * 2.0 ** np.arange(3)

    def p(i, j):
        return ttest_1samp((first[:, j] - first[:, i]) / (first[:, j] + first[:, i]), 0).pvalue

    # Six comparisons: the three of the second set, without any spread, are the surest.
    assert max(p(0, 1), p(1, 2)) < 0.05 / 3 and p(0, 2) > 0.05
    found = order_of(first, second)
    assert (found.agree, found.reverse, found.open, found.low) == (3, 0, 0, 1)


def test_the_units_of_a_shape_are_one_cluster():
    """Method a loses a little on noise and wins more without: on each shape alike, so surely."""
    frame = results({"cad": "abc", "real": "abc"})
    cad = frame["dataset"] == "cad"
    scores = {("a", "clean"): 1 / 3, ("b", "clean"): 1.0, ("a", "noisy"): 0.1 * 13 / 7, ("b", "noisy"): 0.1}
    for (method, sensor), score in scores.items():  # relative differences of -0.5 and 0.3
        frame.loc[cad & (frame["method"] == method) & (frame["sensor"] == sensor), "score.d"] = score
    frame.loc[cad & (frame["method"] == "c"), "score.d"] = 100.0
    found = whole(one(frame))
    assert (found.agree, found.reverse, found.open) == (3, 0, 0)


@pytest.mark.parametrize(("level", "low"), [(0.6, -1), (0.4, 1)])
def test_the_spread_is_the_middle_of_tau_over_resampled_shapes(level, low):
    """Of two shapes, a quarter of the resamples are the second one twice, and only these reverse the order."""
    first, second = np.array([[10.0, 20, 30], [3, 2, 1]]), np.array([[1.0, 2, 3], [1, 2, 3]])
    found = order_of(first, second, level)  # leaves out 20 % at each end, or 30 %
    assert (found.spread_low, found.spread_high) == (low, 1)


# --- coverage ---------------------------------------------------------------------------------------------------------


def simulated(rng: np.random.Generator, quality: np.ndarray, shapes: int) -> Scores:
    """Two units of each shape; errors are log-normal about quality and difficulty."""
    difficulty = 0.7 * rng.standard_normal((shapes, 1))
    luck = 0.35 * rng.standard_normal((shapes, len(quality)))
    units = [difficulty + luck + quality + 0.2 * rng.standard_normal(luck.shape) for _ in range(2)]
    return Scores(np.exp(np.stack(units, axis=1).reshape(2 * shapes, -1)), np.arange(0, 2 * shapes, 2))


def covered(spread: float, likeness: float, level: float, times: int = 40) -> tuple[float, float, float]:
    """How often the interval, and the spread, hold the tau of the true orders; the mean width of the interval."""
    rng = np.random.default_rng(round(100 * spread + 10 * likeness) + 20)
    inside, near, width = 0, 0, 0.0
    for _ in range(times):
        first = spread * rng.standard_normal(6)
        second = likeness * first + np.sqrt(1 - likeness**2) * spread * rng.standard_normal(6)
        true = float(tau_b(np.exp(first), np.exp(second)))
        found = compare(
            simulated(rng, first, 17), simulated(rng, second, 16), rng, level, part="all", name="all", without=False
        )
        inside += found.low - 1e-9 <= true <= found.high + 1e-9
        near += found.spread_low - 1e-9 <= true <= found.spread_high + 1e-9
        width += found.high - found.low
    return inside / times, near / times, width / times


@pytest.fixture
def few_resamples(monkeypatch):
    """The interval needs none of them, and the spread, which does, takes most of the time."""
    monkeypatch.setattr("bench.ranking.agreement.RESAMPLES", 20)


@pytest.mark.parametrize("likeness", [1.0, 0.5, 0.0, -1.0])
@pytest.mark.parametrize("spread", [0.05, 0.3, 1.0])
def test_the_interval_holds_the_true_tau(few_resamples, spread, likeness):
    inside, _, width = covered(spread, likeness, 0.95)
    assert inside >= 0.95
    if spread == 1.0:  # and it says something where there is something to say
        assert width < 1.2


def test_a_lower_level_still_holds_and_is_narrower(few_resamples):
    inside, _, width = covered(0.5, 0.5, 0.5)
    assert inside >= 0.5 and width < covered(0.5, 0.5, 0.95)[2]


def test_the_spread_is_no_interval_where_methods_are_close():
    assert covered(0.3, 0.0, 0.95)[1] > 0.85
    assert covered(0.05, 1.0, 0.95)[1] < 0.3


# --- the parts --------------------------------------------------------------------------------------------------------


def test_the_family_and_the_sensor_that_go_wrong_are_named():
    frame = results({"cad": "abcde", "bumps": "edcba", "fbm": "abcde", "real": "abcde"})
    noisy = (frame["sensor"] == "noisy") & (frame["dataset"] == "real")
    frame.loc[noisy, "score.d"] = 1 / frame.loc[noisy, "score.d"]
    found = one(frame, sensor="clean")
    alone = {tau.name: tau.tau for tau in found.taus if tau.part == "family" and not tau.without}
    without = {tau.name: tau.tau for tau in found.taus if tau.part == "family" and tau.without}
    assert alone == pytest.approx({"bumps": -1, "cad": 1, "fbm": 1})
    assert without["bumps"] == pytest.approx(1) and found.families == ("bumps", "cad", "fbm")
    text = render_agreement([found], "markdown").split("families")[-1]
    assert text.index("bumps") < text.index("cad")
    sensors = {tau.name: tau for tau in one(frame[frame["dataset"] != "bumps"]).taus if tau.part == "sensor"}
    assert sensors["clean"].tau == pytest.approx(1) and sensors["noisy"].tau == pytest.approx(-1)
    assert sensors["noisy"].reverse == 10


def parts_of(found):
    return [(tau.part, tau.name, tau.without, tau.shapes, tau.shapes_other) for tau in found.taus]


def test_the_parts_that_are_compared():
    frame = results({"cad": "abc", "bumps": "abc", "real": "abc"}, shapes=4)
    found = one(frame)
    families = [("bumps", False), ("bumps", True), ("cad", False), ("cad", True)]
    assert parts_of(found) == [
        ("all", "all", False, 8, 4),
        *(("sensor", name, False, 8, 4) for name in ("clean", "noisy")),
        *(("family", name, without, 4, 4) for name, without in families),
    ]
    assert found.sides == ("procedural", "real")
    # One family and one sensor are all.
    found = one(frame, "bumps", dataset="cad,bumps", sensor="clean")
    assert parts_of(found) == [("all", "all", False, 4, 4)] and found.sides == ("others", "bumps")
    # A sensor of one side only.
    found = one(frame[(frame["sensor"] == "clean") | (frame["dataset"] == "cad")], "bumps,real")
    assert parts_of(found) == [("all", "all", False, 4, 8), ("sensor", "clean", False, 4, 8)]
    assert found.sides == ("others", "other")


def test_families_of_a_mixture_are_told_by_the_ids_of_its_shapes():
    assert family_of("mixture[of=cad]", "smooth_csg-test-003") == "smooth_csg"
    assert family_of("headline", "cad-test-000-gear") == "cad"
    assert family_of("cad[kind=gear]", "cad-test-000-gear") == "cad[kind=gear]"
    assert family_of("not_installed", "x-1") == "not_installed"
    frame = results({"cad": "abc", "bumps": "abc", "real": "abc"})
    frame.loc[frame["dataset"] != "real", "dataset"] = "headline"
    assert one(frame).families == ("bumps", "cad")


def test_sure_reversals_are_reported_with_their_names():
    found = one(results({"cad": "abc", "real": "acb"}))
    assert found.reversed == ((1, 2),)
    assert "on procedural b before c; on real the other way" in render_agreement([found])


def test_halves_of_a_sure_order_agree():
    assert one(results({"cad": "abc", "real": "acb"}, sensors=("clean",))).halves == (1.0, 1.0)
    assert np.isnan(one(results({"cad": "abc", "real": "acb"}, shapes=3, sensors=("clean",))).halves).all()


def test_halves_have_half_of_the_shapes_each():
    """Of four shapes one reverses the order of the half that it is in, but would not if two others were with it."""
    sets = {dataset: results({dataset: "abc"}, shapes, ("clean",)) for dataset, shapes in (("cad", 4), ("real", 3))}
    frame = pd.concat(sets.values(), ignore_index=True)
    for method, usual, odd in (("a", 1.0, 4.0), ("b", 2.0, 2.5), ("c", 3.0, 1.0)):
        mine = (frame["dataset"] == "cad") & (frame["method"] == method)
        frame.loc[mine, "score.d"] = [usual, usual, odd, usual]
    assert one(frame).halves == pytest.approx((-1, np.nan), nan_ok=True)


def test_a_single_shape_has_no_spread_and_proves_nothing():
    compared = one(results({"cad": "abc", "real": "abc"}, shapes=1))
    found = whole(compared)
    assert np.isnan(found.spread_low) and (found.low, found.high) == (-1, 1)
    assert "-" in render_agreement([compared])


def test_methods_and_units_that_are_not_common_are_left_out():
    frame = results({"cad": "abcde", "real": "abcd"})
    frame = frame[~((frame["method"] == "a") & (frame["case"] == "cad-0"))]
    found = one(frame)
    assert found.methods["method"].tolist() == list("abcd")
    assert found.left_out == 2 and whole(found).shapes == 7
    assert found.methods["planned_1"].tolist() == [14] * 4 and found.methods["planned_2"].tolist() == [16] * 4
    assert list(found.methods) == [*CONTENDER, *(f"{name}_{n}" for n in (1, 2) for name in RANK)]


def test_the_filters_choose_what_is_compared():
    frame = results({"cad": "abcd", "real": "abcd"}).drop(columns="split").assign(host=None)  # of an unknown machine
    found = one(frame, method="a,b,d", sensor="noisy", split="test")
    assert found.methods["method"].tolist() == ["a", "b", "d"] and found.methods["planned_1"].tolist() == [8] * 3


def test_a_failure_costs_its_place_on_its_side():
    frame = results({"cad": "abc", "real": "abc"})
    failed = (frame["method"] == "a") & (frame["case"] == "real-0")
    frame.loc[failed, ["status", "score.d", "directions"]] = ["error", np.nan, ""]
    found = one(frame)
    assert found.methods.set_index("method")["place_2"].to_dict() == {"a": 3, "b": 1, "c": 2}
    assert found.methods.set_index("method")["solved_2"].to_dict() == {"a": 14, "b": 16, "c": 16}


def test_a_crash_costs_the_worst_score_that_others_know():
    """A process that ended left no worst score; without one the failure would cost the first place."""
    frame = results({"cad": "abc", "real": "abc"}, worst={"d": 2.0})
    crashed = (frame["method"] == "a") & (frame["case"] == "real-0") & (frame["sensor"] == "clean")
    frame.loc[crashed, ["status", "score.d", "worst.d", "directions"]] = ["error", np.nan, np.nan, ""]
    real = frame[frame["dataset"] == "real"]
    means = real["score.d"].fillna(2.0).groupby(real["method"]).mean()
    assert means["a"] < means["b"] < means["c"]
    assert one(frame).methods["place_2"].tolist() == [1, 2, 3]


def test_the_better_is_first_whichever_way_a_metric_goes():
    low = one(results({"cad": "abc", "real": "cab"}))
    frame = results({"cad": "abc", "real": "cab"}, better="higher")
    frame["score.d"] = 1 / frame["score.d"]
    high = one(frame)
    assert low.methods["method"].tolist() == high.methods["method"].tolist() == ["a", "b", "c"]
    assert whole(low).tau == pytest.approx(whole(high).tau)


def test_tasks_and_splits_are_apart():
    frames = [results({"cad": "abc", "real": "abc"}), results({"cad": "abc", "real": "cba"}, task="denoise")]
    frames.append(results({"cad": "abc", "real": "acb"}, split="train"))
    found = agreement(pd.concat(frames, ignore_index=True), "real")
    assert [(f.task, f.split, round(whole(f).tau, 3)) for f in found] == [
        ("denoise", "test", -1),
        ("reconstruct", "test", 1),
        ("reconstruct", "train", 0.333),
    ]


def test_what_cannot_be_compared_is_refused():
    frame = results({"cad": "abc", "real": "abc"})
    for other, message in (("cad,real", "no other datasets"), ("reel", "'real'")):
        with pytest.raises(UsageError, match=message):
            agreement(frame, other)
    with pytest.raises(UsageError, match="needs 3 methods"):
        agreement(results({"cad": "ab", "real": "ab"}), "real")


def test_the_same_every_time():
    first, again = (one(results({"cad": "abcde", "fbm": "badce", "real": "abced"}, seed=3)) for _ in range(2))
    assert first.taus == again.taus and first.halves == again.halves


# --- in print ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def found():
    return agreement(results({"cad": "abcde", "bumps": "abced", "real": "abcde"}), "real")


@pytest.mark.parametrize("format", FORMATS)
def test_every_format_has_both_orders_and_tau(found, format):
    text = render_agreement(found, format)
    if format == "csv":
        table = pd.read_csv(io.StringIO(text))
        assert table["line"].value_counts().to_dict() == {"method": 5, "tau": 1 + 2 + 2 * 2}
        assert set(table["first"]) == {"procedural"} and set(table["second"]) == {"real"}
        assert table.loc[table["part"] == "all", "tau"].tolist() == pytest.approx([whole(found[0]).tau])
    else:
        place = "(rank)" if format == "latex" else "place (rank)"  # there a title has several lines
        for words in ("procedural", "real", place, "tau", "clean", "bumps"):
            assert words in text


def tau_of(part, name, without, tau, spread=(0.25, 1.0)):
    return Tau(part, name, without, tau, -1.0, 0.5, *spread, agree=2, reverse=0, open=1, shapes=8, shapes_other=4)


@pytest.fixture
def by_hand():
    """Three methods, of which c solved nothing real; without family y the orders agree as well as without x."""
    methods = pd.DataFrame({"method": list("abc"), "variant": "", "threads": 1, "device": "cpu", "host": "h"})
    ranks = {"place_1": [1, 2, 3], "rank_low_1": [1, 2, 2], "rank_high_1": [1, 3, 3]}
    ranks |= {"place_2": [2, 1, 3], "rank_low_2": [1, 1, pd.NA], "rank_high_2": [2, 2, pd.NA]}
    means = {"mean_1": [1e-3, 2e-3, 3e-3], "ci_low_1": [8e-4, 1.8e-3, 2.8e-3], "ci_high_1": [1.2e-3, 2.2e-3, 3.2e-3]}
    means |= {"mean_2": [5e-3, 4e-3, np.nan], "ci_low_2": [4e-3, 3e-3, np.nan], "ci_high_2": [6e-3, 5e-3, np.nan]}
    counts = {"solved_1": [8, 8, 7], "planned_1": 8, "solved_2": [4, 4, 0], "planned_2": 4}
    taus = [tau_of("all", "all", False, 1 / 3, (np.nan, np.nan)), tau_of("sensor", "noisy", False, -1.0)]
    for name, alone, others in (("x", 0.2, 0.9), ("y", -0.1, 0.9), ("z", 0.5, np.nan)):
        taus += [tau_of("family", name, False, alone), tau_of("family", name, True, others)]
    methods = methods.assign(**{name: pd.array(values, dtype="Int64") for name, values in ranks.items()}, **means)
    about = ("reconstruct", "test", "d", "lower", ("procedural", "real"), ("x", "y", "z"))
    return Agreement(*about, methods.assign(**counts), tuple(taus), (), (0.75, np.nan), 0)


def printed(found, **options):
    """The tables in Markdown: the lines of cells of each, its heading first, without the rule."""
    text = render_agreement([found], "markdown", **options).replace(r"\|", "/")
    tables = [[line for line in part.splitlines() if line.startswith("|")] for part in text.split("### ")[1:]]
    return [[[cell.strip() for cell in line.strip("|").split("|")] for line in (t[0], *t[2:])] for t in tables]


def test_each_number_stands_in_its_column(by_hand):
    methods, taus, families = printed(by_hand)
    sides = [words for side in by_hand.sides for words in (f"{side}: place (rank)", "d ↓ (1e-3)", "solved")]
    assert methods == [
        ["method", *sides],
        ["a", "1 (1)", "1.00 [0.80, 1.20]", "8/8", "2 (1-2)", "5.0 [4.0, 6.0]", "4/4"],
        ["b", "2 (2-3)", "2.00 [1.80, 2.20]", "8/8", "1 (1-2)", "4.0 [3.0, 5.0]", "4/4"],
        ["c", "3 (2-3)", "3.00 [2.80, 3.20]", "7/8", "3 (-)", "-", "0/4"],
    ]
    assert taus[1:] == [
        ["all", "0.33", "[-1.00, 0.50]", "[-, -]", "2", "0", "1", "8 / 4"],
        ["noisy", "-1.00", "[-1.00, 0.50]", "[0.25, 1.00]", "2", "0", "1", "8 / 4"],
    ]
    assert families[1:] == [["y", "-0.10", "0.90", "8"], ["x", "0.20", "0.90", "8"], ["z", "0.50", "-", "8"]]
    assert "0.75 (procedural) and - (real)" in render_agreement([by_hand])
    assert "90% interval" in printed(by_hand, level=0.9)[1][0]
    assert len(printed(replace(by_hand, families=("x",)))) == 2  # nothing to leave out


def test_units_left_out_are_counted_in_a_note(by_hand):
    assert "Left out" not in render_agreement([by_hand])
    assert "Left out: 3 units not planned" in render_agreement([replace(by_hand, left_out=3)])


@pytest.mark.parametrize(("better", "arrow"), [("higher", "↑"), ("reference", "/diff/ ↓")])
def test_the_mean_has_its_direction_and_no_unit_if_it_needs_none(by_hand, better, arrow):
    large = by_hand.methods.assign(mean_1=by_hand.methods["mean_1"] * 1e3)  # most of the means of both sides
    head = printed(replace(by_hand, better=better, methods=large))[0][0]
    assert head[2] == head[5] == f"d {arrow}"


def test_an_unknown_format_gets_the_nearest(by_hand):
    with pytest.raises(UsageError, match="Did you mean 'markdown'"):
        render_agreement([by_hand], "markdwn")


def test_the_command(monkeypatch, capsys):
    frame = results({"cad": "abcde", "real": "abcde"})
    monkeypatch.setattr("bench.commands.leaderboard.read_rows", lambda *args, **options: frame)
    assert main(["leaderboard", "R", "--agreement", "real"]) == 0
    assert "reconstruct · procedural | real" in capsys.readouterr().out
    for flag in (["--across", "tag"], ["--by", "tag"], ["--pareto", "d,seconds"], ["--convention", "mpu"]):
        assert main(["leaderboard", "R", "--agreement", "real", *flag]) == 1
        assert "does not go with" in capsys.readouterr().err
