"""Each formula of a paper's convention, against a naive computation written from its definition."""

import igl
import numpy as np
import pytest
import trimesh

from bench import Case, PointCloud, Shape, generator
from bench.engine.call import floor
from bench.geometry import reference_sample
from bench.geometry.cloud_surface import CloudSurface
from bench.geometry.comparison import compare, set_samples
from bench.geometry.poisson_disk import sample_poisson_disk
from bench.geometry.reference_sample import POISSON_DISK
from bench.geometry.triangles import point_triangle_distance, triangles_to_points
from bench.metrics.box_scaled_distances import BoxScaledDistances
from bench.metrics.chamfer_l1_point_sum import ChamferL1PointSum
from bench.metrics.chamfer_l1_sum import ChamferL1Sum
from bench.metrics.directed import Directed
from bench.metrics.even_distances import EvenDistances
from bench.metrics.hausdorff_sq_sum import HausdorffSqSum
from bench.metrics.own_sphere_distances import OwnSphereDistances, in_own_sphere
from bench.metrics.p2f_spread import P2fSpread
from bench.metrics.p2m_sq_sum import P2mSqSum
from bench.metrics.recentred_chamfer_l2_sum import RecentredChamferL2Sum
from bench.metrics.s2f import S2f
from bench.metrics.sampled_distances import SampledDistances
from bench.metrics.spacing_variation import neighbour_distances
from bench.plan.cell import Choice
from bench.plugins.registry import snake_case


def two_points_against_three():
    """Directed distances: 1 and 1 to the reference; 1, sqrt 5 and 1 to the output."""
    points = np.array([[1.0, 0, 0], [1, 2, 0], [3, 0, 1]])
    shape = Shape("points", trimesh.Trimesh(points, process=False), surface=CloudSurface(PointCloud(points)))
    return Case("points", {}, shape), PointCloud([[0.0, 0, 0], [3, 0, 0]])


def nearest(P, Q):
    """The distance of each point of P to the nearest of Q, by three loops."""
    return np.array([min(sum((a - b) ** 2 for a, b in zip(p, q, strict=True)) ** 0.5 for q in Q) for p in P])


def mesh_case(mesh, samples=2000):
    case = Case("mesh", {}, Shape("mesh", mesh))
    set_samples(case, samples)
    return case


def square(z=0.0, shift=0.0):
    corners = np.array([[-1, -1, z], [1, -1, z], [1, 1, z], [-1, 1, z]]) + [shift, 0, 0]
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)


# -- two points against three, by hand ---------------------------------------------------------------------------------


def test_sums_means_and_maxima_by_hand():
    case, output = two_points_against_three()
    root = np.sqrt(5)
    assert ChamferL1Sum().score(output, case)["chamfer_l1_sum"] == pytest.approx(1 + (2 + root) / 3)
    assert HausdorffSqSum().score(output, case)["hausdorff_sq_sum"] == pytest.approx(1 + 5)
    assert ChamferL1PointSum().score(output, case)["chamfer_l1_point_sum@10000"] == pytest.approx(4 + root)
    found = SampledDistances(samples=7).score(output, case)
    assert found == pytest.approx(
        {"chamfer_l1_mean@7": (1 + (2 + root) / 3) / 2, "chamfer_l2_sum@7": 1 + 7 / 3, "hausdorff@7": root}
    )


def test_directed_statistics_by_hand():
    case, output = two_points_against_three()
    found = Directed().score(output, case)
    assert [found[f"to_reference_{key}"] for key in ("mean", "p50", "p99", "max")] == [1, 1, 1, 1]
    assert found["to_output_p50"] == 1 and found["to_output_max"] == pytest.approx(np.sqrt(5))
    assert found["to_output_p90"] == pytest.approx(1 + 0.8 * (np.sqrt(5) - 1))  # of 1, 1, sqrt 5, interpolated


def test_distances_relative_to_the_box_by_hand():
    case, output = two_points_against_three()  # the box of the reference is 2 x 2 x 1: its diagonal is 3
    chamfer = (1 + (2 + np.sqrt(5)) / 3) / 2
    expected = {
        "chamfer_l1_mean_by_diagonal": chamfer / 3,
        "hausdorff_by_diagonal": np.sqrt(5) / 3,
        "chamfer_l1_mean_by_edge": chamfer / 2,
        "chamfer_l2_sum_by_diagonal": (1 + 7 / 3) / 9,
        "hausdorff_sq_sum_by_diagonal": (1 + 5) / 9,
    }
    assert BoxScaledDistances().score(output, case) == pytest.approx(expected)


