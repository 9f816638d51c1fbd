"""Outlier removal returns an unchanged subset; reconstruction methods close or keep holes as documented."""

import importlib.util
import sys

import numpy as np
import pytest
import trimesh

from bench import BadInput, PointCloud, Run
from bench.geometry.mesh_surface import MeshSurface
from bench.geometry.poisson_disk import eliminate
from bench.geometry.winding import inside
from bench.methods.classical.advancing_front import AdvancingFront, in_order, turn_pieces
from bench.methods.classical.alpha_shape import AlphaShape, circumcircles, circumradii
from bench.methods.classical.alpha_wrap import AlphaWrap
from bench.methods.classical.front import advancing_front
from bench.methods.classical.poisson import Poisson
from bench.methods.classical.radius_outlier import RadiusOutlier
from bench.methods.classical.statistical_outlier import StatisticalOutlier

CGAL = importlib.util.find_spec("CGAL") is not None
BALL = trimesh.creation.icosphere(5)
OUTLIERS = [StatisticalOutlier(), RadiusOutlier()]


def name(method):
    return type(method).__name__


def even_cloud(count, normals=True):
    points, truth = eliminate(*MeshSurface(BALL).sample(5 * count, np.random.default_rng(2)), BALL, count)
    return PointCloud(points, truth if normals else None)


def with_hole(cloud, radius):
    """Without the points within ``radius`` of the north pole."""
    kept = np.linalg.norm(cloud.points - [0, 0, 1], axis=1) > radius
    return PointCloud(cloud.points[kept], None if cloud.normals is None else cloud.normals[kept])


# -- outliers --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", OUTLIERS, ids=name)
def test_outliers_are_removed_and_the_rest_keeps_positions_order_and_normals(method):
    clean = even_cloud(1000)
    rng = np.random.default_rng(0)
    far = rng.standard_normal((50, 3))
    far *= rng.uniform(2, 3, 50)[:, None] / np.linalg.norm(far, axis=1, keepdims=True)
    place = rng.permutation(1050)
    cloud = PointCloud(np.vstack([clean.points, far])[place], np.vstack([clean.normals, far])[place])
    output = method.denoise(cloud, Run())
    index = [int(np.flatnonzero((cloud.points == p).all(axis=1))[0]) for p in output.points]
    assert index == sorted(index)
    assert np.array_equal(output.normals, cloud.normals[index])
    is_outlier = place[index] >= 1000
    assert is_outlier.sum() <= 2
    assert (~is_outlier).sum() > 950


@pytest.mark.parametrize("method", OUTLIERS, ids=name)
def test_duplicates_are_classified_as_one_point(method):
    cloud = PointCloud(np.repeat(np.vstack([even_cloud(500).points, [[3.0, 0, 0]]]), 3, axis=0))
    output = method.denoise(cloud, Run()).points
    assert np.array_equal(output[::3], output[2::3])
    assert output[:, 0].max() < 2  # three copies, still an outlier


def test_a_second_pass_finds_outliers_hidden_by_a_far_one():
    points = np.vstack([even_cloud(500).points, [[100.0, 0, 0]], [[1.5, 0, 0]]])
    once = StatisticalOutlier(passes=1).denoise(PointCloud(points), Run()).points
    twice = StatisticalOutlier(passes=2).denoise(PointCloud(points), Run()).points
    assert once[:, 0].max() == 1.5
    assert twice[:, 0].max() <= 1


def test_a_cluster_of_outliers_is_found_by_its_size():
    cluster = [2.0, 0, 0] + 0.01 * np.random.default_rng(0).standard_normal((4, 3))
    output = RadiusOutlier(radius=4.0, least=8).denoise(PointCloud(np.vstack([even_cloud(500).points, cluster])), Run())
    assert len(output) == 500


def test_an_empty_result_is_refused():
    with pytest.raises(BadInput, match="raise radius"):
        RadiusOutlier(radius=0.1).denoise(even_cloud(100), Run())


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: StatisticalOutlier(k=0),
        lambda: StatisticalOutlier(threshold=0),
        lambda: StatisticalOutlier(passes=0),
        lambda: RadiusOutlier(radius=0),
        lambda: RadiusOutlier(least=0),
    ],
)
def test_parameters_out_of_range_are_refused(wrong):
    with pytest.raises(ValueError, match="expected"):
        wrong()


# -- holes -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("normals", [True, False])
def test_an_alpha_shape_is_the_outer_sheet(normals):
    mesh = AlphaShape().reconstruct(even_cloud(1000, normals), Run())
    assert mesh.is_watertight and mesh.is_winding_consistent
    # A polyhedron through 1,000 points of a sphere has about 2,000 triangles and lacks 1 % of the volume.
    assert len(mesh.faces) == 1996
    assert 0.98 < mesh.volume / (4 / 3 * np.pi) < 1
    assert np.einsum("ni,ni->n", mesh.face_normals, mesh.triangles_center).min() > 0.9


def test_an_alpha_shape_keeps_a_hole_larger_than_the_ball_and_faces_outward():
    cloud = with_hole(even_cloud(1000), 0.5)
    small, large = AlphaShape(alpha=3).reconstruct(cloud, Run()), AlphaShape(alpha=20).reconstruct(cloud, Run())
    assert large.is_watertight and not small.is_watertight
    # The cap within a chord of 0.5 has the area pi * 0.25 of 4 pi; triangles at its rim are missing as well.
    assert small.area / (4 * np.pi) == pytest.approx(1 - 0.0625, abs=0.03)
    # From inside, the ball reaches the other side of a few flat tetrahedra.
    cosines = np.einsum("ni,ni->n", small.face_normals, small.triangles_center)
    assert np.average(cosines, weights=small.area_faces) > 0.9


