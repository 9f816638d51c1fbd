"""Volume overlap, Laplacians, triangle quality and self-intersections: closed forms and other libraries."""

import igl
import igl.copyleft.cgal
import numpy as np
import pytest
import trimesh

from bench import Case, Shape, generator
from bench.geometry.laplacian import cotangent_laplacian
from bench.geometry.quality import triangle_quality
from bench.geometry.self_intersections import self_intersecting_faces
from bench.geometry.winding import inside
from bench.metrics.cot_laplacian import CotLaplacian
from bench.metrics.iou import Iou
from bench.metrics.mesh_quality import MeshQuality
from bench.metrics.self_intersections import SelfIntersections


def case_of(mesh, source=None):
    return Case("case", {"source": source} if source is not None else {}, Shape("case", mesh))


def placed(mesh, scale=1.0, shift=(0, 0, 0), turn=None):
    vertices = mesh.vertices * scale
    if turn is not None:
        vertices = vertices @ turn[:3, :3].T
    return trimesh.Trimesh(vertices + shift, mesh.faces, process=False)


TURN = trimesh.transformations.rotation_matrix(1.1, [1, 2, 3])
BALL = trimesh.creation.icosphere(2)
PATCH = placed(trimesh.creation.icosphere(3))  # a bumpy ball
PATCH.vertices *= 1 + 0.2 * np.sin(5 * PATCH.vertices[:, :1])


# -- intersection over union -------------------------------------------------------------------------------------------


def test_boxes_that_overlap_by_half():
    box = trimesh.creation.box()
    found = Iou(samples=20_000).score(placed(box, shift=(0.5, 0, 0)), case_of(box))
    assert found["iou"] == pytest.approx(1 / 3, abs=4 * np.sqrt(2 / 9 / 20_000))


@pytest.mark.parametrize("radius", [0.8, 1.25])
def test_concentric_spheres(radius):
    ball = trimesh.creation.icosphere(3)
    found = Iou(samples=20_000).score(placed(ball, radius), case_of(ball))
    assert found["iou"] == pytest.approx(min(radius, 1 / radius) ** 3, abs=0.02)


def test_extreme_values_and_invariance_of_iou():
    box = trimesh.creation.box()
    metric = Iou(samples=5000)
    assert metric.score(box, case_of(box)) == {"iou": 1.0}
    assert metric.score(placed(box, shift=(2, 0, 0)), case_of(box)) == {"iou": 0.0}
    flipped = trimesh.Trimesh(box.vertices, box.faces[:, ::-1], process=False)
    assert metric.score(flipped, case_of(box)) == {"iou": 1.0}
    large = metric.score(placed(box, 5, (1, 0, 0)), case_of(placed(box, 5)))
    assert large == pytest.approx(metric.score(placed(box, 1, (0.2, 0, 0)), case_of(box)), rel=1e-9)


def test_open_references_have_no_volume_and_open_outputs_are_closed():
    ball = trimesh.creation.icosphere(3)
    holed = trimesh.Trimesh(ball.vertices, ball.faces[8:], process=False)
    assert Iou().score(ball, case_of(holed)) == {}
    assert Iou(samples=5000).score(holed, case_of(ball))["iou"] > 0.97
    flat = trimesh.Trimesh([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], [[0, 1, 2]], process=False)
    assert Iou(samples=5000).score(flat, case_of(ball))["iou"] < 0.01


def test_a_far_vertex_gives_zero_not_nan():
    ball = trimesh.creation.icosphere(1)
    vertices = np.vstack([ball.vertices, [[1e6, 1e6, 1e6], [1e6, 1e6, 1e6 + 1e-3], [1e6, 1e6 + 1e-3, 1e6]]])
    spiked = trimesh.Trimesh(vertices, np.vstack([ball.faces, [[42, 43, 44]]]), process=False)
    assert Iou(samples=1000).score(spiked, case_of(ball)) == {"iou": 0.0}


def test_inside_against_the_exact_winding_number():
    points = generator(0).uniform(-1.3, 1.3, (3000, 3))
    exact = igl.winding_number(np.array(PATCH.vertices), np.array(PATCH.faces), points)
    assert (inside(PATCH.vertices, PATCH.faces, points) == (np.abs(exact) > 0.5)).mean() > 0.998


# -- cotangent Laplacian -----------------------------------------------------------------------------------------------


