"""What metrics require of a comparison: other sample counts, both directions, empty outputs, clouds."""

import numpy as np
import pytest
import trimesh

from bench import Case, PointCloud, Shape, generator
from bench.geometry import comparison as module
from bench.geometry.cloud_surface import CloudSurface
from bench.geometry.comparison import NeedsSurface, compare, set_samples

BALL = trimesh.creation.icosphere(2)


def case_of(samples=None):
    case = Case("ball", {}, Shape("ball", BALL))
    if samples:
        set_samples(case, samples)
    return case


def test_comparisons_of_another_count_are_cached_and_the_default_is_that_of_the_case():
    case = case_of(400)
    assert len(case.compare(BALL).reference_points) == 400
    assert compare(BALL, case, 400) is case.compare(BALL)
    first, other = compare(BALL, case, 70), BALL.copy()
    assert len(first.reference_points) == len(first.output_points) == 70
    assert compare(BALL, case, 70) is first
    assert compare(other, case, 70) is not first
    assert compare(other, case, 70).reference_points is first.reference_points
    assert case_of().compare(BALL).samples == module.SAMPLES


def test_distances_to_the_output_surface_are_exact_and_computed_once():
    case, box = case_of(500), trimesh.creation.box()
    pair = case.compare(box)
    expected = trimesh.proximity.closest_point_naive(box, pair.reference_points)[1]
    assert pair.from_surface.distance == pytest.approx(expected, abs=1e-9)
    assert pair.from_surface is pair.from_surface


@pytest.mark.parametrize("empty", [PointCloud(np.empty((0, 3))), trimesh.Trimesh(), trimesh.Trimesh(BALL.vertices)])
def test_an_empty_output_has_infinite_distances(empty):
    pair = case_of(100).compare(empty)
    assert pair.is_empty and not case_of(100).compare(BALL).is_empty
    for found, count in ((pair.to_reference, 1), (pair.to_output, 100), (pair.to_surface, 1)):
        assert found.distance.tolist() == [np.inf] * count


def test_a_cloud_as_reference_has_points_and_no_surface():
    points = generator(0).normal(size=(50, 3))
    shape = Shape("scan", trimesh.Trimesh(points, process=False), surface=CloudSurface(PointCloud(points)))
    pair = Case("scan", {}, shape).compare(PointCloud(points[:5]))
    assert pair.to_reference.distance.tolist() == [0] * 5 and pair.reference_normals is None
    assert len(pair.reference_points) == 50
    for ask in (lambda: pair.to_surface, lambda: pair.reference_area):
        with pytest.raises(NeedsSurface, match="scan: is a point cloud; expected a mesh"):
            ask()


def test_a_cloud_as_surface():
    points = generator(1).normal(size=(30, 3))
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    surface = CloudSurface(PointCloud(points, normals))
    some, their = surface.sample(10, generator(2))
    assert len(np.unique(some, axis=0)) == 10 and {*map(tuple, some)} <= {*map(tuple, points)}
    assert np.allclose(their, some / np.linalg.norm(some, axis=1, keepdims=True))
    found, normal = surface.closest(points[3:5] + 1e-9)
    assert np.array_equal(found, points[3:5]) and np.array_equal(normal, surface.cloud.normals[3:5])
