"""The sensor ``samples``: exact counts, the requested noise, and no use of global random state."""

from __future__ import annotations

import hashlib
import subprocess
import sys

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from bench import BadInput, PointCloud, Shape, generator
from bench.datasets.bumps import Bumps
from bench.datasets.sensors.samples import Samples
from bench.datasets.sensors.uniform import Uniform

BALL = Shape("ball", trimesh.creation.icosphere(5)).framed()[0]
BOX = Shape("box", trimesh.creation.box((1, 2, 3))).framed()[0]
BUMPS = next(Bumps(subdivisions=4).shapes("test")).framed()[0]


def sense(shape: Shape = BALL, seed: int = 0, **parameters):
    return Samples(**parameters).sense(shape, generator(seed, "sensor"))


def distances(cloud, shape: Shape) -> np.ndarray:
    return np.linalg.norm(cloud.points - shape.surface.closest(cloud.points)[0], axis=1)


@pytest.mark.parametrize("sampling", ["poisson_disk", "uniform"])
@pytest.mark.parametrize("count", [1, 2, 3, 10, 777, 5000])
def test_the_count_is_exact(sampling, count):
    for shape in (BALL, BOX, BUMPS):
        cloud = sense(shape, count=count, sampling=sampling)
        assert cloud.points.shape == cloud.normals.shape == (count, 3)
        assert np.isfinite(cloud.points).all()
        assert np.abs(np.linalg.norm(cloud.normals, axis=1) - 1).max() < 1e-12


@pytest.mark.parametrize("sampling", ["poisson_disk", "uniform"])
@pytest.mark.parametrize("shape", [BOX, BUMPS], ids=lambda shape: shape.id)
def test_without_noise_points_and_normals_are_exact(shape, sampling):
    cloud = sense(shape, noise=0.0, count=2000, sampling=sampling)
    closest, normals = shape.surface.closest(cloud.points)
    assert np.abs(cloud.points - closest).max() < 1e-9
    assert np.quantile(np.abs(cloud.normals - normals).max(axis=1), 0.99) < 1e-7  # a point on an edge has two


def test_the_noise_has_its_standard_deviation():
    quiet, loud = (sense(noise=noise, count=5000) for noise in (0.0, 0.02))
    moved = loud.points - quiet.points
    assert moved.std(axis=0) == pytest.approx([0.02] * 3, rel=0.05)
    assert np.abs(moved.mean(axis=0)).max() < 4 * 0.02 / np.sqrt(5000)
    assert np.array_equal(quiet.normals, loud.normals)  # exact, whatever the noise


def test_outliers_have_the_requested_number_and_fill_the_inflated_box():
    clean, cloud = (sense(BOX, noise=0.0, outliers=outliers, count=5000) for outliers in (0.0, 0.2))
    lost = (cloud.points != clean.points).any(axis=1)
    assert lost.sum() == 1000
    box = np.ptp(BOX.mesh.vertices, axis=0)
    outside = cloud.points[lost]
    assert np.ptp(outside, axis=0) == pytest.approx(1.1 * box, rel=0.02)
    assert (np.abs(outside) <= 0.55 * box).all()
    assert np.abs(outside.mean(axis=0)).max() < 0.05
    assert np.abs(cloud.normals[lost].mean(axis=0)).max() < 0.1  # any direction
    assert np.array_equal(cloud.normals[~lost], clean.normals[~lost])


def test_poisson_disk_keeps_its_distance():
    spacing = {}
    for sampling in ("poisson_disk", "uniform"):
        points = sense(noise=0.0, count=3000, sampling=sampling).points
        spacing[sampling] = cKDTree(points).query(points, 2)[0][:, 1]
    # The densest packing of the area has spacing sqrt(2 A / (sqrt(3) n)).
    densest = np.sqrt(2 * 4 * np.pi / (np.sqrt(3) * 3000))
    assert spacing["poisson_disk"].min() > 0.6 * densest
    assert spacing["uniform"].min() < 0.2 * densest
    assert spacing["poisson_disk"].std() / spacing["poisson_disk"].mean() < 0.12


def test_uniform_is_uniform_by_area():
    """On a box of sides a < b < c the faces get points in proportion to their areas."""
    cloud = sense(BOX, noise=0.0, count=20_000, sampling="uniform")
    axis = np.abs(cloud.normals).argmax(axis=1)
    a, b, c = np.ptp(BOX.mesh.vertices, axis=0)
    areas = np.array([b * c, a * c, a * b])
    expected = 20_000 * areas / areas.sum()
    assert np.abs(np.bincount(axis) - expected).max() < 5 * np.sqrt(expected.max())


def test_normals_can_be_left_out():
    assert sense(normals=False, count=100).normals is None
    assert np.array_equal(sense(normals=False, count=100).points, sense(count=100).points)


def test_samples_depend_on_the_seed_alone():
    import open3d as o3d

    o3d.utility.random.seed(1)
    np.random.seed(1)  # noqa: NPY002  (the sensor must ignore it)
    first = sense(count=1000, outliers=0.1)
    o3d.utility.random.seed(2)
    np.random.seed(2)  # noqa: NPY002
    again, other = sense(count=1000, outliers=0.1), sense(count=1000, outliers=0.1, seed=1)
    assert np.array_equal(first.points, again.points) and np.array_equal(first.normals, again.normals)
    assert not np.array_equal(first.points, other.points)


def test_two_processes_give_the_same_samples():
    script = """
import hashlib, sys
from bench import generator
from bench.datasets.bumps import Bumps
from bench.datasets.sensors.samples import Samples
from bench.datasets.sensors.uniform import Uniform
shape = next(Bumps(subdivisions=4).shapes("test")).framed()[0]
cloud = Samples(count=1000, outliers=0.1).sense(shape, generator(0, "sensor"))
sys.stdout.write(hashlib.sha256(cloud.points.tobytes() + cloud.normals.tobytes()).hexdigest())
"""
    other = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout
    cloud = sense(BUMPS, count=1000, outliers=0.1)
    assert hashlib.sha256(cloud.points.tobytes() + cloud.normals.tobytes()).hexdigest() == other


@pytest.mark.parametrize(
    ("parameters", "name"),
    [
        ({"count": 0}, "count"),
        ({"outliers": 1.0}, "outliers"),
        ({"outliers": -0.1}, "outliers"),
        ({"noise": -1.0}, "noise"),
        ({"noise": float("nan")}, "noise"),
        ({"sampling": "grid"}, "sampling"),
    ],
)
def test_bad_parameters_are_named(parameters, name):
    with pytest.raises(ValueError, match=f"^{name}: expected"):
        Samples(**parameters)


def test_the_default_noise_is_visible_but_small():
    cloud = sense(BUMPS)
    assert 0.002 < np.sqrt((distances(cloud, BUMPS) ** 2).mean()) < 0.006


def test_evenly_spread_points_of_a_shape_without_a_surface_are_refused():
    points = Shape("dots", PointCloud(BALL.mesh.vertices))
    with pytest.raises(BadInput, match="^dots: only points of this shape are known.*sensor=uniform"):
        sense(points)
    some = Uniform(count=10).sense(points, generator("sensor")).points
    assert len(some) == 10 and cKDTree(points.cloud.points).query(some)[0].max() == 0
