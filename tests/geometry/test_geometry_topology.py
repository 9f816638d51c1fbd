"""Topology counts of surfaces whose counts are known, and against trimesh."""

import numpy as np
import pytest
import trimesh

from bench.geometry.topology import count_topology

TETRAHEDRON = (
    np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]),
    np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]),
)


def of(mesh):
    return count_topology(mesh.vertices, mesh.faces)


def joined(*meshes):
    return trimesh.util.concatenate(meshes)


def shifted(mesh, x):
    return mesh.copy().apply_translation([x, 0, 0])


def strip(turns, n=24):
    """A band of n quads whose ends are joined after a number of half-turns: 1 is a Moebius strip."""
    angle = 2 * np.pi * np.arange(n) / n
    tilt = turns * angle / 2
    sides = [(1 + s * np.cos(tilt)) * np.array([np.cos(angle), np.sin(angle), 0 * angle]) for s in (-0.3, 0.3)]
    for side, s in zip(sides, (-0.3, 0.3), strict=True):
        side[2] = s * np.sin(tilt)
    faces = []
    for i in range(n):
        a, b, c, d = i, n + i, i + 1, n + i + 1
        if i == n - 1:
            c, d = (0, n) if turns % 2 == 0 else (n, 0)
        faces += [[a, b, c], [c, b, d]]
    return np.hstack(sides).T, np.array(faces)


def test_tetrahedron():
    assert count_topology(*TETRAHEDRON) == (1, 0, 0, True, 0)


@pytest.mark.parametrize(
    ("mesh", "expected"),
    [
        (trimesh.creation.torus(1, 0.3), (1, 1, 0, True, 0)),
        (joined(trimesh.creation.icosphere(2), shifted(trimesh.creation.icosphere(1), 3)), (2, 0, 0, True, 0)),
        (joined(trimesh.creation.torus(1, 0.3), shifted(trimesh.creation.torus(1, 0.3), 4)), (2, 2, 0, True, 0)),
        (trimesh.creation.annulus(0.5, 1, 0.2), (1, 1, 0, True, 0)),
    ],
    ids=["torus", "two spheres", "two tori", "ring"],
)
def test_closed_surfaces(mesh, expected):
    assert of(mesh) == expected


def test_open_disc_and_sphere_with_holes():
    corner = np.array([[np.cos(a), np.sin(a), 0] for a in np.linspace(0, 2 * np.pi, 9)[:-1]] + [[0, 0, 0.0]])
    fan = np.array([[i, (i + 1) % 8, 8] for i in range(8)])
    assert count_topology(corner, fan) == (1, 0, 8, False, 0)
    sphere = trimesh.creation.icosphere(2)
    apart = np.setdiff1d(np.arange(len(sphere.faces)), [0, 200, 300])
    assert count_topology(sphere.vertices, sphere.faces[apart]) == (1, 0, 9, False, 0)


def test_torus_with_a_hole_keeps_its_genus():
    torus = trimesh.creation.torus(1, 0.3)
    assert count_topology(torus.vertices, torus.faces[1:]) == (1, 1, 3, False, 0)


def test_bands():
    assert count_topology(*strip(turns=0)) == (1, 0, 48, False, 0)
    assert count_topology(*strip(turns=1)) == (1, None, 48, False, None)  # not orientable: the boundary is one loop


def test_flipped_faces_do_not_matter():
    V, F = TETRAHEDRON
    for flips in range(16):
        flipped = np.array([f[::-1] if flips >> i & 1 else f for i, f in enumerate(F)])
        turned = bin(flips).count("1")
        assert count_topology(V, flipped) == (1, 0, 0, True, min(turned, 4 - turned))


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.5, 0.8, 1.0])
def test_flipped_faces_are_counted_in_each_component(share):
    mesh = joined(trimesh.creation.icosphere(3), shifted(trimesh.creation.torus(1, 0.3), 4))
    part = np.arange(len(mesh.faces)) >= 1280
    flipped = np.random.default_rng(0).random(len(mesh.faces)) < share
    faces = np.where(flipped[:, None], mesh.faces[:, ::-1], mesh.faces)
    expected = sum(min(flipped[p].sum(), (~flipped[p]).sum()) for p in (part, ~part))
    assert count_topology(mesh.vertices, faces) == (2, 1, 0, True, expected)


