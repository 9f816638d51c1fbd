import numpy as np
import pytest
import trimesh

from bench import PointCloud
from bench.pictures.errors import common_limit, distances, rounded_up, weights


def test_the_distance_to_a_plane_is_the_height():
    plane = trimesh.Trimesh([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], [[0, 1, 2], [0, 2, 3]], process=False)
    points = np.random.default_rng(0).uniform(-1, 1, (50, 3))
    assert distances(PointCloud(points), plane) == pytest.approx(abs(points[:, 2]), abs=1e-12)


def test_the_distance_of_a_mesh_to_itself_is_0_and_to_a_cloud_that_of_the_nearest_point():
    ball = trimesh.creation.icosphere(2)
    assert distances(ball, ball).max() < 1e-12
    cloud = PointCloud(np.random.default_rng(1).normal(size=(40, 3)))
    naive = np.linalg.norm(ball.vertices[:, None] - cloud.points[None], axis=2).min(axis=1)
    assert distances(ball, cloud) == pytest.approx(naive)
    bare = trimesh.Trimesh(cloud.points, process=False)
    assert distances(ball, bare) == pytest.approx(naive)
    assert len(distances(PointCloud(np.zeros((0, 3))), ball)) == 0


def test_weights_are_areas():
    mesh = trimesh.creation.box()
    mesh.vertices[:, 0] *= 3
    shares = np.zeros(len(mesh.vertices))
    for face, area in zip(mesh.faces, mesh.area_faces, strict=True):
        shares[face] += area / 3
    assert weights(mesh) == pytest.approx(shares / mesh.area)
    assert weights(PointCloud(np.zeros((4, 3)))).tolist() == [0.25] * 4


def test_a_common_limit_counts_each_shape_once_and_by_area():
    few, many = np.full(10, 2.0), np.full(1000, 1.0)
    pairs = [(few, np.full(10, 0.1)), (many, np.full(1000, 0.001))]
    assert common_limit(pairs, 0.49) == 1.0 and common_limit(pairs, 0.51) == 2.0
    ramp = np.linspace(0, 1, 10_001)
    assert common_limit([(ramp, np.full(len(ramp), 1 / len(ramp)))], 0.9) == pytest.approx(0.9, abs=0.011)
    assert common_limit([]) == 0.0 and common_limit([(np.zeros(3), np.ones(3) / 3)]) == 0.0


def test_limits_are_rounded_up_to_two_digits():
    assert [rounded_up(v) for v in (0.01234, 0.013, 1.0, 99.1, 0.0)] == [0.013, 0.013, 1.0, 100.0, 0.0]