def test_own_spheres_by_loops():
    case, output = two_points_against_three()
    P, Q = np.array(output.points), np.array(case.reference.mesh.vertices)
    P, Q = P - [1.5, 0, 0], Q - Q.sum(axis=0) / 3
    P, Q = P / 1.5, Q / max(sum(q**2) ** 0.5 for q in Q)
    f, b = nearest(P, Q), nearest(Q, P)
    found = OwnSphereDistances(samples=3).score(output, case)
    assert found["own_sphere_chamfer_l2_sum"] == pytest.approx((f**2).mean() + (b**2).mean())
    assert found["own_sphere_hausdorff_sq_sum"] == pytest.approx(max(f) ** 2 + max(b) ** 2)


def test_own_spheres_ignore_position_and_size_but_one_outlier_changes_them():
    case = mesh_case(trimesh.creation.icosphere(3))
    points, _ = case.reference.surface.sample(1000, generator(5))
    metric = OwnSphereDistances()
    right = metric.score(PointCloud(points), case)
    assert metric.score(PointCloud(3 * points + [5, 0, 0]), case) == pytest.approx(right, rel=1e-9)
    spoiled = metric.score(PointCloud(np.vstack([points, [[1.5, 0, 0]]])), case)
    assert spoiled["own_sphere_chamfer_l2_sum"] > 10 * right["own_sphere_chamfer_l2_sum"]
    assert not in_own_sphere(np.ones((3, 3))).any()


@pytest.mark.parametrize("metric", [OwnSphereDistances(), EvenDistances()], ids=lambda metric: type(metric).__name__)
def test_the_ground_truth_is_a_poisson_disk_sample_as_large_as_the_output(metric):
    case, output = mesh_case(trimesh.creation.icosphere(3)), PointCloud(np.zeros((500, 3)))
    truth = compare(output, case, 500, POISSON_DISK).reference_points
    assert len(truth) == 500 and neighbour_distances(truth).min() > 0.5 * np.sqrt(4 * np.pi / 500)
    perfect = metric.perfect(output, case)
    assert len(perfect) == 500 and not np.isin(perfect.points, truth).any()
    (even, _), (uniform, _) = metric.score(perfect, case).values(), metric.score(case.perfect(output), case).values()
    # Two uniform samples of N points on a sphere of area 4 pi: 2 A / (pi N); two even ones some 40 % less.
    assert even == pytest.approx(0.58 * 8 / 500, rel=0.06)
    assert even < 0.8 * uniform
    assert floor(Choice("metric", snake_case(type(metric).__name__)), metric, output, case) == metric.score(
        perfect, case
    )


def test_a_ground_truth_that_is_a_cloud_is_used_whole():
    case, output = two_points_against_three()
    f, b = nearest(output.points, case.reference.mesh.vertices), nearest(case.reference.mesh.vertices, output.points)
    expected = {
        "even_chamfer_l2_sum": (f**2).mean() + (b**2).mean(),
        "even_hausdorff_sq_sum": max(f) ** 2 + max(b) ** 2,
    }
    assert EvenDistances().score(output, case) == pytest.approx(expected)


def test_poisson_disk_samples_are_drawn_once_for_all_metrics_up_to_the_limit(monkeypatch):
    made = []

    def counted(shape, count, rng):
        made.append(count)
        return sample_poisson_disk(shape, count, rng)

    monkeypatch.setattr(reference_sample, "sample_poisson_disk", counted)
    monkeypatch.setattr(reference_sample, "MOST", 300)
    case = mesh_case(trimesh.creation.icosphere(3))
    clouds = [PointCloud(generator(i).normal(size=(n, 3))) for i, n in enumerate((200, 200, 500, 400))]
    scores = [metric.score(cloud, case) for cloud in clouds for metric in (OwnSphereDistances(), EvenDistances())]
    assert made == [200, 300, 300]  # for 500 and for 400 points; the disk cache would share one
    assert len({score["even_chamfer_l2_sum"] for score in scores[1::2]}) == 4


