"""The winding number field: fast sums against loops over all pairs, closed forms, and a library."""

import functools

import igl
import numpy as np
import pytest
import trimesh

from bench import Run
from bench.geometry.mesh_surface import MeshSurface
from bench.methods.classical.winding.consistency import INSIDE, consistent_normals, descent
from bench.methods.classical.winding.field import WindingField
from bench.methods.classical.winding.tree import Tree

WIDTH = 0.05


def ball(count):
    """Evenly spread points of the unit sphere (Fibonacci): (count, 3)."""
    k = np.arange(count) + 0.5
    z, angle = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    return np.column_stack([np.cos(angle) * np.sqrt(1 - z**2), np.sin(angle) * np.sqrt(1 - z**2), z])


def torus(count, seed=0):
    """Random points of a torus, their normals, and the area of each: (count, 3) twice, and a number."""
    mesh = trimesh.creation.torus(0.7, 0.25, 64, 32)
    points, normals = MeshSurface(mesh).sample(count, np.random.default_rng(seed))
    return points, normals, mesh.area / count


def naive(points, moments, values):
    """Number, adjoint and steepest by definition, in double precision."""
    d = points[None] - points[:, None]
    r = np.linalg.norm(d, axis=2)
    seen = r >= WIDTH
    r = np.where(seen, r, 1)
    kernel = seen / (4 * np.pi * r**3)
    along = np.einsum("ijk,jk->ij", d, moments)
    steepest = np.einsum("ij,jk->ik", kernel, moments) - 3 * np.einsum("ij,ijk->ik", kernel * along / r**2, d)
    return (kernel * along).sum(1), -np.einsum("ij,ijk,j->ik", kernel, d, values), steepest


def fast(points, moments, values, opening, threads=1):
    field = WindingField(points, opening, threads)
    return field.number(moments, WIDTH), field.adjoint(values, WIDTH), field.steepest(moments, WIDTH)


def errors(found, exact):
    return [np.sqrt(((a - b) ** 2).mean() / (b**2).mean()) for a, b in zip(found, exact, strict=True)]


@functools.cache
def exact_sums(oriented):
    """Points scaled by 40 far from the origin, their moments and values, and the exact sums of the unscaled ones."""
    points, normals, area = torus(2000)
    rng = np.random.default_rng(1)
    moments = normals * area if oriented else rng.standard_normal(points.shape) * area
    values = rng.standard_normal(len(points))
    points = 40 * points + [300, -20, 7]
    return points, moments, values, naive((points - [300, -20, 7]) / 40, moments, values)


@pytest.mark.parametrize("opening, tolerance", [(0.0, 1e-5), (0.15, 0.007), (0.3, 0.02), (0.5, 0.06)])
@pytest.mark.parametrize("oriented", [True, False])
def test_the_fast_sums_match_those_over_all_pairs_to_the_tolerance(opening, tolerance, oriented):
    points, moments, values, exact = exact_sums(oriented)
    scaled = WindingField(points, opening)
    found = (
        1600 * scaled.number(moments, 40 * WIDTH),
        1600 * scaled.adjoint(values, 40 * WIDTH),
        64000 * scaled.steepest(moments, 40 * WIDTH),
    )
    assert max(errors(found, exact)) < tolerance


def test_the_error_falls_with_the_opening_and_the_work_grows():
    points, normals, area = torus(1500)
    values = np.random.default_rng(1).standard_normal(len(points))
    exact = naive(points, normals * area, values)
    found = [errors(fast(points, normals * area, values, opening), exact)[0] for opening in (0.6, 0.3, 0.15)]
    assert found[0] > 2 * found[1] > 4 * found[2]
    work = [len(Tree.over(points).runs(opening)[1]) for opening in (0.6, 0.3, 0.15)]
    assert work == sorted(work) and work[0] < 0.5 * work[2]


def test_the_adjoint_is_the_transpose_of_the_number():
    points, _, _ = torus(1500)
    rng = np.random.default_rng(2)
    moments, values = rng.standard_normal(points.shape), rng.standard_normal(len(points))
    field = WindingField(points, 0.0)
    one, other = field.number(moments, WIDTH) @ values, np.sum(field.adjoint(values, WIDTH) * moments)
    assert one == pytest.approx(other, rel=1e-4)


