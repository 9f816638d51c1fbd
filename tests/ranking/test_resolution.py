"""What a table can tell: power against simulation, equivalence against scipy, and what is printed of both."""

import json
import re

import numpy as np
import pytest
from boards import line, ranks, row, rows, table, units
from scipy import stats

from bench.cli import main
from bench.errors import UsageError
from bench.ranking.leaderboard import leaderboard
from bench.ranking.report import render
from bench.ranking.resolution import FEWEST, MOST, Pairs, as_difference, as_ratio, more_needed, noncentrality, pairs
from bench.ranking.statistics import rank_intervals


@pytest.fixture
def rng():
    return np.random.default_rng(3)


# -- power -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ratio", [0.001, 0.02, 0.5, 1.0, 9.0])
def test_ratios_and_differences_are_inverse(ratio):
    a, b = 3 * (1 + ratio), 3.0
    assert as_difference(ratio) == pytest.approx((a - b) / (a + b))
    assert as_ratio(np.array(as_difference(ratio))) == pytest.approx(ratio)
    assert as_ratio(np.array([1.0, 1.5])).tolist() == [np.inf, np.inf]  # few shapes may detect no ratio at all


@pytest.mark.parametrize("n", [4, 6, 17])
@pytest.mark.parametrize("alpha", [0.05, 0.05 / 7])
def test_the_power_is_that_of_simulated_t_tests(n, alpha, rng):
    spread = 0.1
    mean = noncentrality(n, alpha) * spread / np.sqrt(n)
    x = rng.normal(mean, spread, size=(n, 20_000))
    found = (stats.ttest_1samp(x, 0).pvalue < alpha) & (x.mean(axis=0) > 0)
    assert found.mean() == pytest.approx(0.8, abs=0.01)


def test_the_power_is_that_of_the_noncentral_t():
    n, alpha = np.array([2, 4, 8, 50, 500]), 0.01
    quantile = stats.t.ppf(1 - alpha / 2, n - 1)
    assert stats.nct.sf(quantile, n - 1, noncentrality(n, alpha)) == pytest.approx(0.8, abs=1e-5)
    assert np.isnan(noncentrality(np.array([0, 1]), alpha)).all()


def test_how_many_more_against_a_loop():
    for mean, spread, n in ((0.1, 0.1, 4), (-0.05, 0.2, 8), (0.01, 0.1, 17), (0.5, 0.1, 8), (0.05, 0.1, 2)):
        loop = next(
            (k for k in range(MOST + 1) if noncentrality(n + k, 0.05) * spread / np.sqrt(n + k) <= abs(mean)), np.inf
        )
        assert more_needed(np.array([mean]), np.array([spread]), np.array([n]), np.array([0.05])) == loop
    nothing = more_needed(np.array([0.0, 1e-9, 0.1]), np.full(3, 0.1), np.array([8, 8, 1]), np.full(3, 0.05))
    assert np.isnan(nothing[[0, 2]]).all()
    assert more_needed(np.array([1e-4]), np.array([1.0]), np.array([8]), np.array([0.05])) == np.inf


def test_how_many_more_is_enough_in_simulation(rng):
    mean, spread, n = 0.05, 0.1, 8
    total = n + int(more_needed(np.array([mean]), np.array([spread]), np.array([n]), np.array([0.05]))[0])
    for count, reached in ((total, True), (total - 2, False)):
        p = stats.ttest_1samp(rng.normal(mean, spread, size=(count, 40_000)), 0).pvalue
        assert ((p < 0.05).mean() > 0.795) == reached


# -- the columns of a board --------------------------------------------------------------------------------------------


def noisy(rng, factors, n=12, sigma=0.05, seeds=1):
    """Methods whose results are multiples of the difficulty of a shape, with noise of their own around 1."""
    hard = np.exp(0.7 * rng.normal(size=n)).repeat(seeds)
    keys = {"cases": [f"s{i:02d}" for i in range(n)], "seeds": seeds}
    noise = rng.normal(size=(len(factors), n * seeds))
    noise -= noise.mean(axis=1, keepdims=True) * (n > 1)
    return {m: units(*(f * hard * np.exp(sigma * e)), **keys) for (m, f), e in zip(factors.items(), noise, strict=True)}


def relative(scores, a, b):
    x, y = (np.array(list(scores[m].values())) for m in (a, b))
    return (x - y) / (x + y)


