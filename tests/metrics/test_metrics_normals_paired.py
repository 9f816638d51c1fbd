"""Cosines and oriented angles between normals: closed forms, a naive loop, and invariance."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from bench import Case, PointCloud, Shape, generator
from bench.geometry.comparison import set_samples
from bench.metrics.normal_angle_oriented_deg import NormalAngleOrientedDeg, oriented_angles
from bench.metrics.normal_cosine import NormalCosine
from bench.metrics.normal_cosine_distance import NormalCosineDistance


@pytest.fixture(scope="module")
def plane():
    corners = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    case = Case("plane", {}, Shape("plane", trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)))
    set_samples(case, 1000)
    return case


def tilted(degrees, n=200):
    angle = np.radians(degrees)
    points = np.c_[generator(0).uniform(-1, 1, (n, 2)), np.zeros(n)]
    return PointCloud(points, np.broadcast_to([np.sin(angle), 0, np.cos(angle)], (n, 3)))


@pytest.mark.parametrize("degrees", [0, 1e-5, 30, 90, 150, 180])
def test_tilted_normals(plane, degrees):
    cos = np.cos(np.radians(degrees))
    found = NormalCosine().score(tilted(degrees), plane)
    assert found == pytest.approx({"normal_cosine": abs(cos), "normal_cosine_oriented": cos}, abs=1e-12)
    angle = NormalAngleOrientedDeg().score(tilted(degrees), plane)
    assert angle["normal_angle_oriented_deg"] == pytest.approx(degrees, rel=1e-6, abs=1e-12)
    assert angle["normal_flipped_share"] == float(degrees > 90)
    distance = NormalCosineDistance().score(tilted(degrees), plane)
    # IDF adds (1 - cos) / 2 over both directions; pytorch3d adds 1 - |cos|.
    assert distance["normal_cosine_distance_oriented_mean"] == pytest.approx(2 * (1 - cos) / 2, abs=1e-12)
    assert distance["normal_cosine_distance_sum"] == pytest.approx(2 * (1 - abs(cos)), abs=1e-12)


def test_against_a_naive_pairing():
    case = Case("ball", {}, Shape("ball", trimesh.creation.icosphere(2)))
    set_samples(case, 500)
    rng = generator("normals")
    points, normals = rng.normal(size=(300, 3)), rng.normal(size=(300, 3))
    output = PointCloud(points, normals / np.linalg.norm(normals, axis=1, keepdims=True))
    pair = case.compare(output)
    f = [o @ pair.reference_normals[q] for o, q in zip(output.normals, cKDTree(pair.reference_points).query(points)[1])]  # noqa: B905
    b = [r @ output.normals[p] for r, p in zip(pair.reference_normals, cKDTree(points).query(pair.reference_points)[1])]  # noqa: B905
    found = NormalCosine().score(output, case)
    assert found["normal_cosine"] == pytest.approx((np.abs(f).mean() + np.abs(b).mean()) / 2)
    assert found["normal_cosine_oriented"] == pytest.approx((np.mean(f) + np.mean(b)) / 2)
    distances = NormalCosineDistance().score(output, case)
    assert distances["normal_cosine_distance_oriented_mean"] == pytest.approx(1 - found["normal_cosine_oriented"])
    assert distances["normal_cosine_distance_sum"] == pytest.approx(2 - 2 * found["normal_cosine"])
    same = NormalCosineDistance(samples=500).score(output, case)
    assert same == {f"{name}@500": value for name, value in distances.items()}
    assert NormalCosineDistance(samples=100).score(output, case).keys() == {name.replace("500", "100") for name in same}


def test_random_normals(plane):
    rng = generator("random")
    normals = rng.normal(size=(20_000, 3))
    cloud = PointCloud(
        np.c_[rng.uniform(-1, 1, (20_000, 2)), np.zeros(20_000)], normals / np.linalg.norm(normals, axis=1)[:, None]
    )
    found = NormalCosine().score(cloud, plane) | NormalAngleOrientedDeg().score(cloud, plane)
    assert found["normal_cosine"] == pytest.approx(0.5, abs=0.02)
    assert found["normal_angle_oriented_deg"] == pytest.approx(90, abs=3)
    assert found["normal_flipped_share"] == pytest.approx(0.5, abs=0.02)


def test_only_oriented_angles_detect_inverted_normals():
    ball = trimesh.creation.icosphere(3)
    case = Case("ball", {}, Shape("ball", ball))
    set_samples(case, 2000)
    turned = trimesh.Trimesh(ball.vertices, ball.faces[:, ::-1], process=False)
    right, wrong = NormalCosine().score(ball, case), NormalCosine().score(turned, case)
    assert wrong["normal_cosine"] == pytest.approx(right["normal_cosine"], abs=1e-3)
    assert wrong["normal_cosine_oriented"] == pytest.approx(-right["normal_cosine_oriented"], abs=1e-3)
    assert NormalAngleOrientedDeg().score(turned, case)["normal_angle_oriented_deg"] > 178


def test_without_normals_there_is_no_score(plane):
    cloud = PointCloud([[0.0, 0, 0], [1, 0, 0]])
    for metric in (NormalCosine(), NormalCosineDistance(), NormalAngleOrientedDeg()):
        assert metric.score(cloud, plane) == {}


def test_angles_near_0_and_180_degrees_are_accurate():
    t = np.array([1e-9, 1e-5, 1.0, np.pi - 1e-9])
    a, b = np.tile([1.0, 0, 0], (4, 1)), np.c_[np.cos(t), np.sin(t), np.zeros(4)]
    assert oriented_angles(a, b) == pytest.approx(np.degrees(t), rel=1e-7)
    assert len(oriented_angles(np.zeros((2, 3)), np.ones((2, 3)))) == 0