def test_laplacian_against_igl():
    ours = cotangent_laplacian(PATCH.vertices, PATCH.faces)
    theirs = igl.cotmatrix(np.array(PATCH.vertices), np.array(PATCH.faces))
    assert abs(ours - theirs).max() < 1e-12


def test_laplacian_of_one_triangle_by_loops():
    V, F = np.array([[0.0, 0, 0], [2, 0, 0], [0.5, 1.5, 1]]), np.array([[0, 1, 2]])
    L = cotangent_laplacian(V, F).toarray()
    for i, j, o in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        u, w = V[i] - V[o], V[j] - V[o]
        angle = np.arccos(u @ w / np.linalg.norm(u) / np.linalg.norm(w))
        assert L[i, j] == pytest.approx(1 / np.tan(angle) / 2) == L[j, i]
    assert L.sum(axis=1) == pytest.approx(np.zeros(3))
    assert not cotangent_laplacian(V[[0, 1, 1]], F).toarray().any()  # no area, no weight


def test_the_laplacian_ignores_rigid_motion_and_grows_with_scale():
    metric, case = CotLaplacian(), case_of(PATCH, PATCH)
    assert metric.score(placed(PATCH, shift=(1, 2, 3), turn=TURN), case)["cot_laplacian"] < 1e-12
    once, twice = (metric.score(placed(PATCH, s), case)["cot_laplacian"] for s in (1.1, 1.2))
    L = igl.cotmatrix(np.array(PATCH.vertices), np.array(PATCH.faces))
    assert once == pytest.approx(0.1 * np.linalg.norm(L @ PATCH.vertices, axis=1).mean(), rel=1e-6)
    assert twice == pytest.approx(2 * once, rel=1e-6)


def test_units_of_the_three_forms():
    box = trimesh.creation.box(extents=(4, 2, 2))
    found = CotLaplacian().score(placed(PATCH, 1.1), case_of(box, PATCH))
    assert found["cot_laplacian_box"] == pytest.approx(found["cot_laplacian"] / 2)
    total = found["cot_laplacian"] * len(PATCH.vertices)
    assert found["cot_laplacian_per_area"] == pytest.approx(total / PATCH.area)


def test_only_the_form_per_area_converges_with_the_resolution():
    # |L V| / A is twice the mean curvature: on the unit sphere 2, so a growth by 10 % changes 0.2 of each area.
    balls = [trimesh.creation.icosphere(k) for k in (2, 3, 4)]
    found = [CotLaplacian().score(placed(b, 1.1), case_of(b, b)) for b in balls]
    assert [f["cot_laplacian_per_area"] for f in found] == pytest.approx([0.2] * 3, rel=0.02)
    assert found[0]["cot_laplacian"] > 3.5 * found[1]["cot_laplacian"] > 12 * found[2]["cot_laplacian"]


def test_laplacian_does_not_apply_to_other_faces_or_without_a_source():
    metric = CotLaplacian()
    assert metric.score(BALL, case_of(BALL)) == {}
    assert metric.score(BALL, case_of(BALL, PATCH)) == {}
    turned = trimesh.Trimesh(BALL.vertices, BALL.faces[:, ::-1], process=False)
    assert metric.score(turned, case_of(BALL, BALL)) == {}
    noisy = trimesh.Trimesh(
        BALL.vertices + 0.05 * generator(1).normal(size=BALL.vertices.shape), BALL.faces, process=False
    )
    assert metric.score(noisy, case_of(BALL, BALL))["cot_laplacian"] > 0.01


# -- quality -----------------------------------------------------------------------------------------------------------


def test_quality_against_trimesh_and_igl():
    mesh = placed(PATCH)
    mesh.vertices += 0.02 * generator(2).normal(size=mesh.vertices.shape)
    found = triangle_quality(mesh.vertices, mesh.faces)
    assert found.min_angle == pytest.approx(np.degrees(mesh.face_angles.min(axis=1)), rel=1e-6)
    lengths = igl.edge_lengths(np.array(mesh.vertices), np.array(mesh.faces))
    circumscribed, inscribed = lengths.prod(axis=1) / (4 * mesh.area_faces), 2 * mesh.area_faces / lengths.sum(axis=1)
    assert found.radius_ratio == pytest.approx(2 * inscribed / circumscribed, rel=1e-9)
    altitude = 2 * mesh.area_faces / lengths.max(axis=1)
    assert found.aspect_ratio == pytest.approx(np.sqrt(3) / 2 * lengths.max(axis=1) / altitude, rel=1e-9)


