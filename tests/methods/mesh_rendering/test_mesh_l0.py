"""L0 smoothing of the images of a mesh: cameras, the mesh through the points, and the result for a cube."""

from __future__ import annotations

import numpy as np
import pytest

from bench import BadInput, PointCloud, Run
from bench.geometry.spacing import mean_spacing
from bench.methods.mesh_rendering.fitting.filtered import filtered_views, mesh_through, rig
from bench.methods.mesh_rendering.paparazzi_l0 import PaparazziL0
from bench.methods.mesh_rendering.raster.hard import HardDrawn


def cube(side=16, noise=0.0):
    """Points on lattices over the faces of a cube, edges left out, with exact normals."""
    line = (np.arange(side) + 0.5) / side - 0.5
    u, v = (a.ravel() for a in np.meshgrid(line, line))
    points, normals = [], []
    for axis in range(3):
        for sign in (-1, 1):
            place = np.zeros((len(u), 3))
            place[:, axis], place[:, axis - 2], place[:, axis - 1] = 0.5 * sign, u, v
            points.append(place)
            normals.append(np.tile(sign * np.eye(3)[axis], (len(u), 1)))
    points, normals = np.concatenate(points), np.concatenate(normals)
    return points + noise * np.random.default_rng(0).normal(size=points.shape), normals


def test_the_points_are_the_vertices_and_faces_look_outwards():
    points, normals = cube()
    vertices, faces = mesh_through(PointCloud(points, normals), mean_spacing(points))
    np.testing.assert_array_equal(vertices, points)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    assert (np.einsum("fi,fi->f", cross, (a + b + c) / 3) > 0).mean() > 0.99
    assert np.linalg.norm(cross, axis=1).sum() / 2 > 0.9 * 6 * (15 / 16) ** 2  # nearly the whole cube
    with pytest.raises(BadInput, match="no ball"):
        mesh_through(PointCloud(points[::64] * 100, normals[::64]), 1e-3)


def test_cameras_see_the_whole_mesh_and_face_its_centre():
    points, _ = cube()
    views = rig(points + 2.0, 7, 64, np.random.default_rng(0))
    pixels, depth = views.project(points + 2.0)
    assert (depth > 0).all() and pixels.min() >= 0 and pixels.max() <= 64
    np.testing.assert_allclose(views.project(np.full((1, 3), 2.0))[0], 32.0, atol=1e-9)
    np.testing.assert_allclose(
        views.light_directions @ views.light_directions.transpose(0, 2, 1), [np.eye(3)] * 7, atol=1e-12
    )


def test_images_of_a_cube_are_already_piecewise_constant():
    points, normals = cube()
    vertices, faces = mesh_through(PointCloud(points, normals), mean_spacing(points))
    seen = []
    views = rig(vertices, 3, 64, np.random.default_rng(0))
    out = filtered_views(HardDrawn.of, vertices, faces, views, lambda image: seen.append(image) or image)
    assert len(seen) == 3 and out.masks.mean() > 0.15 and not out.images[~out.masks].any()
    np.testing.assert_allclose(out.images[1] / 255, np.where(out.masks[1][..., None], seen[1], 0), atol=0.5 / 255)


def test_a_little_noise_on_a_cube_is_smoothed():
    points, exact = cube(noise=0.004)
    method = PaparazziL0(cycles=2, steps=20, views=6, pixels=80, rate=0.01)
    out = method.denoise(PointCloud(points, exact), Run(seed=1))
    assert len(out) == len(points)
    before = method.__class__(cycles=1, steps=1, rate=1e-9).denoise(PointCloud(points, exact), Run(seed=1))

    def off(normals):
        return np.degrees(np.arccos(np.clip((normals * exact).sum(1), -1, 1))).mean()

    assert off(out.normals) < 0.8 * off(before.normals)
    stopped = method.denoise(PointCloud(points, exact), Run(seed=1, seconds=0.0))
    np.testing.assert_array_equal(stopped.points, points)


@pytest.mark.parametrize(
    "wrong", [{"cycles": 0}, {"pixels": 0}, {"rate": 0.0}, {"smoothing": -1.0}, {"evenness": -1.0}]
)
def test_wrong_parameters_are_named(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        PaparazziL0(**wrong)
