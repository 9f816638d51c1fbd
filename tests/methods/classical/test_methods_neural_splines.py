"""Neural Splines: known surfaces, and the effect of parameters."""

import numpy as np
import pytest
import trimesh

from bench import PointCloud, Run
from bench.geometry.mesh_surface import MeshSurface
from bench.methods.classical.neural_splines import NeuralSplines

SMALL = {"centers": 150, "resolution": 16}
SHAPES = {
    "sphere": trimesh.creation.icosphere(4),
    "torus": trimesh.creation.torus(0.7, 0.25, 64, 32),
    "box": trimesh.creation.box((1.0, 0.8, 0.6)),
}


def cloud_of(shape, sigma=0.0, count=1000):
    rng = np.random.default_rng(3)
    points, normals = MeshSurface(SHAPES[shape]).sample(count, rng)
    return PointCloud(points + sigma * rng.standard_normal(points.shape), normals)


def off(mesh, shape):
    """The mean distance from a mesh to the shape."""
    samples = MeshSurface(mesh).sample(1500, np.random.default_rng(0))[0]
    return np.linalg.norm(MeshSurface(SHAPES[shape]).closest(samples)[0] - samples, axis=1).mean()


@pytest.mark.parametrize("shape", ["torus", "box"])
def test_the_surface_is_closed_accurate_and_outward(shape):
    mesh = NeuralSplines(**SMALL).reconstruct(cloud_of(shape), Run())
    assert mesh.is_watertight and mesh.volume == pytest.approx(SHAPES[shape].volume, rel=0.03)
    assert off(mesh, shape) < 0.006


def test_a_larger_reach_smooths_noise_away():
    cloud = cloud_of("sphere", 0.02)
    held, smooth = (off(NeuralSplines(reach=reach, **SMALL).reconstruct(cloud, Run()), "sphere") for reach in (0.2, 4))
    assert smooth < 0.6 * held


def test_more_centres_keep_more_detail():
    few, many = (NeuralSplines(centers=n, resolution=16).reconstruct(cloud_of("box"), Run()) for n in (60, 300))
    assert off(many, "box") < 0.7 * off(few, "box")


def test_scale_and_position_do_not_matter_and_runs_are_equal():
    cloud = cloud_of("box", count=500)
    mesh, again = (NeuralSplines(**SMALL).reconstruct(cloud, Run(seed=1)) for _ in range(2))
    assert np.array_equal(mesh.vertices, again.vertices)
    moved = PointCloud(100 * cloud.points + [5, 6, 7], cloud.normals)
    away = NeuralSplines(**SMALL).reconstruct(moved, Run(seed=1))
    assert off(trimesh.Trimesh((away.vertices - [5, 6, 7]) / 100, away.faces, process=False), "box") < 0.01


def test_a_flat_cloud_does_not_refine_the_lattice():
    """A sheet of sides 2, on a lattice of at least 16 cells across 0.8: edges of half a cell, not of an eighth."""
    x, y = np.random.default_rng(2).uniform(-1, 1, (2, 500))
    sheet = PointCloud(np.stack([x, y, 0 * x], axis=1), np.tile([[0.0, 0.0, 1.0]], (500, 1)))
    mesh = NeuralSplines(centers=60, resolution=16).reconstruct(sheet, Run())
    assert np.median(mesh.edges_unique_length) > 0.025
    assert np.abs(mesh.vertices[:, 2]).max() < 0.02


def test_missing_normals_are_estimated():
    mesh = NeuralSplines(**SMALL).reconstruct(PointCloud(cloud_of("sphere").points), Run())
    assert off(mesh, "sphere") < 0.01 and mesh.volume > 0


def test_a_short_time_limit_is_met_and_reported():
    run = Run(seconds=0.05)
    mesh = NeuralSplines(centers=250, resolution=64).reconstruct(cloud_of("sphere"), run)
    assert len(mesh.faces) and "were fitted in half of the time limit" in run.notes[0]


@pytest.mark.parametrize("wrong", [{"centers": 3}, {"regularisation": 0.0}, {"reach": -1.0}, {"resolution": 4}])
def test_parameters_out_of_range_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong)) + ": expected"):
        NeuralSplines(**wrong)
