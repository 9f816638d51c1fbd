"""Deformation transfer: gradients of triangles, correspondence by landmarks, and parts that stay together."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from trimesh import Trimesh
from trimesh.creation import icosphere

from bench import BadInput, PointCloud, Run
from bench.methods.deformation.deformation_transfer import DeformationTransfer
from bench.methods.deformation.registration.gradients import corresponding_faces, deformation_gradients
from bench.metrics.pose_distance_mean import PoseDistanceMean
from bench.tasks.pose_transfer import PoseTransfer

from registration_shapes import stool  # isort: skip

TURN = Rotation.from_rotvec([0.3, -1.1, 0.6]).as_matrix()


def landmarks_of(mesh, here=None, count=40):
    rows = np.random.default_rng(0).permutation(len(mesh.vertices))[:count]
    other = mesh.vertices if here is None else here
    return {str(k): np.stack([mesh.vertices[k], other[k]]) for k in rows}


def test_gradients_of_a_similarity_are_its_linear_map():
    ball = icosphere(subdivisions=2)
    gradients = deformation_gradients(ball.vertices, 1.7 * ball.vertices @ TURN.T + 3, ball.faces)
    np.testing.assert_allclose(gradients, np.broadcast_to(1.7 * TURN, gradients.shape), atol=1e-9)


def test_gradients_map_edges_and_are_the_identity_on_faces_of_zero_area():
    rng = np.random.default_rng(0)
    ball = icosphere(subdivisions=1)
    moved = ball.vertices + 0.1 * rng.normal(size=ball.vertices.shape)
    faces = np.concatenate([ball.faces, [[0, 1, 1]]])
    gradients = deformation_gradients(ball.vertices, moved, faces)
    for face, gradient in zip(faces, gradients, strict=True):
        for k in (1, 2):
            edge, after = (v[face[k]] - v[face[0]] for v in (ball.vertices, moved))
            np.testing.assert_allclose(gradient @ edge, after if face[1] != face[2] else edge, atol=1e-9)


def test_faces_correspond_through_the_landmarks():
    ball = icosphere(subdivisions=2)
    moved = ball.vertices @ TURN.T * (1.0, 1.0, 1.0) + (5, 0, 0)  # far away and rotated: only landmarks relate them
    places = np.array(list(landmarks_of(ball, moved).values()))
    found = corresponding_faces(ball, places[:, 0], places[:, 1], moved, ball.faces, 1)
    assert np.array_equal(found[:, 0], np.arange(len(ball.faces)))


def test_the_opposite_side_of_a_thin_sheet_does_not_correspond():
    ball = icosphere(subdivisions=3)
    sheet = Trimesh(ball.vertices * (1, 1, 0.01), ball.faces, process=False)
    places = np.array(list(landmarks_of(sheet, count=60).values()))
    found = corresponding_faces(sheet, places[:, 0], places[:, 1], np.asarray(sheet.vertices), sheet.faces, 3)
    normals = sheet.face_normals
    assert (np.einsum("fa,fka->fk", normals, normals[found]) > 0).all()


@pytest.mark.parametrize("character", [icosphere(subdivisions=3), stool()], ids=["ball", "three parts"])
def test_a_similarity_of_the_template_is_transferred_to_the_character(character):
    """All triangles rotate and scale equally, so parts connected only by springs stay together."""
    template = icosphere(subdivisions=2)
    posed = Trimesh(1.3 * template.vertices @ TURN.T, template.faces, process=False)
    output = DeformationTransfer().pose_transfer(character, template, landmarks_of(template), posed, Run())
    wanted = 1.3 * np.asarray(character.vertices) @ TURN.T
    apart = output.vertices - wanted
    assert np.abs(apart - apart.mean(axis=0)).max() < 1e-6
    assert np.array_equal(output.faces, character.faces)


def test_the_toy_is_solved_with_and_without_the_posed_template():
    score = PoseDistanceMean().score
    known = PoseTransfer(target="corresponding").toy()
    at_rest = score(known.input["source"], known)["pose_distance_mean"]
    output = DeformationTransfer().pose_transfer(**known.input, run=Run())
    assert score(output, known)["pose_distance_mean"] < 0.15 * at_rest
    seen, run = PoseTransfer().toy(), Run()
    assert isinstance(seen.input["target"], PointCloud)
    notes = []
    run.note = notes.append
    output = DeformationTransfer().pose_transfer(**seen.input, run=run)
    assert score(output, seen)["pose_distance_mean"] < 0.7 * at_rest and "it is registered" in notes[0]


def test_invalid_landmarks_and_parameters_are_refused():
    toy = PoseTransfer(target="corresponding").toy()
    flat = {name: places * (1, 1, 0) for name, places in toy.input["landmarks"].items()}
    for marks in (flat, dict(list(flat.items())[:3])):
        with pytest.raises(BadInput, match="do not lie in a plane"):
            DeformationTransfer().pose_transfer(**toy.input | {"landmarks": marks}, run=Run())
    for wrong in ({"partners": 0}, {"registration": "icp"}, {"reach": 0}, {"joint": 0}):
        with pytest.raises(ValueError, match=f"^{next(iter(wrong))}: expected"):
            DeformationTransfer(**wrong)
