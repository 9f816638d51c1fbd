"""Stray points far from all others change nothing; sparse regions, scan lines and far objects are not strays."""

import functools
import importlib.util

import numpy as np
import pytest
from scipy.spatial import cKDTree

from bench import PointCloud, Run
from bench.geometry.mesh_surface import MeshSurface
from bench.methods.classical.isolated import isolated
from bench.plugins.registry import registry

CGAL = importlib.util.find_spec("CGAL") is not None
DISTANCES = [3.0, 10.0, 100.0, 1e4, 1e6]  # in radii
QUICK = {"poisson": {"depth": 5}, "ipsr": {"depth": 5, "rounds": 2}, "apss": {"resolution": 30}}
QUICK["rimls"] = {"resolution": 30}
RECONSTRUCT = ["poisson", "ipsr", "apss", "rimls", "ball_pivoting", "alpha_shape"]
RECONSTRUCT += ["alpha_wrap", "advancing_front"] if CGAL else []
DENOISE = ["apss", "rimls", *(["jet", "bilateral"] if CGAL else [])]


def on_sphere(count, radius=1.0, center=(0, 0, 0), seed=0):
    points = np.random.default_rng(seed).standard_normal((count, 3))
    return radius * points / np.linalg.norm(points, axis=1, keepdims=True) + center


def strays(count, distance, seed=1):
    return on_sphere(count, seed=seed) * distance * np.random.default_rng(seed).uniform(1, 1.5, (count, 1))


def rings(ratio):
    """A sphere in 60 lines of latitude, on which points are denser along a line than across by ``ratio``."""
    around = np.arange(0, 2 * np.pi, np.pi / 60 / ratio)
    return np.concatenate(
        [
            np.stack([np.sin(t) * np.cos(around), np.sin(t) * np.sin(around), np.full(len(around), np.cos(t))], axis=1)
            for t in (np.arange(60) + 0.5) * np.pi / 60
        ]
    )


def from_one_place(count, ratio):
    """A floor around a scanner: the spacing grows with the distance, up to ``ratio`` times that below the scanner."""
    rng = np.random.default_rng(0)
    far, angle = np.exp(rng.random(count) * np.log(ratio)), rng.uniform(0, 2 * np.pi, count)
    return np.stack([far * np.cos(angle), far * np.sin(angle), 0 * far], axis=1)


def clusters(count, size):
    rng = np.random.default_rng(0)
    return (rng.random((count, 1, 3)) * 1000 + 0.1 * rng.standard_normal((count, size, 3))).reshape(-1, 3)


LEGITIMATE = {
    "sphere": on_sphere(3000),
    "few points": on_sphere(60),
    "two objects far apart": np.concatenate([on_sphere(2000), on_sphere(2000, center=(1000, 0, 0))]),
    "a small one far off": np.concatenate([on_sphere(5000), on_sphere(60, 0.3, (30, 0, 0), seed=2)]),
    "sparse ground": np.concatenate(
        [on_sphere(5000), np.random.default_rng(3).uniform(-8, 8, (250, 3)) * [1, 1, 0] - [0, 0, 1.2]]
    ),
    "density falls by 100": from_one_place(4000, 10),
    "spacing falls by 100": from_one_place(4000, 100),
    "scan lines, 8 to 1": rings(8),
    "scan lines, 30 to 1": rings(30),
    "clusters of 20": clusters(1000, 20),
    "clusters of 5": clusters(1000, 5),
    "a volume": np.random.default_rng(4).standard_normal((3000, 3)),
    "noise around": np.concatenate([on_sphere(3000), np.random.default_rng(5).uniform(-1, 1, (300, 3))]),
}


@pytest.mark.parametrize("kind", LEGITIMATE)
def test_sparse_regions_are_not_isolated(kind):
    assert isolated(LEGITIMATE[kind]).sum() == 0


@pytest.mark.parametrize("distance", DISTANCES)
@pytest.mark.parametrize("count", [1, 3, 30, 150])
def test_only_strays_are_found(count, distance):
    points = np.concatenate([on_sphere(3000), strays(count, distance)])
    order = np.random.default_rng(6).permutation(len(points))
    assert np.array_equal(isolated(points[order]), order >= 3000)


