"""Cages of characters: around a body, fitted by landmarks, learned in poses, and transferred."""

import numpy as np
import pytest
import torch
from trimesh import Trimesh
from trimesh.creation import box, icosphere

from bench import BadInput, Run, UsageError
from bench.contract.training import TrainingData
from bench.geometry.winding import inside
from bench.methods.cages.cage_per_pair import CagePerPair
from bench.methods.cages.character_cages import CharacterCages
from bench.methods.cages.characters.body_cage import body_cage
from bench.methods.cages.characters.examples import Poses, poses_of
from bench.methods.cages.characters.fitting import fitted
from bench.methods.cages.characters.posing import Posing
from bench.methods.cages.coordinates.mean_value import mean_value_coordinates
from bench.methods.cages.meshes.round_cages import ball_cage
from bench.methods.cages.networks.cage_network import PoseNetwork
from bench.metrics.pose_distance_mean import PoseDistanceMean
from bench.tasks.pose_transfer import PoseTransfer

from trainings import Logged, killed_and_resumed  # isort: skip

SMALL = {"cage_vertices": 30, "code": 16, "points": 64, "batch": 2, "steps": 40}


@pytest.fixture(scope="module")
def toy():
    return PoseTransfer().toy()


@pytest.fixture(scope="module")
def examples(toy):
    return poses_of(data_of([toy] * 4), Run(), 30)


def data_of(cases):
    return TrainingData(lambda: iter([Recipe(case) for case in cases]), None, len(cases))


class Recipe:
    def __init__(self, case):
        self._case = case

    def build(self):
        return self._case


def weights_of(points, cage, faces):
    return mean_value_coordinates(torch.from_numpy(points)[None], torch.from_numpy(cage)[None], faces)[0].numpy()


def test_a_cage_is_closed_contains_the_body_and_has_the_requested_vertices():
    body = icosphere(subdivisions=2)
    body.vertices = body.vertices * (0.3, 0.2, 1.0)
    for count in (30, 60):
        cage, faces = body_cage(body, count)
        mesh = Trimesh(cage, faces, process=False)
        assert len(cage) == count and mesh.is_watertight and mesh.volume > body.volume and mesh.body_count == 1
        assert inside(cage, faces, np.asarray(body.vertices)).all()
    with pytest.raises(BadInput, match="cage_vertices"):
        body_cage(body, 4)


def test_a_cage_fitted_to_a_scaled_and_moved_template_is_scaled_and_moved():
    """Points have the same coordinates in a cage scaled and moved with them: the loss is 0 there."""
    cage, faces = ball_cage(0, 1.7)
    there = np.asarray(icosphere(subdivisions=1).vertices)
    here, wanted = 1.1 * there + (0.05, 0, -0.03), 1.1 * cage + (0.05, 0, -0.03)
    fit = fitted(cage, faces, there, here, Run(), steps=80, learning_rate=1e-2, laplacian=0.0)
    off, before = (weights_of(here, c, faces) - weights_of(there, cage, faces) for c in (fit, cage))
    assert (off**2).mean() < 0.01 * (before**2).mean()
    assert np.abs(fit - wanted).max() < 0.2 * np.abs(cage - wanted).max()
    same = fitted(cage, faces, there, there, Run(), steps=5, learning_rate=5e-3, laplacian=0.05)
    assert np.array_equal(same, cage)


def test_the_laplacian_keeps_the_cage_smooth():
    rng = np.random.default_rng(1)
    cage, faces = ball_cage(1, 1.6)
    there = np.asarray(icosphere(subdivisions=1).vertices)
    here = there * (1.2, 0.9, 1.0) + 0.05 * rng.normal(size=there.shape)
    rough, smooth = (
        fitted(cage, faces, there, here, Run(), steps=50, learning_rate=1e-2, laplacian=w) for w in (0.0, 1.0)
    )
    edges = np.unique(np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1), axis=0)

    def roughness(c):
        return np.square((c - cage)[edges[:, 0]] - (c - cage)[edges[:, 1]]).sum()

    assert roughness(smooth) < 0.8 * roughness(rough)


