"""Estimated normals against exact ones, and against planes through fixed numbers of neighbours."""

import time
import warnings

import numpy as np
import pytest
from normal_cases import degrees, noisy, plain, rings, scans

from bench import PointCloud
from bench.geometry.neighbourhood_size import SIZES
from bench.geometry.normal_signs import consistent_signs
from bench.geometry.normals import completed, disagreement, estimate_normals, oriented_normals, with_normals
from bench.notices import InputWarning, collected

NOISY = [("sphere", 3000, 0.0), ("sphere", 3000, 0.02), ("cube", 3000, 0.0), ("cube", 3000, 0.01)]
NOISY += [("bumps", 3000, 0.005), ("bumps", 5000, 0.03), ("knots", 3000, 0.01)]
CLOUDS = {f"{name} {count} {noise}": (noisy, (name, count, noise)) for name, count, noise in NOISY}
CLOUDS |= {"dense sphere": (noisy, ("sphere", 8000, 0.05))}
CLOUDS |= {"laplace": (lambda: noisy("torus", 4000, 0.02, kind="laplace"), ())}
CLOUDS |= {f"rings {ratio}": (rings, (ratio, count)) for ratio, count in ((1, 30), (4, 20), (8, 20))}
CLOUDS |= {"noisy rings": (rings, (8, 20, 0.01)), "range noise": (rings, (8, 20, 0.01, "ray"))}
CLOUDS |= {"scans": (scans, ("bumps", "triangulation", 2, 1.0, 0.005))}


@pytest.mark.parametrize("name", CLOUDS)
def test_errors_are_no_larger_than_those_of_the_better_of_two_fixed_sizes(name):
    make, arguments = CLOUDS[name]
    points, truth = make(*arguments)
    ours, few, many = (
        degrees(n, truth) for n in (estimate_normals(points).normals, plain(points, 30), plain(points, 100))
    )
    # Below a twentieth of a degree, on the faces of a clean cube, a ratio is meaningless.
    assert ours.mean() <= 1.1 * min(few.mean(), many.mean()) + 0.05
    assert np.median(ours) <= 1.1 * min(np.median(few), np.median(many)) + 0.05


def test_edges_and_thin_sheets_are_no_worse_than_from_16_neighbours_where_there_is_no_noise():
    for name in ("cube", "plate"):
        points, truth = noisy(name, 5000, 0.0)
        assert degrees(estimate_normals(points).normals, truth).mean() < 1.1 * degrees(plain(points, 16), truth).mean()


@pytest.mark.parametrize("ratio", [2, 4, 8])
def test_orientation_is_propagated_across_scan_lines(ratio):
    points, truth = rings(ratio, 20)
    assert (np.einsum("ni,ni->n", oriented_normals(points), truth) > 0).mean() > 0.999


@pytest.mark.parametrize("cloud", [("sphere", 4000, 0.05), ("plate", 8000, 0.005), ("torus", 4000, 0.02)])
def test_orientation_of_noisy_surfaces_and_of_both_sides_of_a_plate(cloud):
    points, truth = noisy(*cloud)
    assert (np.einsum("ni,ni->n", oriented_normals(points), truth) > 0).mean() > 0.97


@pytest.mark.parametrize("k", [3, 15, 32])
def test_a_fixed_number_of_neighbours_matches_the_naive_computation(k):
    points, _ = noisy("torus", 300, 0.01)
    found = estimate_normals(points, k)
    for point, normal in zip(points, found.normals, strict=True):
        nearest = points[np.argsort(np.linalg.norm(points - point, axis=1), kind="stable")[:k]]
        axes = np.linalg.svd(nearest - nearest.mean(axis=0))[2]
        assert abs(axes[2] @ normal) > 1 - 1e-6
    assert (found.sizes == k).all()


@pytest.mark.parametrize("count", [3, 5, 9, 13, 40, 200])
def test_few_points_have_normals_too(count):
    points, _ = noisy("sphere", count, 0.0)
    assert np.allclose(np.linalg.norm(oriented_normals(points), axis=1), 1)


def test_sizes_follow_the_noise_and_do_not_depend_on_the_order_of_points():
    points, _ = noisy("sphere", 4000, 0.0)
    blurred, _ = noisy("sphere", 4000, 0.04)
    assert np.median(estimate_normals(points).sizes) < 64 <= np.median(estimate_normals(blurred).sizes) <= SIZES[-1]
    order = np.random.default_rng(1).permutation(4000)
    assert degrees(estimate_normals(blurred).normals[order], estimate_normals(blurred[order]).normals).max() < 0.1


def test_a_note_reports_neighbourhoods_that_are_lines_at_every_size():
    rng = np.random.default_rng(0)
    lines = np.concatenate([rng.random((3000, 1)) * [1.0, 0, 0] + [0, y, 0] for y in range(3)])
    with collected() as notes:
        estimate_normals(lines + 1e-6 * rng.normal(size=lines.shape))
    assert len(notes) == 1 and "100% of the points are lines" in notes[0]


