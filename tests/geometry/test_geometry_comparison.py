"""The shared distances of a case: computed once, from independent samples, to the right surface."""

import numpy as np
import pytest
import trimesh

from bench import Case, InvalidOutput, PointCloud, Shape, generator
from bench.geometry import comparison as module
from bench.geometry.comparison import Comparison


class UnitSphere:
    """The sphere that an icosphere approximates."""

    def __init__(self):
        self.calls = []

    def sample(self, count, rng):
        self.calls.append("sample")
        points = rng.normal(size=(count, 3))
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        return points, points

    def closest(self, points):
        self.calls.append("closest")
        points = points / np.linalg.norm(points, axis=1, keepdims=True)
        return points, points


def sphere_case(subdivisions=3, surface=None, seed=0):
    return Case("sphere", {}, Shape("sphere", trimesh.creation.icosphere(subdivisions), surface=surface), seed=seed)


def test_each_distance_is_computed_once_and_only_on_demand(monkeypatch):
    counted = []
    for cls, name in ((module.OrderedPoints, "nearest_in"), (module.MeshSurface, "project")):
        real = getattr(cls, name)

        def count(self, *args, real=real, name=name):
            counted.append(name)
            return real(self, *args)

        monkeypatch.setattr(cls, name, count)
    case = sphere_case()
    output = PointCloud(case.reference.mesh.vertices)
    assert not counted
    for _ in range(2):
        assert case.compare(output).to_reference.distance.shape == (len(output),)
        assert case.compare(output).to_output.distance.shape == (100_000,)
    assert counted == ["nearest_in"] * 2
    for _ in range(2):
        assert case.compare(output).to_surface.distance.max() < 1e-12
    assert counted == ["nearest_in"] * 2 + ["project"]


def test_outputs_of_a_case_share_the_reference():
    case = sphere_case()
    a, b = (case.compare(PointCloud(np.eye(3) * k)) for k in (1, 2))
    assert a.reference_points is b.reference_points
    assert a._reference.mesh is b._reference.mesh


def test_reference_mesh_as_output_gets_other_samples():
    case = sphere_case()
    pair = case.compare(case.reference.mesh)
    assert len(pair.output_points) == len(pair.reference_points) == 100_000
    assert pair.to_reference.distance.min() > 0
    assert pair.to_surface.distance.max() < 1e-14


def test_samples_depend_on_seed_and_case_alone():
    first, again, other = (sphere_case(seed=s) for s in (0, 0, 1))
    mesh = trimesh.creation.icosphere(1)
    assert np.array_equal(first.compare(mesh).output_points, again.compare(mesh.copy()).output_points)
    assert np.array_equal(first.compare(mesh).reference_points, again.compare(mesh).reference_points)
    assert not np.array_equal(first.compare(mesh).reference_points, other.compare(mesh).reference_points)


def test_distances_are_in_the_order_of_the_output():
    case = sphere_case()
    points = np.random.default_rng(0).normal(size=(2000, 3))
    pair = Comparison(PointCloud(points), case, samples=5000)
    assert np.array_equal(pair.output_points, points)
    naive = np.linalg.norm(points - pair.reference_points[pair.to_reference.index], axis=1)
    assert pair.to_reference.distance == pytest.approx(naive)
    naive = np.linalg.norm(pair.reference_points - points[pair.to_output.index], axis=1)
    assert pair.to_output.distance == pytest.approx(naive)
    assert pair.to_surface.distance == pytest.approx(np.linalg.norm(points - pair.to_surface.points, axis=1))


def test_exact_surface_gives_samples_and_normals_and_the_mesh_gives_distances():
    case = sphere_case(2, UnitSphere())
    pair = case.compare(case.perfect(PointCloud(np.zeros((5000, 3)))))
    assert np.linalg.norm(pair.reference_points, axis=1) == pytest.approx(1)
    assert pair.to_surface.distance.max() > 1e-3  # the mesh cuts the corners of the sphere
    # The faces are tilted by whole degrees, the exact normals are not.
    tilt = np.degrees(np.arccos(np.clip((pair.output_normals * pair.surface_normals).sum(axis=1), -1, 1)))
    assert tilt.max() < 0.3
    faces = case.reference.mesh.face_normals[pair.to_surface.faces]
    assert np.degrees(np.arccos((pair.output_normals * faces).sum(axis=1))).max() > 3


def test_normals_do_not_leak_over_creases():
    class Box:
        """The cube, whose corners must choose one of three normals."""

        def sample(self, count, rng):
            return self.closest(rng.normal(size=(count, 3)))

        def closest(self, points):
            axis = np.abs(points).argmax(axis=1)[:, None]
            largest = np.take_along_axis(points, axis, axis=1)
            normals = np.zeros_like(points)
            np.put_along_axis(normals, axis, np.sign(largest), axis=1)
            return points / np.abs(largest), normals

    cube = trimesh.creation.box([2, 2, 2]).subdivide()
    pair = Case("box", {}, Shape("box", trimesh.Trimesh(cube.vertices, cube.faces, process=False), surface=Box()))
    pair = pair.compare(PointCloud(generator(0).uniform(-0.9, 0.9, (2000, 3)), generator(0).normal(size=(2000, 3))))
    axis = np.abs(pair.output_points).argmax(axis=1)
    rows = np.arange(2000)
    assert pair.surface_normals[rows, axis] == pytest.approx(np.sign(pair.output_points[rows, axis]))


def test_mesh_normals_are_those_of_the_sampled_faces():
    pair = sphere_case().compare(trimesh.creation.box())
    axis = np.abs(pair.output_points).argmax(axis=1)
    rows = np.arange(len(axis))
    assert pair.output_normals[rows, axis] == pytest.approx(np.sign(pair.output_points[rows, axis]))


def test_mesh_without_area_is_an_invalid_output():
    flat = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2], [0, 1, 1]], process=False)
    with pytest.raises(InvalidOutput, match="all 2 faces .* no area"):
        _ = sphere_case().compare(flat).output_points
