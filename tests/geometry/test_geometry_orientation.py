"""Inconsistently wound faces: winding numbers after they are repaired, against exact volumes."""

import numpy as np
import pytest
import trimesh

from bench import generator
from bench.geometry.orientation import NoSides, oriented
from bench.geometry.signed_distance import signed_distances
from bench.geometry.winding import inside

BALL = trimesh.creation.icosphere(3)
BOX = trimesh.creation.box()


def mesh_of(vertices, faces):
    return trimesh.Trimesh(vertices, faces, process=False)


def moved(mesh, shift=(0, 0, 0), scale=1.0):
    return mesh_of(np.array(mesh.vertices) * scale + shift, mesh.faces)


def inverted(mesh):
    return mesh_of(mesh.vertices, np.array(mesh.faces)[:, ::-1])


def flipped(mesh, share, seed=0):
    chosen = generator(seed, "flips").random(len(mesh.faces)) < share
    return mesh_of(mesh.vertices, np.where(chosen[:, None], np.array(mesh.faces)[:, ::-1], mesh.faces))


def joined(*meshes):
    vertices = np.vstack([mesh.vertices for mesh in meshes])
    offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    return mesh_of(vertices, np.vstack([mesh.faces + o for mesh, o in zip(meshes, offsets, strict=True)]))


HOLLOW = joined(BALL, inverted(moved(BALL, scale=0.5)))
SOLIDS = {
    "ball": BALL,
    "torus": trimesh.creation.torus(1, 0.3),
    "hollow ball": HOLLOW,
    "ball in a hollow ball": joined(HOLLOW, moved(BALL, scale=0.25)),
    "two balls": joined(BALL, moved(BALL, (3, 0, 0))),
    "two balls that overlap": joined(BALL, moved(BALL, (0.8, 0, 0))),
    "two boxes with a common edge": joined(BOX, moved(BOX, (1, 1, 0))),
    "soup": mesh_of(BALL.vertices[BALL.faces].reshape(-1, 3), np.arange(BALL.faces.size).reshape(-1, 3)),
}


def is_in(mesh, faces, points):
    return inside(mesh.vertices, faces, points)


def probes(mesh, count=600):
    low, high = mesh.bounds
    return generator(1, "probes").uniform(low - 0.1, high + 0.1, (count, 3))


@pytest.mark.parametrize("name", SOLIDS)
def test_consistently_wound_faces_are_returned_unchanged(name):
    faces = np.array(SOLIDS[name].faces)
    assert oriented(SOLIDS[name].vertices, faces) is faces


@pytest.mark.parametrize("share", [0.3, 0.5, 1.0])
@pytest.mark.parametrize("name", SOLIDS)
def test_flipped_faces_do_not_change_the_interior(name, share):
    mesh = SOLIDS[name]
    points = probes(mesh)
    spoilt = flipped(mesh, share)
    found = is_in(mesh, oriented(spoilt.vertices, spoilt.faces), points)
    assert (found == is_in(mesh, mesh.faces, points)).mean() > 0.998


@pytest.mark.parametrize("name", SOLIDS)
def test_copies_of_faces_do_not_change_the_interior(name):
    mesh, points = SOLIDS[name], probes(SOLIDS[name])
    expected = is_in(mesh, mesh.faces, points)
    for more in (mesh.faces, mesh.faces[:, ::-1], mesh.faces[:100, ::-1], mesh.faces[:100, [1, 2, 0]]):
        faces = oriented(mesh.vertices, np.vstack([mesh.faces, more]))
        assert len(faces) == len(mesh.faces)
        assert (is_in(mesh, faces, points) == expected).mean() > 0.998


def test_a_protruding_double_sided_sheet_encloses_nothing():
    vertices = np.vstack([BOX.vertices, [[2, 0.5, 0.5], [2, -0.5, 0.5]]])
    a, b = (int(np.abs(BOX.vertices - corner).sum(axis=1).argmin()) for corner in ([0.5, 0.5, 0.5], [0.5, -0.5, 0.5]))
    fin = np.array([[a, b, 8], [b, 9, 8], [a, 8, b], [b, 8, 9]])
    found = oriented(vertices, np.vstack([BOX.faces, fin]))
    assert sorted(map(tuple, found)) == sorted(map(tuple, BOX.faces))


def test_a_body_that_is_inside_out_is_turned_with_its_cavity():
    hollow = moved(HOLLOW, (2.5, 0, 0))
    mesh, right = joined(BALL, inverted(hollow)), joined(BALL, hollow)
    assert np.array_equal(oriented(mesh.vertices, mesh.faces), right.faces)
    overlapping = joined(BALL, inverted(moved(BALL, (0.8, 0, 0))))
    points = probes(overlapping)
    expected = is_in(SOLIDS["two balls that overlap"], SOLIDS["two balls that overlap"].faces, points)
    assert (is_in(overlapping, oriented(overlapping.vertices, overlapping.faces), points) == expected).all()