def test_neighbours_against_scipy(rng):
    scores = noisy(rng, {"a": 1.0, "b": 1.03, "c": 2.0})
    board = leaderboard(table(scores)).set_index("method")
    assert list(board.index) == ["a", "b", "c"] and (board["shapes"] == 12).all()
    assert board["versus_next"].tolist() == ["open", "better", ""]
    d = relative(scores, "a", "b")
    # Of the two comparisons of each of the first two, the one with c is settled: Holm's step is the full level.
    step = noncentrality(12, 0.05) * stats.sem(d)
    assert board["detectable"].iloc[0] == pytest.approx(2 * step / (1 - step))
    wanted = more_needed(np.array([d.mean()]), np.array([d.std(ddof=1)]), np.array([12]), np.array([0.05]))[0]
    assert board["more_shapes"].iloc[0] == wanted > 0
    assert board["more_shapes"].iloc[1:].isna().all() and np.isnan(board["detectable"].iloc[2])


@pytest.mark.parametrize("level", [0.99, 0.999])
def test_the_level_is_shared_by_the_comparisons_that_are_open(level, rng):
    """Of four methods with a far fourth, each of the first three has two that are."""
    scores = noisy(rng, {"a": 1.0, "b": 1.03, "c": 1.06, "d": 9.0})
    board = leaderboard(table(scores), level=level).set_index("method")
    assert ranks(board.reset_index()) == {"a": (1, 3), "b": (1, 3), "c": (1, 3), "d": (4, 4)}
    for one, other in ("ab", "bc"):
        step = noncentrality(12, (1 - level) / 2) * stats.sem(relative(scores, one, other))
        assert board["detectable"][one] == pytest.approx(2 * step / (1 - step))
    d = relative(scores, "a", "b")
    top = [np.array([value]) for value in (d.mean(), d.std(ddof=1), 12, (1 - level) / 2)]
    assert board["more_shapes"].iloc[0] == more_needed(*top)[0] > 0 and board["more_shapes"].iloc[1:].isna().all()


def against_one(d):
    """Two methods with these relative differences, of the second to the first."""
    return {"a": units(*np.ones(len(d)), cases="abcdefghijkl"), "b": units(*(1 + d) / (1 - d), cases="abcdefghijkl")}


def test_what_is_separated_needs_no_more_shapes():
    """It takes a larger difference to be found in four of five tables than to be significant in this one."""
    wobble = np.repeat([1.0, -1.0], 6)
    d = 0.02 + 0.02 / 2.5 * 11**0.5 * wobble  # 2.5 standard errors
    assert stats.ttest_1samp(d, 0).pvalue < 0.05
    assert more_needed(np.array([0.02]), np.array([d.std(ddof=1)]), np.array([12]), np.array([0.05]))[0] > 0
    assert leaderboard(table(against_one(d)))["more_shapes"].iloc[0] == 0
    assert "the first two are separated." in printed(against_one(d))


@pytest.mark.parametrize(
    ("a", "b"),
    [
        # A tenth worse on eleven shapes, and so much better on one that its mean is: the ranks believe neither.
        ((*[1.1] * 11, 10.0), (*[1.0] * 11, 20.0)),
        # Clearly better on eleven shapes, and so much worse on one that the means are the same.
        ((*[1.0] * 11, 102.75), (*[1.25] * 11, 100.0)),
    ],
)
def test_where_means_and_relative_differences_disagree_more_shapes_do_not_help(a, b):
    scores = {m: units(*values, cases="abcdefghijkl") for m, values in (("a", a), ("b", b))}
    board = leaderboard(table(scores))
    assert board["method"].tolist() == ["a", "b"] and board["versus_next"].tolist() == ["open", ""]
    assert np.isnan(board["more_shapes"].iloc[0])
    assert "more shapes would not separate the first two." in printed(scores)


@pytest.mark.parametrize(("shapes", "seeds", "more"), [(4, 1, 1), (5, 1, 0), (4, 2, 0)])
def test_where_nothing_varies_more_measurements_separate_the_first_two(shapes, seeds, more):
    """Only one of nine methods is right, and always: 2 / 4^4 is more than 0.05 / 8, and one more shape is enough."""
    right = {m: units(*[float(m != "a")] * 10, cases="abcdefgh"[:shapes], seeds=seeds) for m in "abcdefghi"}
    board = leaderboard(table(right))
    assert board["more_shapes"].iloc[0] == more
    assert board["versus_next"].iloc[0] == ("open" if more else "better")


