"""Chamfer, Hausdorff, point-to-face and F-score: closed forms, other libraries, and invariance."""

import igl
import numpy as np
import point_cloud_utils as pcu
import pytest
import trimesh
from scipy.spatial.distance import cdist

from bench import Case, PointCloud, Shape, generator
from bench.geometry.comparison import Comparison, set_samples
from bench.metrics.chamfer_l1_mean import ChamferL1Mean
from bench.metrics.chamfer_l2_sum import ChamferL2Sum
from bench.metrics.fscore import Fscore
from bench.metrics.hausdorff import Hausdorff
from bench.metrics.p2f_mean import P2fMean
from bench.metrics.s2f import S2f
from bench.metrics.surface_distance_mean import SurfaceDistanceMean

METRICS = (ChamferL2Sum(), ChamferL1Mean(), Hausdorff(), P2fMean(), Fscore())
N = 100_000


def case_of(mesh, seed=0):
    return Case("case", {}, Shape("case", mesh), seed=seed)


def scores(output, case):
    return {key: value for metric in METRICS for key, value in metric.score(output, case).items()}


def square(z=0.0, side=2.0, cells=4):
    """A flat, centred square at the height z."""
    x, y = np.meshgrid(*[np.linspace(-side / 2, side / 2, cells + 1)] * 2, indexing="ij")
    i = np.arange((cells + 1) ** 2).reshape(cells + 1, -1)
    a, b, c, d = i[:-1, :-1].ravel(), i[1:, :-1].ravel(), i[1:, 1:].ravel(), i[:-1, 1:].ravel()
    faces = np.vstack([np.c_[a, b, c], np.c_[a, c, d]])
    return trimesh.Trimesh(np.c_[x.ravel(), y.ravel(), np.full(x.size, z)], faces, process=False)


def sphere(radius=1.0, subdivisions=5):
    mesh = trimesh.creation.icosphere(subdivisions, radius)
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)


def moved(mesh, matrix):
    return trimesh.Trimesh(mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3], mesh.faces, process=False)


# -- closed forms ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("delta", [1e-6, 0.05, 0.3])
def test_parallel_planes(delta):
    found = scores(square(delta), case_of(square()))
    assert found["p2f_mean"] == pytest.approx(delta, rel=1e-9)
    # Nearest samples of the plane below: d^2 = delta^2 + r^2, and the mean of r^2 is A / (pi N).
    spread = 4 / (np.pi * N)
    assert found["chamfer_l2_sum"] == pytest.approx(2 * (delta**2 + spread), rel=0.02)
    assert delta <= found["chamfer_l1_mean"] <= np.sqrt(delta**2 + 1.05 * spread)
    assert delta <= found["hausdorff"] <= np.hypot(delta, 0.04)


@pytest.mark.parametrize("radius", [0.7, 1.2])
def test_concentric_spheres(radius):
    gap = abs(1 - radius)
    case = case_of(sphere())
    set_samples(case, 30_000)
    found = scores(sphere(radius), case)
    assert found["p2f_mean"] == pytest.approx(gap, rel=2e-3)  # both are polyhedra
    assert found["chamfer_l1_mean"] == pytest.approx(gap, rel=5e-3)
    assert found["chamfer_l2_sum"] == pytest.approx(2 * gap**2, rel=0.02)
    assert gap * 0.99 < found["hausdorff"] < np.hypot(gap, 0.05)
    assert found["fscore@0.01"] == 0


@pytest.mark.parametrize("delta", [1e-6, 0.05, 0.3])
def test_two_way_surface_distance_of_parallel_planes(delta):
    assert exact(square(delta), few_of(square())) == pytest.approx(delta, rel=1e-9)


@pytest.mark.parametrize("radius", [0.7, 1.2])
def test_two_way_surface_distance_of_concentric_spheres(radius):
    assert exact(sphere(radius), few_of(sphere())) == pytest.approx(abs(1 - radius), rel=2e-3)


