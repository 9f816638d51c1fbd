"""The report on two sets of points that differ much in size or position."""

from __future__ import annotations

import numpy as np
import pytest

from bench import generator
from bench.geometry.extents import unlike

POINTS = generator("extents").normal(size=(500, 3))


@pytest.mark.parametrize(
    ("factor", "guess"),
    [(1000, "millimetres against metres"), (25.4, "millimetres against inches"), (100, "centimetres against metres"),
     (304.8, "millimetres against feet"), (39.37, "inches against metres"), (60, "")],
)  # fmt: skip
def test_units_are_guessed_from_the_factor(factor, guess):
    expected = f"times as large as b{f' ({guess}?)' if guess else ''}; expected both in the same units"
    assert unlike(factor * POINTS, "a", 1.05 * POINTS[:300], "b").startswith("a is about")
    assert expected in unlike(factor * POINTS, "a", POINTS, "b")
    assert expected in unlike(POINTS, "b", factor * POINTS, "a")


def test_similar_sets_and_a_few_far_points_are_accepted():
    stray = np.vstack([POINTS, [[1e4, 0, 0]]])
    for points in (POINTS, 9 * POINTS, stray, POINTS[:1], np.empty((0, 3))):
        assert unlike(points, "a", POINTS, "b") == ""


def test_disjoint_boxes_are_reported():
    assert unlike(POINTS + [0, 0, 50], "a", POINTS, "b").startswith("the boxes of a and b do not overlap")