def test_a_nested_body_stays_solid_where_its_faces_are_consistent():
    nested = joined(BALL, moved(BALL, scale=0.5))
    assert np.array_equal(oriented(nested.vertices, nested.faces), nested.faces)
    spoilt = joined(flipped(BALL, 0.3), moved(BALL, scale=0.5))
    assert np.array_equal(oriented(spoilt.vertices, spoilt.faces), nested.faces)


def test_boxes_with_a_common_edge_of_which_one_is_inside_out():
    right = SOLIDS["two boxes with a common edge"]
    wrong, points = joined(BOX, inverted(moved(BOX, (1, 1, 0)))), probes(right)
    found = is_in(wrong, oriented(wrong.vertices, wrong.faces), points)
    assert np.array_equal(found, is_in(right, right.faces, points))


def test_an_open_mesh_is_wound_consistently_and_outward():
    holed = mesh_of(BALL.vertices, BALL.faces[20:])
    for share in (0.3, 0.7):
        spoilt = flipped(holed, share)
        assert np.array_equal(oriented(spoilt.vertices, spoilt.faces), holed.faces)


def grid_torus(closed_by, n=12, m=8):
    """A grid of n x m quads whose sides are glued: as a torus, or as a Klein bottle, which crosses itself."""
    u, v = np.meshgrid(2 * np.pi * np.arange(n) / n, 2 * np.pi * np.arange(m) / m, indexing="ij")
    turn = u / 2 if closed_by == "klein" else 0 * u
    x, y = np.cos(v), np.sin(2 * v) if closed_by == "klein" else np.sin(v)
    across, up = np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y
    radius = 3 + across
    points = np.stack([radius * np.cos(u), radius * np.sin(u), up], axis=-1).reshape(-1, 3)
    faces = []
    for i in range(n):
        for j in range(m):
            k = (j + 1) % m
            near, far = (i * m + j, i * m + k), ((i + 1) % n * m + j, (i + 1) % n * m + k)
            if (
                i == n - 1 and closed_by == "klein"
            ):  # half a turn takes v to pi - v or v + pi: a reflection of the eight
                far = ((m // 2 - j) % m, (m // 2 - k) % m)
            faces += [(near[0], far[0], near[1]), (near[1], far[0], far[1])]
    return mesh_of(points, np.array(faces))


def test_a_one_sided_surface_is_refused():
    klein = grid_torus("klein")
    with pytest.raises(NoSides, match="Moebius"):
        oriented(klein.vertices, klein.faces)
    torus = grid_torus("torus")
    assert oriented(torus.vertices, torus.faces) is not None


def test_a_randomly_wound_open_non_manifold_mesh_is_refused():
    """Three half planes meet in one line: an open mesh with edges of three faces and random winding."""
    rng = generator(3)
    vertices = [(x, np.cos(a) * y, np.sin(a) * y) for a in (0, 2, 4) for x in range(12) for y in range(6)]
    corners = [72 * s + 6 * x + y for s in range(3) for x in range(11) for y in range(5)]
    faces = np.array([f for c in corners for f in ((c, c + 6, c + 1), (c + 1, c + 6, c + 7))])
    faces = np.where((rng.random(len(faces)) < 0.5)[:, None], faces[:, ::-1], faces)
    with pytest.raises(NoSides, match="wound inconsistently"):
        oriented(np.array(vertices), faces)


def test_a_few_contradictory_faces_do_not_affect_the_rest_of_a_surface():
    """Fins on an open ball, wound inconsistently with the ball and with each other."""
    holed, rng = BALL.faces[10:], generator(4)
    spots = rng.choice(len(holed), 5, replace=False)
    vertices = np.vstack([BALL.vertices, BALL.vertices[holed[spots, 0]] * 1.05])
    fins = [(holed[s, 0], holed[s, 1], len(BALL.vertices) + k) for k, s in enumerate(spots)]
    mesh = mesh_of(vertices, np.vstack([holed, fins]))
    points = probes(BALL)
    found = is_in(mesh, oriented(mesh.vertices, mesh.faces), points)
    assert (found == is_in(BALL, BALL.faces, points)).mean() > 0.98


def test_signed_distances_to_a_mesh_with_flipped_faces():
    points = probes(BALL, 500)
    found = signed_distances(flipped(BALL, 0.4), points)
    assert found == pytest.approx(signed_distances(BALL, points), abs=1e-12)


def test_vertices_that_no_face_uses_and_faces_without_an_area():
    vertices = np.vstack([BALL.vertices, [[9, 9, 9]]])
    faces = np.vstack([flipped(BALL, 0.3).faces, [[0, 0, 642], [642, 642, 642]]])
    found = oriented(vertices, faces)
    assert np.array_equal(found, BALL.faces)