def test_pairs_by_hand():
    """Two perfect results, a difference of rounding only, results of any size, and a shape that one was not run on."""
    x = np.array([0.0, 1.0, 1e-12, 3.0, 5.0])[:, None, None]
    y = np.array([0.0, 1 + 1e-14, 3e-12, 1.0, 7.0])[:, None, None]
    planned = np.ones((5, 2, 1), dtype=bool)
    planned[4, 1] = False
    found = pairs(np.concatenate([x, y], axis=1), planned, np.arange(5), np.array([[0]]), np.array([[1]]))
    assert found.mean.item() == pytest.approx(0, abs=1e-15)  # of 0, 0, -1/2 and 1/2
    assert found.n.item() == found.units.item() == 4
    assert found.error.item() == pytest.approx(stats.sem([0, 0, -0.5, 0.5]), abs=1e-12)
    alike = pairs(np.concatenate([x, y], axis=1)[:2], planned[:2], np.arange(2), np.array([[0]]), np.array([[1]]))
    assert (alike.mean.item(), alike.error.item()) == (0.0, 0.0)
    planned[:3, 0] = False
    single = pairs(np.concatenate([x, y], axis=1), planned, np.arange(5), np.array([[0]]), np.array([[1]]))
    assert (single.mean.item(), single.n.item()) == (0.5, 1) and np.isnan(single.error.item())


def test_exactly_as_much_as_the_region_is_not_equal():
    two = Pairs(np.array([0.25, -0.25, 0.2499, 0.0]), np.zeros(4), np.array([4, 4, 4, 3]), np.full(4, 8))
    assert two.within(0.25, 0.95).tolist() == [False, False, True, False]


def test_the_seeds_of_a_shape_are_one_cluster(rng):
    scores = noisy(rng, {"a": 1.0, "b": 1.05}, n=8, seeds=3)
    d = relative(scores, "a", "b").reshape(8, 3).mean(axis=1)
    values = np.array([list(s.values()) for s in scores.values()]).T[..., None]
    found = pairs(values, np.ones(values.shape, bool), np.arange(0, 24, 3), np.array([[0]]), np.array([[1]]))
    assert found.mean.item() == pytest.approx(d.mean()) and (found.n.item(), found.units.item()) == (8, 24)
    assert found.spread.item() == pytest.approx(d.std(ddof=1))
    assert (leaderboard(table(scores))["shapes"] == 8).all()


def test_the_sensors_of_a_shape_are_one_cluster(rng):
    """Seen thrice, a shape is still one: a pooled table detects no more than its shapes allow, and few rank nobody."""
    scores = noisy(rng, {"a": 1.0, "b": 1.05}, n=6)
    one = table(scores)
    three = rows(*(r for s in ("x", "y", "z") for r in one.assign(sensor=s).to_dict("records")))
    alone, pooled = leaderboard(one), leaderboard(three, by="task")
    assert pooled["shapes"].tolist() == [6, 6]
    assert pooled["detectable"].iloc[0] == pytest.approx(alone["detectable"].iloc[0])
    few = three[three["case"].isin(["s00", "s01", "s02"])]
    assert "Only 3 shapes: too few to rank" in render(leaderboard(few, by="task"))


@pytest.mark.parametrize(("equal", "level"), [(0.005, 0.95), (0.02, 0.9), (0.1, 0.95)])
def test_equal_is_two_one_sided_tests(equal, level, rng):
    seen = set()
    for sigma in np.geomspace(0.0003, 0.3, 8):
        scores = noisy(rng, {"a": 1.0, "b": 1.004}, sigma=sigma)
        board = leaderboard(table(scores), equal=equal, level=level)
        d, region = relative(scores, *board["method"]), equal / (2 + equal)
        above = stats.ttest_1samp(d, -region, alternative="greater").pvalue
        below = stats.ttest_1samp(d, region, alternative="less").pvalue
        assert (board["versus_first"].iloc[1] == "equal") == (max(above, below) < 1 - level)
        assert board["versus_first"].iloc[0] == "first"
        seen.add(board["versus_first"].iloc[1])
    assert {"equal", "open"} <= seen


@pytest.mark.parametrize("shapes", [4, 12])
def test_equal_is_rarely_claimed_of_what_differs_by_the_region(shapes, rng):
    """At the edge of the region the claim is wrong in at most 5 % of tables, however small the noise is."""
    trials = 4000
    hard = np.exp(0.7 * rng.normal(size=(shapes, 1, trials)))
    values = hard * np.array([[1.0], [1.02]]) * np.exp(0.002 * rng.normal(size=(shapes, 2, trials)))
    one, two = np.zeros((1, trials), dtype=int), np.ones((1, trials), dtype=int)
    found = pairs(values, np.ones(values.shape, dtype=bool), np.arange(shapes), one, two)
    assert found.within(as_difference(0.02), 0.95).mean() == pytest.approx(0.05, abs=0.01)


