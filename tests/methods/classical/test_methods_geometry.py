"""Spacing, and normals that point outward."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from bench import BadInput, PointCloud, Run
from bench.geometry.normals import oriented_normals, with_normals
from bench.geometry.sampling import face_normals, sample_uniform
from bench.geometry.spacing import mean_spacing
from bench.plugins.registry import registry


def cloud_of(mesh, count, sigma, seed=0):
    rng = np.random.default_rng(seed)
    points, faces = sample_uniform(mesh, count, rng)
    return points + sigma * rng.standard_normal(points.shape), face_normals(mesh)[faces]


def test_spacing_of_a_grid_is_its_step_despite_duplicates():
    grid = np.stack(np.meshgrid(*[np.arange(20) * 0.25] * 2, [0.0]), axis=-1).reshape(-1, 3)
    assert mean_spacing(grid) == pytest.approx(0.25)
    assert mean_spacing(np.repeat(grid, 5, axis=0)) == pytest.approx(0.25)


def test_spacing_of_random_points_is_that_of_a_poisson_process():
    points = np.random.default_rng(0).random((20_000, 3)) * [1, 1, 0]
    # 0.5 / sqrt(density); leaving out the farthest hundredth changes 2.5 %; the standard error is 0.4 %.
    assert mean_spacing(points) == pytest.approx(0.5 / np.sqrt(20_000), rel=0.05)


def test_spacing_scales_and_ignores_outliers():
    rng = np.random.default_rng(0)
    points = rng.random((5000, 3)) * [1, 1, 0]
    assert mean_spacing(points * 1000) == pytest.approx(1000 * mean_spacing(points))
    assert mean_spacing(np.vstack([points, [[100.0, 0, 0]]])) == pytest.approx(mean_spacing(points), rel=1e-2)


@pytest.mark.parametrize("points", [np.empty((0, 3)), [[1.0, 2, 3]] * 4])
def test_spacing_needs_two_points(points):
    with pytest.raises(BadInput):
        mean_spacing(np.asarray(points))


@pytest.mark.parametrize("shape", ["sphere", "torus", "box", "two spheres", "thin plate"])
def test_normals_point_outward(shape):
    ball = trimesh.creation.icosphere(4)
    mesh = {
        "sphere": ball,
        "torus": trimesh.creation.torus(0.7, 0.3),
        "box": trimesh.creation.box((2, 1.4, 1)),
        # Components are oriented one by one: neighbours on opposite sides of a gap are unrelated.
        "two spheres": trimesh.util.concatenate([ball, ball.copy().apply_translation([2.4, 0, 0])]),
        "thin plate": trimesh.creation.box((2, 2, 0.2)),
    }[shape]
    for sigma, count, wrong in ((0.0, 6000, 0.0), (0.01, 3000, 0.002)):
        points, truth = cloud_of(mesh, count, sigma)
        normals = oriented_normals(points)
        assert np.allclose(np.linalg.norm(normals, axis=1), 1)
        assert (np.einsum("ni,ni->n", normals, truth) < 0).mean() <= wrong


def test_normals_of_a_sphere_are_accurate_at_any_scale_and_position():
    points, _ = cloud_of(trimesh.creation.icosphere(5), 3000, 0.0)
    normals = oriented_normals(points)
    # A neighbourhood of 16 points has the radius sqrt(16 * 4 pi / 3000 / pi) = 0.15; normals tilt by a fraction of it.
    cosines = np.einsum("ni,ni->n", normals, points / np.linalg.norm(points, axis=1, keepdims=True))
    assert np.degrees(np.arccos(np.clip(cosines, -1, 1))).mean() < 2
    moved = oriented_normals(points * 250 + [4000.0, -9000, 100])
    assert np.abs(moved - normals).max() < 1e-6


def test_coincident_points_share_a_normal():
    points, _ = cloud_of(trimesh.creation.icosphere(3), 300, 0.0)
    assert np.array_equal(oriented_normals(np.vstack([points, points])), np.tile(oriented_normals(points), (2, 1)))


def test_given_normals_are_kept_and_completed():
    points, normals = cloud_of(trimesh.creation.icosphere(3), 300, 0.0)
    given = -3 * normals  # deliberately inward: given normals are trusted
    given[7] = 0
    given[8] = np.nan
    result = with_normals(PointCloud(points, given)).normals
    kept = np.delete(np.arange(300), [7, 8])
    assert np.allclose(result[kept], -normals[kept])
    assert np.einsum("ni,ni->n", result, -normals).min() > 0.8


def test_normals_that_are_all_zero_are_estimated():
    points, normals = cloud_of(trimesh.creation.icosphere(3), 300, 0.0)
    result = with_normals(PointCloud(points, np.zeros((300, 3)))).normals
    assert np.einsum("ni,ni->n", result, normals).min() > 0.8


def test_two_points_have_no_normals():
    with pytest.raises(BadInput):
        oriented_normals(np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 0]]))


def test_reach_is_in_units_of_the_local_spacing():
    """On a square lattice of step 0.1 the local spacing is 0.1, as estimated from 16 neighbours."""
    from bench.methods.classical.mls import within_reach

    lattice = np.stack(np.meshgrid(*[np.arange(20) * 0.1] * 2, [0.0]), axis=-1).reshape(-1, 3)
    above = lattice[210] + np.array([[0, 0, z] for z in (0.0, 0.17, 0.23, 5.0)])
    assert within_reach(above, lattice, 2.0).tolist() == [True, True, False, False]
    assert within_reach(1000 * above, 1000 * lattice, 2.0).tolist() == [True, True, False, False]


@pytest.mark.parametrize("name", ["apss", "rimls"])
def test_reach_limits_the_distance_of_the_surface_to_the_points(name):
    """Two balls whose gap is narrower than the support: without a reach, sheets appear between them."""
    ball = trimesh.creation.icosphere(3)
    one, normals = np.asarray(ball.vertices), np.asarray(ball.vertices)
    cloud = PointCloud(np.concatenate([one, one + [2.3, 0, 0]]), np.concatenate([normals, normals]))
    method, away = registry().find("method", name).cls, []
    for reach in (0.5, 2.0, 0.0):
        mesh = method(filterscale=5.0, resolution=40, reach=reach).reconstruct(cloud, Run())
        away.append(cKDTree(cloud.points).query(mesh.vertices)[0].max())
    spacing = np.sqrt(4 * np.pi / len(one))
    assert away[0] < 0.7 * spacing and away[0] < away[1] <= away[2]
    assert away[1] < 2.3 * spacing
    with pytest.raises(ValueError, match="reach: expected"):
        method(reach=-1.0)
