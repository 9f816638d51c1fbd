"""The pseudo-methods do what their names state."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from bench import BadInput, InvalidOutput, PointCloud, Run
from bench.geometry.spacing import mean_spacing
from bench.geometry.tiny_triangles import triangles_around
from bench.methods.pseudo.empty import Empty
from bench.methods.pseudo.identity import Identity
from bench.methods.pseudo.noise import Noise
from bench.tasks.denoise import Denoise
from bench.tasks.reconstruct import Reconstruct
from bench.tasks.upsample import Upsample


@pytest.fixture
def sphere():
    points = np.random.default_rng(0).standard_normal((500, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return PointCloud(points, normals=points)


@pytest.mark.parametrize("method", [Identity(), Noise()])
def test_identity_and_noise_give_valid_outputs(method, sphere):
    for task, output in [
        (Denoise(), method.denoise(sphere, Run())),
        (Upsample(ratio=3), method.upsample(sphere, 3, Run())),
        (Reconstruct(), method.reconstruct(sphere, Run())),
    ]:
        task.validate(output, task.input(sphere))


def test_empty_gives_invalid_outputs(sphere):
    for task, output in [
        (Denoise(), Empty().denoise(sphere, Run())),
        (Upsample(), Empty().upsample(sphere, 4, Run())),
        (Reconstruct(), Empty().reconstruct(sphere, Run())),
    ]:
        with pytest.raises(InvalidOutput):
            task.validate(output, task.input(sphere))


def test_identity_changes_nothing(sphere):
    assert np.array_equal(Identity().denoise(sphere, Run()).points, sphere.points)
    upsampled = Identity().upsample(sphere, 3, Run())
    assert np.array_equal(upsampled.points[1::3], sphere.points)
    assert np.array_equal(upsampled.normals[2::3], sphere.normals)


@pytest.mark.parametrize("with_normals", [True, False])
def test_the_mesh_of_identity_has_tiny_faces_at_the_points(sphere, with_normals):
    cloud = sphere if with_normals else PointCloud(sphere.points)
    mesh = Identity().reconstruct(cloud, Run())
    size = 0.01 * mean_spacing(cloud.points)
    assert np.allclose(mesh.triangles_center, cloud.points, atol=1e-12)
    assert np.allclose(np.linalg.norm(mesh.vertices - np.repeat(cloud.points, 3, axis=0), axis=1), size)
    # Outward: normals estimated from 500 random points are accurate to some degrees.
    cosines = np.einsum("ni,ni->n", mesh.face_normals, cloud.points)
    assert cosines.min() > (1 - 1e-9 if with_normals else 0.8)


def test_noise_is_uniform_in_the_unit_ball_and_repeatable(sphere):
    big = PointCloud(np.repeat(sphere.points, 40, axis=0))
    points = Noise().denoise(big, Run(seed=3)).points
    radii = np.linalg.norm(points, axis=1)
    # Uniform: the cubed radius is uniform in 0..1, with mean 1/2 and standard deviation 1/sqrt(12).
    assert radii.max() <= 1
    assert abs((radii**3).mean() - 0.5) < 5 / np.sqrt(12 * len(points))
    assert np.abs(points.mean(axis=0)).max() < 5 * np.sqrt(0.2 / len(points))
    assert np.array_equal(points, Noise().denoise(big, Run(seed=3)).points)
    assert not np.array_equal(points, Noise().denoise(big, Run(seed=4)).points)


def test_the_mesh_of_noise_has_a_face_per_point_and_hardly_any_area(sphere):
    mesh = Noise().reconstruct(sphere, Run())
    assert len(mesh.faces) == len(sphere)
    assert mesh.area == pytest.approx(len(sphere) * 3 * np.sqrt(3) / 4 * 1e-6)
    assert cKDTree(sphere.points).query(mesh.triangles_center)[0].mean() > 0.1


def test_triangles_are_perpendicular_to_their_normals():
    normals = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, 1], [0.6, 0, 0.8]])
    mesh = triangles_around(np.arange(12.0).reshape(4, 3), normals, 0.1)
    assert isinstance(mesh, trimesh.Trimesh)
    assert np.allclose(mesh.face_normals, normals)


@pytest.mark.parametrize("method", [Identity(), Noise()])
@pytest.mark.parametrize("points", [np.empty((0, 3)), [[np.nan, 0, 0], [1, 0, 0], [0, 1, 0]]], ids=["none", "nan"])
def test_unusable_input_is_refused(method, points):
    cloud = PointCloud(points)
    for call in (method.denoise, method.reconstruct):
        with pytest.raises(BadInput):
            call(cloud, Run())