def test_strays_that_are_duplicates_beside_two_objects_are_found():
    points = np.concatenate([on_sphere(1500), on_sphere(1500, center=(20, 0, 0)), np.tile([[0.0, 50, 0]], (20, 1))])
    assert np.array_equal(np.flatnonzero(isolated(points)), np.arange(3000, 3020))


def built(name):
    return registry().find("method", name).cls(**QUICK.get(name, {}))


def with_strays(points, count, distance, normals):
    """The points mixed with strays, and the rows of the points in that cloud."""
    both = np.concatenate([points, strays(count, distance)])
    order = np.random.default_rng(7).permutation(len(both))
    truth = both / np.linalg.norm(both, axis=1, keepdims=True)
    place = np.argsort(order)[: len(points)]
    return PointCloud(both[order], truth[order] if normals else None), place


@functools.cache
def without_strays(name):
    """The reconstructed sphere that several tests compare with."""
    points = on_sphere(1000)
    return built(name).reconstruct(PointCloud(points, points if name != "ipsr" else None), Run())


@functools.cache
def denoised_without_strays(name, normals):
    """A noisy sphere and its denoised points."""
    points = on_sphere(800) + 0.01 * np.random.default_rng(8).standard_normal((800, 3))
    truth = points / np.linalg.norm(points, axis=1, keepdims=True)
    return points, built(name).denoise(PointCloud(points, truth if normals else None), Run()).points


@pytest.mark.parametrize("count, distance", [(1, 1e6), (30, 10.0)])
@pytest.mark.parametrize("name", RECONSTRUCT)
def test_strays_do_not_change_surfaces(name, count, distance):
    points = on_sphere(1000)
    cloud, place = with_strays(points, count, distance, normals=name != "ipsr")
    run = Run()
    mesh = built(name).reconstruct(cloud, run)
    clean = without_strays(name)
    assert len(mesh.faces) == len(clean.faces)
    assert cKDTree(clean.vertices).query(mesh.vertices)[0].max() < 1e-9
    assert any(f"{name}: {count} isolated point" in note for note in run.notes)
    assert np.linalg.norm(MeshSurface(mesh).closest(cloud.points[place])[0] - cloud.points[place], axis=1).mean() < 0.03


@pytest.mark.parametrize("distance", [10.0, 1e6])
@pytest.mark.parametrize("normals", [True, False])
@pytest.mark.parametrize("name", DENOISE)
def test_strays_do_not_change_denoised_points_and_stay(name, normals, distance):
    points, clean = denoised_without_strays(name, normals)
    cloud, place = with_strays(points, 15, distance, normals)
    output = built(name).denoise(cloud, Run())
    assert len(output) == len(cloud)
    assert np.abs(output.points[place] - clean).max() < 1e-9
    rest = np.setdiff1d(np.arange(len(cloud)), place)
    assert np.array_equal(output.points[rest], cloud.points[rest])
    if output.normals is not None:
        assert np.allclose(np.linalg.norm(output.normals, axis=1), 1)


@pytest.mark.parametrize("name", ["apss", "rimls", "poisson", *(["ear"] if CGAL else [])])
def test_the_number_of_upsampled_points_counts_strays(name):
    cloud, _ = with_strays(on_sphere(800), 8, 100.0, normals=True)
    output = built(name).upsample(cloud, 2, Run())
    assert len(output) == 2 * len(cloud)
    assert np.linalg.norm(output.points, axis=1).max() < 1.2


if CGAL:

    def test_wlop_appends_the_strays():
        cloud, _ = with_strays(on_sphere(800), 3, 100.0, normals=False)
        output = built("wlop").denoise(cloud, Run()).points
        assert len(output) == len(cloud)
        assert (np.linalg.norm(output[:-3], axis=1) < 1.2).all()
        assert {tuple(p) for p in output[-3:]} == {tuple(p) for p in cloud.points[isolated(cloud.points)]}


def test_without_strays_there_is_no_note():
    run = Run()
    built("ball_pivoting").reconstruct(PointCloud(on_sphere(1000)), run)
    assert run.notes == []
