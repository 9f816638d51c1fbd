"""3DN: the network, and the terms of the losses."""

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
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree
from torch.nn import functional as F

from bench import Run
from bench.methods.deformation.networks.offset_network import OffsetNetwork
from bench.methods.deformation.three_dn import ThreeDn
from bench.methods.deformation.training.offset_training import OffsetTraining, mirrored
from bench.methods.deformation.training.terms import (
    chamfer,
    distance,
    earth_mover,
    laplacian_change,
    matches,
    squared,
    taken,
)

TOY = ThreeDn(width=0.0625, points=64, steps=3, batch=2, matched=16)


# --- the network ------------------------------------------------------------------------------------------------------


def test_the_network_has_the_published_number_of_parameters():
    assert number_of_parameters(OffsetNetwork()) == 8_046_089
    assert 2 * number_of_parameters(OffsetNetwork(ThreeDn().width)) < 1.5e6


def test_an_untrained_network_is_the_identity():
    network = OffsetNetwork(0.125, generator())
    source, target = points((3, 50, 3)), points((3, 40, 3), 1)
    assert torch.equal(network(source, network.encode(source, target)), source)


def test_a_fold_applies_its_layers_to_point_and_code():
    fold = OffsetNetwork(0.125, generator()).folds[0]
    x, code = points((2, 7, 3)), points((2, fold.first.in_features - 3), 1)
    together = torch.cat([x, code[:, None].expand(-1, 7, -1)], dim=2)
    expected = fold.last(F.relu(fold.second(F.relu(fold.first(together)))))
    torch.testing.assert_close(fold(x, code), expected)


# --- the terms --------------------------------------------------------------------------------------------------------


def test_matches_are_those_of_a_kd_tree():
    a, b = points((3, 40, 3)), points((3, 60, 3), 1)
    to_b, to_a = matches(a, b)
    for k in range(3):
        assert (to_b[k].numpy() == cKDTree(b[k]).query(a[k])[1]).all()
        assert (to_a[k].numpy() == cKDTree(a[k]).query(b[k])[1]).all()
    assert torch.equal(taken(b, to_b)[1, 5], b[1, to_b[1, 5]])


def test_chamfer_is_the_mean_over_both_sets():
    a, b = points((2, 40, 3)), points((2, 60, 3), 1)
    expected = np.mean(
        [(cKDTree(x).query(y)[0] ** 2).mean() + (cKDTree(y).query(x)[0] ** 2).mean() for x, y in zip(a, b, strict=True)]
    )
    assert float(chamfer(a, b)) == pytest.approx(expected, rel=1e-4)


def test_the_derivative_of_chamfer_matches_finite_differences():
    a, b = points((1, 6, 3)).double().requires_grad_(), points((1, 9, 3), 1).double()
    assert torch.autograd.gradcheck(lambda x: chamfer(x, b), (a,))


def test_terms_are_zero_for_perfect_output():
    a = points((2, 40, 3))
    other = a[:, torch.randperm(40, generator=generator())]
    assert chamfer(a, other) == 0 and squared(a, a) == 0 and earth_mover(a, other) == pytest.approx(0, abs=1e-4)
    assert distance(a, a) == pytest.approx(0, abs=1e-9)
    assert laplacian_change(a, a + 0.3, 20, 4) == pytest.approx(0, abs=1e-12)
    grad = torch.autograd.grad(distance(a.requires_grad_(), a.detach()), a)[0]
    assert (grad == 0).all()


def test_the_earth_movers_distance_approximates_an_exact_matching():
    a, b = points((2, 50, 3)), points((2, 50, 3), 1) * 0.7 + 0.2
    exact = []
    for x, y in zip(a.numpy(), b.numpy(), strict=True):
        cost = np.linalg.norm(x[:, None] - y[None], axis=2)
        exact.append(cost[linear_sum_assignment(cost)].mean())
    assert earth_mover(a, b).item() == pytest.approx(np.mean(exact), rel=0.1)
    assert earth_mover(a, b, rounds=300).item() == pytest.approx(np.mean(exact), rel=0.02)
    shift = torch.tensor([0.01, 0, 0])
    assert float(earth_mover(a, a + shift)) == pytest.approx(0.01, rel=0.01)


def test_the_change_of_the_laplacian_matches_a_loop():
    before, after = points((2, 30, 3)), points((2, 30, 3), 1)
    errors = []
    for x, y in zip(before.numpy(), after.numpy(), strict=True):
        index = cKDTree(x).query(x[:10], 5)[1][:, 1:]
        errors.append((((x[:10] - x[index].mean(1)) - (y[:10] - y[index].mean(1))) ** 2).sum(1).mean())
    assert float(laplacian_change(before, after, 10, 4)) == pytest.approx(np.mean(errors), rel=1e-4)


def test_a_mirror_image_changes_one_sign():
    assert mirrored(torch.ones(1, 1, 3), "y").tolist() == [[[1, -1, 1]]]


@pytest.mark.parametrize("turned, expected", [(1.0, 0.0), (-1.0, 6 * 0.005 / 3)])
def test_the_order_term_counts_reversed_steps(turned, expected):
    """For a network that mirrors z, a third of the steps are reversed; for the identity, none."""
    training = OffsetTraining(TOY._network(generator()), examples(), TOY, Run())
    training.network = lambda x, code: x * torch.tensor([1.0, 1.0, turned])
    x = points((4, 500, 3))
    found = training._disorder(x, training.network(x, None), None, np.random.default_rng(0))
    assert float(found) == pytest.approx(expected, rel=0.1, abs=1e-7)


# --- the training -----------------------------------------------------------------------------------------------------


def test_all_terms_are_zero_for_equal_symmetric_shapes():
    """With an identity network; the points of the matching are then equal, too."""
    training = OffsetTraining(TOY._network(generator()), examples(), TOY, Run())
    half = points((2, 1, 32, 3))
    shape = torch.cat([half, half * torch.tensor([-1.0, 1, 1])], dim=2)
    shapes = torch.cat([shape, shape], dim=2).expand(-1, 2, -1, -1)
    assert training.terms(shapes, np.random.default_rng(0), 0.0).item() == pytest.approx(0, abs=1e-6)


def test_an_interrupted_training_resumes_exactly():
    assert_resumes(TOY, examples())


def test_a_training_learns():
    method = ThreeDn(width=0.0625, points=64, batch=2, matched=16, learning_rate=5e-3)
    assert_learns(OffsetTraining(method._network(generator()), examples(), method, Run()), 30, 0.9)


def test_a_source_keeps_its_faces_in_any_frame():
    assert_deforms(TOY, TOY.fit(examples(), Run()))


def test_invalid_parameters_are_refused():
    own = {"width": 2.0, "plane": "w", "matched": 0, "neighbours": 0, "order": -1.0, "earth_mover": -1.0}
    assert_refuses(ThreeDn, SHARED_MISTAKES | own)