def test_circumscribed_circles_and_balls():
    rng = np.random.default_rng(0)
    corners = rng.standard_normal((50, 4, 3))
    corners /= np.linalg.norm(corners, axis=2, keepdims=True)
    assert np.allclose(circumradii(3 * corners + 5), 3, rtol=1e-6)
    a, b, c = np.moveaxis(corners[:, :3], 1, 0)
    centers, radii = circumcircles(a, b, c)
    for corner in (a, b, c):
        assert np.allclose(np.linalg.norm(corner - centers, axis=1), radii)
    assert np.allclose(np.linalg.det(np.stack([b - a, c - a, centers - a], axis=1)), 0)
    flat = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 3, 0]]])
    assert np.isinf(circumradii(flat)).all()


def test_a_cut_opens_only_regions_without_points():
    cloud = even_cloud(2000)
    assert Poisson(depth=6, cut=0.7).reconstruct(cloud, Run()).is_watertight
    opened = Poisson(depth=6, cut=0.7).reconstruct(with_hole(cloud, 0.6), Run())
    assert not opened.is_watertight
    assert 0.85 < opened.area / (4 * np.pi) < 0.97  # the cap has 9 %, and points are near its rim


def test_components_are_oriented_one_by_one():
    ball = trimesh.creation.icosphere(2)
    vertices = np.vstack([ball.vertices, ball.vertices + [3.0, 0, 0]])
    normals = np.vstack([ball.vertices, ball.vertices])
    mixed = np.vstack([ball.faces, ball.faces[:, ::-1] + len(ball.vertices)])
    turned = turn_pieces(vertices, mixed, vertices, normals)
    assert trimesh.Trimesh(vertices, turned, process=False).volume == pytest.approx(2 * ball.volume)


def test_the_order_of_a_front_does_not_matter():
    rng = np.random.default_rng(0)
    ball = trimesh.creation.icosphere(2)
    mixed = rng.permutation(len(ball.vertices))
    faces = turn_pieces(ball.vertices[mixed], np.argsort(mixed)[ball.faces[:, ::-1]], ball.vertices, ball.vertices)
    faces = np.array([np.roll(face, turn) for face, turn in zip(faces, rng.integers(0, 3, len(faces)), strict=True)])
    for one, other in zip(
        in_order(ball.vertices[mixed], rng.permutation(faces)), in_order(ball.vertices, ball.faces), strict=True
    ):
        assert np.array_equal(one, other)


if CGAL:

    def test_a_wrap_spans_a_hole():
        cloud = with_hole(even_cloud(2000, normals=False), 0.3)
        mesh = AlphaWrap(alpha=12).reconstruct(cloud, Run())
        assert mesh.is_watertight
        # A flat lid removes the volume pi h^2 (1 - h / 3) with h = 0.045: 0.15 %; the offset above it adds some.
        assert mesh.volume == pytest.approx(4 / 3 * np.pi, rel=0.01)
        sphere = np.linalg.norm(mesh.vertices, axis=1)
        assert np.abs(sphere - 1).mean() < 0.005

    def test_an_unfitted_wrap_lies_outside_the_points():
        cloud = even_cloud(1000)
        wrapped = AlphaWrap(fit=False).reconstruct(cloud, Run())
        assert wrapped.is_watertight
        assert inside(wrapped.vertices, wrapped.faces, cloud.points * (1 - 1e-6)).all()

    def test_a_wrap_refuses_points_too_far_apart():
        with pytest.raises(BadInput, match="remove far outliers"):
            objects = [even_cloud(200).points + shift for shift in ([0, 0, 0], [1e6, 0, 0], [0, 1e6, 0])]
            AlphaWrap().reconstruct(PointCloud(np.vstack(objects)), Run())

    def test_a_front_does_not_depend_on_earlier_work_of_the_process(tmp_path, monkeypatch):
        # Two sheets closer than the spacing: many triangles are equally plausible.
        rng = np.random.default_rng(3)
        cloud = PointCloud(rng.uniform(-1, 1, (2000, 3)) * [1, 1, 0.03])
        faces = []
        for folder in ("/", tmp_path, "/"):
            monkeypatch.chdir(folder)
            faces.append(AdvancingFront().reconstruct(cloud, Run()).faces)
            memory = [np.zeros(size) for size in rng.integers(10, 20_000, 40)]
            del memory[::2]
        assert np.array_equal(faces[0], faces[1])
        assert np.array_equal(faces[0], faces[2])

    def test_a_crash_of_the_front_is_reported(monkeypatch):
        monkeypatch.setattr(sys, "executable", "false")
        with pytest.raises(RuntimeError, match="advancing front ended with exit status 1"):
            advancing_front(even_cloud(100).points, 5.0, 0.8)

    def test_an_advancing_front_interpolates_points_and_closes_holes():
        cloud = even_cloud(1000, normals=False)
        for given in (cloud, with_hole(cloud, 0.5)):
            mesh = AdvancingFront().reconstruct(given, Run())
            assert mesh.is_watertight
            assert {tuple(v) for v in mesh.vertices.tolist()} <= {tuple(p) for p in given.points.tolist()}
            # A flat lid removes pi h^2 (1 - h / 3) with h = 0.125: 1.1 %; the polyhedron lacks another 1 %.
            assert 0.97 < mesh.volume / (4 / 3 * np.pi) < 1
