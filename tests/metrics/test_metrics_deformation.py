"""Scores of deformations: distances between corresponding vertices, and of outputs to their mirror images."""

import numpy as np
import pytest
import trimesh

from bench import Case, PointCloud, Shape, generator
from bench.geometry.comparison import set_samples
from bench.metrics.mirror_chamfer_l2_sum import MirrorChamferL2Sum
from bench.metrics.vertex_distance_mean import VertexDistanceMean

BALL = trimesh.creation.icosphere(3)
N = 20_000


def case_of(mesh, **info):
    return Case("case", {}, Shape("case", mesh, info=info))


def with_vertices(mesh, vertices):
    return trimesh.Trimesh(vertices, mesh.faces, process=False)


# -- corresponding vertices --------------------------------------------------------------------------------------------


def apart(output, reference):
    return VertexDistanceMean().score(output, case_of(reference))


def test_a_shift_scores_its_length_and_the_reference_scores_zero():
    assert apart(BALL, BALL) == {"vertex_distance_mean": 0.0}
    for shift in ((0.3, 0, 0), (0.1, -0.2, 0.2)):
        found = apart(with_vertices(BALL, BALL.vertices + shift), BALL)["vertex_distance_mean"]
        assert type(found) is float and found == pytest.approx(0.3)


def test_a_scaled_sphere_is_off_by_the_difference_of_radii():
    assert apart(with_vertices(BALL, 1.2 * BALL.vertices), BALL)["vertex_distance_mean"] == pytest.approx(0.2)


def test_a_rotation_of_a_sphere_onto_itself_is_measured():
    """A rotation by a about the z axis moves a vertex by 2 sin(a / 2) times its distance from the axis."""
    turn = trimesh.transformations.rotation_matrix(0.4, [0, 0, 1])[:3, :3]
    found = apart(with_vertices(BALL, BALL.vertices @ turn.T), BALL)["vertex_distance_mean"]
    assert found == pytest.approx(2 * np.sin(0.2) * np.linalg.norm(BALL.vertices[:, :2], axis=1).mean())
    assert found == pytest.approx(2 * np.sin(0.2) * np.pi / 4, rel=0.01)  # the mean over a sphere


def test_it_is_a_mean_of_distances_not_of_squares():
    vertices = BALL.vertices.copy()
    vertices[7] += (0, 0, 2)
    assert apart(with_vertices(BALL, vertices), BALL)["vertex_distance_mean"] == pytest.approx(2 / len(vertices))


def test_vertices_that_no_face_uses_do_not_count():
    reference = trimesh.Trimesh(np.vstack([[[0, 0, 0]], BALL.vertices]), BALL.faces + 1, process=False)
    moved = reference.vertices + (0.1, 0, 0)
    moved[0] = 1e6
    assert apart(with_vertices(reference, moved), reference)["vertex_distance_mean"] == pytest.approx(0.1)


@pytest.mark.parametrize(
    "output",
    [
        trimesh.creation.icosphere(2),
        trimesh.Trimesh(BALL.vertices, BALL.faces[::-1], process=False),
        trimesh.Trimesh(BALL.vertices, BALL.faces[:, ::-1], process=False),
        trimesh.Trimesh(BALL.vertices, BALL.faces[1:], process=False),
        trimesh.Trimesh(),
    ],
    ids=["other", "another order", "flipped", "one less", "empty"],
)
def test_an_output_with_different_faces_is_not_scored(output):
    assert apart(output, BALL) == {}


def test_an_additional_vertex_that_no_face_uses_is_ignored():
    more = trimesh.Trimesh(np.vstack([BALL.vertices, [[0, 0, 0]]]), BALL.faces, process=False)
    assert apart(more, BALL) == apart(BALL, more) == apart(BALL, BALL) != {}


# -- mirror images -----------------------------------------------------------------------------------------------------


def mirrored(output, symmetry="mirror x", reference=BALL, samples=N):
    return MirrorChamferL2Sum(samples).score(output, case_of(reference, symmetry=symmetry))


