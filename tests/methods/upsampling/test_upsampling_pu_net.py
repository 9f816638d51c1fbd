"""PU-Net and its parts, against loops, scipy and finite differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.optimize import linear_sum_assignment
from trainings import Logged, killed_and_resumed
from upsampling_toys import tiny_clouds, toy_data, upsampled

from bench import BadInput, Run
from bench.methods.upsampling.losses.matching import auction, earth_mover, matching
from bench.methods.upsampling.losses.repulsion import hinge_repulsion, neighbour_distances, repulsion
from bench.methods.upsampling.networks.grouping import ball_query, farthest_order, interpolate
from bench.methods.upsampling.networks.pu_network import PuNetwork
from bench.methods.upsampling.networks.set_abstraction import PointFeatures, SetAbstraction
from bench.methods.upsampling.pu_net import PuNet
from bench.methods.upsampling.training.pairs import Augmentation, held_out, uneven
from bench.methods.upsampling.training.pu_training import adam

TINY = PuNet(points=24, bases=(0,), steps=6, batch=2)


def tensor(*shape, seed=0, dtype=torch.float32):
    return torch.from_numpy(np.random.default_rng(seed).normal(size=shape)).to(dtype)


@pytest.fixture(scope="module")
def examples():
    return TINY.examples(toy_data(), Run())


@pytest.fixture(scope="module")
def weights(examples):
    return TINY.fit(examples, Logged(seed=3))


# -- grouping --------------------------------------------------------------------------------------------------------


def test_farthest_order_is_the_greedy_one():
    points = tensor(3, 2, 40)
    order = farthest_order(points)
    for of_set in range(2):
        p, chosen = points[:, of_set].T.numpy(), [0]
        distance = np.linalg.norm(p - p[0], axis=1)
        while len(chosen) < 40:
            distance[chosen] = -1
            chosen.append(int(distance.argmax()))
            distance = np.minimum(distance, np.linalg.norm(p - p[chosen[-1]], axis=1))
        assert order[of_set].tolist() == chosen


def test_farthest_order_of_copies_is_a_permutation():
    assert farthest_order(torch.ones(3, 1, 9)).sort(1).values.tolist() == [list(range(9))]


def test_farthest_order_of_its_own_prefix_is_the_same():
    points = tensor(3, 1, 40)
    sorted_points = points[:, :, farthest_order(points)[0]]
    assert farthest_order(sorted_points[:, :, :20]).tolist() == [list(range(20))]


@pytest.mark.parametrize("count", [1, 4, 30])
@pytest.mark.parametrize("trim", [False, True])
def test_ball_query_by_loops(count, trim):
    points, queries = tensor(3, 2, 30, seed=1), tensor(3, 2, 7, seed=2)
    index = ball_query(queries, points, 0.9, count, trim=trim)
    fullest = 1
    for of_set in range(2):
        for query in range(7):
            gaps = np.linalg.norm(points[:, of_set].T.numpy() - queries[:, of_set, query].numpy(), axis=1)
            hits = np.flatnonzero(gaps < 0.9)[:count].tolist()
            fullest = max(fullest, len(hits))
            hits += [hits[0] if hits else 0] * (index.shape[1] - len(hits))
            assert index[of_set, :, query].tolist() == hits
    assert index.shape[1] == (fullest if trim else count)


def test_trimming_does_not_change_a_maximum():
    module = SetAbstraction(0.5, 32, 0, (8, 8, 8), torch.Generator().manual_seed(0))
    points = tensor(3, 2, 50)
    with torch.no_grad():
        found = module(points, None, 20)
        index = ball_query(points[:, :, :20], points, 0.5, 32, trim=False)
        x = torch.stack([points[:, b][:, index[b]] - points[:, b, :20][:, None] for b in range(2)], dim=1)
        for layer in module.layers:
            x = torch.relu(layer(x))
    torch.testing.assert_close(found, x.amax(2))


def test_interpolation_by_loops():
    points, queries, features = tensor(3, 2, 9, seed=1), tensor(3, 2, 5, seed=2), tensor(4, 2, 9, seed=3)
    queries[:, :, 0] = points[:, :, 4]
    found = interpolate(queries, points, features)
    for of_set in range(2):
        for query in range(5):
            squared = ((points[:, of_set] - queries[:, of_set, query, None]) ** 2).sum(0).numpy()
            near = np.argsort(squared)[:3]
            weight = 1 / np.maximum(squared[near], 1e-10)
            expected = (features[:, of_set, near].numpy() * weight).sum(1) / weight.sum()
            np.testing.assert_allclose(found[:, of_set, query], expected, rtol=1e-4, atol=1e-5)


# -- networks --------------------------------------------------------------------------------------------------------


def count(module):
    return sum(parameter.numel() for parameter in module.parameters())


def test_the_number_of_parameters_is_that_of_the_paper():
    network = PuNetwork()
    assert count(network) == 814_307
    assert [count(level) for level in network.features.levels] == [3_296, 16_832, 66_432, 263_936]
    assert [count(layer) for layer in network.features.restore] == [32_832, 16_448, 8_256]
    assert count(network.branches) == 4 * 99_456
    assert count(PuNetwork(times=16)) == 814_307 + 12 * 99_456


@pytest.mark.parametrize("n", [1, 2, 7, 50])
def test_features_do_not_depend_on_the_order_after_the_first_point(n):
    features = PointFeatures((0.3, 0.5, 0.8, 1.0), generator=torch.Generator().manual_seed(0))
    points = tensor(3, 1, n)
    order = [0, *(1 + np.random.default_rng(1).permutation(n - 1))]
    with torch.no_grad():
        torch.testing.assert_close(features(points)[:, :, order], features(points[:, :, order]), rtol=1e-4, atol=1e-5)


def test_weight_decay_excludes_the_last_layer():
    network = PuNetwork()
    optimizer = adam(network, network.last, 1e-3, "cpu")
    decayed, spared = optimizer.param_groups
    assert spared["params"] == list(network.last.parameters()) and spared["weight_decay"] == 0
    assert len(decayed["params"]) == len(list(network.parameters())) - 2 and decayed["weight_decay"] == 1e-5


# -- losses ----------------------------------------------------------------------------------------------------------


def costs(points, truth):
    return ((points[:, :, :, None] - truth[:, :, None]) ** 2).sum(0)


@pytest.mark.parametrize("kind", ["apart", "near", "collapsed"])
def test_the_auction_is_within_its_tolerance(kind):
    truth = tensor(3, 3, 80, seed=1)
    points = {
        "apart": tensor(3, 3, 80, seed=2),
        "near": truth[:, :, torch.randperm(80, generator=torch.Generator().manual_seed(0))] + 0.05 * tensor(3, 3, 80),
        "collapsed": 0.01 * tensor(3, 3, 80),
    }[kind]
    cost = costs(points, truth)
    found = auction(cost, 0.5)
    assert (found.sort(1).values == torch.arange(80)).all()
    for of_set in range(3):
        rows, columns = linear_sum_assignment(cost[of_set].numpy())
        best = cost[of_set][rows, columns].mean()
        mine = cost[of_set][rows, found[of_set]].mean()
        assert best - 1e-6 <= mine <= best + 0.5 * cost[of_set].amin(1).mean() + 1e-5
    assert (auction(cost, 0.5) == found).all()


def test_the_auction_of_ties_or_a_single_point_ends():
    assert auction(torch.zeros(2, 5, 5)).sort(1).values.tolist() == [list(range(5))] * 2
    assert auction(torch.ones(1, 1, 1)).tolist() == [[0]]


def test_the_auction_completes_an_unfinished_assignment(monkeypatch):
    monkeypatch.setattr("bench.methods.upsampling.losses.matching.ROUNDS", 2)
    found = auction(costs(tensor(3, 2, 30, seed=1), tensor(3, 2, 30, seed=2)))
    assert (found.sort(1).values == torch.arange(30)).all()


def test_the_matching_is_optimal_and_the_distance_a_third_of_the_mean_square():
    points, truth = tensor(3, 2, 20, seed=1), tensor(3, 2, 20, seed=2)
    cost = costs(points, truth)
    for of_set, value in enumerate(earth_mover(points, truth)):
        rows, columns = linear_sum_assignment(cost[of_set].numpy())
        assert matching(points, truth)[of_set].tolist() == columns.tolist()
        assert float(value) == pytest.approx(float(cost[of_set][rows, columns].mean()) / 3, rel=1e-5)


def test_repulsion_by_loops():
    points = 0.1 * tensor(3, 1, 30)
    squared = ((points[:, 0, :, None] - points[:, 0, None]) ** 2).sum(0).numpy()
    expected, hinge = [], []
    for row in squared:
        hits = np.flatnonzero(row < 0.15**2)[:10].tolist()
        hits += [hits[0]] * (10 - len(hits))
        near = np.sort(row[hits])[1:5]
        expected += [0.15 - d * np.exp(-(d**2) / 0.06**2) for d in np.sqrt(np.maximum(near, 1e-12))]
        hinge += [max(0.0, 0.01 - value) for value in near]
    assert float(repulsion(points, 0.15, 0.06, 10)) == pytest.approx(np.mean(expected), rel=1e-4)
    assert float(hinge_repulsion(points, 0.15, 0.01, 10)) == pytest.approx(np.mean(hinge), rel=1e-4)
    assert neighbour_distances(points, 0.15, 10).shape == (1, 4, 30)


def test_gradients_of_the_losses():
    points = 0.1 * tensor(3, 1, 12, dtype=torch.float64)
    truth = 0.1 * tensor(3, 1, 12, seed=4, dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda x: earth_mover(x, truth), points.clone().requires_grad_())
    assert torch.autograd.gradcheck(lambda x: repulsion(x, 0.5, 0.1), points.clone().requires_grad_())


# -- examples --------------------------------------------------------------------------------------------------------


def test_patches_are_pairs_in_frames_of_the_inputs(examples):
    pairs, others = held_out(examples, 24, "cpu")
    patches = pairs.draw(4, np.random.default_rng(0), Augmentation())
    assert patches.inputs.shape == (3, 4, 24) and patches.truths.shape == (3, 4, 96)
    assert patches.inputs.mean(2).abs().max() < 1e-5
    torch.testing.assert_close(patches.inputs.square().sum(0).amax(1), torch.ones(4))
    seeds = patches.move(patches.seeds)
    for points in (patches.inputs, patches.truths):
        gaps = (points - seeds).square().sum(0)
        assert (gaps.diff(dim=1) >= -1e-6).all()
    torch.testing.assert_close(patches.inputs[:, :, :1], seeds, atol=1e-5, rtol=0)
    assert set(pairs.draw(9, np.random.default_rng(0), Augmentation()).pyramids) == {0}
    assert set(others.draw(9, np.random.default_rng(0), Augmentation()).pyramids) == {1}


def test_a_subset_is_a_part_of_the_truth(examples):
    patches = held_out(examples, 24, "cpu")[0].draw(2, np.random.default_rng(0), Augmentation(subset=True))
    gaps = costs(patches.inputs, patches.truths).amin(2)
    assert gaps.max() < 1e-10
    index = uneven(96, 24, np.random.default_rng(0))
    assert len(set(index)) == 24 and index.min() >= 0 and index.max() < 96


# -- the method ------------------------------------------------------------------------------------------------------


def test_the_loss_falls(examples):
    run = Logged(seed=1)
    PuNet(points=24, bases=(0,), steps=21, batch=4, jitter=0, repulsion=0).fit(examples, run)
    assert run.losses()[-1] < 0.5 * run.losses()[0]


def test_an_interrupted_training_ends_with_the_same_weights(examples, weights):
    again = killed_and_resumed(TINY, examples, at=3)
    assert again.keys() == weights.keys()
    assert all((again[name] == weights[name]).all() for name in weights)


def test_sixteen_times_in_one_pass():
    direct = replace(TINY, times=16)
    found = direct.examples(toy_data(), Run())
    assert (found["counts"][:, 1] == 16 * found["counts"][:, 0]).all()
    output = upsampled(direct, direct.fit(found, Logged(seed=3)), np.random.default_rng(0).normal(size=(70, 3)), 16)
    assert output.shape == (1120, 3) and np.isfinite(output).all()


@pytest.mark.parametrize("ratio", [1, 2, 3, 4, 16])
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


def test_coincident_points_are_refused(weights):
    with pytest.raises(BadInput, match="coincide"):
        upsampled(TINY, weights, np.ones((9, 3)), 4)


def test_published_parameters_are_accepted_and_invalid_ones_refused():
    thesis = PuNet(points=1024, subset=True, jitter=0.025, shift=0.1, batch=28, decay=1.0)
    assert thesis._widening() == 1.0
    for wrong in (
        {"points": 4},
        {"batch": 0},
        {"scale": 1.0},
        {"bases": ()},
        {"scans": ("a",)},
        {"repulsion": -1},
        {"times": 1},
    ):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            PuNet(**wrong)