def test_surely_different_and_equal_in_practice_at_once(rng):
    board = leaderboard(table(noisy(rng, {"a": 1.0, "b": 1.01}, sigma=0.002)))
    assert ranks(board) == {"a": (1, 1), "b": (2, 2)}
    assert board["versus_first"].tolist() == ["first", "equal"] and board["versus_next"].tolist() == ["better", ""]


def test_methods_that_solved_nothing_and_single_methods_are_not_compared(rng):
    scores = noisy(rng, {"a": 1.0, "b": 2.0}) | {"none": units(*[None] * 12, cases=[f"s{i:02d}" for i in range(12)])}
    board = leaderboard(table(scores))
    assert board["versus_next"].tolist() == ["better", "", ""]
    assert board["versus_first"].tolist() == ["first", "worse", ""]
    alone = leaderboard(table({"a": scores["a"]}))
    assert alone["versus_next"].tolist() == [""] and alone["versus_first"].tolist() == ["first"]
    assert "Resolution" not in render(alone) and "Compared with" not in render(alone)


# -- few shapes --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shapes", [1, 2, 3])
@pytest.mark.parametrize("format", ["terminal", "markdown", "latex"])
def test_with_few_shapes_nothing_is_ranked_and_that_is_reported_once(shapes, format, rng):
    scores = noisy(rng, {"a": 1.0, "b": 3.0, "c": 9.0}, n=shapes, sigma=1e-3, seeds=3)
    board = leaderboard(table(scores))
    assert ranks(board) == dict.fromkeys("abc", (1, 3))
    assert board["method"].tolist() == ["a", "b", "c"]  # in the order of their means all the same
    text = render(board, format)
    assert text.count("too few to rank methods") == 1
    assert f"Only {shapes} shape{'s' * (shapes > 1)}:" in text
    assert not re.search(r"tied for first|the best mean|\*\*|textbf|\]\*|Resolution|Compared", text)
    assert all(re.search(rf"^(\| )?{m}[ |&]+-", text, re.MULTILINE) for m in "abc")


def test_four_shapes_are_enough(rng):
    board = leaderboard(table(noisy(rng, {"a": 1.0, "b": 3.0}, n=FEWEST, sigma=1e-3)))
    assert ranks(board) == {"a": (1, 1), "b": (2, 2)}
    assert "the best mean" in render(board) and "too few to rank" not in render(board)


def test_a_column_of_few_shapes_is_not_starred_where_the_table_is_ranked(rng):
    scores = noisy(rng, {"a": 1.0, "b": 3.0}, n=8, sigma=1e-3)
    frame = table(scores)
    frame["score.e"] = frame["score.d"].where(frame["case"].isin(["s00", "s01"]))
    frame["directions"] = [json.dumps({"d": "lower"} | ({"e": "lower"} if e == e else {})) for e in frame["score.e"]]
    lines = render(leaderboard(frame), "markdown").splitlines()
    cells = next(cell for cell in lines if cell.startswith("| a ")).split("|")
    assert cells[3].strip().startswith("**") and not cells[4].strip().startswith("*")


# -- what is printed ---------------------------------------------------------------------------------------------------


def printed(scores, **options):
    return " ".join(render(leaderboard(table(scores), **options), "terminal").split())


def test_the_resolution_line_says_what_the_columns_say(rng):
    scores = noisy(rng, {"a": 1.0, "b": 1.03, "c": 2.0, "d": 2.02})
    board = leaderboard(table(scores))
    text = printed(scores)
    apart = (board["versus_next"] == "better").sum()
    share = 100 * board["detectable"].median()
    assert f"Resolution by d: {apart} of 3 pairs of neighbours significantly differ; 12 shapes detect" in text
    assert float(re.search(r"a difference of ([\d.]+) %", text)[1]) == pytest.approx(share, rel=0.06)
    assert f"about {board['more_shapes'].iloc[0]:.0f} more would separate the first two." in text


