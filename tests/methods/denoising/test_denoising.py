"""The learned denoisers: networks, patches, targets, training, and denoising by the shipped weights."""

from pathlib import Path

import numpy as np
import pytest
import torch
from denoising_toys import ball, examples, square
from scipy.spatial import cKDTree
from torch import nn
from torch.nn import functional as F
from trainings import killed_and_resumed

from bench import BadInput, PointCloud, Run
from bench.methods.denoising.networks.cleaning_network import CleaningNetwork, rotations
from bench.methods.denoising.networks.nearby import nearest
from bench.methods.denoising.networks.score_network import DenseEdgeConvolution, ScoreNetwork, planes_of
from bench.methods.denoising.patches.ascent import Score, ascend
from bench.methods.denoising.patches.cleaning import without_shrinking
from bench.methods.denoising.patches.cover import covering, most_central
from bench.methods.denoising.patches.frames import principal_frames, random_turns
from bench.methods.denoising.pointcleannet import Pointcleannet
from bench.methods.denoising.score_denoise import ScoreDenoise
from bench.methods.denoising.training.cleaning_training import ball as in_ball
from bench.methods.denoising.training.cleaning_training import cleaning_loss
from bench.methods.denoising.training.clouds import Clouds, on_discs
from bench.methods.denoising.training.score_training import Plan, Training
from bench.plugins.registry import registry
from bench.plugins.schema import parameters
from bench.plugins.weights import load, shipped

METHODS = Path(__file__).resolve().parents[3] / "methods"
LEARNED = ("pointcleannet", "score_denoise")
SCORE = ScoreDenoise(points=64, neighbours=4, width=8, bases=(200, 600), queries=8, steps=6, batch=2)
CLEAN = Pointcleannet(width=0.0625, points=16, radius=0.2, bases=(200, 600), steps=6, batch=10)


def generator():
    return torch.Generator().manual_seed(0)


def count(network):
    return sum(parameter.numel() for parameter in network.parameters())


# --- networks ---------------------------------------------------------------------------------------------------------


def test_the_networks_have_the_published_numbers_of_parameters():
    full = CleaningNetwork(1.0)
    assert count(full) == 27_948_248 and full.features() == 26_301_364
    assert count(CleaningNetwork(0.125)) == 156_456
    score = ScoreNetwork()
    assert count(score) == 187_291 and count(score.transforms) + count(score.convolutions) == 11_544


@pytest.mark.parametrize("relative", [True, False])
def test_an_edge_convolution_applies_its_layers_to_each_edge(relative):
    """The published form: both ends and their difference on each edge, layer by layer, then the maximum."""
    convolution = DenseEdgeConvolution(5, relative)
    x = torch.randn(2, 20, 24, generator=generator())
    index = nearest(x, x, 6)
    other = x[torch.arange(2)[:, None, None], index]
    own = x[:, :, None].expand_as(other)
    given = other - own if relative else torch.cat([own, other, other - own], dim=3)
    y = torch.cat([F.relu(convolution.first(given)), own], dim=3)
    y = torch.cat([F.relu(convolution.second(y)), y], dim=3)
    y = torch.cat([convolution.last(y), y], dim=3).amax(2)
    torch.testing.assert_close(convolution(x), y, atol=1e-5, rtol=1e-5)


def test_the_nearest_points_match_a_kd_tree():
    points, queries = torch.randn(2, 50, 3, generator=generator()), torch.randn(2, 9, 3, generator=generator())
    for b in range(2):
        exact = cKDTree(points[b]).query(queries[b], 4)[1]
        assert (np.sort(nearest(queries, points, 4)[b], axis=1) == np.sort(exact, axis=1)).all()


def test_matrices_of_a_transform_are_rotations():
    turn = rotations(torch.randn(50, 4, generator=generator(), dtype=torch.float64))
    torch.testing.assert_close(turn @ turn.transpose(1, 2), torch.eye(3, dtype=torch.float64).expand(50, 3, 3))
    torch.testing.assert_close(torch.linalg.det(turn), torch.ones(50, dtype=torch.float64))
    torch.testing.assert_close(rotations(torch.zeros(1, 4))[0], torch.eye(3))


def test_an_untrained_cleaning_network_moves_points_onto_a_plane():
    """The order of points and repetitions of the centre do not matter."""
    network = CleaningNetwork(0.0625, generator())
    flat = torch.rand(3, 20, 3, generator=generator()) * torch.tensor([1.0, 1.0, 0.0]) + torch.tensor([0, 0, 0.2])
    padded = F.pad(flat, (0, 0, 0, 5))
    torch.testing.assert_close(network(padded), torch.tensor([0.0, 0.0, 0.2]).expand(3, 3), atol=1e-5, rtol=1e-5)
    for module in network.modules():
        if type(module).__name__ == "Scaled":
            nn.init.normal_(module.weight)
    torch.testing.assert_close(network(padded), network(padded.flip(1)))
    assert network(padded)[:, :2].abs().max() > 1e-3


