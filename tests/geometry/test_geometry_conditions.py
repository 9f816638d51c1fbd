"""Measured conditions of a cloud, against the parameters of sensors that have a single effect."""

import numpy as np
import pytest
from trimesh.creation import icosphere

from bench import Case, PointCloud, Shape
from bench.geometry.conditions import describe_cloud

N = 4000


@pytest.fixture(scope="module")
def case():
    return Case("ball", {}, Shape("ball", icosphere(subdivisions=5)))


@pytest.fixture(scope="module")
def uniform():
    points = np.random.default_rng(0).normal(size=(N, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def test_independent_uniform_points(case, uniform):
    state = describe_cloud(PointCloud(uniform), case)
    assert state["points"] == N
    assert state["rms"] < 1e-3 and state["outliers"] == 0 and state["coverage"] == 1
    # The area that k neighbours take up is Gamma(k): its variation is 1 / sqrt(k).
    assert state["density_variation"] == pytest.approx(1 / np.sqrt(8), rel=0.05)


@pytest.mark.parametrize("sigma", [0.002, 0.01])
def test_the_rms_error_is_the_noise_along_the_normal(case, uniform, sigma):
    moved = uniform * (1 + sigma * np.random.default_rng(1).normal(size=(N, 1)))
    assert describe_cloud(PointCloud(moved), case)["rms"] == pytest.approx(sigma, rel=0.05)


def test_outliers_are_counted_and_do_not_affect_the_measured_noise(case, uniform):
    points = uniform * 1.01
    points[: N // 10] *= 2
    state = describe_cloud(PointCloud(points), case)
    assert state["outliers"] == pytest.approx(0.1)
    assert state["rms_inliers"] == pytest.approx(0.01, rel=0.02)
    assert state["rms"] > 0.3


def test_points_on_half_of_the_surface_cover_half_of_it(case, uniform):
    state = describe_cloud(PointCloud(uniform[uniform[:, 2] > 0]), case)
    # A rim of the width 2 sqrt(A / N) beyond the edge counts as covered: on a unit sphere, half of that in area share.
    reach = 2 * np.sqrt(4 * np.pi / (N / 2))
    assert state["coverage"] == pytest.approx((1 + np.sin(reach)) / 2, abs=0.02)


def test_uneven_density_is_measured(case, uniform):
    crowded = np.concatenate([uniform, np.repeat(uniform[:50], 20, axis=0) * 1.0])
    crowded[N:] += 0.01 * np.random.default_rng(2).normal(size=(1000, 3))
    assert describe_cloud(PointCloud(crowded), case)["density_variation"] > 0.4


@pytest.mark.parametrize("count", [1, 5])
def test_a_few_points_have_no_density(case, uniform, count):
    assert "density_variation" not in describe_cloud(PointCloud(uniform[:count]), case)


def test_only_outliers(case):
    state = describe_cloud(PointCloud(np.full((4, 3), 9.0)), case)
    assert state["outliers"] == 1 and np.isnan(state["rms_inliers"]) and state["coverage"] == 0