def test_quality_of_known_triangles():
    root = np.sqrt(0.75)
    corners = [[0, 0, 0], [1, 0, 0], [0.5, root, 0], [0, 1, 0], [2, 0, 0], [1, 1e-3, 0]]
    faces = [[0, 1, 2], [0, 1, 3], [0, 1, 4], [0, 4, 5], [0, 0, 1]]
    found = triangle_quality(np.array(corners), np.array(faces))
    assert found.min_angle[:3] == pytest.approx([60, 45, 0])
    assert found.radius_ratio[:3] == pytest.approx([1, 2 * (np.sqrt(2) - 1), 0])  # of 1, 1, sqrt 2
    assert found.aspect_ratio[:2] == pytest.approx([1, 2 * root]) and np.isinf(found.aspect_ratio[[2, 4]]).all()
    mesh = trimesh.Trimesh(corners, faces, process=False)
    assert MeshQuality().score(mesh, case_of(BALL))["triangle_sliver_share"] == pytest.approx(3 / 5)


def test_quality_does_not_change_with_place_and_size():
    moved = placed(PATCH, 7, (1, 2, 3), TURN)
    assert MeshQuality().score(moved, case_of(BALL)) == pytest.approx(
        MeshQuality().score(PATCH, case_of(BALL)), rel=1e-9
    )


# -- self-intersections ------------------------------------------------------------------------------------------------


def exact(mesh):
    """By CGAL's exact predicates."""
    found = igl.copyleft.cgal.remesh_self_intersections(
        np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int64), detect_only=True
    )
    crossing = np.zeros(len(mesh.faces), dtype=bool)
    crossing[np.asarray(found[2]).ravel()] = True
    return crossing


@pytest.mark.parametrize("sigma", [0.0, 0.03, 0.1, 0.5])
def test_self_intersections_of_a_noisy_sphere_against_cgal(sigma):
    mesh = placed(BALL)
    mesh.vertices += sigma * generator(3).normal(size=mesh.vertices.shape)
    assert (self_intersecting_faces(mesh.vertices, mesh.faces) == exact(mesh)).all()


def test_self_intersections_of_long_and_short_triangles_against_cgal():
    rng = generator(4)
    corners = rng.normal(size=(150, 1, 3)) + rng.normal(size=(150, 3, 3)) * 10.0 ** rng.uniform(-4, 0.5, (150, 1, 1))
    soup = trimesh.Trimesh(corners.reshape(-1, 3), np.arange(450).reshape(-1, 3), process=False)
    found = self_intersecting_faces(soup.vertices, soup.faces)
    assert 10 < found.sum() < 140
    assert (found == exact(soup)).all()


def test_two_spheres_that_pass_through_each_other():
    both = trimesh.util.concatenate([BALL, placed(BALL, shift=(0.7, 0.1, 0.05))])
    found = self_intersecting_faces(both.vertices, both.faces)
    assert (found == exact(both)).all() and found.any()
    scores = SelfIntersections().score(both, case_of(BALL))
    assert scores == {"self_intersecting_faces": found.sum(), "self_intersecting_share": found.mean()}
    again = placed(both, 1e-3, (5, 5, 5), TURN)
    assert (self_intersecting_faces(again.vertices, again.faces) == found).all()
    shuffled = generator(5).permutation(len(both.faces))
    assert (self_intersecting_faces(both.vertices, both.faces[shuffled]) == found[shuffled]).all()


@pytest.mark.parametrize("turn", [None, TURN])
def test_flat_regions_contact_and_copies_are_not_self_intersections(turn):
    box = trimesh.creation.box().subdivide().subdivide()
    beside = placed(box, shift=(1, 0, 0))  # they touch along a whole side
    mesh = placed(trimesh.util.concatenate([box, beside, box]), turn=turn)
    assert not self_intersecting_faces(mesh.vertices, mesh.faces).any()
    soup = trimesh.Trimesh(box.triangles.reshape(-1, 3), np.arange(3 * len(box.faces)).reshape(-1, 3), process=False)
    assert not self_intersecting_faces(soup.vertices, soup.faces).any()
    assert not self_intersecting_faces(np.zeros((0, 3)), np.zeros((0, 3), dtype=int)).any()