def test_an_untrained_score_is_the_offset_to_a_plane():
    patches = torch.randn(2, 100, 3, generator=generator()) * torch.tensor([1.0, 1.0, 0.0])
    network = SCORE._network(generator())
    known = torch.cat([network.encode(patches), planes_of(patches)], dim=2).flatten(0, 1)
    places = torch.randn(200, 3, generator=generator())
    scores = network(places, known[:, :-6], known[:, -6:])
    torch.testing.assert_close(scores, -places * torch.tensor([0.0, 0.0, 1.0]), atol=1e-5, rtol=1e-5)


# --- patches ----------------------------------------------------------------------------------------------------------


def test_patches_cover_all_points_and_the_most_central_place_is_the_least_column():
    points = np.concatenate([ball(300), np.repeat(ball(3), 40, axis=0)])
    patches = covering(points, 32)
    place = most_central(patches, len(points))
    assert (patches.ravel()[place] == np.arange(len(points))).all()
    for point in range(0, len(points), 17):
        assert place[point] % 32 == np.nonzero(patches == point)[1].min()


def test_frames_are_rotations_whose_last_axis_is_the_normal_of_a_plane():
    rng = np.random.default_rng(0)
    turn = np.linalg.qr(rng.normal(size=(4, 3, 3)))[0]
    flat = rng.normal(size=(4, 30, 3)) * [3, 2, 0.1] + 0.3
    flat[:, 25:] = 0  # padding
    frames = principal_frames(flat @ turn.transpose(0, 2, 1))
    np.testing.assert_allclose(frames @ frames.transpose(0, 2, 1), np.tile(np.eye(3), (4, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(frames), 1)
    assert (np.abs(np.einsum("bi,bi->b", frames[:, 2], turn[:, :, 2])) > 0.99).all()
    turns = random_turns(20, rng)
    np.testing.assert_allclose(np.linalg.det(turns), 1)
    np.testing.assert_allclose(np.abs(turns[:, 2, 2]), 1)


def test_discs_are_flat_and_bounded():
    points, normals = torch.zeros(1, 1, 3), torch.tensor([[[0.0, 0.0, 1.0]]])
    places = torch.tensor([[[0.1, 0.0, 2.0], [3.0, 4.0, -1.0], [0.0, 0.0, 1.0]]])
    expected = torch.tensor([[[0.1, 0.0, 0.0], [0.3, 0.4, 0.0], [0.0, 0.0, 0.0]]])
    torch.testing.assert_close(on_discs(places, points, normals, 0.5), expected)


def test_without_shrinking_removes_common_translations():
    points, common = ball(500), np.tile([0.1, 0.2, 0.3], (500, 1))
    assert np.abs(without_shrinking(points, common, 20)).max() < 1e-12
    assert without_shrinking(points, common, 0) is common


# --- training ---------------------------------------------------------------------------------------------------------


def test_a_patch_contains_the_surface_of_the_ball():
    """The surface of a patch is that of the ball in the frame of the patch: at radius 1 around one centre."""
    clouds = Clouds(examples())
    patch = clouds.patch(64, (0.02, 0.02), np.random.default_rng(0), level=0)
    assert patch.noisy.shape == (64, 3) and patch.noisy[0].abs().max() == 0
    centre = (patch.surface - patch.normals).mean(0)
    found = (patch.nearest_surface(patch.noisy) - centre).norm(dim=1)
    assert (found - 1).abs().max() < 0.02
    off = (patch.noisy - patch.nearest_surface(patch.noisy)).norm(dim=1)
    assert 0.01 < off.square().mean().sqrt() < 0.03


def test_a_ball_of_points_is_padded_with_its_centre():
    rng = np.random.default_rng(0)
    points = torch.tensor([[0.0, 0, 0], [0.5, 0, 0], [3, 0, 0]])
    found = in_ball(points, points[0], 1.0, 4, rng)
    assert sorted(found[:, 0].tolist()) == [0, 0, 0, 0.5]
    again = in_ball(points, points[0], 1.0, 4, rng, again=True)
    assert sorted(again[:, 0].tolist()) == [0, 0, 0.5, 0.5]


def test_the_cleaning_loss_in_closed_form():
    clean = torch.tensor([[[1.0, 0, 0], [0, 3.0, 0]]])
    assert cleaning_loss(torch.zeros(1, 3), clean).item() == pytest.approx(100 * (0.99 * 1 + 0.01 * 9), rel=1e-5)


def test_the_exact_score_has_zero_loss_and_errors_are_at_most_one():
    plan = Plan(**{name: getattr(SCORE, name) for name in Plan.__dataclass_fields__})
    training = Training(SCORE._network(generator()), examples(), plan, Run(seed=0))
    batch = training.batch(training.clouds, 2, np.random.default_rng(0))
    exact = batch.offsets.reshape(-1, 3)
    for factor, low, high in ((1.0, 0.0, 1e-9), (0.0, 0.01, 1.0), (2.0, 0.01, 1.0)):
        training.network.forward = lambda places, features, planes, factor=factor: factor * exact
        assert (low <= training._errors(batch)).all() and (training._errors(batch) <= high).all()


@pytest.mark.parametrize("method", [SCORE, CLEAN], ids=LEARNED[::-1])
def test_an_interrupted_training_ends_with_the_same_weights(method):
    data = examples()
    whole = method.fit(data, Run(seed=3))
    again = killed_and_resumed(method, data, 3)
    assert whole.keys() == again.keys() and all((whole[name] == again[name]).all() for name in whole)


# --- denoising --------------------------------------------------------------------------------------------------------


def test_points_stay_where_the_score_is_zero_and_go_where_it_points():
    points = ball(200)
    network = SCORE._network(generator()).eval()
    network.forward = lambda places, features, planes: 0 * places
    score = Score(network, points, 64, 3.0, "cpu")
    assert (ascend(score, 4, 3, 0.2, 0.95, Run(seed=0), 0, 3) == points).all()
    network.forward = lambda places, features, planes: -places  # towards the point of the features
    score = Score(network, points, 64, 3.0, "cpu")
    np.testing.assert_allclose(score.at(points + 0.001, 1), -0.001, atol=1e-6)


def test_without_training_a_plane_stays_and_a_noisy_one_is_flattened():
    points = np.random.default_rng(0).uniform(-1, 1, (400, 3)) * [1, 1, 0]
    score = Score(SCORE._network(generator()).eval(), points, 128, 3.0, "cpu")
    assert np.abs(ascend(score, 4, 5, 0.2, 0.95, Run(seed=0), 0, 5) - points).max() < 1e-5
    noisy = points + np.random.default_rng(1).normal(0, 0.02, points.shape) * [0, 0, 1]
    score = Score(SCORE._network(generator()).eval(), noisy, 128, 3.0, "cpu")
    moved = ascend(score, 4, 30, 0.2, 0.95, Run(seed=0), 0, 30)
    assert np.abs(moved[:, 2]).mean() < 0.5 * np.abs(noisy[:, 2]).mean()


@pytest.mark.parametrize("name", LEARNED)
def test_bad_parameters_and_inputs_are_refused(name):
    cls = registry().find("method", name).cls
    for wrong in ({"noise": (0.1, 0.01)}, {"bases": (600, 200)}, {"points": 2}, {"passes": 0}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            cls(**wrong)
    run = Run(weights=weights_of(name))
    with pytest.raises(BadInput):
        cls().denoise(PointCloud(np.full((5, 3), np.nan)), run)


def weights_of(name):
    plugin = registry().find("method", name)
    file = shipped(plugin, parameters(plugin, plugin.cls()))
    assert file == METHODS / "denoising" / "weights" / f"{name}.safetensors" and file.stat().st_size < 1e6
    return load(file)


@pytest.mark.parametrize("name", LEARNED)
@pytest.mark.parametrize("truth", [ball, square], ids=["sphere", "plane"])
def test_the_shipped_weights_halve_the_noise(name, truth):
    exact = truth(1500 if truth is ball else 1200)
    noisy = exact + np.random.default_rng(1).normal(scale=0.04, size=exact.shape)
    run = Run(weights=weights_of(name), threads=1, seed=0)
    fewer = {"iterations": 8, "step": 0.45} if name == "score_denoise" else {"passes": 2}
    moved = registry().find("method", name).cls(**fewer).denoise(PointCloud(noisy), run).points
    assert moved.shape == noisy.shape

    def error(points):
        if truth is ball:
            return np.abs(np.linalg.norm(points, axis=1) - 1).mean()
        inner = np.abs(exact[:, :2]).max(axis=1) < 0.9
        return np.abs(points[inner, 2]).mean()

    assert error(moved) < 0.5 * error(noisy)


@pytest.mark.parametrize("name", LEARNED)
def test_a_cloud_may_be_moved_and_scaled(name):
    noisy = ball(400) + np.random.default_rng(1).normal(scale=0.03, size=(400, 3))
    outputs = []
    for scale in (1.0, 7.0):
        run = Run(weights=weights_of(name), threads=1, seed=0)
        output = registry().find("method", name).cls().denoise(PointCloud(scale * noisy + scale), run)
        outputs.append(output.points / scale - 1)
    np.testing.assert_allclose(outputs[0], outputs[1], atol=1e-3)
