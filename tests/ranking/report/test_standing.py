"""The notes on ranks, from lines of a board that are written down."""

import math

import pytest

from bench.ranking.report.standing import coverage, equality, is_ranked, percent, resolution
from bench.ranking.resolution import FEWEST


def line(label="a", metric="d", **changes):
    """A line of a board that is compared with nobody."""
    base = {"label": label, "metric": metric, "shapes": 8, "not_run": 0, "undefined": 0, "versus_next": ""}
    return base | {"detectable": math.nan, "more_shapes": math.nan, "versus_first": "", "rank_low": 1} | changes


@pytest.mark.parametrize(
    ("shapes", "ranked"),
    [((1,), True), ((3, 3), False), ((3, 3, 3), False), ((3, 4), True), ((4, 4), True), ((), True)],
)
def test_two_methods_are_ranked_from_four_shapes_of_one_of_them_on(shapes, ranked):
    lines = [line(shapes=n) for n in shapes]
    assert FEWEST == 4 and is_ranked(lines) == ranked
    assert ("too few to rank methods" in " ".join(resolution("d", lines))) != ranked


@pytest.mark.parametrize(
    ("detectable", "said"),
    [
        (0.0034, "a difference of 0.34 %"),
        (0.097, "a difference of 9.7 %"),
        (0.124, "a difference of 12 %"),
        (0.996, "a difference of 100 %"),
        (1.0, "a factor of 2"),
        (1.5, "a factor of 2.5"),
        (math.inf, "no difference"),
    ],
)
def test_what_the_shapes_detect(detectable, said):
    lines = [line(versus_next="open", detectable=detectable, more_shapes=3.0), line("b")]
    assert resolution("d", lines) == [
        f"Resolution by d: 0 of 1 pair of neighbours significantly differ; 8 shapes detect {said} between neighbours "
        "(median, power 80 %); about 3 more would separate the first two."
    ]


def test_the_pairs_that_differ_are_counted_and_their_median_is_given():
    pairs = [("better", 0.5), ("open", 0.02), ("better", 0.03)]
    lines = [line(versus_next=v, detectable=d, more_shapes=0.0) for v, d in pairs]
    (text,) = resolution("d", [*lines, line()])
    assert "2 of 3 pairs of neighbours significantly differ; 8 shapes detect a difference of 3 % between" in text
    assert text.endswith("the first two are separated.")
    assert percent(1.0) == "100 %"
    (text,) = resolution("d", [line(), *lines])  # the first two share too few shapes to be compared
    assert text.endswith("between neighbours (median, power 80 %).")


def test_methods_are_equal_undecided_or_hardly_worse():
    lines = [
        line(versus_first="first"),
        line(versus_first="equal"),
        line(versus_first="open"),
        line(versus_first="equal", rank_low=2),
        line(versus_first="worse", rank_low=3),
    ]
    assert equality(lines, "abcde", 0.02) == [
        "Compared with a: b: equal within 2 %; c: too few shapes to tell; d: significantly worse, but by less than 2 %."
    ]
    assert equality([one | {"shapes": 3} for one in lines], "abcde", 0.02) == []
    assert equality(lines[:1], "a", 0.02) == equality([], "", 0.02) == []


@pytest.mark.parametrize(("n", "said"), [(3, "b0, b1, b2"), (4, "b0, b1, b2, b3"), (5, "5 methods")])
def test_more_than_four_methods_are_counted(n, said):
    names = [f"b{i}" for i in range(n)]
    equal = [line(name, versus_first="equal") for name in names]
    assert equality([line(versus_first="first"), *equal], ["a", *names], 0.02) == [
        f"Compared with a: {said}: equal within 2 %."
    ]
    lacking = [line(name, not_run=i + 1) for i, name in enumerate(names)]
    some = ", ".join(f"b{i} lacks {i + 1}" for i in range(n)) if n < 5 else "5 methods lack some, up to 5"
    assert coverage([line(), *lacking], ["d"])[0].startswith(f"Methods were run on different cases: {some}. Each")


def test_only_what_is_shown_is_said_to_be_undefined():
    lines = [line(undefined=1), line("b", undefined=2), line(metric="e", undefined=3), line(metric="f")]
    said = [" ".join(coverage(lines, shown)) for shown in (["d"], ["e", "f"], [], ["f"])]
    d, e = "d (up to 2 outputs of a method)", "e (up to 3 outputs of a method)"
    starts = [f"Not defined for every output: {parts}. Each pair" for parts in (d, e, f"{d}, {e}")]
    assert [text.startswith(start) for text, start in zip(said, starts, strict=False)] == [True] * 3
    assert said[3] == ""
