"""The GPF-like filter: shares, normals and repulsion in closed form, exact planes, and sharp edges."""

import numpy as np
import pytest

from bench import PointCloud, Run
from bench.methods.classical.gpf import Gpf, Nearby, around, expectation, filtered_normals, pushed_apart


def square(count, rng, noise=0.0):
    return rng.uniform(-1, 1, (count, 3)) * [1, 1, 0] + rng.normal(0, noise, (count, 3)) * [0, 0, 1]


def cube(count, rng):
    """Random points of the surface of the cube [-1, 1]^3, and their normals."""
    axis, side = rng.integers(3, size=count), rng.choice([-1.0, 1.0], count)
    points, normals = rng.uniform(-1, 1, (count, 3)), np.zeros((count, 3))
    points[np.arange(count), axis] = normals[np.arange(count), axis] = side
    return points, normals


def to_cube(points):
    """Distances (n,) of points to the surface of the cube."""
    beyond = np.abs(points) - 1
    outside = np.linalg.norm(np.maximum(beyond, 0), axis=1)
    return np.where(outside > 0, outside, -beyond.max(axis=1))


def test_an_exact_plane_stays_exact():
    points = square(400, np.random.default_rng(0))
    output = Gpf().denoise(PointCloud(points, np.tile([0.0, 0, 1], (400, 1))), Run())
    assert np.abs(output.points[:, 2]).max() < 1e-12
    still = Gpf(repulsion=0).denoise(PointCloud(points, np.tile([0.0, 0, 1], (400, 1))), Run())
    np.testing.assert_allclose(still.points, points, atol=1e-12)


def test_the_noise_of_a_plane_is_less_than_half():
    points = square(1500, np.random.default_rng(1), 0.03)
    output = Gpf().denoise(PointCloud(points), Run())
    inner = np.abs(points[:, :2]).max(axis=1) < 0.9
    assert np.abs(output.points[inner, 2]).mean() < 0.5 * np.abs(points[inner, 2]).mean()


def test_points_of_a_sphere_stay_at_its_radius():
    """Averaging the heights over both planes does not shrink the sphere."""
    points = np.random.default_rng(2).normal(size=(600, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    _, heights = expectation(points, points, points, around(points, points, points, 20, 25.0))
    assert np.abs(heights).max() < 1e-12


def test_edges_of_a_cube_are_kept_better_than_by_plain_projection():
    rng = np.random.default_rng(3)
    exact, _ = cube(1800, rng)
    noisy = exact + rng.normal(0, 0.02, exact.shape)
    near = np.sort(np.abs(exact), axis=1)[:, 1] > 0.9  # less than a tenth of the half width of the cube from an edge
    output = Gpf(k=32).denoise(PointCloud(noisy), Run()).points
    mean, index = noisy.copy(), around(noisy, noisy, exact, 32, 90.0).indices
    for row, of in enumerate(index):  # plain projection: onto the plane through as many neighbours
        centre = noisy[of].mean(axis=0)
        normal = np.linalg.svd(noisy[of] - centre)[2][2]
        mean[row] -= (noisy[row] - centre) @ normal * normal
    assert to_cube(output)[near].mean() < 0.75 * to_cube(mean)[near].mean()
    assert to_cube(output).mean() < 0.6 * to_cube(noisy).mean()


def test_shares_are_those_of_a_mixture():
    """Two centres near one point share it in proportion to their likelihoods."""
    points, normals = np.array([[0.0, 0, 0], [0, 0, 1.0]]), np.tile([0.0, 0, 1], (2, 1))
    nearby = Nearby(np.array([[0, 1], [0, 1]]), np.ones((2, 2)))
    shares, heights = expectation(points, points, normals, nearby)
    np.testing.assert_allclose(heights, [[0, 1], [-1, 0]])
    own = 1 / (1 + np.exp(-0.5 / (4 * 0.5)))  # the mean square of the heights is a half
    np.testing.assert_allclose(shares, [[own, 1 - own], [1 - own, own]])


def test_filtered_normals_are_smooth_on_a_side_and_sharp_across_an_edge():
    rng = np.random.default_rng(4)
    points, normals = cube(1500, rng)
    noisy = normals + rng.normal(0, 0.1, normals.shape)
    noisy /= np.linalg.norm(noisy, axis=1, keepdims=True)
    filtered = filtered_normals(points, noisy, 30, 25.0)
    assert np.degrees(np.arccos(np.clip((filtered * normals).sum(axis=1), -1, 1))).mean() < 3
    np.testing.assert_allclose(np.linalg.norm(filtered, axis=1), 1)


def test_points_are_pushed_apart_within_their_planes():
    points = np.concatenate([square(200, np.random.default_rng(5)), [[0, 0, 0], [1e-3, 0, 0]]])
    push = pushed_apart(points, np.tile([0.0, 0, 1], (202, 1)))
    assert np.abs(push[:, 2]).max() == 0
    assert push[200, 0] < 0 < push[201, 0]


@pytest.mark.parametrize("wrong", [{"k": 3}, {"angle": 0.0}, {"rounds": 0}, {"repulsion": 2.0}])
def test_bad_parameters_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Gpf(**wrong)
