"""Cycle-consistent deformation: the network, the cycles, and the training set shared by learned deformers."""

import numpy as np
import pytest
import torch
from learned_deformation_toys import (
    SHARED_MISTAKES,
    assert_deforms,
    assert_learns,
    assert_refuses,
    assert_resumes,
    examples,
    generator,
    number_of_parameters,
    points,
)
from scipy.spatial import cKDTree
from torch.nn import functional as F

from bench import Run, TrainingData
from bench.geometry.mesh_surface import MeshSurface
from bench.methods.deformation.cycle_consistent import CycleConsistent
from bench.methods.deformation.networks.adaptive_network import AdaptiveNetwork
from bench.methods.deformation.training.cycle_training import WAYS, Cycles, CycleTraining
from bench.methods.deformation.training.pairs import FULL, Pairs, pairs_of
from bench.tasks.deform import Deform

TOY = CycleConsistent(width=0.0625, points=64, steps=3, batch=2)


def distances(a, b):
    return cKDTree(b).query(a)[0]


# --- the network ------------------------------------------------------------------------------------------------------


def test_the_network_has_the_published_number_of_parameters():
    network = AdaptiveNetwork()
    assert number_of_parameters(network) == 8_436_117 and sum(network.predicted) == 24_972
    weights = CycleConsistent()._network().state_dict()
    assert 2 * sum(tensor.numel() for tensor in weights.values()) < 1.5e6


def test_an_untrained_network_is_the_identity():
    network = AdaptiveNetwork(0.125, residual=True, generator=generator())
    source, target = points((3, 50, 3)), points((3, 40, 3), 1)
    assert torch.equal(network(source, network.encode(source, target)), source)


def test_layers_are_the_predicted_matrices_added_to_the_identity():
    """Written out for one pair, point by point; an untrained normalisation changes nothing."""
    network = AdaptiveNetwork(0.125, generator=generator()).eval()
    x = points((1, 9, 3))
    code = network.encode(x, points((1, 30, 3), 1))
    rest, h = code[0], x[0]
    for layer in network.layers:
        size = layer.inputs
        W, b, rest = rest[: size**2].reshape(size, size), rest[size**2 : size**2 + size], rest[size**2 + size :]
        h = torch.stack([(W.t() + torch.eye(size)) @ (each + b) for each in h])
        h = layer.linear(F.relu(h))
        h = h if layer is network.layers[-1] else F.relu(h)
    assert len(rest) == 0
    torch.testing.assert_close(network(x, code)[0], 2 * torch.tanh(h), atol=1e-4, rtol=1e-3)


def test_the_order_of_points_does_not_change_the_code():
    network = AdaptiveNetwork(0.125, generator=generator()).eval()
    source, target = points((2, 50, 3)), points((2, 40, 3), 1)
    torch.testing.assert_close(network.encode(source.flip(1), target), network.encode(source, target.flip(1)))


# --- the cycles -------------------------------------------------------------------------------------------------------


def test_cycles_of_exact_deformations_have_no_loss():
    """Three permutations of one set of points: each deformation gives exactly the points of the other shape."""
    x = points((2, 1, 30, 3))
    order = [torch.randperm(30, generator=generator(k)) for k in range(3)]
    shapes = torch.cat([x[:, :, index] for index in order], dim=1)
    moved = shapes[:, [i for i, _ in WAYS]]
    nearest = torch.cdist(moved, shapes[:, [j for _, j in WAYS]]).argmin(3)
    cycles = Cycles(shapes, moved, nearest)
    assert cycles.of_two() == 0 and cycles.of_three() == 0


def test_cycles_match_loops_over_points():
    shapes, moved = points((1, 3, 12, 3)), points((1, 6, 12, 3), 1)
    nearest = torch.cdist(moved, shapes[:, [j for _, j in WAYS]]).argmin(3)
    cycles = Cycles(shapes, moved, nearest)

    def step(i, j, at):
        """The position of point ``at`` of shape i after its deformation to shape j, and the nearest point of j."""
        place = moved[0, WAYS.index((i, j)), at]
        return place, int((shapes[0, j] - place).norm(dim=1).argmin())

    two, three = [], []
    for i, j in WAYS:
        k = 3 - i - j
        for at in range(12):
            _, there = step(i, j, at)
            back, _ = step(j, i, there)
            two.append(float((back - shapes[0, i, at]).square().sum()))
            _, on = step(j, k, there)
            home, _ = step(k, i, on)
            three.append(float((home - shapes[0, i, at]).square().sum()))
    assert float(cycles.of_two()) == pytest.approx(np.mean(two), rel=1e-5)
    assert float(cycles.of_three()) == pytest.approx(np.mean(three), rel=1e-5)


