"""Packed shapes: what comes out is what went in, rounded; and the figures that the module states."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from bench.pages.packing import STEPS, WORST, pack, quantised, unpack


def same(shape, other):
    assert np.array_equal(shape.positions, other.positions) and shape.positions.dtype == other.positions.dtype
    assert np.array_equal(shape.low, other.low) and shape.step == other.step
    for name in ("faces", "errors", "normals"):
        a, b = getattr(shape, name), getattr(other, name)
        assert (a is None) == (b is None) and (a is None or np.array_equal(a, b))


def triangles(points, faces, errors):
    """The triangles as a multiset, whatever the order of vertices and faces, and the corner that they begin with."""
    corners = [list(map(tuple, face)) for face in np.column_stack([points, errors])[faces].tolist()]
    return sorted(min(face[k:] + face[:k] for k in range(3)) for face in corners)


def rounded(shape, points, errors):
    steps = np.rint((np.asarray(points) - shape.low) / np.float64(shape.step)).clip(0, STEPS)
    return np.float64(shape.low) + steps * np.float64(shape.step), np.rint(np.clip(errors, 0, 1) * WORST)


def check(points, faces):
    errors = np.random.default_rng(0).uniform(0, 1.2, len(points))
    shape = quantised(points, faces, errors)
    same(unpack(pack(shape)), shape)
    places, shades = rounded(shape, points, errors)
    assert triangles(shape.points, shape.faces, shape.errors) == triangles(places, faces, shades)
    return shape


def random_faces(seed, vertices=40, faces=120):
    generator = np.random.default_rng(seed)
    return generator.normal(size=(vertices, 3)), generator.integers(0, vertices, size=(faces, 3))


@pytest.mark.parametrize(
    "mesh", [trimesh.creation.box(), trimesh.creation.icosphere(3), trimesh.creation.torus(1, 0.3)]
)
def test_a_mesh_comes_back_as_it_was_quantised(mesh):
    check(mesh.vertices, mesh.faces)


@pytest.mark.parametrize("seed", range(20))
def test_soups_come_back_with_edges_of_many_faces_degenerate_faces_and_both_orientations(seed):
    check(*random_faces(seed))


def test_many_components_and_unused_vertices():
    ball = trimesh.creation.icosphere(1)
    several = trimesh.util.concatenate([ball.copy().apply_translation([3 * k, 0, 0]) for k in range(7)])
    points = np.concatenate([np.full((5, 3), 99.0), several.vertices])
    shape = check(points, several.faces + 5)
    assert len(shape.positions) == len(several.vertices) and shape.points.max() < 50


def test_rounding_is_at_most_half_a_step_of_the_longest_side():
    mesh = trimesh.creation.icosphere(3, radius=0.7)
    shape = quantised(mesh.vertices, mesh.faces)
    from scipy.spatial import cKDTree

    assert shape.step == pytest.approx(1.4 / STEPS, rel=1e-6)
    assert cKDTree(mesh.vertices).query(shape.points)[0].max() <= shape.step * np.sqrt(3) / 2 * 1.01


def test_clouds_keep_their_errors_and_normals_and_lie_along_a_curve():
    normals = np.random.default_rng(1).normal(size=(2000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    errors = (normals[:, 2] + 1) / 2
    shape = quantised(normals, None, errors, normals)
    same(unpack(pack(shape)), shape)
    xy = shape.normals / 127.0 - 1  # decoded as Cigolle et al. (2014) do
    z = 1 - np.abs(xy).sum(axis=1)
    folded = (1 - np.abs(xy[:, ::-1])) * np.where(xy >= 0, 1, -1)
    decoded = np.column_stack([np.where(z[:, None] < 0, folded, xy), z])
    decoded /= np.linalg.norm(decoded, axis=1, keepdims=True)
    assert np.abs(decoded - shape.points).max() < 0.02
    assert np.abs(shape.errors / WORST - (shape.points[:, 2] + 1) / 2).max() < 0.5 / WORST + 1e-4
    steps = np.linalg.norm(np.diff(shape.points, axis=0), axis=1)
    assert np.median(steps) < 0.1 < np.median(np.linalg.norm(np.diff(normals, axis=0), axis=1))


@pytest.mark.parametrize("points, faces", [(np.empty((0, 3)), None), (np.ones((4, 3)), np.empty((0, 3), int))])
def test_empty_shapes(points, faces):
    shape = quantised(points, faces, np.zeros(len(points)))
    same(unpack(pack(shape)), shape)
    assert not len(shape.positions)


def test_one_point_and_one_flat_point_set():
    same(unpack(pack(quantised(np.ones((1, 3))))), quantised(np.ones((1, 3))))
    flat = np.random.default_rng(2).uniform(size=(50, 3)) * [1, 1, 0]
    same(unpack(pack(quantised(flat))), quantised(flat))


def test_the_same_shape_has_the_same_bytes_and_a_smooth_surface_takes_few():
    ball = trimesh.creation.icosphere(5)
    points = ball.vertices * (1 + 0.1 * np.sin(5 * ball.vertices[:, :1]))
    data = pack(quantised(points, ball.faces, np.abs(points[:, 0])))
    assert data == pack(quantised(points, ball.faces, np.abs(points[:, 0])))
    assert len(data) < 9 * len(points)


def test_something_else_is_refused():
    with pytest.raises(ValueError, match="no packed shape"):
        unpack(b"glTF\x02\0\0\0")
