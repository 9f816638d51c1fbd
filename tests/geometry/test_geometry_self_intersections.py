"""Crossing faces: the results and the time of MeshLab, and vertices that no face uses."""

import time
from functools import cache

import numpy as np
import pytest
import trimesh

from bench import generator
from bench.geometry.self_intersections import self_intersecting_faces


def by_meshlab(mesh):
    """The crossing faces, and the CPU seconds taken."""
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(np.array(mesh.vertices), np.array(mesh.faces)))
    start = time.process_time()
    meshes.compute_selection_by_self_intersections_per_face()
    return meshes.current_mesh().face_selection_array(), time.process_time() - start


def ours(mesh):
    start = time.process_time()
    found = self_intersecting_faces(np.array(mesh.vertices), np.array(mesh.faces))
    return found, time.process_time() - start


def bodies(rng, count=24):
    balls = [trimesh.creation.icosphere(3 + k % 2, radius=rng.uniform(0.1, 0.35)) for k in range(count)]
    for ball in balls:
        ball.apply_translation(rng.uniform(-0.6, 0.6, 3))
    return trimesh.util.concatenate(balls)


def noisy(rng):
    ball = trimesh.creation.icosphere(5)
    return trimesh.Trimesh(ball.vertices + 0.01 * rng.normal(size=ball.vertices.shape), ball.faces, process=False)


def soup(rng):
    size = rng.choice([0.003, 0.03, 0.2], (3000, 1, 1))
    corners = rng.uniform(-1, 1, (3000, 1, 3)) + size * rng.normal(size=(3000, 3, 3))
    return trimesh.Trimesh(corners.reshape(-1, 3), np.arange(9000).reshape(-1, 3), process=False)


def fine_and_coarse(rng):
    """A fine torus with twelve faces through it that are as long as itself."""
    torus = trimesh.creation.torus(1, 0.3, major_sections=250, minor_sections=100)
    return trimesh.util.concatenate([torus, trimesh.creation.box((2.6, 0.3, 0.3))])


@cache
def solved(make, seed=0):
    """A mesh and the result of MeshLab for it."""
    mesh = make(generator(seed, make.__name__))
    return mesh, *by_meshlab(mesh)


@pytest.mark.parametrize(
    ("make", "seed"), [(bodies, 0), (bodies, 1), (noisy, 0), (soup, 0), (soup, 1), (fine_and_coarse, 0)]
)
def test_the_results_of_meshlab(make, seed):
    mesh, theirs, _ = solved(make, seed)
    found, _ = ours(mesh)
    assert found.any() and (found == theirs).all()


@pytest.mark.parametrize("make", [bodies, noisy, fine_and_coarse])
def test_it_takes_at_most_a_few_times_as_long_as_meshlab(make):
    # About twice on an idle machine; comparing all faces in cells of the largest one's size takes 200 times as long.
    mesh, _, theirs = solved(make, 0)
    assert any(ours(mesh)[1] < 4 * max(theirs, 0.1) for _ in range(3))


def test_vertices_that_no_face_uses_and_the_order_of_faces_do_not_matter():
    mesh, rng = soup(generator(3)), generator(4)
    found, _ = ours(mesh)
    stray = trimesh.Trimesh(np.vstack([mesh.vertices, [[1e9, 1e9, 1e9]]]), mesh.faces, process=False)
    assert (ours(stray)[0] == found).all()
    order = rng.permutation(len(mesh.faces))
    assert (ours(trimesh.Trimesh(mesh.vertices, mesh.faces[order], process=False))[0] == found[order]).all()


def test_many_faces_in_one_place():
    """A face that is known to cross another is not tested again, but the others are still tested against it."""
    rng = generator(5)
    corners = rng.normal(size=(600, 3, 3))
    far = corners[:5] + 100.0
    mesh = trimesh.Trimesh(np.vstack([corners, far]).reshape(-1, 3), np.arange(1815).reshape(-1, 3), process=False)
    assert (ours(mesh)[0] == by_meshlab(mesh)[0]).all()