def test_without_cycles_the_loss_is_the_distance_to_the_target():
    """For an identity network: the mean distance from each shape to each other."""
    method = CycleConsistent(width=0.0625, points=64, two_cycle=0, three_cycle=0, early=0)
    training = CycleTraining(method._network(generator()), examples(), method, Run())
    shapes = points((2, 3, 128, 3))
    given = shapes[:, :, :64].numpy()
    expected = np.mean([distances(given[b, j], given[b, i]) for b in range(2) for i, j in WAYS])
    found = training.terms(shapes, np.random.default_rng(0), 1.0).item()
    assert found == pytest.approx(expected, abs=2e-5)


def test_known_deformations_are_learned_only_at_the_beginning():
    method = CycleConsistent(width=0.0625, points=64, scale=0.5)
    training = CycleTraining(method._network(generator()), examples(), method, Run())
    shapes = points((2, 3, 128, 3))
    early, late = (training.terms(shapes, np.random.default_rng(0), done).item() for done in (0.0, 0.5))
    factors = np.random.default_rng(0).uniform(0.5, 1.5, (2, 1, 3))
    wrong = ((1 - factors) * shapes[:, 2, :64].numpy()) ** 2  # of an identity network, both ways
    assert early - late == pytest.approx(wrong.sum(2).mean(), rel=1e-3)


# --- the training -----------------------------------------------------------------------------------------------------


def test_examples_are_points_of_both_shapes_normalised_by_their_boxes():
    task = Deform()
    cases = [task.toy() for _ in range(2)]
    data = TrainingData(lambda: iter(()), sensor=None, count=2)
    object.__setattr__(data, "recipes", lambda: iter([type("R", (), {"build": lambda self, c=c: c})() for c in cases]))
    made = pairs_of(data, Run(), count=500)
    assert made["points"].shape == (2, 2, 500, 3) and made["points"].dtype == np.int16
    for side, mesh in enumerate((cases[0].input["source"], cases[0].reference.mesh)):
        low, high = mesh.bounds
        half = (high - low).max() / 2
        assert made["extents"][0, side] == pytest.approx((high - low) / 2 / half, rel=1e-6)
        back = made["points"][0, side] / FULL * half + (low + high) / 2
        assert MeshSurface(mesh).closest(back)[0] == pytest.approx(back, abs=1e-4)


def test_drawn_shapes_are_scaled_and_fill_their_boxes_again():
    data = examples(5)
    train, held_out = Pairs(data), Pairs(data, held_out=True)
    assert len(train._points) == 4 and len(held_out._points) == 1
    drawn = train.draw(6, 2048, 0.25, 0.5, np.random.default_rng(0), shapes=3)
    assert drawn.shape == (6, 3, 2048, 3)
    assert np.abs(drawn).max((2, 3)) == pytest.approx(1, abs=0.02) and np.abs(drawn).max() < 1 + 1e-3
    plain = train.draw(20, 100, 0.0, 0.0, np.random.default_rng(0))
    stored = train._points / FULL
    for first, second in plain:  # two shapes of one pair
        assert any(
            min(distances(first, pair[k]).max() + distances(second, pair[1 - k]).max() for k in (0, 1)) < 1e-6
            for pair in stored
        )


def test_an_interrupted_training_resumes_exactly():
    assert_resumes(TOY, examples())


def test_a_training_learns():
    assert_learns(CycleTraining(TOY._network(generator()), examples(), TOY, Run()), 20, 0.95)


def test_a_source_keeps_its_faces_in_any_frame():
    assert_deforms(TOY, TOY.fit(examples(), Run()))


def test_invalid_parameters_are_refused():
    assert_refuses(CycleConsistent, {**SHARED_MISTAKES, "width": 0.0, "two_cycle": -1.0, "early": -1})
