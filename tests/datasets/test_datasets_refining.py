"""Meshes refined where their surface deviates from them: closed forms, and exact samples of families."""

from itertools import islice

import numpy as np
import pytest
from trimesh import Trimesh
from trimesh.creation import icosphere, torus

from bench import generator
from bench.datasets.blobs import Blobs
from bench.datasets.fbm import Fbm
from bench.datasets.smooth_csg import SmoothCsg
from bench.datasets.surfaces.refining import refined
from bench.datasets.tpms import Tpms
from bench.geometry.closest import TriangleTree
from bench.geometry.self_intersections import self_intersecting_faces
from bench.geometry.topology import count_topology


def onto_ball(middles, _):
    return middles / np.linalg.norm(middles, axis=1, keepdims=True)


def onto_ring(middles, _):
    """The torus about z of radius 1 and tube radius 0.3."""
    spine = middles * [1, 1, 0] / np.linalg.norm(middles[:, :2], axis=1, keepdims=True)
    away = middles - spine
    return spine + 0.3 * away / np.linalg.norm(away, axis=1, keepdims=True)


@pytest.mark.parametrize(
    ("mesh", "onto"), [(icosphere(1), onto_ball), (torus(1, 0.3, major_sections=12, minor_sections=8), onto_ring)]
)
def test_all_midpoints_are_within_the_tolerance_and_the_topology_stays(mesh, onto):
    before = count_topology(mesh.vertices, mesh.faces)
    V, F = refined(mesh.vertices, mesh.faces, onto, tolerance=1e-3)
    assert count_topology(V, F) == before and (V[: len(mesh.vertices)] == mesh.vertices).all()
    new = V[len(mesh.vertices) :]
    assert np.abs(onto(new, None) - new).max() < 1e-12
    edges = np.unique(np.sort(np.concatenate([F[:, :2], F[:, 1:], F[:, ::2]]), axis=1), axis=0)
    middles = V[edges].mean(axis=1)
    radius = np.linalg.norm(mesh.vertices - mesh.bounds.mean(axis=0), axis=1).max()
    assert np.linalg.norm(onto(middles, None) - middles, axis=1).max() < 1.001e-3 * radius
    fine = Trimesh(V, F, process=False)
    assert fine.volume > mesh.volume > 0 and fine.is_winding_consistent
    assert not self_intersecting_faces(V, F).any()


def test_flat_regions_stay_and_only_a_bend_is_refined():
    """A sheet with a bend of radius 0.1 along y: only edges around the bend deviate."""

    def at(u):
        turn = np.clip(u / 0.1, 0, np.pi / 2)
        over = np.maximum(u - 0.1 * np.pi / 2, 0)
        return 0.1 * np.sin(turn) + np.minimum(u, 0), 0.1 * (1 - np.cos(turn)) + over

    u, y = (m.ravel() for m in np.meshgrid(np.linspace(-1, 1, 21), np.linspace(0, 1, 6), indexing="ij"))
    x, z = at(u)
    number = np.arange(len(u)).reshape(21, 6)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)
    F = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    places = np.stack([u, y], axis=1)[F]
    seen = []

    def onto(middles, between):
        seen.append(between)
        x, z = at(between[:, 0])
        return np.stack([x, between[:, 1], z], axis=1)

    V, G = refined(np.stack([x, y, z], axis=1), F, onto, places, tolerance=1e-4)
    new = V[len(u) :]
    assert len(new) and ((new[:, 0] > -1e-9) & (new[:, 2] < 0.1 + 1e-9)).mean() > 0.9
    assert (V[:, 1] >= 0).all() and count_topology(V, G).genus == 0 and len(seen) > 1


def test_the_number_of_faces_is_limited_and_the_worst_are_refined_first():
    ball = icosphere(2)
    V, F = refined(
        ball.vertices * [3, 1, 1], ball.faces, lambda m, _: onto_ball(m / [3, 1, 1], _) * [3, 1, 1], most=600
    )
    assert len(ball.faces) < len(F) <= 600
    new = V[len(ball.vertices) :]
    assert np.abs(new[:, 0]).mean() > 1.5  # at the pointed ends


def test_refinement_that_would_cause_self_intersections_is_omitted():
    """Midpoints that move far beyond their neighbours, as where a mesh cuts off a deep crease."""
    ball = icosphere(2)

    def shifted(middles, _):
        return onto_ball(middles, _) + np.where(middles[:, 2:] > 0.95, [0.25, 0, -0.1], 0)

    V, F = refined(ball.vertices, ball.faces, shifted, tolerance=4e-3)
    assert not self_intersecting_faces(V, F).any() and count_topology(V, F).watertight
    assert len(F) > 3 * len(ball.faces)  # except around these points
    assert np.linalg.norm(V, axis=1) == pytest.approx(1)


# The mean and the largest distance of exact samples, in radii; without refinement the largest is 3e-3 or more.
ACCURATE = [(SmoothCsg, 1, 1e-4, 4e-4), (Fbm, 3, 1e-4, 4e-4), (Tpms, 1, 1e-4, 4e-4), (Blobs, 1, 1.2e-4, 1e-3)]


@pytest.mark.parametrize(("family", "index", "mean", "largest"), ACCURATE, ids=lambda x: getattr(x, "__name__", None))
def test_exact_samples_are_near_the_mesh(family, index, mean, largest):
    shape, _ = next(islice(family().shapes("test"), index, None)).framed()
    points = shape.surface.sample(20_000, generator(0))[0]
    distance = TriangleTree(shape.mesh.vertices, shape.mesh.faces).closest(points).distance
    assert distance.mean() < mean and distance.max() < largest
    assert len(shape.mesh.faces) <= 200_000 and 10_000 <= len(shape.mesh.vertices) <= 105_000
    counts = count_topology(shape.mesh.vertices, shape.mesh.faces)
    assert counts.watertight and (counts.components, counts.genus) == (1, shape.info.get("genus", counts.genus))
    assert shape.mesh.is_winding_consistent and shape.mesh.volume > 0
    assert len(np.unique(shape.mesh.vertices, axis=0)) == len(shape.mesh.vertices)
    assert shape.mesh.area_faces.min() > 1e-6 * shape.mesh.area_faces.mean()
