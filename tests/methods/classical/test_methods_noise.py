"""The noise estimate behind the defaults of classical methods, on spheres and plates of known noise."""

import numpy as np
import pytest

from bench import PointCloud
from bench.methods.classical.ball_pivoting import radii_for
from bench.methods.classical.bilateral import neighbours_for
from bench.methods.classical.ear import passes_for
from bench.methods.classical.noise import noise_of, noise_to_spacing, noise_without_normals
from bench.methods.classical.poisson import weight_for


def ball(count=4000):
    """Evenly spread points of the unit sphere (Fibonacci), and their normals."""
    k = np.arange(count) + 0.5
    z, angle = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    points = np.column_stack([np.cos(angle) * np.sqrt(1 - z**2), np.sin(angle) * np.sqrt(1 - z**2), z])
    return points, points


def sheet(gap, count=64):
    """Two sides of a plate, and their normals."""
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, count)] * 2), axis=-1).reshape(-1, 2)
    heights = np.repeat([0.0, gap], len(grid))
    return np.column_stack([np.tile(grid, (2, 1)), heights]), np.repeat([[0, 0, -1.0], [0, 0, 1.0]], len(grid), axis=0)


def moved(points, normals, sigma):
    return points + np.random.default_rng(0).normal(0, sigma, len(points))[:, None] * normals


def test_a_sphere_and_a_plate_without_noise_have_none():
    for points, normals in (ball(), sheet(0.05), sheet(0.004)):
        assert noise_to_spacing(points, normals) < 1e-6


@pytest.mark.parametrize("sigma", [0.001, 0.003, 0.006])
def test_the_estimate_matches_the_added_noise(sigma):
    # On a lattice, four of the six nearest neighbours are a step away and two the diagonal of a cell.
    step = 1 / 63 * (4 + 2 * 2**0.5) / 6
    points, normals = sheet(0.4)
    assert noise_to_spacing(moved(points, normals, sigma), normals) == pytest.approx(sigma / step, rel=0.12)


def test_it_does_not_depend_on_scale_position_order_or_the_opposite_side():
    points, normals = sheet(0.02)
    noisy = moved(points, normals, 0.003)
    found = noise_to_spacing(noisy, normals)
    assert noise_to_spacing(1e3 * noisy + 5, normals) == pytest.approx(found, rel=1e-9)
    order = np.random.default_rng(1).permutation(len(points))
    assert noise_to_spacing(noisy[order], normals[order]) == pytest.approx(found, rel=1e-9)
    apart, theirs = sheet(0.4)
    assert found == pytest.approx(noise_to_spacing(moved(apart, theirs, 0.003), theirs), rel=0.15)


def test_a_cloud_without_normals_uses_estimated_ones():
    points, normals = ball()
    noisy = moved(points, normals, 0.01)
    known = noise_of(PointCloud(noisy, normals), "jet", at_least=10)
    assert noise_of(PointCloud(noisy), "jet", at_least=10) == pytest.approx(known, rel=0.15)
    assert noise_of(PointCloud(np.repeat(noisy, 2, axis=0)), "jet", at_least=10) == pytest.approx(known, rel=0.15)


def test_defaults_grow_smoother_with_the_noise():
    points, normals = ball()
    clouds = [(moved(points, normals, sigma), normals) for sigma in (0.0, 0.005, 0.01, 0.03)]
    weights, neighbours, passes = ([f(*c) for c in clouds] for f in (weight_for, neighbours_for, passes_for))
    assert weights == sorted(weights, reverse=True) and weights[0] == 10 and weights[-1] < 2
    assert neighbours == sorted(neighbours) and neighbours[0] == 12 and neighbours[-1] > 40
    assert passes[0] == 0 and passes[1] == 1 and passes[-1] == 2
    assert min(radii_for(*clouds[0])) < min(radii_for(*clouds[-1]))


@pytest.mark.parametrize("sigma", [0.0, 0.02, 0.05, 0.1])
def test_without_normals_at_least_half_of_noise_above_the_spacing_is_found(sigma):
    points, _ = ball()  # the spacing is 0.05
    noisy = points + np.random.default_rng(2).normal(0, sigma, points.shape)
    found = noise_without_normals(noisy)
    assert (0.5 * sigma if sigma > 0.04 else 0) <= found <= 1.1 * sigma
    assert noise_without_normals(100 * noisy + 7) == pytest.approx(100 * found, rel=1e-6)
    assert noise_without_normals(noisy[:15]) == 0
