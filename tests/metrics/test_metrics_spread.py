"""Uniformity and coverage of a cloud: closed forms, naive loops, and invariance."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.distance import cdist

from bench import Case, PointCloud, Shape, generator
from bench.geometry.comparison import set_samples
from bench.metrics.coverage import Coverage
from bench.metrics.projected_uniformity import ProjectedUniformity
from bench.metrics.spacing_variation import SpacingVariation, neighbour_distances
from bench.metrics.uniformity import Uniformity

METRICS = (Coverage(), SpacingVariation(), Uniformity(shares=(0.004, 0.012), disks=300))


def plane_case(side=2.0, samples=5000):
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * side / 2
    case = Case("plane", {}, Shape("plane", trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)))
    set_samples(case, samples)
    return case


def lattice(n=60):
    """A hexagonal lattice on the square of side 2, about n points per side."""
    step = 2 / n
    rows = np.arange(-1 + step / 2, 1, step * np.sqrt(0.75))
    points = [
        [x + (i % 2) * step / 2, y, 0] for i, y in enumerate(rows) for x in np.arange(-1 + step / 4, 1 - step / 4, step)
    ]
    return PointCloud(np.array(points))


def random_cloud(n=4000, seed=0):
    return PointCloud(np.c_[generator(seed).uniform(-1, 1, (n, 2)), np.zeros(n)])


def scores(output, case):
    return {key: value for metric in METRICS for key, value in metric.score(output, case).items()}


def test_poisson_process():
    # The nearest neighbour is farther than t with probability exp(-pi t^2 N / A): a Rayleigh distribution.
    found = scores(random_cloud(20_000), plane_case())
    assert found["spacing_variation"] == pytest.approx(np.sqrt(4 / np.pi - 1), rel=0.03)
    assert found["coverage@1"] == pytest.approx(1 - np.exp(-np.pi), abs=0.015)
    assert Coverage(reach=0.5).score(random_cloud(20_000), plane_case())["coverage@0.5"] == pytest.approx(
        1 - np.exp(-np.pi / 4), abs=0.03
    )


def test_lattice_is_the_most_even():
    case = plane_case()
    even, chance = scores(lattice(), case), scores(random_cloud(len(lattice())), case)
    assert even["spacing_variation"] < 1e-9
    assert even["coverage@1"] == 1
    for key in ("uniformity@0.004", "uniformity@0.012"):
        assert even[key] < chance[key] / 3  # the remainder comes from disks at the boundary


def test_uniformity_by_loops():
    case, share = plane_case(), 0.02
    cloud = PointCloud(np.vstack([random_cloud(840).points, np.tile(random_cloud(5).points, (12, 1))]))  # copies too
    centers, _ = case.reference.surface.sample(40, generator(0, "plane", "disks"))
    radius, expected, parts = np.sqrt(share * 4 / np.pi), share * 900, []
    for center in centers:
        inside = cloud.points[np.linalg.norm(cloud.points - center, axis=1) <= radius]
        n = len(inside)
        assert n > 1
        distances = cdist(inside, inside) + np.diag([np.inf] * n)
        hexagonal = np.sqrt(2 * np.pi * radius**2 / (n * np.sqrt(3)))
        clutter = np.mean([(min(row) - hexagonal) ** 2 / hexagonal for row in distances])
        parts.append((n - expected) ** 2 / expected * clutter)
    found = Uniformity(shares=(share,), disks=40).score(cloud, case)
    assert found == pytest.approx({"uniformity@0.02": np.mean(parts)}, rel=1e-9)


def test_projected_uniformity_by_loops():
    """For points off the plane, over the disks that hold five of their foot points."""
    case, share = plane_case(), 0.004
    cloud = PointCloud(random_cloud(900).points + np.c_[np.zeros((900, 2)), generator(3).normal(size=900)])
    feet = cloud.points * [1, 1, 0]
    centers, _ = case.reference.surface.sample(200, generator(0, "plane", "disks"))
    radius, expected, parts = np.sqrt(share * 4 / np.pi), share * 900, []
    for center in centers:
        inside = feet[np.linalg.norm(feet - center, axis=1) <= radius]
        n = len(inside)
        if n >= 5:
            spacing = (cdist(inside, inside) + np.diag([np.inf] * n)).min(axis=0)
            hexagonal = np.sqrt(2 * np.pi * radius**2 / (n * np.sqrt(3)))
            parts.append((n - expected) ** 2 / expected * np.mean((spacing - hexagonal) ** 2 / hexagonal))
    assert 20 < len(parts) < 120
    found = ProjectedUniformity(shares=(share,), disks=200).score(cloud, case)
    assert found == pytest.approx({"projected_uniformity@0.004": np.mean(parts)}, rel=1e-9)
    # On the surface, where every disk holds enough points, it equals uniformity.
    dense = random_cloud(9000)
    plain = Uniformity(shares=(0.01,), disks=50).score(dense, case)["uniformity@0.01"]
    assert ProjectedUniformity(shares=(0.01,), disks=50).score(dense, case) == {
        "projected_uniformity@0.01": pytest.approx(plain, rel=1e-9)
    }


def test_projected_uniformity_is_not_defined_where_no_disk_holds_five_points():
    found = ProjectedUniformity(shares=(0.004, 0.5), disks=50).score(random_cloud(40), plane_case())
    assert list(found) == ["projected_uniformity@0.5"]
    empty = ProjectedUniformity(shares=(0.004,)).score(PointCloud(np.empty((0, 3))), plane_case())
    assert empty == {"projected_uniformity@0.004": np.inf}


def test_holes_and_clumps_are_measured():
    case, whole = plane_case(), random_cloud(6000)
    half = PointCloud(whole.points[whole.points[:, 0] < 0])
    clumped = PointCloud(np.vstack([whole.points, [0.3, 0.3, 0] + 0.01 * generator(7).normal(size=(3000, 3))]))
    table = [scores(c, case) for c in (whole, half, clumped)]
    for spoiled in table[1:]:
        assert spoiled["uniformity@0.012"] > 2 * table[0]["uniformity@0.012"]
        assert spoiled["coverage@1"] < table[0]["coverage@1"]
    assert table[1]["coverage@1"] == pytest.approx(0.957 / 2, abs=0.03)
    assert table[2]["spacing_variation"] > table[0]["spacing_variation"]


def test_coverage_does_not_reward_more_points():
    found = [Coverage().score(random_cloud(n), plane_case())["coverage@1"] for n in (1000, 16_000)]
    assert found[0] == pytest.approx(found[1], abs=0.03)


def test_order_does_not_matter_and_scores_grow_with_a_power_of_scale():
    cloud, case = random_cloud(), plane_case()
    usual = scores(cloud, case)
    shuffled = PointCloud(cloud.points[generator(1).permutation(len(cloud))])
    assert scores(shuffled, case) == pytest.approx(usual, rel=1e-9)
    large = scores(PointCloud(cloud.points * 4), plane_case(side=8))
    power = {key: 4.0 if key.startswith("uniformity") else 1.0 for key in usual}
    assert large == pytest.approx({key: power[key] * value for key, value in usual.items()}, rel=1e-6)


def test_a_rigid_motion_of_the_cloud_does_not_change_its_spacing():
    matrix = trimesh.transformations.rotation_matrix(0.7, [1, 1, 0])[:3, :3]
    cloud = random_cloud(500)
    moved = PointCloud(cloud.points @ matrix.T + [3, 2, 1])
    metric, case = SpacingVariation(), plane_case()
    assert metric.score(moved, case) == pytest.approx(metric.score(cloud, case), rel=1e-9)


def test_duplicate_and_coincident_points():
    points = np.array([[0.0, 0, 0], [0, 0, 0], [1, 0, 0], [3, 0, 0]])
    assert neighbour_distances(points).tolist() == [0, 0, 1, 2]
    metric, case = SpacingVariation(), plane_case()
    assert metric.score(PointCloud(points), case)["spacing_variation"] == pytest.approx(np.std([0, 0, 1, 2]) / 0.75)
    for places in (np.zeros((5, 3)), np.zeros((1, 3))):
        assert metric.score(PointCloud(places), case) == {"spacing_variation": np.inf}


def test_one_outlier():
    case, cloud = plane_case(), random_cloud()
    far = PointCloud(np.vstack([cloud.points, [[100, 0, 0]]]))
    usual, spoiled = scores(cloud, case), scores(far, case)
    assert spoiled["coverage@1"] == pytest.approx(usual["coverage@1"], abs=1e-3)
    assert spoiled["uniformity@0.012"] == pytest.approx(usual["uniformity@0.012"], rel=0.01)
    assert spoiled["spacing_variation"] > 10 * usual["spacing_variation"]  # documented: a few points dominate it


@pytest.mark.parametrize(
    "metric",
    [
        lambda: Coverage(reach=0),
        lambda: Uniformity(disks=0),
        lambda: Uniformity(shares=(2,)),
        lambda: ProjectedUniformity(least=1),
    ],
)
def test_invalid_parameters(metric):
    with pytest.raises(ValueError, match="expected"):
        metric()
