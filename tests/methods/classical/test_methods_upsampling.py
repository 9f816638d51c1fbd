"""Upsampling: exact counts, evenly on the surface, with edges where the method keeps them."""

import functools
import importlib.util

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from bench import BadInput, PointCloud, Run
from bench.geometry.farthest import farthest_points
from bench.geometry.mesh_surface import MeshSurface
from bench.geometry.poisson_disk import eliminate
from bench.methods.classical.apss import Apss
from bench.methods.classical.ear import Ear
from bench.methods.classical.midpoint_jet import MidpointJet
from bench.methods.classical.poisson import Poisson
from bench.methods.classical.quadrics import project_to_quadrics
from bench.methods.classical.refinement import midpoints, refine
from bench.methods.classical.rimls import Rimls
from bench.tasks.upsample import Upsample

CGAL = importlib.util.find_spec("CGAL") is not None
UPSAMPLE = [MidpointJet(), Apss(), Rimls(), Poisson(depth=6), *([Ear()] if CGAL else [])]
PLANAR = (Rimls, Ear)  # they fit planes, and keep edges
BOX = trimesh.creation.box((1, 1, 1))
BALL = trimesh.creation.icosphere(4)


def name(method):
    return type(method).__name__


@functools.cache
def even_cloud(mesh, count, sigma=0.0, normals=True):
    """Evenly spread points with exact normals."""
    rng = np.random.default_rng(2)
    points, truth = eliminate(*MeshSurface(mesh).sample(5 * count, rng), mesh, count)
    return PointCloud(points + sigma * rng.standard_normal(points.shape), truth if normals else None)


def distances(mesh, points):
    return np.linalg.norm(MeshSurface(mesh).closest(points)[0] - points, axis=1)


def gaps(points):
    """The distance of each point to its nearest neighbour."""
    return cKDTree(points).query(points, 2)[0][:, 1]


# -- farthest points -------------------------------------------------------------------------------------------------


def one_by_one(points, count, taken):
    chosen = list(range(taken)) or [int(((points - points.mean(axis=0)) ** 2).sum(axis=1).argmin())]
    distance = np.linalg.norm(points[:, None] - points[chosen], axis=2).min(axis=1)
    while len(chosen) < count:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
        distance[chosen[-1]] = -1
    return np.array(chosen)


@pytest.mark.parametrize("taken", [0, 1, 100])
@pytest.mark.parametrize("kind", ["sphere", "volume", "line", "clusters", "far away"])
def test_farthest_points_match_the_greedy_order(kind, taken):
    points = np.random.default_rng(0).standard_normal((800, 3))
    if kind == "clusters":
        points[:500] = points[:500] * 1e-4 + 0.3
    points += 1e5 if kind == "far away" else 0
    points /= np.linalg.norm(points, axis=1, keepdims=True) if kind == "sphere" else 1
    points *= [1, 0, 0] if kind == "line" else 1
    assert np.array_equal(farthest_points(points, 300, taken), one_by_one(points, 300, taken))


@pytest.mark.parametrize("count", [1, 32, 33, 125])
def test_among_equally_far_points_the_first_is_chosen(count):
    grid = np.stack(np.meshgrid(*[np.arange(5.0)] * 3), axis=-1).reshape(-1, 3)
    assert np.array_equal(farthest_points(grid, count), one_by_one(grid, count, 0))


def test_a_single_point_is_the_farthest():
    assert farthest_points(np.ones((1, 3)), 1).tolist() == [0]


@pytest.mark.parametrize("taken", [0, 5])
def test_farthest_points_of_duplicates_are_distinct_first(taken):
    points = np.repeat(np.random.default_rng(0).random((50, 3)), 4, axis=0)
    chosen = farthest_points(points, 150, taken)
    assert len(set(chosen.tolist())) == 150
    # Four of the five points chosen at the start coincide.
    assert len(np.unique(points[chosen[: 50 + (3 if taken else 0)]], axis=0)) == 50


# -- quadrics and midpoints ------------------------------------------------------------------------------------------


def test_a_quadric_is_reproduced():
    rng = np.random.default_rng(0)
    u, v = rng.uniform(-0.1, 0.1, (2, 400))
    paraboloid = np.stack([u, v, 0.7 * u * u - 0.4 * u * v + 0.2 * v * v], axis=1)
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    queries = paraboloid[:50] + [0, 0, 0.003]
    moved = project_to_quadrics(queries @ turn.T, cKDTree(paraboloid @ turn.T), 40) @ turn
    x, y, z = moved.T
    # The tangent planes are tilted by up to 0.1 against the axis of the paraboloid, along which the error is measured.
    assert np.abs(z - (0.7 * x * x - 0.4 * x * y + 0.2 * y * y)).max() < 2e-5


def test_points_of_a_plane_stay_in_it():
    points = np.random.default_rng(0).random((300, 3)) * [1, 1, 0]
    assert np.abs(project_to_quadrics(points + [0, 0, 0.01], cKDTree(points), 12)[:, 2]).max() < 1e-9


