"""Upsampling by a learned distance."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from trainings import Logged, killed_and_resumed
from upsampling_toys import BALL, BOX, tiny_clouds, toy_data, upsampled

from bench import BadInput, Run
from bench.geometry.mesh_surface import MeshSurface
from bench.methods.upsampling.grad_pu import GradPu
from bench.methods.upsampling.networks.distance_network import DistanceNetwork
from bench.methods.upsampling.patches.descent import LearnedDistance, midpoints
from bench.methods.upsampling.training.clouds import rotations
from bench.methods.upsampling.training.gradient_training import Queries

TINY = GradPu(points=24, bases=(0,), steps=6, batch=2, width=16)


@pytest.fixture(scope="module")
def examples():
    return TINY.examples(toy_data(), Run())


@pytest.fixture(scope="module")
def weights(examples):
    return TINY.fit(examples, Logged(seed=3))


def network(dtype=torch.float64):
    net = DistanceNetwork(16, 6, torch.Generator().manual_seed(0)).to(dtype)
    torch.nn.init.normal_(net.last.weight, generator=torch.Generator().manual_seed(1))  # it is initialised to zero
    return net


def cloud(n=50, seed=0):
    return torch.from_numpy(np.random.default_rng(seed).normal(size=(3, 1, n)))


def test_the_number_of_parameters():
    assert sum(parameter.numel() for parameter in DistanceNetwork().parameters()) == 76_418


def test_distances_are_equivariant_to_similarities():
    net, points, queries = network(), cloud(), cloud(9, seed=1)
    turn = torch.from_numpy(rotations(1, np.random.default_rng(0)))[0]

    def moved(x):
        return 3 * torch.einsum("ij,jbn->ibn", turn, x) + 5

    with torch.no_grad():
        here, normals = net(queries, net.encode(points))
        there, turned = net(moved(queries), net.encode(moved(points)))
    torch.testing.assert_close(there, 3 * here)
    torch.testing.assert_close(turned, torch.einsum("ij,jbn->ibn", turn, normals))


def test_distances_do_not_depend_on_the_order():
    net, points, queries = network(), cloud(), cloud(9, seed=1)
    with torch.no_grad():
        torch.testing.assert_close(net(queries, net.encode(points))[0], net(queries, net.encode(points.flip(2)))[0])


def test_gradients_at_the_queries():
    net, queries = network(), cloud(9, seed=1)
    with torch.no_grad():
        local = net.encode(cloud())
    assert torch.autograd.gradcheck(lambda x: net(x, local)[0], queries.clone().requires_grad_())


def test_the_kd_tree_and_the_network_find_the_same_neighbours():
    net, points, queries = network(torch.float32), cloud()[:, 0].T.numpy(), cloud(9, seed=1)
    with torch.no_grad():
        expected = net(queries.float(), net.encode(cloud().float()))[0][0]
    found, _ = LearnedDistance(net, points, "cpu").distances(queries[:, 0].T.numpy())
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-5)


def test_midpoints_are_between_neighbours_and_unique():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [3, 0, 0]])
    assert sorted(midpoints(points)[:, 0]) == [0.5, 1.5, 2.0]


def test_the_distances_of_the_examples_are_exact(examples):
    batch = Queries(examples, 24, "cpu").draw(1, np.random.default_rng(0), 0.0)
    assert batch.points.shape == batch.queries.shape == batch.normals.shape == (3, 1, 24)
    assert batch.distances.shape == (1, 24)
    packed = np.split(examples["points"], examples["counts"].ravel().cumsum()[:-1])
    truths = np.split(examples["truths"], examples["counts"][:, 1].cumsum()[:-1])
    for number, mesh in enumerate((BOX, BALL)):
        queries = packed[2 * number + 1] * examples["scales"][number]
        closest = MeshSurface(mesh).closest(queries)[0]
        np.testing.assert_allclose(abs(truths[number][:, 0]), np.linalg.norm(queries - closest, axis=1), atol=2e-4)
        # The faces of the ball are up to 0.01 below the sphere.
        outside = (abs(queries) > BOX.extents / 2).any(1) if mesh is BOX else np.linalg.norm(queries, axis=1) > 1
        sure = abs(truths[number][:, 0]) > 0.02
        assert ((truths[number][:, 0] > 0) == outside)[sure].all()


def test_the_loss_falls_and_the_descent_comes_near_the_surface(examples):
    run = Logged(seed=1)
    method = GradPu(points=24, bases=(0,), steps=61, batch=4, noise=0.0)
    weights = method.fit(examples, run)
    assert run.losses()[-1] < run.losses()[0]
    points = np.asarray(BALL.sample(60, seed=4))
    net = DistanceNetwork()
    net.load_state_dict({name: torch.from_numpy(array) for name, array in weights.items()})
    before = midpoints(points)
    after = LearnedDistance(net, points, "cpu").descend(before, 5, 0.5)
    error = [np.linalg.norm(MeshSurface(BALL).closest(x)[0] - x, axis=1).mean() for x in (before, after)]
    assert error[1] < error[0]


def test_an_interrupted_training_ends_with_the_same_weights(examples, weights):
    again = killed_and_resumed(TINY, examples, at=3)
    assert again.keys() == weights.keys()
    assert all((again[name] == weights[name]).all() for name in weights)


@pytest.mark.parametrize("ratio", [1, 2, 3, 4, 7, 16])
def test_counts_are_exact(weights, ratio):
    points = np.random.default_rng(0).normal(size=(70, 3))
    output = upsampled(TINY, weights, points, ratio)
    assert output.shape == (70 * ratio, 3) and np.isfinite(output).all()
    assert (upsampled(TINY, weights, points, ratio) == output).all()


@pytest.mark.parametrize("name", tiny_clouds())
def test_tiny_clouds(weights, name):
    points = tiny_clouds()[name]
    output = upsampled(TINY, weights, points, 4)
    assert output.shape == (4 * len(points), 3) and np.isfinite(output).all()


def test_points_of_the_input_stay_if_requested(weights):
    points = np.random.default_rng(0).normal(size=(30, 3))
    output = upsampled(GradPu(width=16, keep=True), weights, points, 4)
    gaps = np.linalg.norm(output[:, None] - points, axis=2).min(axis=0)
    assert gaps.max() < 1e-12


def test_coincident_points_are_refused(weights):
    with pytest.raises(BadInput, match="coincide"):
        upsampled(TINY, weights, np.ones((9, 3)), 4)


def test_invalid_parameters_are_refused():
    for wrong in ({"neighbours": 0}, {"iterations": 0}, {"rate": 0}, {"rate": 2}, {"noise": -1}, {"bases": ()}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            GradPu(**wrong)