def test_zero_offsets_keep_the_character_and_a_constant_one_translates_it(toy):
    posing = Posing(toy.input["source"], toy.input["template"], toy.input["landmarks"], Run())
    cage, faces = body_cage(
        Trimesh(toy.input["template"].vertices / posing.unit, toy.input["template"].faces, process=False), 30
    )
    still = posing.posed(cage, faces, np.zeros_like(cage), steps=5)
    np.testing.assert_allclose(still.vertices, toy.input["source"].vertices, atol=1e-9)
    kept = {}
    run = Run()
    run.keep = lambda name, make: kept.setdefault(name, make())
    moved = Posing(toy.input["source"], toy.input["template"], toy.input["landmarks"], run).posed(
        cage, faces, np.tile([0.1, 0, 0.2], (len(cage), 1)), steps=20
    )
    apart = moved.vertices - toy.input["source"].vertices
    assert np.abs(apart - apart[0]).max() < 1e-9 and np.abs(apart).max() > 0.05
    assert set(kept) == {"cage", "deformed_cage"} and len(kept["cage"].vertices) == len(cage)
    flat = Trimesh(toy.input["source"].vertices * (1, 1, 0), toy.input["source"].faces, process=False)
    with pytest.raises(BadInput, match="a height along z"):
        Posing(flat, toy.input["template"], toy.input["landmarks"], Run())
    with pytest.raises(BadInput, match="at least 8, got 2"):
        Posing(toy.input["source"], toy.input["template"], dict(list(toy.input["landmarks"].items())[:2]), Run())


def test_the_network_has_the_published_size_and_stores_its_cage():
    network = PoseNetwork(torch.zeros(77, 3), 512)
    assert sum(p.numel() for p in network.parameters()) == 1_362_023
    assert network.state_dict()["cage"].shape == (77, 3)


def test_examples_are_targets_and_posed_templates_in_the_unit_of_the_template(toy, examples):
    unit = np.ptp(toy.input["template"].vertices, axis=0).max() / 2
    targets, posed = Poses(examples).drawn(np.array([0, 1]), 2000, np.random.default_rng(0))
    assert len(Poses(examples)) == 3 and len(Poses(examples, held_out=True)) == 1
    truth = toy.reference.attributes["template_posed"] / unit
    np.testing.assert_allclose(posed[0], truth, atol=1e-4)  # all 642 vertices, in order
    np.testing.assert_allclose(examples["rest"], toy.input["template"].vertices / unit)
    assert np.abs(targets.max(axis=1) - toy.input["target"].points.max(axis=0) / unit).max() < 0.02


def test_two_templates_in_one_training_are_refused(toy):
    other = PoseTransfer().toy()
    other.input["template"].vertices *= (1.0, 1.3, 1.0)
    with pytest.raises(UsageError, match="several templates"):
        poses_of(data_of([toy, other]), Run(), 30)


def test_a_training_learns_resumes_exactly_and_poses_the_character(toy, examples):
    method = CharacterCages(**SMALL, fit_steps=60)
    run = Logged(seed=3)
    weights = method.fit(examples, run)
    losses = run.losses()
    assert losses[-1] < 0.5 * losses[0]
    again = killed_and_resumed(method, examples, at=11)
    assert weights.keys() == again.keys() and all(np.array_equal(weights[k], again[k]) for k in weights)
    posed = Run(weights=weights)
    output = method.pose_transfer(**toy.input, run=posed)
    PoseTransfer().validate(output, toy.input)
    score = PoseDistanceMean().score
    at_rest = score(toy.input["source"], toy)["pose_distance_mean"]
    assert score(output, toy)["pose_distance_mean"] < 0.5 * at_rest
    assert posed.notes == []
    wider = {**toy.input, "template": Trimesh(toy.input["template"].vertices * (3, 3, 1), toy.input["template"].faces)}
    method.pose_transfer(**wider, run=posed)
    assert "does not enclose the template" in str(posed.notes)
    assert posed.parameters == sum(w.size for k, w in weights.items() if k not in ("cage", "cage_faces"))


def test_one_cage_poses_the_toy_by_descent(toy):
    output = CagePerPair(points=128, steps=40, cage_vertices=30).pose_transfer(**toy.input, run=Run())
    score = PoseDistanceMean().score
    assert score(output, toy)["pose_distance_mean"] < 0.9 * score(toy.input["source"], toy)["pose_distance_mean"]


def test_several_bodies_get_one_cage():
    two = box((0.5, 0.5, 0.5))
    other = box((0.5, 0.5, 0.5))
    other.apply_translation((0, 0, 0.52))
    both = two + other
    cage, faces = body_cage(both, 40)
    assert Trimesh(cage, faces, process=False).body_count == 1 and inside(cage, faces, np.asarray(both.vertices)).all()


@pytest.mark.parametrize(
    "wrong", [{"cage_vertices": 19}, {"code": 0}, {"steps": -1}, {"worst": -1}, {"decay": 0}, {"fit_rate": 0.0}]
)
def test_invalid_parameters(wrong):
    with pytest.raises(ValueError, match=f"^{next(iter(wrong))}: expected"):
        CharacterCages(**wrong)