def plate(x, side=1.0):
    """A square in a plane of constant x."""
    corners = side / 2 * np.array([[0, -1, -1], [0, 1, -1], [0, 1, 1], [0, -1, 1]]) + (x, 0, 0)
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)


def floor_of(area, samples=N):
    return 2 * area / (np.pi * samples)


@pytest.mark.parametrize("name", ["ball", "two plates", "box"])
def test_symmetric_outputs_score_the_floor(name):
    mesh = {
        "ball": BALL,
        "two plates": trimesh.util.concatenate([plate(-0.4), plate(0.4)]),
        "box": trimesh.creation.box((0.5, 1, 1)),
    }[name]
    found = mirrored(mesh)["mirror_chamfer_l2_sum"]
    assert type(found) is float and found == pytest.approx(floor_of(mesh.area), rel=0.05)


def test_the_floor_falls_with_the_samples():
    few, many = (mirrored(BALL, samples=n)["mirror_chamfer_l2_sum"] for n in (1000, 8000))
    assert few == pytest.approx(8 * many, rel=0.1)


@pytest.mark.parametrize("x", [0.05, 0.2, -0.2])
def test_a_plate_beside_the_plane_is_twice_as_far_from_its_image(x):
    expected = 2 * (2 * x) ** 2 + floor_of(1)
    assert mirrored(plate(x))["mirror_chamfer_l2_sum"] == pytest.approx(expected, rel=0.01)


def test_points_of_a_cloud_are_used_unchanged():
    cloud = PointCloud(np.array([[0.3, 0, 0], [-0.1, 1, 0], [0, 0, 1]]))
    assert mirrored(cloud)["mirror_chamfer_l2_sum"] == pytest.approx(2 * (0.6**2 + 0.2**2) / 3)
    rng = generator("cloud")
    half = rng.normal(size=(50, 3))
    assert mirrored(PointCloud(np.vstack([half, half * (-1, 1, 1)])))["mirror_chamfer_l2_sum"] < 1e-24


def test_it_does_not_depend_on_the_distance_to_the_reference():
    found = mirrored(with_vertices(BALL, 0.5 * BALL.vertices + (0, 3, 1)))["mirror_chamfer_l2_sum"]
    assert found == pytest.approx(floor_of(BALL.area / 4), rel=0.05)


def test_a_less_symmetric_output_scores_worse():
    bent = [with_vertices(BALL, BALL.vertices + b * BALL.vertices[:, 1:2] * (1, 0, 0)) for b in (0.1, 0.2, 0.4)]
    found = [mirrored(mesh)["mirror_chamfer_l2_sum"] for mesh in bent]
    assert found[2] > 2 * found[1] > 4 * found[0] > 0


@pytest.mark.parametrize("symmetry", ["mirror x", "mirror x y"])
def test_it_applies_where_the_reference_has_the_mirror_plane(symmetry):
    assert mirrored(BALL, symmetry=symmetry)["mirror_chamfer_l2_sum"] > 0


@pytest.mark.parametrize(
    "symmetry", ["none", "", "mirror y", "revolution about an axis", "rotation 5 about an axis", None]
)
def test_it_does_not_apply_elsewhere(symmetry):
    assert mirrored(BALL, symmetry=symmetry) == {}
    assert MirrorChamferL2Sum().score(BALL, case_of(BALL)) == {}


def test_an_empty_output_scores_infinity():
    for empty in (trimesh.Trimesh(), PointCloud(np.empty((0, 3)))):
        assert mirrored(empty) == {"mirror_chamfer_l2_sum": np.inf}


def test_it_uses_its_own_number_of_samples():
    case = case_of(BALL, symmetry="mirror x")
    set_samples(case, 700)
    found = [MirrorChamferL2Sum(n).score(BALL, case)["mirror_chamfer_l2_sum"] for n in (N, 700)]
    assert found == pytest.approx([floor_of(BALL.area), floor_of(BALL.area, 700)], rel=0.15)