def test_non_manifold_edge():
    V = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1.0]])
    assert count_topology(V, [[0, 1, 2], [0, 1, 3], [0, 1, 4]]) == (1, None, 6, False, 0)


def test_non_manifold_vertex():
    V, F = TETRAHEDRON
    # Two tetrahedra that touch in one vertex: closed, two components, but not manifold at that vertex.
    assert count_topology(np.vstack([V, -V]), np.vstack([F, F + 4])) == (2, None, 0, True, 0)
    # One component that touches itself: a closed fan around a vertex, whose tip another fan uses too.
    disc = [[0, 1, 2], [0, 3, 4], [1, 5, 2], [2, 5, 3], [3, 5, 4]]
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 2, 1], [1, 3, 3], [2, 1, 5.0]])
    assert count_topology(points, disc).genus is None


def test_triangle_soup_is_one_surface():
    torus = trimesh.creation.torus(1, 0.3)
    soup = torus.vertices[torus.faces].reshape(-1, 3)
    soup[::2] += 0.0
    soup[soup == 0] = -0.0  # equal positions, different bits
    assert count_topology(soup, np.arange(len(soup)).reshape(-1, 3)) == of(torus)


def test_degenerate_faces_and_unused_vertices_are_ignored():
    V, F = TETRAHEDRON
    V = np.vstack([[[9, 9, 9.0]], V, V[:1]])
    F = np.vstack([F + 1, [[1, 1, 2], [1, 5, 2], [3, 3, 3]]])
    assert count_topology(V, F) == (1, 0, 0, True, 0)
    assert count_topology(V, [[1, 1, 2]]) == (0, None, 0, False, None)
    assert count_topology(V, np.zeros((0, 3), int)) == (0, None, 0, False, None)


def test_numbering_of_vertices_and_faces_does_not_matter():
    rng = np.random.default_rng(0)
    mesh = joined(trimesh.creation.torus(1, 0.3), shifted(trimesh.creation.icosphere(1), 4))
    renamed = rng.permutation(len(mesh.vertices))
    vertices = np.empty_like(mesh.vertices)
    vertices[renamed] = mesh.vertices
    faces = np.array([np.roll(f, rng.integers(3)) for f in renamed[mesh.faces]])[rng.permutation(len(mesh.faces))]
    assert count_topology(vertices, faces) == (2, 1, 0, True, 0)


@pytest.mark.parametrize("seed", range(8))
def test_random_holes_against_trimesh(seed):
    rng = np.random.default_rng(seed)
    sphere = trimesh.creation.icosphere(3)
    keep = rng.random(len(sphere.faces)) < [0.4, 0.6, 0.8, 0.95][seed % 4]
    mesh = trimesh.Trimesh(sphere.vertices, sphere.faces[keep], process=False)
    found = of(mesh)
    pieces = trimesh.graph.connected_components(mesh.face_adjacency, nodes=np.arange(len(mesh.faces)))
    assert found.components == len(pieces)
    uses = np.unique(mesh.edges_sorted, axis=0, return_counts=True)[1]
    assert found.boundary_edges == (uses == 1).sum()
    assert found.watertight == mesh.is_watertight
    if found.genus is not None:  # part of a sphere: either manifold or without a genus
        assert found.genus == 0


@pytest.mark.parametrize("holes", [0, 1, 2, 5])
def test_genus_against_trimesh_euler_number(holes):
    box = trimesh.creation.box([10, 1, 1])
    drills = [
        trimesh.creation.cylinder(0.2, 3, sections=12).apply_translation([1.5 * i - 4, 0, 0]) for i in range(holes)
    ]
    mesh = trimesh.boolean.difference([box, *drills], engine="manifold") if holes else box
    found = of(mesh)
    assert found.genus == holes == (2 - mesh.euler_number) // 2
    assert found.watertight and mesh.is_watertight
