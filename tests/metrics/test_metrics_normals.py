"""The angle between normals: closed forms and invariance."""

import numpy as np
import pytest
import trimesh

from bench import Case, PointCloud, Shape, generator
from bench.geometry.comparison import Comparison
from bench.metrics.normal_angle_deg import NormalAngleDeg, mean_angle


def angle(output, case):
    return NormalAngleDeg().score(output, case)["normal_angle_deg"]


def case_of(mesh, surface=None):
    return Case("case", {}, Shape("case", mesh, surface=surface))


@pytest.fixture(scope="module")
def plane():
    return case_of(
        trimesh.Trimesh([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]], process=False)
    )


def cloud_on_plane(normals, n=500):
    points = np.c_[generator(0).uniform(-1, 1, (n, 2)), np.zeros(n)]
    return PointCloud(points, np.broadcast_to(normals, (n, 3)))


@pytest.mark.parametrize("degrees", [0, 1e-6, 0.5, 30, 89.9, 90])
def test_tilted_normals_on_a_plane(plane, degrees):
    tilt = np.radians(degrees)
    found = angle(cloud_on_plane([np.sin(tilt), 0, np.cos(tilt)]), plane)
    assert found == pytest.approx(degrees, rel=1e-6, abs=1e-12)


def test_orientation_does_not_matter(plane):
    rng = generator(1)
    normals = rng.normal(size=(500, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    cloud = cloud_on_plane(normals)
    flipped = PointCloud(cloud.points, normals * rng.choice([-1, 1], (500, 1)))
    assert angle(flipped, plane) == pytest.approx(angle(cloud, plane), rel=1e-12)


def test_mesh_with_flipped_faces_scores_the_same(plane):
    mesh = trimesh.creation.icosphere(3)
    case = case_of(mesh)
    flipped = np.array([f[::-1] if i % 3 else f for i, f in enumerate(mesh.faces)])
    # The samples move within the flipped faces: equal up to sampling.
    found = angle(trimesh.Trimesh(mesh.vertices, flipped, process=False), case)
    assert found == pytest.approx(angle(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False), case), rel=0.02)


def test_random_normals_score_one_radian(plane):
    # For unit vectors uniform on the sphere |cos| is uniform in 0..1, so the mean angle is 1 radian.
    normals = generator(2).normal(size=(20_000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert angle(cloud_on_plane(normals, 20_000), plane) == pytest.approx(np.degrees(1), rel=0.02)


def test_both_directions_count(plane):
    # Left of x = 0 the normals are right, right of it they are turned by 90 degrees; most points are on the left.
    points = np.c_[generator(3).uniform(-1, 1, (4000, 2)), np.zeros(4000)]
    points = points[(points[:, 0] < 0) | (np.arange(4000) % 9 == 0)]
    right = points[:, 0] > 0
    cloud = PointCloud(points, np.where(right[:, None], [1.0, 0, 0], [0, 0, 1.0]))
    assert angle(cloud, plane) == pytest.approx((90 * right.mean() + 90 * 0.5) / 2, rel=0.06)


def test_against_a_naive_loop():
    rng = generator(4)
    case = case_of(trimesh.creation.icosphere(2))
    normals = rng.normal(size=(60, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    # Inside a convex shape the closest point lies in one face; outside it often lies on an edge between faces.
    cloud = PointCloud(rng.uniform(-0.5, 0.5, (60, 3)), normals)
    pair = Comparison(cloud, case, samples=300)
    case._cache["comparisons"] = [pair]
    mesh, forward, backward = case.reference.mesh, [], []
    closest, _, faces = trimesh.proximity.closest_point_naive(mesh, cloud.points)
    for n, face in zip(normals, faces, strict=True):
        forward.append(np.degrees(np.arccos(min(1, abs(n @ mesh.face_normals[face])))))
    for q, n in zip(pair.reference_points, pair.reference_normals, strict=True):
        nearest = np.argmin(np.linalg.norm(cloud.points - q, axis=1))
        backward.append(np.degrees(np.arccos(min(1, abs(n @ normals[nearest])))))
    assert angle(cloud, case) == pytest.approx((np.mean(forward) + np.mean(backward)) / 2, rel=1e-6)


def test_floor_of_exact_normals_is_small(plane):
    class Sphere:
        def sample(self, count, rng):
            return self.closest(rng.normal(size=(count, 3)))

        def closest(self, points):
            points = points / np.linalg.norm(points, axis=1, keepdims=True)
            return points, points

    mesh, output = trimesh.creation.icosphere(4), PointCloud(np.zeros((100_000, 3)))
    exact, tessellated = case_of(mesh, Sphere()), case_of(mesh)
    # Backward, a sample and its neighbour are 0.5 sqrt(A / N) = 0.32 degrees apart; forward, nothing is.
    assert angle(exact.perfect(output), exact) == pytest.approx(0.16, abs=0.02)
    # Against the faces of the mesh, exact normals score the tilt of the faces.
    assert angle(exact.perfect(output), tessellated) > 1


def test_clouds_without_normals_get_no_score(plane):
    assert NormalAngleDeg().score(PointCloud(np.zeros((1, 3))), plane) == {}


def test_normals_of_length_zero_are_left_out(plane):
    normals = np.tile([0, 0, 1.0], (500, 1))
    normals[::2] = 0
    assert angle(cloud_on_plane(normals), plane) == 0
    assert NormalAngleDeg().score(cloud_on_plane([0, 0, 0]), plane) == {}


def test_length_of_normals_does_not_matter(plane):
    assert angle(cloud_on_plane([0.3, 0, 0.3]), plane) == pytest.approx(45)


def test_mean_angle_is_undefined_without_directions():
    assert np.isnan(mean_angle(np.zeros((2, 3)), np.ones((2, 3))))