def test_two_way_surface_distance_weights_both_directions_equally():
    # Half of a square, on the square: 0 one way; the other way, half of the points are 0 to 1 away.
    half = moved(square(side=1.0), np.diag([1.0, 2.0, 1.0, 1.0]) + np.array([[0, 0, 0, -0.5]] + [[0] * 4] * 3))
    case = few_of(square())
    assert P2fMean().score(half, case)["p2f_mean"] < 1e-15
    assert exact(half, case) == pytest.approx(0.125, rel=0.05)
    # Exchanged: the output exceeds the reference by as much.
    assert exact(square(), few_of(half)) == pytest.approx(0.125, rel=0.05)


@pytest.mark.parametrize("sigma", [0.01, 0.1])
def test_two_way_surface_distance_is_the_mean_of_both_directions(sigma):
    case, noisy = few_of(sphere(subdivisions=3)), sphere(subdivisions=3)
    noisy.vertices += generator("rough").normal(0, sigma, noisy.vertices.shape)
    halves = P2fMean().score(noisy, case)["p2f_mean"], S2f().score(noisy, case)["s2f_mean"]
    assert exact(noisy, case) == np.mean(halves)
    # Another library, on the same samples.
    pair = case.compare(noisy)
    there = pcu.closest_points_on_mesh(pair.output_points, *arrays(case.reference.mesh))[0]
    back = pcu.closest_points_on_mesh(pair.reference_points, *arrays(noisy))[0]
    assert exact(noisy, case) == pytest.approx((there.mean() + back.mean()) / 2, rel=1e-5)


def arrays(mesh):
    return np.array(mesh.vertices), np.array(mesh.faces)


def test_two_way_surface_distance_measures_noise_below_the_floor_of_chamfer():
    """The truth scores 0, and twice the noise scores twice as much, where Chamfer-L1 is mostly its floor."""
    case, meshes = few_of(sphere(subdivisions=4)), []
    for sigma in (0.0, 1e-3, 2e-3, 0.2):
        meshes.append(sphere(subdivisions=4))
        meshes[-1].vertices *= 1 + generator("ladder").normal(0, sigma, (len(meshes[-1].vertices), 1))
    truth, little, twice, noise = (exact(mesh, case) for mesh in meshes)
    assert truth < 1e-15 < little < noise
    assert twice / little == pytest.approx(2, rel=0.02)
    chamfer = [ChamferL1Mean().score(mesh, case)["chamfer_l1_mean"] for mesh in meshes[1:3]]
    assert chamfer[1] / chamfer[0] < 1.2
    assert exact(trimesh.Trimesh(), case) == np.inf


def few_of(mesh):
    """Few samples: an exact distance needs no more."""
    case = case_of(mesh)
    set_samples(case, 5000)
    return case


def exact(output, case):
    return SurfaceDistanceMean().score(output, case)["surface_distance_mean"]


def test_floor_is_that_of_two_poisson_processes():
    # field: mean f = 0.5 sqrt(A / N) and mean f^2 = A / (pi N) for independent uniform samples of a surface.
    mesh = sphere()
    case = case_of(mesh)
    found = scores(case.perfect(mesh), case)
    assert found["chamfer_l1_mean"] == pytest.approx(0.5 * np.sqrt(mesh.area / N), rel=0.01)
    assert found["chamfer_l2_sum"] == pytest.approx(2 * mesh.area / (np.pi * N), rel=0.01)
    # The nearest of a Poisson process is farther than t with probability exp(-pi t^2 N / A).
    assert found["fscore@0.01"] == pytest.approx(1 - np.exp(-np.pi * 0.01**2 * N / mesh.area), rel=0.005)
    assert found["p2f_mean"] < 1e-15