def test_threads_and_repeated_runs_give_the_same_bits():
    points, normals, area = torus(2000)
    arguments = points, normals * area, np.ones(len(points)), 0.4
    for a, b in zip(fast(*arguments), fast(*arguments, threads=3), strict=True):
        assert np.array_equal(a, b)


def test_on_a_sphere_the_winding_number_is_one_half_and_falls_outward():
    points = ball(4000)
    field = WindingField(points, 0.3)
    moments = points * (4 * np.pi / len(points))
    assert np.abs(field.number(moments, 0.1) - 0.5).max() < 0.05
    slopes = field.steepest(moments, 0.1)
    assert (np.einsum("ni,ni->n", slopes, points) > 0.99 * np.linalg.norm(slopes, axis=1)).all()


def test_the_number_matches_a_library_away_from_the_points():
    """Points with zero moment evaluate the field of the others; libigl sums over all faces of a mesh."""
    mesh = trimesh.creation.icosphere(4)
    queries = np.random.default_rng(3).uniform(-1.5, 1.5, (400, 3))
    queries = queries[np.abs(np.linalg.norm(queries, axis=1) - 1) > 0.15]
    exact = igl.winding_number(np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int64), queries)
    points = np.concatenate([mesh.triangles_center, queries])
    moments = np.concatenate([mesh.face_normals * mesh.area_faces[:, None], np.zeros_like(queries)])
    found = WindingField(points, 0.2).number(moments, 1e-3)[-len(queries) :]
    assert np.abs(found - exact).max() < 0.02


@pytest.mark.parametrize("count", [3, 24, 25, 1000])
def test_leaves_and_nodes_contain_each_point_once(count):
    points = np.random.default_rng(count).standard_normal((count, 3))
    tree = Tree.over(points)
    assert sorted(tree.order) == list(range(count)) and np.array_equal(tree.points, points[tree.order])
    assert np.diff(tree.starts).max() <= 24 and np.diff(tree.starts).min() >= 1
    np.testing.assert_allclose(tree.sums(tree.points)[0], points.sum(axis=0))
    np.testing.assert_allclose(tree.centers[0], points.mean(axis=0), atol=1e-12)
    assert tree.radii[0] == pytest.approx(np.linalg.norm(points - points.mean(axis=0), axis=1).max())
    begins, runs = tree.runs(0.4)
    sizes = np.concatenate([tree.sums(np.ones((count, 1)))[:, 0]])
    for leaf in range(len(tree.starts) - 1):  # each leaf sums over every point once
        mine = runs[begins[leaf] : begins[leaf + 1]]
        total = sum(sizes[a - count] if a >= count else b - a for a, b in mine)
        assert total == count


def test_a_descent_is_the_best_step_along_the_gradient():
    points, _, _ = torus(800)
    field = WindingField(points, 0.0)
    moments = np.zeros_like(points)
    step = descent(field, moments, WIDTH)

    def loss(moments):
        return ((field.number(moments, WIDTH) - INSIDE) ** 2).sum()

    assert loss(step) < loss(moments)
    assert loss(step) <= min(loss(0.9 * step), loss(1.1 * step))
    # Its direction is the gradient of the loss: differences along random directions.
    along = field.adjoint(INSIDE - field.number(moments, WIDTH), WIDTH)
    other = np.random.default_rng(0).standard_normal(points.shape)
    slope = (loss(1e-2 * other) - loss(-1e-2 * other)) / 2e-2
    assert slope == pytest.approx(-2 * np.sum(along * other), rel=1e-3)
    assert not descent(field, moments, 100.0).any()  # all points are within the width of each other


def test_no_round_begins_after_its_share_of_the_time_limit():
    points, _, _ = torus(500)
    assert consistent_normals(WindingField(points), np.full(10, 0.1), Run(seconds=0.0))[1] == 1
    normals, done = consistent_normals(WindingField(points), np.full(10, 0.1), Run(seconds=1e6), 0.5)
    assert done == 10
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1)