def test_points2surf_by_loops():
    """In the frame where the longest edge, 2, is 1: the paper's table gives 100 times the sum over the count."""
    case, output = two_points_against_three()
    found = ChamferL1PointSum().score(output, case)
    mean = (1 + (2 + np.sqrt(5)) / 3) / 2
    assert found["chamfer_l1_sum_by_edge@10000"] == pytest.approx(mean)
    assert found["rejection_chamfer_l1_sum_by_edge@10000"] == pytest.approx(mean)


def test_samples_by_rejection_have_no_close_pairs():
    mesh = trimesh.creation.icosphere(3)
    samples = ChamferL1PointSum(samples=1000)._sample(mesh, mesh_case(mesh), "output")
    assert len(samples) == 1000 and neighbour_distances(samples).min() >= np.sqrt(mesh.area / 3000)


def test_recentred_chamfer_by_loops():
    case, output = two_points_against_three()
    P, Q = output.points - [1.5, 0, 0], case.reference.mesh.vertices - [2, 1, 0.5]  # half of the longest edge is 1
    f, b = nearest(P, Q), nearest(Q, P)
    found = RecentredChamferL2Sum().score(output, case)
    assert found == pytest.approx({"recentred_chamfer_l2_sum@5000": (f**2).mean() + (b**2).mean()})


def test_recentred_chamfer_of_a_mesh_uses_the_box_of_its_vertices():
    box = trimesh.creation.box(extents=(4, 2, 1))
    moved = trimesh.Trimesh(box.vertices + [9, 9, 9], box.faces, process=False)
    case = mesh_case(box)
    found = RecentredChamferL2Sum(samples=2000).score(moved, case)["recentred_chamfer_l2_sum@2000"]
    at_home = case.compare(box)
    assert found == pytest.approx(
        ((at_home.to_reference.distance**2).mean() + (at_home.to_output.distance**2).mean()) / 4, rel=1e-9
    )


# -- parallel squares and concentric spheres ---------------------------------------------------------------------------


@pytest.mark.parametrize("delta", [1e-6, 0.05, 0.4])
def test_exact_distances_of_parallel_squares(delta):
    case = mesh_case(square())
    s2f, spread = S2f().score(square(delta), case), P2fSpread().score(square(delta), case)
    assert s2f == pytest.approx(dict.fromkeys(("s2f_mean", "s2f_rms", "s2f_max"), delta), rel=1e-9)
    assert spread["p2f_rms"] == pytest.approx(delta) == spread["p2f_max"]
    assert spread["p2f_std"] == pytest.approx(0, abs=1e-12)
    # Two faces per square: mean of squares forward, and backward from the faces to the nearest output point.
    points = np.array([[0.0, -0.5, delta], [0, 0.5, delta]])
    assert P2mSqSum().score(PointCloud(points), case)["p2m_sq_sum"] == pytest.approx(2 * delta**2, rel=1e-9)


def test_p2m_weights_all_faces_equally_whatever_their_area():
    corners = [[0, 0, 0], [10, 0, 0], [0, 10, 0], [0, -1, 0]]
    mesh = trimesh.Trimesh(corners, [[0, 1, 2], [0, 3, 1]], process=False)
    cloud = PointCloud([[2.0, 2, 1], [2, 3, 2]])
    # Forward 1 and 2; backward, the large face has 1; the small one is nearest to the first point, at its edge y = 0.
    expected = (1 + 4) / 2 + (1 + (2**2 + 1)) / 2
    assert P2mSqSum().score(cloud, mesh_case(mesh))["p2m_sq_sum"] == pytest.approx(expected)


def test_s2f_measures_what_the_output_lacks():
    half = trimesh.Trimesh(square().vertices * [0.5, 1, 1] - [0.5, 0, 0], square().faces, process=False)
    case = mesh_case(square(), 20_000)
    found = S2f().score(half, case)
    assert found["s2f_mean"] == pytest.approx(0.25, rel=0.03)  # half is covered, the rest is 0 to 1 away
    assert found["s2f_rms"] == pytest.approx(np.sqrt(1 / 6), rel=0.03)
    assert found["s2f_max"] == pytest.approx(1, rel=1e-3)
    assert P2fSpread().score(half, case)["p2f_max"] < 1e-15