def test_floor_of_a_cloud_has_its_own_count():
    case = case_of(sphere())
    few = case.perfect(PointCloud(np.zeros((5000, 3))))
    forward, backward = case.compare(few).to_reference.distance, case.compare(few).to_output.distance
    area = case.reference.mesh.area
    assert forward.mean() == pytest.approx(0.5 * np.sqrt(area / N), rel=0.03)
    assert backward.mean() == pytest.approx(0.5 * np.sqrt(area / 5000), rel=0.03)
    assert P2fMean().score(few, case)["p2f_mean"] < 1e-15


def test_single_point_at_the_centre_of_a_sphere():
    found = scores(PointCloud(np.zeros((1, 3))), case_of(sphere()))
    assert found["p2f_mean"] == pytest.approx(1, rel=1e-3)
    assert found["chamfer_l1_mean"] == pytest.approx(1, rel=1e-3)
    assert found["chamfer_l2_sum"] == pytest.approx(2, rel=1e-3)
    assert found["hausdorff"] == pytest.approx(1, rel=1e-3)
    assert found["fscore@0.01"] == found["precision@0.01"] == found["recall@0.01"] == 0


def test_huge_outlier_counts_in_full():
    case = case_of(sphere())
    points = np.vstack([case.perfect(PointCloud(np.zeros((999, 3)))).points, [[1e9, 0, 0]]])
    found = scores(PointCloud(points), case)
    assert found["hausdorff"] == pytest.approx(1e9, rel=1e-6)
    assert found["p2f_mean"] == pytest.approx(1e6, rel=1e-6)
    assert found["chamfer_l2_sum"] == pytest.approx(1e15, rel=1e-6)
    assert found["precision@0.01"] < 1


def test_fscore_is_the_harmonic_mean_of_shares():
    # 300 of 400 output points on the plane; the output covers the left half of it, densely against t.
    rng = generator(0)
    on = np.c_[rng.uniform(-1, 0, 300_00), rng.uniform(-1, 1, 300_00), np.zeros(300_00)]
    off = np.c_[rng.uniform(-1, 1, (100_00, 2)), np.full(100_00, 1.0)]
    found = Fscore(t=0.1).score(PointCloud(np.vstack([on, off])), case_of(square()))
    assert found["precision@0.1"] == 0.75
    assert found["recall@0.1"] == pytest.approx(0.55, abs=0.005)  # the covered half, and a band of width t beside it
    p, r = found["precision@0.1"], found["recall@0.1"]
    assert found["fscore@0.1"] == pytest.approx(2 / (1 / p + 1 / r))
    with pytest.raises(ValueError, match="t: expected"):
        Fscore(t=0)


# -- other libraries ---------------------------------------------------------------------------------------------------


def random_pair(seed, n=1500):
    rng = generator(seed, "pair")
    case = case_of(sphere(subdivisions=2), seed)
    output = PointCloud(rng.normal(size=(n, 3)) * rng.uniform(0.2, 1.5))
    pair = Comparison(output, case, samples=2000)
    case._cache["comparisons"] = [pair]
    return case, output, pair


