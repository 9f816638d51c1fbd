"""Repulsion and projection, against plain loops, and on planes and balls with known results."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree
from splat_scenes import ball

from bench.methods.splatting.regularisers.planes import least_direction
from bench.methods.splatting.regularisers.settings import PRESETS, Regularity
from bench.methods.splatting.regularisers.terms import Neighbours

FORMS = ["released", "thesis"]


def scene(count=60, seed=0):
    """Points near a wavy sheet with roughly its normals, some of them hidden."""
    rng = np.random.default_rng(seed)
    plane = rng.uniform(-0.5, 0.5, (count, 2))
    points = np.column_stack([plane, 0.1 * np.sin(4 * plane[:, 0]) + 0.02 * rng.normal(size=count)])
    normals = np.array([0, 0, 1.0]) + 0.3 * rng.normal(size=(count, 3))
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True), rng.integers(0, 4, count)


def weights_of(i, index, points, normals, visible, distance, form):
    """psi, and psi theta phi, of the neighbours of a point."""
    squared = ((points[index] - points[i]) ** 2).sum(1)
    near = np.exp(-squared / (distance**2 * (2 if form == "released" else 1))) * (squared <= distance**2)
    alike = np.exp(-((1 - normals[index] @ normals[i]) ** 2) / 0.25)
    return near, near * alike * visible[index]


def plane_of(index, points, weights):
    """Normal and mean of the plane through neighbours."""
    mean = weights @ points[index]
    kept = weights >= 0.01 * weights.max()
    rows = (weights[:, None] * (points[index] - mean))[kept]
    return np.linalg.svd(rows)[2][2], mean


def repulsion_of(place, i, index, points, near, normal, form):
    """The loss of one point at another position, with the same neighbours, weights and plane."""
    offset = place - points[index]
    offset = offset - np.outer(offset @ normal, normal)
    squared = (offset**2).sum(1) + 1e-4
    return (near / np.sqrt(squared)).sum() / near.sum() if form == "released" else (near / squared).sum()


@pytest.mark.parametrize("seed", range(4))
def test_the_least_direction_matches_lapack(seed):
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(3, 3)) * rng.uniform(0.01, 10, 3)
    matrix = half @ half.T
    found = least_direction(matrix.copy())
    assert abs(found @ np.linalg.eigh(matrix)[1][:, 0]) == pytest.approx(1, abs=1e-9)


def test_the_least_direction_of_a_flat_matrix_is_its_normal():
    assert abs(least_direction(np.diag([2.0, 0, 2]))[1]) == 1
    assert np.linalg.norm(least_direction(np.zeros((3, 3)))) == 1


@pytest.mark.parametrize("form", FORMS)
def test_repulsion_matches_plain_loops_and_finite_differences(form):
    points, normals, hidden = scene()
    how = Regularity(neighbours=12, repulsion_distance=0.6, repulsion=0.7, form=form)
    around = Neighbours(points, how)
    loss, gradient = around.repulsion(points, normals, hidden)
    each = []
    for i, index in enumerate(around.index):
        near, weights = weights_of(i, index, points, normals, 1 / (1 + hidden), 0.6, form)
        normal, _ = plane_of(index, points, weights / weights.sum())
        each.append(repulsion_of(points[i], i, index, points, near, normal, form))
        for axis in range(3):
            step = 1e-6 * np.eye(3)[axis]
            values = [repulsion_of(points[i] + s * step, i, index, points, near, normal, form) for s in (-1, 1)]
            slope = 0.7 / 60 * (values[1] - values[0]) / 2e-6
            assert gradient[i, axis] == pytest.approx(slope, rel=1e-5, abs=1e-7)
    assert loss == pytest.approx(0.7 * np.mean(each), rel=1e-9)


@pytest.mark.parametrize("form", FORMS)
def test_projection_matches_plain_loops(form):
    points, normals, hidden = scene()
    how = Regularity(neighbours=12, projection_distance=0.6, projection=0.5, largest=10.0, form=form)
    around = Neighbours(points, how)
    found = around.projected(points, normals, hidden)
    for i, index in enumerate(around.index):
        if form == "thesis":
            _, weights = weights_of(i, index, points, normals, 1 / (1 + hidden), 0.6, form)
            normal, mean = plane_of(index, points, weights / weights.sum())
            height = (points[i] - mean) @ normal
        else:
            squared = ((points[index] - points[i]) ** 2).sum(1)
            weights = np.exp(-squared / (4 * 0.6**2) - ((1 - normals[index] @ normals[i]) ** 2) / 0.25)
            weights *= (squared <= 0.6**2) / (1 + hidden[index]) ** 2
            normal = (weights[:, None] * normals[index]).sum(0)
            normal /= np.linalg.norm(normal)
            height = (weights * ((points[i] - points[index]) * normals[index]).sum(1)).sum() / weights.sum()
        np.testing.assert_allclose(found[i], points[i] - 0.5 * height * normal, atol=1e-12)


@pytest.mark.parametrize("form", FORMS)
def test_projection_smooths_a_noisy_ball(form):
    points, normals, _, _ = ball(800)
    noisy = points * (1 + 0.02 * np.random.default_rng(0).normal(size=(800, 1)))
    how = Regularity(projection_distance=0.25, projection=0.5, largest=1.0, form=form)
    before = after = noisy
    for _ in range(5):
        after = Neighbours(after, how).projected(after, normals, np.zeros(800))
    spread = [np.linalg.norm(cloud, axis=1).std() for cloud in (before, after)]
    assert spread[1] < 0.5 * spread[0]


@pytest.mark.parametrize("form", FORMS)
def test_repulsion_spreads_points_within_their_plane(form):
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(0, 1, (300, 2)), np.zeros(300)])
    normals = np.tile([0.0, 0, 1], (300, 1))
    how = Regularity(neighbours=16, repulsion_distance=0.1, form=form)

    def unevenness(cloud):
        nearest = cKDTree(cloud).query(cloud, 2)[0][:, 1]
        return nearest.std() / nearest.mean()

    moved = points
    for _ in range(30):
        _, gradient = Neighbours(moved, how).repulsion(moved, normals, np.zeros(300))
        assert np.abs(gradient[:, 2]).max() < 1e-12
        moved = moved - 0.004 * gradient / np.abs(gradient).max()
    assert unevenness(moved) < 0.7 * unevenness(points)


def test_hidden_neighbours_have_smaller_weights():
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-0.2, 0.2, (40, 2)), np.zeros(40)])
    points[0], points[1] = 0, [0.05, 0, 0.05]  # one neighbour is off the plane
    normals, hidden = np.tile([0.0, 0, 1], (40, 1)), np.zeros(40)
    how = Regularity(projection_distance=0.5, projection=1.0)
    heights = []
    for times in (0, 3):
        hidden[1] = times
        heights.append(Neighbours(points, how).projected(points, normals, hidden)[0, 2])
    assert 0 < heights[1] < 0.1 * heights[0]  # by (1 + 3)^-2


def test_isolated_points_do_not_move():
    points = np.array([[0.0, 0, 0], [5, 0, 0], [0, 5, 0], [5.01, 0, 0]])
    normals = np.tile([0.0, 0, 1], (4, 1))
    around = Neighbours(points, Regularity())
    np.testing.assert_array_equal(around.projected(points, normals, np.zeros(4)), points)
    _, gradient = around.repulsion(points, normals, np.zeros(4))
    assert (gradient[[0, 2]] == 0).all() and gradient[1, 0] > 0  # two nearby points repel each other
    coincident = Neighbours(np.zeros((5, 3)), Regularity())
    assert np.isfinite(coincident.repulsion(np.zeros((5, 3)), np.tile([0.0, 0, 1], (5, 1)), np.zeros(5))[1]).all()
    assert Neighbours(np.zeros((1, 3)), Regularity()).index.shape == (1, 0)


@pytest.mark.parametrize("wrong", [{"neighbours": 2}, {"angle": 0}, {"repulsion": -1}, {"form": "x"}])
def test_wrong_settings_are_named(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Regularity(**wrong)
    assert all(preset.form == "released" for preset in PRESETS.values())
