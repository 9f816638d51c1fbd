"""Signed distances against closed forms, and the rotation between points in correspondence."""

import numpy as np
import pytest
from trimesh import Trimesh
from trimesh.creation import box, icosphere

from bench.geometry.alignment import rotation_between
from bench.geometry.signed_distance import signed_distances

HALF = np.array([0.3, 0.5, 0.7])


def box_distance(points):
    """The distance to an axis-aligned box around the origin: outside to its corner region, inside to a face."""
    beyond = np.abs(points) - HALF
    return np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0)


@pytest.fixture
def points():
    rng = np.random.default_rng(0)
    return np.vstack([rng.uniform(-1.2, 1.2, (4000, 3)), rng.uniform(-1e4, 1e4, (100, 3))])


def test_distances_to_a_box_match_the_closed_form(points):
    mesh = box(2 * HALF)
    distances = signed_distances(mesh, points)
    assert distances.dtype == np.float64 and distances.shape == (len(points),)
    assert np.abs(distances - box_distance(points)).max() < 1e-11
    assert (distances < 0).sum() > 100


def test_a_fine_sphere_is_within_its_sagitta_of_the_closed_form(points):
    mesh = icosphere(subdivisions=5, radius=0.8)
    distances = signed_distances(mesh, points)
    # The vertices are on the sphere, so the mesh is inside of it by at most an edge squared over eight radii, and more
    # in the middle of a face than of an edge: by a third.
    sagitta = mesh.edges_unique_length.max() ** 2 / (6 * 0.8)
    excess = distances - (np.linalg.norm(points, axis=1) - 0.8)
    assert excess.min() > -1e-12 and excess.max() < sagitta < 4e-4


@pytest.mark.parametrize("offset", [1e-6, 1e-4])
def test_the_sign_is_right_close_to_the_surface(offset):
    mesh = icosphere(subdivisions=4)
    for side in (-1, 1):
        points = mesh.triangles_center + side * offset * mesh.face_normals
        assert np.allclose(signed_distances(mesh, points), side * offset, rtol=0, atol=1e-12)


def test_duplicate_vertices_holes_and_degenerate_faces_are_accepted():
    mesh = icosphere(subdivisions=3)
    points = np.random.default_rng(0).uniform(-0.8, 0.8, (500, 3))
    whole = signed_distances(mesh, points)
    soup = Trimesh(
        mesh.vertices[mesh.faces].reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3), process=False
    )
    assert np.array_equal(signed_distances(soup, points), whole)
    # A sliver across the ball is not a surface, however a search tree treats it.
    slivers = Trimesh(mesh.vertices, np.vstack([mesh.faces, [[0, 0, 0], [1, 1, 2]]]), process=False)
    assert np.array_equal(signed_distances(slivers, points), whole)
    holey = Trimesh(mesh.vertices, mesh.faces[40:], process=False)
    assert (signed_distances(holey, 0.5 * points) < 0).all()


def test_no_points_give_no_distances():
    mesh = box()
    assert signed_distances(mesh, np.empty((0, 3))).shape == (0,)


# -- alignment ---------------------------------------------------------------------------------------------------------


def rotation(rng):
    Q, R = np.linalg.qr(rng.normal(size=(3, 3)))
    Q = Q * np.sign(np.diag(R))
    return Q * np.linalg.det(Q)


@pytest.mark.parametrize("flat", [False, True])
def test_a_similarity_is_undone(flat):
    rng = np.random.default_rng(1)
    source, R = rng.normal(size=(50, 3)), rotation(rng)
    if flat:
        source[:, 2] = 0
    found = rotation_between(source, 3 * source @ R.T + (5, 6, 7))
    assert np.abs(found - R).max() < 1e-12


def test_a_mirror_image_gets_the_best_rotation():
    rng = np.random.default_rng(2)
    source = rng.normal(size=(50, 3)) * (3, 2, 1)
    target = source * (-1, 1, 1) + 0.1 * rng.normal(size=source.shape)
    found = rotation_between(source, target)
    assert np.linalg.det(found) == pytest.approx(1)
    p, q = source - source.mean(axis=0), target - target.mean(axis=0)

    def badness(R):
        return ((p @ R.T - q) ** 2).sum()

    assert all(badness(found) <= badness(rotation(rng)) for _ in range(2000))


def test_points_without_correspondence_are_refused():
    with pytest.raises(ValueError, match=r"\(4, 3\) and \(5, 3\)"):
        rotation_between(np.ones((4, 3)), np.ones((5, 3)))
