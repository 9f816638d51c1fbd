"""Triangulated polygons: the area of a flat one does not depend on its first corner, and nothing crashes."""

from __future__ import annotations

import time

import numpy as np
import pytest
import trimesh

from bench.geometry.io.files import load_mesh
from bench.geometry.io.polygons import triangulate

L = [(1, 1), (1, 2), (0, 2), (0, 0), (2, 0), (2, 1)]
ARROW = [(0, 0), (2, 1), (0, 2), (0.5, 1)]
TURN = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3])[:3, :3]


def star(corners=20, inner=0.4):
    angle = 2 * np.pi * np.arange(corners) / corners
    return np.column_stack([np.cos(angle), np.sin(angle)]) * np.where(np.arange(corners) % 2, inner, 1)[:, None]


def prism(polygon):
    """The polygon extruded by 1, turned in space, as vertices and polygons that face outward."""
    polygon = np.asarray(polygon, dtype=float)
    x, y = polygon.T
    if (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() < 0:
        polygon = polygon[::-1]
    n = len(polygon)
    vertices = np.vstack([np.column_stack([polygon, np.full(n, z)]) for z in (0.0, 1.0)]) @ TURN.T
    sides = [[k, (k + 1) % n, n + (k + 1) % n, n + k] for k in range(n)]
    return vertices, [list(range(n))[::-1], list(range(n, 2 * n)), *sides]


def shoelace(polygon):
    x, y = np.asarray(polygon, dtype=float).T
    return abs((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) / 2


def perimeter(polygon):
    return np.linalg.norm(np.roll(polygon, -1, axis=0) - polygon, axis=1).sum()


def write(path, vertices, polygons):
    if path.suffix == ".obj":
        rows = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
        rows += ["f " + " ".join(str(k + 1) for k in polygon) for polygon in polygons]
    else:
        rows = [f"{x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
        rows += [f"{len(polygon)} " + " ".join(map(str, polygon)) for polygon in polygons]
        head = ["OFF", f"{len(vertices)} {len(polygons)} 0"]
        if path.suffix == ".ply":
            head = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
            head += [f"property double {axis}" for axis in "xyz"]
            head += [f"element face {len(polygons)}", "property list uchar int vertex_indices", "end_header"]
        rows = head + rows
    path.write_text("\n".join([*rows, ""]))
    return path


@pytest.mark.parametrize("suffix", [".obj", ".off", ".ply"])
@pytest.mark.parametrize(
    "polygon", [L, L[::-1], ARROW, star(), star(50, 0.05)], ids=["L", "clockwise", "arrow", "star", "50"]
)
def test_a_prism_keeps_area_and_volume_whichever_corner_comes_first(tmp_path, suffix, polygon):
    for start in range(len(polygon)):
        turned = np.roll(np.asarray(polygon, dtype=float), -start, axis=0)
        mesh = load_mesh(write(tmp_path / f"prism{suffix}", *prism(turned)))
        assert mesh.area == pytest.approx(2 * shoelace(polygon) + perimeter(turned), rel=1e-12)
        assert mesh.volume == pytest.approx(shoelace(polygon), rel=1e-12)
        assert mesh.is_watertight and mesh.is_winding_consistent
    assert len(mesh.faces) == 2 * (len(polygon) - 2) + 2 * len(polygon)


def area_of(points, scale=1.0):
    points = np.column_stack([np.asarray(points, dtype=float), np.zeros(len(points))]) * scale
    faces = triangulate(np.array([len(points)]), np.arange(len(points)), points, "name")
    assert faces.shape == (len(points) - 2, 3) and faces.min() >= 0 and faces.max() < len(points)
    a, b, c = np.moveaxis(points[faces], 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 / scale**2


AWKWARD = {
    "straight corners": [(0, 0), (1, 0), (2, 0), (2, 1), (1, 0.5), (0, 1), (0, 0.5)],
    "a corner twice": [(1, 1), (1, 1), (1, 2), (0, 2), (0, 0), (2, 0), (2, 1)],
    "touches itself": [(0, 0), (2, 0), (2, 2), (1, 0), (0, 2)],
    "a bridge to a hole": [(0, 0), (3, 0), (3, 3), (0, 3), (0, 0), (1, 1), (1, 2), (2, 2), (2, 1), (1, 1)],
}


@pytest.mark.parametrize("name", AWKWARD)
@pytest.mark.parametrize("scale", [1.0, 1e-9, 1e9])
def test_the_area_of_awkward_polygons(name, scale):
    polygon = AWKWARD[name]
    for start in range(len(polygon)):
        assert area_of(np.roll(polygon, -start, axis=0), scale) == pytest.approx(shoelace(polygon), rel=1e-9)


@pytest.mark.parametrize(
    "polygon",
    [
        [(0, 0)] * 5,
        [(0, 0), (1, 0), (2, 0), (3, 0), (1, 0)],
        [(0, 0), (1, 1), (1, 0), (0, 1)],
        star(5)[[0, 2, 4, 1, 3]],
    ],
    ids=["one point", "a line", "crossing", "pentagram"],
)
def test_a_polygon_without_an_interior_is_triangulated_as_well(polygon):
    assert np.isfinite(area_of(polygon))


def test_random_simple_polygons_in_space():
    """Corners around a centre at random distances: simple polygons that are not convex."""
    rng = np.random.default_rng(1)
    for _ in range(50):
        n = int(rng.integers(5, 30))
        angle = np.sort(rng.uniform(0, 2 * np.pi, n))
        if np.diff(np.append(angle, angle[0] + 2 * np.pi)).max() > 3:
            continue  # the centre is outside the polygon
        polygon = np.column_stack([np.cos(angle), np.sin(angle)]) * rng.uniform(0.1, 1, (n, 1))
        assert area_of(polygon) == pytest.approx(shoelace(polygon), rel=1e-9)


def test_convex_polygons_and_bent_quadrangles_become_fans():
    rng = np.random.default_rng(2)
    quad = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    points = np.concatenate([quad + 0.2 * rng.normal(size=(4, 3)) * (0, 0, 1) for _ in range(100)])
    faces = triangulate(np.full(100, 4), np.arange(400), points, "name")
    assert faces.tolist() == [[4 * k, 4 * k + i, 4 * k + i + 1] for k in range(100) for i in (1, 2)]


def test_many_polygons_take_little_time():
    """The quadrangles of 238,000 triangles and quadrangles are tested together; without the test it took 20 ms."""
    sizes = np.tile([3, 4], 119_000)
    corners = np.random.default_rng(3).integers(0, 1000, sizes.sum())
    points = np.random.default_rng(4).normal(size=(1000, 3))
    start = time.process_time()
    triangulate(sizes, corners, points, "name")
    assert time.process_time() - start < 0.5


def spiral(turns, corners):
    angle = np.linspace(0, 2 * np.pi * turns, corners)
    arms = [np.column_stack([np.cos(angle), np.sin(angle)]) * (radius + angle)[:, None] for radius in (1, 3)]
    return np.concatenate([arms[0], arms[1][::-1]])


COMB = [(0, 0), *((x / 2, 5.0 * (x % 2)) for x in range(1, 12)), (6, 0), (6, -1), (0, -1)]


@pytest.mark.parametrize("polygon", [spiral(3, 40), COMB, star(12, 0.3), L], ids=["spiral", "comb", "star", "L"])
@pytest.mark.parametrize("bend", [0, 1e-9, 1e-5])
def test_flat_polygons_with_corners_that_coincide_or_are_straight(polygon, bend):
    """Each corner twice and one more in the middle of each edge, all slightly off the plane."""
    polygon = np.asarray(polygon, dtype=float)
    with_middles = np.stack([polygon, (polygon + np.roll(polygon, -1, axis=0)) / 2], axis=1).reshape(-1, 2)
    many = np.repeat(with_middles, 2, axis=0)
    rng = np.random.default_rng(5)
    for start in range(0, len(many), 1 + len(many) // 12):
        for turned in (np.roll(many, -start, axis=0), np.roll(many, -start, axis=0)[::-1]):
            corners = np.column_stack([turned, bend * rng.normal(size=len(turned))]) @ TURN.T
            faces = triangulate(np.array([len(corners)]), np.arange(len(corners)), corners, "name")
            a, b, c = np.moveaxis(corners[faces], 1, 0)
            area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
            assert len(faces) == len(corners) - 2 and area == pytest.approx(shoelace(polygon), rel=1e-12 + 100 * bend)
