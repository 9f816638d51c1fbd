"""Nearest neighbours and closest points against naive loops, independent libraries and closed forms."""

import time
from fractions import Fraction

import igl
import numpy as np
import pytest
import trimesh
from scipy.spatial.distance import cdist

from bench import PointCloud, generator
from bench.geometry.closest import TriangleTree
from bench.geometry.mesh_surface import MeshSurface
from bench.geometry.neighbours import OrderedPoints, curve_order

CLOUDS = {
    "gaussian": lambda rng: rng.normal(size=(500, 3)),
    "one": lambda rng: rng.normal(size=(1, 3)),
    "two": lambda rng: rng.normal(size=(2, 3)),
    "all equal": lambda rng: np.full((300, 3), 0.25),
    "mostly copies": lambda rng: np.repeat(rng.normal(size=(40, 3)), 20, axis=0)[rng.permutation(800)],
    "huge outlier": lambda rng: np.vstack([rng.normal(size=(300, 3)), [[1e12, -1e9, 0]]]),
    "flat": lambda rng: rng.normal(size=(400, 3)) * [1, 1, 0],
    "far away": lambda rng: rng.normal(size=(300, 3)) + 1e6,
    "tiny": lambda rng: rng.normal(size=(300, 3)) * 1e-9,
}


@pytest.mark.parametrize("name", CLOUDS)
def test_nearest_neighbours_match_all_pairs(name):
    rng = generator(0, name)
    targets, queries = CLOUDS[name](rng), CLOUDS["gaussian"](rng)
    distance, index = OrderedPoints(queries).nearest_in(OrderedPoints(targets))
    pairs = cdist(queries, targets)
    assert distance == pytest.approx(pairs.min(axis=1), rel=1e-12, abs=1e-15)
    assert pairs[np.arange(len(queries)), index] == pytest.approx(distance, rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("name", CLOUDS)
def test_curve_order_is_a_permutation(name):
    points = CLOUDS[name](generator(1, name))
    assert np.array_equal(np.sort(curve_order(points)), np.arange(len(points)))


def test_the_curve_order_brings_neighbours_together_and_can_be_undone():
    points = generator(2).uniform(-1, 1, (20_000, 3))
    ordered = OrderedPoints(points)
    step = np.linalg.norm(np.diff(ordered.along_curve, axis=0), axis=1).mean()
    assert step < 0.1 * np.linalg.norm(np.diff(points, axis=0), axis=1).mean()
    assert np.array_equal(ordered.restore(ordered.along_curve), points)


def test_points_of_a_frozen_cloud_are_not_touched():
    cloud = PointCloud(generator(3).normal(size=(100, 3)))
    before = cloud.points.copy()
    OrderedPoints(cloud.points).nearest_in(OrderedPoints(cloud.points))
    assert np.array_equal(cloud.points, before)


def test_collapsed_points_take_little_time():
    # A kd-tree leaf of 50,000 equal points would be searched whole by each of 50,000 queries: about a minute.
    queries = OrderedPoints(generator(4).normal(size=(50_000, 3)))
    begin = time.perf_counter()
    distance, _ = queries.nearest_in(OrderedPoints(np.zeros((50_000, 3))))
    assert time.perf_counter() - begin < 5
    assert distance == pytest.approx(np.linalg.norm(queries.points, axis=1), rel=1e-12)


def closest_on_triangle(p, a, b, c):
    """The squared distance of a point to a triangle, in rational arithmetic: no rounding anywhere."""

    def dot(u, v):
        return sum(x * y for x, y in zip(u, v, strict=True))

    def sub(u, v):
        return [x - y for x, y in zip(u, v, strict=True)]

    def to_segment(p, a, b):
        d = sub(b, a)
        t = min(max(dot(sub(p, a), d) / dot(d, d), Fraction(0)), Fraction(1)) if dot(d, d) else Fraction(0)
        r = [x - y - t * z for x, y, z in zip(p, a, d, strict=True)]
        return dot(r, r)

    p, a, b, c = ([Fraction(float(x)) for x in q] for q in (p, a, b, c))
    nearest = min(to_segment(p, a, b), to_segment(p, b, c), to_segment(p, c, a))
    u, v, w = sub(b, a), sub(c, a), sub(p, a)
    uu, uv, vv, wu, wv = dot(u, u), dot(u, v), dot(v, v), dot(w, u), dot(w, v)
    area = uu * vv - uv * uv
    if area > 0:
        s, t = (vv * wu - uv * wv) / area, (uu * wv - uv * wu) / area
        if s >= 0 and t >= 0 and s + t <= 1:
            r = [x - s * y - t * z for x, y, z in zip(w, u, v, strict=True)]
            nearest = min(nearest, dot(r, r))
    return float(nearest) ** 0.5


@pytest.mark.parametrize("squeeze", [1.0, 1e-3, 1e-6, 0.0])
def test_closest_point_against_rational_arithmetic(squeeze):
    rng = generator(5, str(squeeze))
    triangles = rng.normal(size=(6, 3, 3))
    along = rng.uniform(size=(6, 1))  # towards a needle: the third corner approaches the opposite edge
    foot = triangles[:, 0] * (1 - along) + triangles[:, 1] * along
    triangles[:, 2] = foot + squeeze * (triangles[:, 2] - foot)
    queries = rng.normal(size=(40, 3))
    found = TriangleTree(triangles.reshape(-1, 3), np.arange(18).reshape(6, 3)).closest(queries)
    exact = np.array([[closest_on_triangle(q, *t) for t in triangles] for q in queries])
    assert found.distance == pytest.approx(exact.min(axis=1), rel=1e-9)
    assert exact[np.arange(40), found.faces] == pytest.approx(found.distance, rel=1e-9)
    assert np.linalg.norm(queries - found.points, axis=1) == pytest.approx(found.distance, rel=1e-9)


def bumpy_sphere(subdivisions=4):
    mesh = trimesh.creation.icosphere(subdivisions)
    x, y, z = mesh.vertices.T
    scale = 1 + 0.15 * np.sin(5 * x) * np.cos(4 * y) * np.cos(3 * z)
    return trimesh.Trimesh(mesh.vertices * scale[:, None], mesh.faces, process=False)


def test_closest_agrees_with_igl_on_a_bumpy_sphere():
    mesh = bumpy_sphere()
    queries = generator(6).normal(size=(5000, 3))
    squared, _, closest = igl.point_mesh_squared_distance(queries, np.array(mesh.vertices), np.array(mesh.faces))
    found = MeshSurface(mesh).project(queries)
    assert found.distance == pytest.approx(np.sqrt(squared), rel=1e-12)
    ties = np.linalg.norm(found.points - closest, axis=1) > 1e-9  # two closest points at equal distance
    assert ties.mean() < 1e-3


def test_samples_lie_on_their_faces():
    mesh = bumpy_sphere()
    surface = MeshSurface(mesh)
    points, normals = surface.sample(3000, generator(7))
    assert surface.project(points).distance.max() < 1e-14
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1)
    closest, there = surface.closest(points + 1e-4 * normals)
    assert np.einsum("ni,ni->n", normals, there).min() > 0.8
    assert np.linalg.norm(closest - points, axis=1).max() < 2e-4


def test_closest_ignores_faces_without_area():
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [3, 0, 0], [5, 0, 0.0]])
    faces = [[0, 1, 1], [1, 4, 5], [0, 1, 2], [0, 2, 3], [2, 2, 2]]
    closest, normals = MeshSurface(trimesh.Trimesh(square, faces, process=False)).closest(
        np.array([[0.5, 0, 0.2], [4, 0, 0], [1, 1, 1]])
    )
    assert closest == pytest.approx(np.array([[0.5, 0, 0], [1, 0, 0], [1, 1, 0]]))
    assert normals == pytest.approx(np.array([[0, 0, 1.0]] * 3))
    flat = MeshSurface(trimesh.Trimesh(square, [[0, 1, 1]], process=False))
    assert flat.project(np.array([[0.5, 0, 2]])).distance == pytest.approx([2])


def test_an_empty_set_of_points_is_accepted():
    from trimesh.creation import icosphere

    from bench.geometry.mesh_surface import MeshSurface

    surface, none = MeshSurface(icosphere(subdivisions=1)), np.empty((0, 3))
    assert [len(part) for part in surface.closest(none)] == [0, 0]
    assert len(OrderedPoints(none).nearest_in(OrderedPoints(np.eye(3))).distance) == 0