# -- signs -------------------------------------------------------------------------------------------------------------


def naive_signs(points, normals, edges):
    """Prim's algorithm and a traversal, node by node."""
    import networkx as nx

    graph = nx.Graph()
    graph.add_nodes_from(range(len(points)))
    for i, j in edges:
        along = (points[j] - points[i]) / np.linalg.norm(points[j] - points[i])
        across = (normals[i] - 2 * (normals[i] @ along) * along) @ normals[j]
        direct = normals[i] @ normals[j]
        doubt = min(abs(across), abs(direct))
        graph.add_edge(i, j, weight=1 - doubt if across * direct > 0 else 1 + doubt, sign=-1 if across < 0 else 1)
    signs = np.ones(len(points))
    tree = nx.minimum_spanning_tree(graph)
    for piece in nx.connected_components(tree):
        for parent, child in nx.bfs_edges(tree, min(piece)):
            signs[child] = signs[parent] * graph.edges[parent, child]["sign"]
    return signs


def test_signs_match_a_naive_traversal_of_the_forest():
    rng = np.random.default_rng(0)
    points = np.concatenate([noisy("sphere", 150, 0.02, seed)[0] + 5 * seed for seed in range(4)])
    normals = rng.normal(size=points.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    neighbours = np.argsort(np.linalg.norm(points[:, None] - points, axis=2), axis=1)[:, 1:7]
    signs, piece = consistent_signs(points, normals, neighbours)
    naive = naive_signs(points, normals, [(i, j) for i in range(len(points)) for j in neighbours[i]])
    for number in range(piece.max() + 1):
        assert abs((signs * naive)[piece == number].mean()) == 1


def test_many_components_take_about_as_long_as_one():
    rng = np.random.default_rng(0)
    n = 24_000
    pieces = (1000 * rng.random((n // 20, 1, 3)) + 0.1 * rng.normal(size=(n // 20, 20, 3))).reshape(-1, 3)
    seconds = []
    for points in (noisy("sphere", n, 0.0)[0], pieces):
        normals = points / np.linalg.norm(points, axis=1, keepdims=True)
        neighbours = estimate_normals(points, 12).neighbours
        began = time.process_time()
        consistent_signs(points, normals, neighbours)
        seconds.append(time.process_time() - began)
    assert seconds[1] < 3 * seconds[0]  # eleven times as long when each component was traversed by itself


# -- normals of the input ----------------------------------------------------------------------------------------------


def test_a_few_bad_normals_are_filled_from_the_nearest_and_counted():
    points, truth = noisy("sphere", 500, 0.0)
    given = 3 * truth
    given[7], given[8], given[9, 1] = 0, np.nan, np.inf
    with collected() as notes:
        normals = with_normals(PointCloud(points, given)).normals
    assert len(notes) == 1 and "3 of 500 normals have no direction" in notes[0]
    assert np.allclose(np.delete(normals, [7, 8, 9], axis=0), np.delete(truth, [7, 8, 9], axis=0))
    good = np.delete(np.arange(500), [7, 8, 9])
    for bad in (7, 8, 9):
        assert np.allclose(normals[bad], truth[good[np.linalg.norm(points[good] - points[bad], axis=1).argmin()]])


def test_normals_are_left_out_when_most_are_bad_and_kept_when_tiny_or_huge():
    points, truth = noisy("sphere", 100, 0.0)
    with pytest.warns(InputWarning, match="60 of 100 normals have no direction; all normals are left out"):
        assert completed(points, np.where(np.arange(100)[:, None] < 60, 0, truth), "scan.ply") is None
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for scale in (1e-200, 1e200):
            assert np.allclose(completed(points, scale * truth, "scan.ply"), truth)


def test_unoriented_normals_disagree_and_oriented_ones_do_not():
    points, truth = noisy("sphere", 3000, 0.01)
    half = np.where(np.random.default_rng(0).random(3000) < 0.5, -1, 1)[:, None]
    assert disagreement(points, truth) == disagreement(points, -truth) == 0
    assert disagreement(points, half * truth) > 0.4
    assert disagreement(points, np.where(truth[:, 2:] < 0, -1, 1) * truth) > 0.4  # all upward: signs rarely disagree
    sides, outward = noisy("plate", 4000, 0.0)  # two sheets 0.1 apart, whose normals are rightly opposite
    assert disagreement(sides, outward) < 0.01


def test_normals_of_open3d_are_unoriented():
    import open3d

    points, _ = noisy("bumps", 4000, 0.0)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(30))
    assert disagreement(points, np.asarray(cloud.normals)) > 0.05