@pytest.mark.parametrize(
    ("other", "said"),
    [
        (2.0, "the first two are separated."),
        (1.0, "more shapes would not separate the first two."),
        (None, "more than 1,000 more would be needed to separate the first two."),
    ],
)
def test_what_is_said_of_the_first_two(other, said, rng):
    one = units(*(1 + np.arange(8) % 2))
    # Twice as large; the same; a third larger and smaller by turns, and a trifle larger all in all.
    turns = 1.002 * (4 / 3) ** np.array([1, 1, -1, -1, -1, -1, 1, 1])
    two = {u: v * (other or turns[i]) for i, (u, v) in enumerate(one.items())}
    assert said in printed({"one": one, "two": two})


def test_those_tied_for_first_are_distinguished_by_what_is_known():
    scores = {"a": units(*np.repeat([1.0, 1.5, 2.0, 2.5, 3.0], 2), cases="abcdefghij")}
    for name, factor, sigma in (("b", 1.001, 0.002), ("c", 1.03, 0.2), ("d", 3.0, 0.01)):
        wobble = np.exp(sigma * np.array([1, -1, 1, -1, 1, -1, 1, -1, 1, -1]))
        scores[name] = {u: v * factor * w for (u, v), w in zip(scores["a"].items(), wobble, strict=True)}
    text = printed(scores)
    assert "Compared with a: b: equal within 2 %; c: too few shapes to tell." in text
    assert "Compared with a: b: too few" not in text
    assert "b, c: too few shapes to tell." in printed(scores, equal=0.0005)
    many = scores | {f"e{i}": scores["c"] for i in range(5)}
    assert "6 methods: too few shapes to tell" in printed(many)


def test_a_small_sure_difference_is_said_to_be_small(rng):
    assert "b: significantly worse, but by less than 2 %." in printed(noisy(rng, {"a": 1.0, "b": 1.01}, sigma=0.002))


def test_what_a_rank_is_and_what_of_a_whole_table_stands_below_once(rng):
    frame = table(noisy(rng, {"a": 1.0, "b": 2.0}))
    both = leaderboard(rows(*frame.to_dict("records"), *frame.assign(dataset="cad").to_dict("records")))
    for format in ("terminal", "markdown"):
        text = " ".join(render(both, format).split())
        assert text.count("2-4 is the 95% confidence interval of a rank") == 1
        assert text.count("Each interval is for its own method, with Holm's correction over its comparisons") == 1


@pytest.mark.parametrize(("sigma", "shapes", "least", "most"), [(0.3, 16, 0.11, 0.19), (1.0, 4, 0.23, 0.33)])
def test_how_often_a_table_of_equal_methods_has_a_wrong_interval(sigma, shapes, least, most, rng):
    """The numbers of docs/metrics.md, and of the note below tables."""
    trials, k = 1000, 8
    hard = np.exp(0.7 * rng.normal(size=(shapes, 1, trials)))
    values = hard * np.exp(sigma * rng.normal(size=(shapes, k, trials)))
    low, high, _ = rank_intervals(values, np.ones(values.shape, dtype=bool), np.arange(shapes))
    wrong = (low > 1) | (high < k)
    assert least < wrong.any(axis=0).mean() < most
    assert wrong.mean() < 0.1


# -- the command -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("wrong", [0.0, 1.0, 1.5, -0.1])
def test_a_region_that_makes_no_sense_is_refused(wrong, capsys):
    with pytest.raises(UsageError, match="equal .*: expected a share"):
        leaderboard(table({"a": units(1, 2)}), equal=wrong)
    assert main(["leaderboard", f"--equal={wrong}"]) == 1
    assert "expected a share between 0 and 1, as 0.02 for 2 %" in capsys.readouterr().err


# -- who was run on what -----------------------------------------------------------------------------------------------

DIFFERENT, UNDEFINED = "Methods were run on different cases", "Not defined for every output"


def scored(method, case, *metrics, **changes):
    return row(method, case, 0, dict.fromkeys(metrics, 1.0), **changes)


def shown(*records):
    frame = rows(*records)
    board = leaderboard(frame)
    return " ".join(render(board, "terminal", rows=frame).split()), board


def test_different_cases_are_named_where_methods_were_not_run_on_the_same():
    text, board = shown(*(scored("a", c, "d") for c in "vwxyz"), *(scored("b", c, "d") for c in "vwxy"))
    assert f"{DIFFERENT}: b lacks 1. Each pair is compared on the cases that both were run on." in text
    assert UNDEFINED not in text
    assert board.set_index("method")["not_run"].to_dict() == {"a": 0, "b": 1}