@pytest.mark.parametrize("seed", range(3))
def test_against_all_pairs_of_scipy(seed):
    case, output, pair = random_pair(seed)
    distances = cdist(output.points, pair.reference_points)
    f, b = distances.min(axis=1), distances.min(axis=0)
    precision, recall = (f <= 0.2).mean(), (b <= 0.2).mean()
    found = scores(output, case) | Fscore(t=0.2).score(output, case)
    assert found["chamfer_l2_sum"] == pytest.approx((f**2).mean() + (b**2).mean(), rel=1e-9)
    assert found["chamfer_l1_mean"] == pytest.approx((f.mean() + b.mean()) / 2, rel=1e-9)
    assert found["hausdorff"] == pytest.approx(max(f.max(), b.max()), rel=1e-9)
    assert found["fscore@0.2"] == pytest.approx(2 * precision * recall / (precision + recall), rel=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_against_point_cloud_utils_and_igl(seed):
    case, output, pair = random_pair(seed)
    found = scores(output, case)
    points, samples = np.array(output.points), np.array(pair.reference_points)
    assert 2 * found["chamfer_l1_mean"] == pytest.approx(pcu.chamfer_distance(points, samples), rel=1e-6)
    assert found["hausdorff"] == pytest.approx(pcu.hausdorff_distance(points, samples), rel=1e-6)
    mesh = case.reference.mesh
    squared, _, _ = igl.point_mesh_squared_distance(points, np.array(mesh.vertices), np.array(mesh.faces))
    assert found["p2f_mean"] == pytest.approx(np.sqrt(squared).mean(), rel=1e-9)


# -- behaviour ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def noisy():
    case = case_of(sphere(subdivisions=4))
    points, normals = case.reference.surface.sample(4000, generator(1))
    return case, points, generator(2).normal(size=points.shape)


def test_order_of_the_points_does_not_matter(noisy):
    case, points, noise = noisy
    cloud = points + 0.02 * noise
    shuffled = scores(PointCloud(cloud[generator(3).permutation(len(cloud))]), case)
    assert shuffled == pytest.approx(scores(PointCloud(cloud), case), rel=1e-12)


def test_rigid_motion_of_everything_does_not_matter(noisy):
    case, points, noise = noisy
    matrix = trimesh.transformations.rotation_matrix(1.1, [1, 2, 3])
    matrix[:3, 3] = [0.3, -5, 2]
    turned = case_of(moved(case.reference.mesh, matrix))
    cloud = points + 0.02 * noise
    found = scores(PointCloud(cloud @ matrix[:3, :3].T + matrix[:3, 3]), turned)
    assert found == pytest.approx(scores(PointCloud(cloud), case), rel=1e-6)


def test_scores_grow_with_the_declared_power_of_scale(noisy):
    case, points, noise = noisy
    cloud = points + 0.02 * noise
    small = scores(PointCloud(cloud), case)
    large = scores(PointCloud(cloud * 4), case_of(moved(case.reference.mesh, np.diag([4, 4, 4, 1.0]))))
    for key, power in {"chamfer_l2_sum": 2, "chamfer_l1_mean": 1, "hausdorff": 1, "p2f_mean": 1}.items():
        assert large[key] == pytest.approx(4**power * small[key], rel=1e-9)


def test_a_better_output_scores_better(noisy):
    case, points, noise = noisy
    outputs = [PointCloud(points + sigma * noise) for sigma in (0, 0.003, 0.01, 0.03, 0.1)]
    outputs.append(PointCloud(generator(4).uniform(-1, 1, points.shape)))
    table = [scores(output, case) for output in outputs]
    for key in table[0]:
        # One gap in 4000 random points decides the Hausdorff distance of small noise.
        values = [row[key] for row in (table[3:] if key == "hausdorff" else table)]
        better_first = values if "@" not in key else values[::-1]
        assert better_first == sorted(better_first), key
        assert better_first[0] < better_first[-1], key


def test_degenerate_faces_of_the_output_do_not_change_scores():
    mesh, case = sphere(0.9, 4), case_of(sphere(subdivisions=4))
    flat = np.vstack([mesh.faces, np.c_[mesh.faces[:50, :2], mesh.faces[:50, 1]]])
    both = scores(trimesh.Trimesh(mesh.vertices, flat, process=False), case)
    assert both == pytest.approx(scores(mesh, case), rel=1e-9)


def test_degenerate_faces_of_the_reference_do_not_change_scores():
    mesh, output = sphere(subdivisions=4), PointCloud(generator(5).normal(size=(500, 3)))
    flat = np.vstack([np.c_[mesh.faces[:50, :2], mesh.faces[:50, 1]], mesh.faces])
    with_flat = scores(output, case_of(trimesh.Trimesh(mesh.vertices, flat, process=False)))
    assert with_flat == pytest.approx(scores(output, case_of(mesh)), rel=1e-9)
