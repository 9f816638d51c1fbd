"""Filters of images, cameras close to a cloud, and the denoisers made of them."""

from __future__ import annotations

import numpy as np
import pytest

from bench import PointCloud, Run
from bench.methods.learned.images.l0 import l0_smoothed
from bench.methods.splatting.dss_l0 import DssL0
from bench.methods.splatting.dss_slic import DssSlic
from bench.methods.splatting.filtering.close_ups import close_ups
from bench.methods.splatting.filtering.superpixels import superpixels
from bench.tasks.fit_shape import FitShape


def two_tones(noise=0.05):
    """An image of two uniform halves, without and with noise."""
    image = np.zeros((32, 48, 3))
    image[:, :24], image[:, 24:] = (0.8, 0.3, 0.2), (0.2, 0.4, 0.9)
    return image, image + noise * np.random.default_rng(0).normal(size=image.shape)


# -- images ------------------------------------------------------------------------------------------------------------


def test_l0_smoothing_keeps_edges_and_removes_noise():
    clean, noisy = two_tones()
    smooth = l0_smoothed(noisy, 0.05)
    assert np.abs(noisy - clean).max() > 0.15 > 1.5 * np.abs(smooth - clean).max()
    inside = smooth[:, 2:22]
    assert np.abs(inside - clean[:, 2:22]).max() < 0.02 and inside.std(axis=(0, 1)).max() < 2e-3


def test_l0_smoothing_keeps_the_mean_and_converges_to_it():
    _, noisy = two_tones()
    np.testing.assert_allclose(l0_smoothed(noisy, 0.01).mean(axis=(0, 1)), noisy.mean(axis=(0, 1)), rtol=1e-12)
    everything = l0_smoothed(noisy, 1e6, last=1e9)
    np.testing.assert_allclose(everything, np.broadcast_to(noisy.mean(axis=(0, 1)), noisy.shape), atol=1e-4)
    np.testing.assert_allclose(l0_smoothed(noisy, 1e-12), noisy, atol=1e-9)


def test_an_iteration_of_l0_smoothing_solves_its_linear_system():
    # With the first beta only: (1 + beta (Dx'Dx + Dy'Dy)) S = I + beta (Dx'h + Dy'v)
    _, noisy = two_tones()
    beta, weight = 0.5, 0.015
    found = l0_smoothed(noisy, weight, first=beta, last=beta * 1.001)
    down, right = (np.roll(noisy, -1, axis) - noisy for axis in (0, 1))
    small = (down**2 + right**2).sum(2) < weight / beta
    assert 0.1 < small.mean() < 0.9
    down[small] = right[small] = 0

    def back(field, axis):
        return np.roll(field, 1, axis) - field

    def laplacian(image):
        return sum(back(np.roll(image, -1, axis) - image, axis) for axis in (0, 1))

    np.testing.assert_allclose(
        found + beta * laplacian(found), noisy + beta * (back(down, 0) + back(right, 1)), atol=1e-9
    )


def test_superpixels_have_the_means_of_their_regions():
    rng = np.random.default_rng(0)
    ramp = np.stack(np.meshgrid(np.linspace(0, 1, 60), np.linspace(0, 1, 40)), axis=-1)
    image = np.clip(np.dstack([ramp, 0.5 * np.ones((40, 60))]) + 0.02 * rng.normal(size=(40, 60, 3)), 0, 1)
    found = superpixels(image, segments=30)
    colors = np.unique(found.reshape(-1, 3), axis=0)
    assert 15 <= len(colors) <= 45
    np.testing.assert_allclose(found.mean(axis=(0, 1)), image.mean(axis=(0, 1)), rtol=1e-9)
    for color in colors[:5]:
        region = (found == color).all(axis=2)
        np.testing.assert_allclose(image[region].mean(axis=0), color, rtol=1e-9)


# -- cameras -----------------------------------------------------------------------------------------------------------


def test_close_ups_face_distant_points_along_their_normals():
    cloud = FitShape(points=800, size=1.0).beginning()
    cameras, lights = close_ups(cloud.points, cloud.normals, 8, 64, 0.9, np.random.default_rng(0))
    targets = []
    for camera, directions in zip(cameras, lights.directions, strict=True):
        np.testing.assert_allclose(directions @ directions.T, np.eye(3), atol=0.05)
        np.testing.assert_allclose(directions[0], -camera.rotation[2], atol=1e-9)
        assert np.linalg.norm(camera.center) == pytest.approx(8, rel=0.02)
        nearest = cloud.points[np.linalg.norm(cloud.points - camera.center, axis=1).argmin()]
        targets.append(nearest)
        fx, _, _, cx, cy = camera.lens()
        x, y, z = camera.to_camera(nearest[None])[0]
        assert abs(fx * x / z) < 8 and abs(fx * y / z) < 8 and (cx, cy) == (32, 32)
        assert 64 / (fx / 7) == pytest.approx(0.9, rel=0.02)  # the width of its view at the surface
    gaps = np.linalg.norm(np.array(targets)[:, None] - np.array(targets), axis=2)[~np.eye(8, dtype=bool)]
    assert gaps.min() > 0.9
    other, _ = close_ups(cloud.points, cloud.normals, 8, 64, 0.9, np.random.default_rng(1))
    assert not np.allclose(other[0].center, cameras[0].center)


# -- the denoisers -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def noisy():
    """A noisy cube, and the clean cube."""
    cube = FitShape(start="cube", points=1500, size=0.55).beginning()
    rng = np.random.default_rng(0)
    tilted = cube.normals + 0.25 * rng.normal(size=cube.normals.shape)
    points = cube.points + 0.012 * rng.normal(size=cube.points.shape)
    return PointCloud(points, tilted / np.linalg.norm(tilted, axis=1, keepdims=True)), cube


def off(cloud, cube):
    """The mean distance of points from their original faces, and the mean cosine of normals with those of the faces."""
    height = ((cloud.points - cube.points) * cube.normals).sum(1)
    return float(np.abs(height).mean()), float((cloud.normals * cube.normals).sum(1).mean())


@pytest.mark.parametrize(("method", "more"), [(DssL0, {}), (DssSlic, {"segments": 15})])
def test_a_noisy_cube_becomes_flatter(noisy, method, more):
    cloud, cube = noisy
    few = {"cycles": 2, "pixels": 64, "span": 1.4, "views": 8, "point_steps": 4, "projection": 0.5, "depth_limit": 0.1}
    few |= more
    found = method(**few).denoise(cloud, Run(seed=1))
    before, after = off(cloud, cube), off(found, cube)
    assert len(found) == len(cloud)
    assert after[0] < 0.8 * before[0] and 1 - after[1] < 0.6 * (1 - before[1])
    few |= {"cycles": 1, "views": 4, "point_steps": 2}
    found, again = (method(**few).denoise(cloud, Run(seed=1)) for _ in range(2))
    np.testing.assert_array_equal(found.points, again.points)


def test_without_time_the_input_is_returned(noisy):
    cloud, _ = noisy
    found = DssL0(pixels=32).denoise(cloud, Run(seconds=0.0))
    np.testing.assert_array_equal(found.points, cloud.points)


@pytest.mark.parametrize(
    ("method", "wrong"),
    [(DssL0, {"smoothing": 0}), (DssSlic, {"segments": 0}), (DssL0, {"cycles": 0}), (DssSlic, {"projection": -1})],
)
def test_wrong_parameters_are_named(method, wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        method(**wrong)
