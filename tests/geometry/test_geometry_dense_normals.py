"""Normals of dense clouds: nearly as accurate as others, cheaper, and independent of the number of processors."""

import numpy as np
import pytest
from normal_cases import degrees, noisy

from bench.geometry import dense_normals, normals
from bench.geometry.dense_normals import dense_planes
from bench.geometry.distinct import distinct_rows
from bench.geometry.neighbours import curve_order
from bench.geometry.normals import FAR, estimate_normals, oriented_normals


@pytest.fixture(autouse=True)
def as_if_dense(monkeypatch):
    """Treated as a million points are: neighbourhood sizes are tried at one point in sixteen."""
    monkeypatch.setattr(normals, "DENSE", 1000)
    monkeypatch.setattr(dense_normals, "SAMPLES", 500)


@pytest.mark.parametrize("cloud", [("sphere", 0.0), ("sphere", 0.02), ("cube", 0.0), ("bumps", 0.01), ("torus", 0.005)])
def test_errors_are_at_most_a_sixth_above_those_of_sizes_tried_at_every_point(cloud, monkeypatch):
    points, truth = noisy(cloud[0], 5_000, cloud[1])
    dense = estimate_normals(points)
    monkeypatch.setattr(normals, "DENSE", 10**9)
    every = estimate_normals(points)
    ours, theirs = degrees(dense.normals, truth), degrees(every.normals, truth)
    assert ours.mean() < 1.17 * theirs.mean() + 0.1 and np.median(ours) < 1.17 * np.median(theirs) + 0.1
    if cloud[1]:  # as much noise is removed before signs are propagated
        moved = [np.linalg.norm(found.flattened - points, axis=1).mean() for found in (dense, every)]
        assert abs(moved[0] / moved[1] - 1) < 0.2
    assert (np.einsum("ni,ni->n", oriented_normals(points), truth) > 0).mean() > 0.99


def test_large_neighbourhoods_of_blocks_are_weighted_moments_of_their_points():
    """Against a naive sum over all points of the blocks, one by one."""
    points, _ = noisy("torus", 2000, 0.01)
    points = points[curve_order(points)]
    blocks = dense_normals._Blocks.of(points)
    seeds = points[blocks.seeds]
    block = np.linalg.norm(points[:, None] - seeds, axis=2).argmin(axis=1)
    rows, size = np.array([3, 500, 1999]), 96
    found = np.empty((2000, 3)), np.empty(2000), np.empty((2000, dense_normals.NEAR), np.int32)
    from scipy.spatial import cKDTree

    blocks.fit(points, cKDTree(points), rows, size, [], found)
    for row in rows:
        distance = np.linalg.norm(seeds - points[row], axis=1)
        order = np.argsort(distance)
        count = round(dense_normals.SPREAD * size / dense_normals.BLOCK)
        weight = np.zeros(len(seeds))
        weight[order[:count]] = 1 - (distance[order[:count]] / distance[order[count]]) ** 2
        w = weight[block]
        mean = w @ points / w.sum()
        covariance = ((points - mean).T * w) @ (points - mean)
        normal = np.linalg.eigh(covariance)[1][:, 0]
        assert abs(normal @ found[0][row]) > 1 - 1e-9
        assert abs(abs(found[1][row]) - abs((points[row] - mean) @ normal)) < 1e-9
        nearest = np.argsort(np.linalg.norm(points - points[row], axis=1))[1 : dense_normals.NEAR + 1]
        assert set(found[2][row]) == set(nearest)


def test_the_same_for_any_number_of_processors(monkeypatch):
    points, _ = noisy("bumps", 4000, 0.01)
    points = points[curve_order(points)]
    found = []
    for count in (1, 3):
        monkeypatch.setattr(dense_normals, "processors", lambda count=count: count)
        monkeypatch.setattr("bench.geometry.planes.processors", lambda count=count: count)
        found.append(dense_planes(points, FAR))
    assert all(np.array_equal(one, other) for one, other in zip(*found, strict=True))


def test_distinct_rows_are_those_of_numpy():
    points = np.random.default_rng(0).integers(0, 4, (500, 3)) - 1.0
    points[::7] *= -0.0
    distinct, inverse = distinct_rows(points)
    expected, place = np.unique(points, axis=0, return_inverse=True)
    assert np.array_equal(distinct, expected) and np.array_equal(inverse, place.ravel())
    assert np.array_equal(distinct[inverse], points)