def test_concentric_spheres():
    ball = trimesh.creation.icosphere(4)
    case = mesh_case(ball, 5000)
    large = trimesh.Trimesh(ball.vertices * 1.2, ball.faces, process=False)
    found = ChamferL1Sum().score(large, case) | HausdorffSqSum().score(large, case) | S2f().score(large, case)
    assert found["s2f_mean"] == pytest.approx(0.2, rel=5e-3)
    assert found["chamfer_l1_sum"] == pytest.approx(0.4, rel=0.02)
    assert 2 * 0.2**2 * 0.99 < found["hausdorff_sq_sum"] < 2 * (0.2**2 + 0.15**2)
    total = ChamferL1PointSum(samples=5000).score(large, case)["chamfer_l1_point_sum@5000"]
    assert total == pytest.approx(5000 * found["chamfer_l1_sum"])  # the very same samples
    usual, same, fewer = (ChamferL1Sum(samples=samples).score(large, case) for samples in (0, 5000, 50))
    assert same == {"chamfer_l1_sum@5000": usual["chamfer_l1_sum"]}
    assert fewer["chamfer_l1_sum@50"] > usual["chamfer_l1_sum"]  # with ten times the floor


@pytest.mark.parametrize("power, key", [(1, "chamfer_l1_sum"), (2, "hausdorff_sq_sum"), (1, "s2f_mean"), (0, "own")])
def test_scores_grow_with_the_declared_power_of_scale(power, key):
    metrics = (ChamferL1Sum(), HausdorffSqSum(), S2f(), OwnSphereDistances())
    ball, box = trimesh.creation.icosphere(2), trimesh.creation.box()

    def scored(scale):
        reference, output = (trimesh.Trimesh(m.vertices * scale, m.faces, process=False) for m in (ball, box))
        case = mesh_case(reference, 1000)
        found = {k: v for m in metrics for k, v in m.score(output, case).items()}
        return found | {"own": found["own_sphere_chamfer_l2_sum"]}

    assert scored(4.0)[key] == pytest.approx(4**power * scored(1.0)[key], rel=1e-9)


# -- triangles and points ----------------------------------------------------------------------------------------------


def test_point_triangle_distance_against_igl():
    rng = generator("triangles")
    points, triangles = rng.normal(size=(300, 3)), rng.normal(size=(300, 3, 3))
    triangles[:20, 2] = triangles[:20, 1]  # segments
    triangles[20:30] = triangles[20:30, :1]  # points
    for point, triangle, distance in zip(points, triangles, point_triangle_distance(points, triangles), strict=True):
        squared, _, _ = igl.point_mesh_squared_distance(point[None], triangle, np.array([[0, 1, 2]]))
        assert distance == pytest.approx(np.sqrt(squared[0]), rel=1e-9)


@pytest.mark.parametrize("mesh", [trimesh.creation.icosphere(1), trimesh.creation.box(), trimesh.creation.cone(0.1, 3)])
def test_triangles_to_points_against_all_pairs(mesh):
    rng, triangles = generator("pairs", len(mesh.faces)), mesh.vertices[mesh.faces]
    for points in (rng.normal(size=(400, 3)), np.array([[9.0, 0, 0]]), rng.normal(size=(300, 3)) * 1e-3):
        every = [point_triangle_distance(np.broadcast_to(p, (len(triangles), 3)), triangles) for p in points]
        assert triangles_to_points(triangles, points) == pytest.approx(np.min(every, axis=0), rel=1e-12)


def test_triangles_to_points_is_an_upper_bound_where_too_many_points_are_near(monkeypatch):
    monkeypatch.setattr("bench.geometry.triangles.BRUTE_FORCE", 0)
    mesh, points = trimesh.creation.icosphere(2), generator(0).normal(size=(2000, 3)) * 1e-3
    triangles = mesh.vertices[mesh.faces]
    found = triangles_to_points(triangles, points)
    exact = [point_triangle_distance(points, np.broadcast_to(t, (len(points), 3, 3))).min() for t in triangles]
    radius = np.linalg.norm(triangles - triangles.mean(axis=1, keepdims=True), axis=2).max()
    assert (found >= np.array(exact) - 1e-12).all() and (found <= np.array(exact) + 2 * radius).all()
