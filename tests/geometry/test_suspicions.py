"""Coordinates saved with too few digits, and a few far points that enlarge the bounding box."""

from __future__ import annotations

import numpy as np

from bench.geometry.io.files import load_cloud
from bench.geometry.suspicions import single_steps
from bench.notices import collected

RNG = np.random.default_rng(0)
BALL = RNG.normal(size=(3000, 3))
BALL = 50 * BALL / np.linalg.norm(BALL, axis=1, keepdims=True)
UTM = np.array([500_000.0, 5_400_000.0, 350.0])


def single(points):
    return points.astype(np.float32).astype(np.float64)


def test_steps_of_single_precision_are_detected():
    assert single_steps(single(BALL + UTM)) == [0.5]  # of x, 1/32, a sixtieth of the spacing
    assert single_steps(single(BALL / 10 + UTM)) == [2**-5, 0.5]
    assert single_steps(BALL + UTM) == single_steps(single(BALL)) == []
    assert single_steps(np.rint(BALL) + UTM) == []  # on a regular grid


def test_the_reader_reports_both(tmp_path):
    points = single(np.concatenate([BALL, [[5000, 0, 0]]]) + UTM)
    np.savetxt(tmp_path / "a.xyz", points, "%.17g")
    with collected() as notices:
        load_cloud(tmp_path / "a.xyz")
    assert "steps of 0.5: they were saved in single precision" in notices[0]
    assert f"{len(BALL):,} of {len(BALL) + 1:,} points lie in" in notices[1] and "method=radius_outlier" in notices[1]