def test_fewer_points_than_a_quadric_needs_define_a_plane():
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    assert np.abs(project_to_quadrics(np.array([[0.4, 0.6, 0.1]]), cKDTree(corners), 18)[:, 2]).max() < 1e-6


def test_no_midpoint_bridges_a_gap():
    grid = np.stack(np.meshgrid(*[np.arange(10) * 0.1] * 2, [0.0]), axis=-1).reshape(-1, 3)
    middle = midpoints(np.vstack([grid, grid + [0, 0, 0.35]]))
    assert np.isclose(middle[:, 2], 0).sum() + np.isclose(middle[:, 2], 0.35).sum() == len(middle)


def test_refinement_keeps_the_points_and_makes_any_count():
    points = np.random.default_rng(0).random((60, 3)) * [1, 1, 0]
    for count in (60, 61, 240, 300, 1000):
        refined = refine(points, count, lambda queries: queries)
        assert refined.shape == (count, 3)
        assert np.array_equal(refined[:60], points)
        assert len(np.unique(refined, axis=0)) == count


# -- the methods -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", [*UPSAMPLE[:3], Poisson(depth=5), *UPSAMPLE[4:]], ids=name)
def test_the_count_is_exact_despite_duplicates(method):
    cloud = even_cloud(BALL, 150, normals=False)
    twice = PointCloud(np.repeat(cloud.points, 2, axis=0))
    for given, ratio in ((cloud, 1), (cloud, 5), (cloud, 16), (twice, 2)):
        output = method.upsample(given, ratio, Run())
        Upsample(ratio).validate(output, {"cloud": given})


@pytest.mark.parametrize("method", UPSAMPLE, ids=name)
def test_new_points_lie_on_the_surface_evenly(method):
    cloud = even_cloud(BALL, 1000, normals=False)
    points = method.upsample(cloud, 4, Run()).points
    # Planes fitted within a radius of 2.5 spacings of 0.1 are up to 0.25^2 / 2 off a unit sphere; quadrics,
    # spheres and Poisson's smooth function are nearer than the midpoint of a chord of 0.1.
    assert distances(BALL, points).mean() < (0.03 if isinstance(method, PLANAR) else 0.00125)
    # The gaps of random points, a Poisson process, have a coefficient of variation of 0.52.
    assert gaps(points).std() / gaps(points).mean() < 0.15
    everywhere, _ = MeshSurface(BALL).sample(5000, np.random.default_rng(0))
    # Four times the points have half the spacing; the largest gap shrinks a little less.
    assert cKDTree(points).query(everywhere)[0].max() < 0.7 * cKDTree(cloud.points).query(everywhere)[0].max()


# The default of midpoint_jet keeps the points of the input, and their noise.
@pytest.mark.parametrize("method", [MidpointJet(k=24, keep=False), *UPSAMPLE[1:]], ids=name)
def test_noise_is_smoothed_away(method):
    exact = even_cloud(BOX, 1500, sigma=0.013)
    for given in (exact, PointCloud(exact.points)):
        points = method.upsample(given, 2, Run()).points
        assert distances(BOX, points).mean() < 0.7 * distances(BOX, given.points).mean()


def test_points_stay_where_requested():
    cloud = even_cloud(BALL, 500, sigma=0.01)
    output = MidpointJet(keep=True).upsample(cloud, 3, Run()).points
    assert np.array_equal(np.unique(output[:500], axis=0), np.unique(cloud.points, axis=0))


if CGAL:

    def test_edges_are_kept_by_ear_and_rounded_by_quadrics():
        cloud = even_cloud(BOX, 3000, sigma=0.004)

        def error_at_edges(points):
            # Within about a spacing of an edge: two coordinates near 1/2.
            near = np.sort(np.abs(points), axis=1)[:, 1] > 0.5 - 0.04
            return distances(BOX, points[near]).mean()

        ear = error_at_edges(Ear().upsample(cloud, 4, Run()).points)
        rimls = error_at_edges(Rimls().upsample(cloud, 4, Run()).points)
        quadrics = error_at_edges(MidpointJet().upsample(cloud, 4, Run()).points)
        assert max(ear, rimls) < 0.7 * quadrics

    def test_ear_clusters_only_with_edge_sensitivity():
        cloud = even_cloud(BOX, 300)

        def variation(sensitivity):
            found = gaps(Ear(edge_sensitivity=sensitivity).upsample(cloud, 3, Run()).points)
            return found.std() / found.mean()

        assert variation(0.0) < 0.3 < variation(1.0)

    def test_ear_refuses_points_too_far_apart_for_its_grid():
        cloud = even_cloud(BALL, 500)
        far = PointCloud(np.vstack([cloud.points, cloud.points + [300.0, 400, 500]]))  # not stray points but an object
        with pytest.raises(BadInput, match="remove far outliers"):
            Ear().upsample(far, 4, Run())


@pytest.mark.parametrize("method", [m for m in UPSAMPLE if isinstance(m, (Poisson, Ear))], ids=name)
def test_output_normals_belong_to_the_surface(method):
    output = method.upsample(even_cloud(BALL, 1000), 4, Run())
    assert np.einsum("ni,ni->n", output.normals, output.points).min() > 0.9