@pytest.mark.parametrize(("common", "versus"), [(1, ""), (2, "open")])
def test_methods_that_share_a_single_shape_are_not_compared(common, versus):
    scores = {"a": units(1, 2, 3, 4, cases="abcd"), "b": units(5, 2, 7, 3, cases="abcdefgh"[4 - common :])}
    board = leaderboard(table(scores))
    assert board["versus_next"].tolist() == [versus, ""]
    assert board["detectable"].notna().tolist() == [versus == "open", False]


def test_as_many_but_other_cases_are_different_cases():
    """The counts agree, and no case is common."""
    text, board = shown(*(scored("a", c, "d") for c in "abcd"), *(scored("b", c, "d") for c in "wxyz"))
    assert f"{DIFFERENT}: a lacks 4, b lacks 4." in text
    assert (board["planned"] == 4).all()


def test_a_metric_that_does_not_apply_to_a_method_is_no_different_case():
    text, board = shown(*(scored("a", c, "d", "normal") for c in "wxyz"), *(scored("b", c, "d") for c in "wxyz"))
    assert DIFFERENT not in text and UNDEFINED not in text
    assert (board["not_run"] == 0).all() and (board["undefined"] == 0).all()


def test_a_failure_is_no_different_case():
    text, _ = shown(*(scored("a", c, "d") for c in "wxyz"), *(scored("b", c, "d") for c in "wxy"), row("b", "z"))
    assert DIFFERENT not in text and UNDEFINED not in text


def test_a_metric_that_is_undefined_for_some_outputs_is_named_with_the_reason():
    """The genus of a mesh that is no manifold: the method was run on all cases."""
    text, board = shown(
        *(scored("a", c, "d", "genus") for c in "wxyz"),
        *(scored("b", c, "d", *(["genus"] if c in "wx" else [])) for c in "wxyz"),
    )
    assert DIFFERENT not in text
    assert f"{UNDEFINED}: genus (up to 2 outputs of a method). Each pair is compared where both have a score." in text
    assert line(board, "b", "genus")["undefined"] == 2 and line(board, "b", "d")["undefined"] == 0


def test_a_metric_that_is_undefined_for_everybody_on_a_case_is_fair():
    """The overlap of volumes for an open reference."""
    text, _ = shown(*(scored(m, c, "d", *(["iou"] if c in "wx" else [])) for m in "ab" for c in "wxyz"))
    assert DIFFERENT not in text and UNDEFINED not in text


# -- metrics that are to be near the reference's own value -------------------------------------------------------------


def genera(**scores):
    return leaderboard(table({m: units(*v) for m, v in scores.items()}, better="reference", floors={"d": 1.0}))


def test_differences_to_the_reference_do_not_cancel():
    """Genus 5 too high on one shape and 5 too low on the next looked perfect."""
    board = genera(wild=(6, -4, 6, -4), near=(2, 1, 1, 2))
    assert line(board, "wild")["mean"] == 5 and line(board, "near")["mean"] == 0.5
    assert line(board, "wild")["score_mean"] == 1 and line(board, "near")["score_mean"] == 1.5
    assert (board["floor"] == 1).all() and (board["ci_low"] >= 0).all()
    assert board["method"].tolist() == ["near", "wild"]
    assert leaderboard(table({"a": units(1, 2, 3, 4)}))["score_mean"].isna().all()


@pytest.mark.parametrize(
    ("format", "heading", "last"),
    [
        ("terminal", "d |diff| ↓", "ref 1"),
        ("markdown", r"d \|diff\| ↓", "ref 1"),
        ("latex", r"$|$diff$|$ $\downarrow$", "ref 1"),
    ],
)
def test_the_heading_says_that_it_is_a_difference(format, heading, last):
    text = render(genera(wild=(6, -4, 6, -4), near=(2, 1, 1, 2)), format)
    assert heading in text and last in text
    assert "mean absolute difference to the reference's own value" in " ".join(text.split())
    assert "|diff|" not in render(leaderboard(table({"a": units(1, 2, 3, 4)})), format)


def test_a_paper_that_prints_the_count_gets_the_count():
    from bench.ranking.conventions import load_convention

    scores = {"components": 3.0, "boundary_edges": 4.0}
    directions = json.dumps(dict.fromkeys(scores, "reference"))
    floors = {"components": 1.0, "boundary_edges": 0.0}
    frame = rows(*(row("a", c, 0, scores, floors, directions=directions) for c in "wxyz"))
    text = render(leaderboard(frame), "markdown", convention=load_convention("dsr_benchmark"))
    assert "| **3.0** | **4.0** |" in text and "|diff|" not in text.replace("\\", "") and "→ref" in text
    assert "No interval" not in text
