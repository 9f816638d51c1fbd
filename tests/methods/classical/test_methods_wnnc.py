"""Winding number normal consistency: estimated normals are outward, and the surface is near."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from bench import PointCloud, Run
from bench.geometry.mesh_surface import MeshSurface
from bench.geometry.poisson_disk import eliminate
from bench.methods.classical.wnnc import Wnnc
from bench.plugins.registry import registry


def comb():
    """Blades on a bar: walls of 0.1 with gaps of 0.35."""
    parts = [trimesh.creation.box((2.0, 0.2, 0.6))]
    for x in np.linspace(-0.9, 0.9, 5):
        parts.append(trimesh.creation.box((0.1, 0.9, 0.6)).apply_translation((x, 0.54, 0)))
    return trimesh.boolean.union(parts, engine="manifold")


def hollow():
    """A ball of radius 1 with a cavity of radius 0.5."""
    inner = trimesh.creation.icosphere(4, radius=0.5)
    inner.invert()
    return trimesh.util.concatenate([trimesh.creation.icosphere(4), inner])


SHAPES = {
    "sphere": lambda: trimesh.creation.icosphere(4),
    "torus": lambda: trimesh.creation.torus(0.7, 0.25, 64, 32),
    "comb": comb,
    "hollow": hollow,
    "furniture": lambda: next(iter(registry().find("dataset", "furniture").cls().shapes("train"))).framed()[0].mesh,
}


def cloud_of(shape, sigma, count=2500):
    """Noisy points, and the outward normals of the shape at their exact positions."""
    mesh, rng = SHAPES[shape](), np.random.default_rng(3)
    points, normals = eliminate(*MeshSurface(mesh).sample(5 * count, rng), mesh, count)
    return mesh, points + sigma * rng.standard_normal(points.shape), normals


def reconstructed(points, normals=None, **parameters):
    """The mesh, and the estimated normals in the order of the points."""
    kept = {}
    method = Wnnc(**{"depth": 6, **parameters})
    mesh = method.reconstruct(PointCloud(points, normals), Run(on_keep=kept.__setitem__))
    oriented = kept["oriented"]
    return mesh, oriented.normals[cKDTree(oriented.points).query(points)[1]]


def wrong_share(normals, truth):
    return (np.einsum("ni,ni->n", normals, truth) < 0).mean()


@pytest.mark.parametrize("shape", ["torus", "comb", "hollow", "furniture"])
def test_normals_are_outward_and_the_surface_is_near(shape):
    count = 5000 if shape == "furniture" else 2500
    truth, points, normals = cloud_of(shape, 0.005, count)
    mesh, found = reconstructed(points, depth=7 if shape in ("furniture", "comb") else 6)
    assert wrong_share(found, normals) < 0.015
    assert np.allclose(np.linalg.norm(found, axis=1), 1)
    assert mesh.volume > 0
    samples = MeshSurface(mesh).sample(1500, np.random.default_rng(0))[0]
    assert (
        np.linalg.norm(MeshSurface(truth).closest(samples)[0] - samples, axis=1).mean() < 0.015
    )  # a third of a spacing


def test_noise_above_the_spacing_is_detected_and_increases_widths():
    _, points, normals = cloud_of("sphere", 0.1, 4000)
    few = {"depth": 5, "rounds": 12}
    aware, unaware = (wrong_share(reconstructed(points, noise=noise, **few)[1], normals) for noise in (2.0, 0.0))
    assert aware < 0.5 * unaware


def test_given_normals_are_ignored_and_runs_are_equal():
    _, points, normals = cloud_of("torus", 0.005, 1000)
    without, wrong = (reconstructed(points, n, depth=5, rounds=5)[0] for n in (None, -normals))
    assert np.array_equal(without.vertices, wrong.vertices) and np.array_equal(without.faces, wrong.faces)


def test_it_stops_before_the_time_limit_and_reports_it():
    _, points, _ = cloud_of("torus", 0.0, 1000)
    run = Run(seconds=1e-3)
    mesh = Wnnc(depth=5).reconstruct(PointCloud(points), run)
    assert len(mesh.faces) and "stopped after 1 of 40 rounds" in run.notes[0]


@pytest.mark.parametrize(
    "wrong",
    [
        {"depth": 4},
        {"rounds": 0},
        {"widths": (2.0, 1.0)},
        {"widths": (0.0, 1.0)},
        {"opening": 1.0},
        {"noise": -1.0},
        {"scale": 0.5},
    ],
)
def test_parameters_out_of_range_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong)) + ": expected"):
        Wnnc(**wrong)
