"""EC-Net and its parts, against trimesh, closed forms and finite differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh
from trainings import Logged, killed_and_resumed
from upsampling_toys import BALL, BOX, shape, tiny_clouds, toy_data, upsampled

from bench import BadInput, Run
from bench.methods.upsampling.ec_net import EcNet
from bench.methods.upsampling.losses.nearest_surface import (
    squared_to_segments,
    squared_to_triangles,
    to_all_segments,
    to_all_triangles,
)
from bench.methods.upsampling.networks.ec_network import EcNetwork
from bench.methods.upsampling.training.clouds import pack
from bench.methods.upsampling.training.ec_training import near_edges
from bench.methods.upsampling.training.edges import FAR, EdgedSurfaces, edged, pack_edged
from bench.methods.upsampling.training.pairs import Augmentation, Patches, held_out

TINY = EcNet(points=24, bases=(0,), steps=6, batch=2, triangles=40, segments=6)


@pytest.fixture(scope="module")
def examples():
    return TINY.examples(toy_data(), Run())


@pytest.fixture(scope="module")
def weights(examples):
    return TINY.fit(examples, Logged(seed=3))


def components_first(array, dtype=torch.float64):
    """(b, k, ..., 3) to (3, b, k, ...)."""
    return torch.from_numpy(np.moveaxis(np.asarray(array), -1, 0)).to(dtype)


# -- distances -------------------------------------------------------------------------------------------------------


def test_distances_to_triangles_match_trimesh():
    rng = np.random.default_rng(0)
    corners, points = rng.normal(size=(2, 25, 3, 3)), 2 * rng.normal(size=(2, 60, 3))
    found = to_all_triangles(components_first(points), components_first(corners))
    for of_set in range(2):
        for number, triangle in enumerate(corners[of_set]):
            closest = trimesh.triangles.closest_point(np.repeat(triangle[None], 60, axis=0), points[of_set])
            expected = ((points[of_set] - closest) ** 2).sum(1)
            np.testing.assert_allclose(found[of_set, number], expected, atol=1e-12)
    nearest = squared_to_triangles(components_first(points), components_first(corners))
    torch.testing.assert_close(nearest, found.amin(1), rtol=0, atol=1e-12)


def test_distances_to_segments_in_closed_form():
    ends = components_first([[[[0.0, 0, 0], [2, 0, 0]], [[0, 5, 0], [0, 5, 0]]]])
    points = components_first([[[1.0, 1, 0], [3, 0, 1], [-1, 0, 0], [0, 4.5, 0], [0.5, 0, 0]]])
    assert squared_to_segments(points, ends).tolist() == [[1.0, 2.0, 1.0, 0.25, 0.0]]
    assert to_all_segments(points, ends)[0, 1, 0] == 1 + 16


def test_gradients_of_the_distances():
    rng = np.random.default_rng(1)
    points = components_first(rng.normal(size=(1, 8, 3))).requires_grad_()
    corners, ends = components_first(rng.normal(size=(1, 5, 3, 3))), components_first(rng.normal(size=(1, 5, 2, 3)))
    assert torch.autograd.gradcheck(lambda x: squared_to_triangles(x, corners), points)
    assert torch.autograd.gradcheck(lambda x: squared_to_segments(x, ends), points)


# -- surfaces --------------------------------------------------------------------------------------------------------


def test_a_box_has_twelve_edges():
    box = edged(shape(BOX), 1000, 30.0)
    assert len(box.segments) == 12 and len(box.triangles) == 12
    lengths = np.linalg.norm(box.segments[:, 0] - box.segments[:, 1], axis=1)
    np.testing.assert_allclose(sorted(lengths), np.repeat(sorted(BOX.extents), 4), rtol=1e-6)
    assert len(edged(shape(BOX), 1000, 100.0).segments) == 0


def test_smooth_shapes_have_no_edges_and_fine_meshes_become_coarser():
    assert len(edged(shape(BOX, "analytic"), 1000, 30.0).segments) == 0
    ball = edged(shape(BALL), 300, 30.0)
    assert len(ball.segments) == 0 and 200 < len(ball.triangles) <= 300


def test_triangles_and_edges_around_a_patch_move_with_it(examples):
    pairs, surfaces = held_out(examples, 24, "cpu")[0], EdgedSurfaces(examples, "cpu")
    patches = pairs.draw(3, np.random.default_rng(0), Augmentation(scale=0.2, shift=0.2))
    triangles, segments = surfaces.around(patches, 12, 20)
    assert triangles.shape == (3, 3, 12, 3) and segments.shape == (3, 3, 20, 2)
    assert squared_to_triangles(patches.truths, triangles).sqrt().max() < 1e-3  # rounding to 16 bits
    lengths = (segments[..., 0] - segments[..., 1]).square().sum(0).sqrt()
    assert (lengths[:, :12] > 0.1).all() and (lengths[:, 12:] == 0).all()
    assert segments[:, :, 12:].abs().amax() > FAR / 10


def test_surfaces_of_different_sizes_can_share_a_batch():
    box, ball = edged(shape(BOX), 1000, 30.0), edged(shape(BALL), 300, 30.0)
    cloud = np.random.default_rng(0).normal(size=(9, 3))
    packed = pack((number, [cloud, cloud]) for number in range(2)) | pack_edged([box, ball])
    frame = (torch.eye(3).expand(2, 3, 3), torch.zeros(3, 2, 1), torch.ones(2, 1))
    seeds = torch.tensor([[2.0, 0.1], [0.3, 0.2], [0.1, 1.4]])[..., None]
    none = torch.zeros(3, 2, 1)
    patches = Patches(none, none, torch.ones(2), seeds, np.array([0, 1]), frame, none)
    triangles, segments = EdgedSurfaces(packed, "cpu").around(patches, 30, 5)
    for number, surface in enumerate((box, ball)):
        corners = components_first(surface.triangles[None], torch.float32)
        squared = to_all_triangles(seeds[:, number : number + 1], corners)[0, :, 0]
        chosen = to_all_triangles(seeds[:, number : number + 1], triangles[:, number : number + 1])[0, :, 0]
        count = min(30, len(squared))
        torch.testing.assert_close(chosen[:count], squared.sort().values[:count])
        torch.testing.assert_close(chosen[count:], chosen[: 30 - count])
    assert segments[:, 0].abs().max() < 10 and (segments[:, 1] == FAR).all()


def test_a_surface_with_fewer_triangles_repeats_them(examples):
    pairs, surfaces = held_out(examples, 24, "cpu")[0], EdgedSurfaces(examples, "cpu")
    patches = pairs.draw(1, np.random.default_rng(0), Augmentation())
    triangles, _ = surfaces.around(patches, 30, 1)
    torch.testing.assert_close(triangles[:, :, :6], triangles[:, :, 24:])


def test_which_points_are_pulled_to_edges():
    distance = torch.tensor([[0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.5, 0.5]])
    predicted = torch.tensor([[0.3, 0.1, 0.0, 0.5, 0.5, 0.5, 0.5, 0.5]])
    assert near_edges(distance, predicted, 0.5).tolist() == [[0, 1, 1, 0, 0, 0, 0, 0]]
    assert near_edges(distance, predicted + 0.06, 0.0).tolist() == [[0, 0, 1, 0, 0, 0, 0, 0]]


# -- the network -----------------------------------------------------------------------------------------------------


def test_the_number_of_parameters_is_that_of_the_paper():
    assert sum(parameter.numel() for parameter in EcNetwork().parameters()) == 823_652


@pytest.mark.parametrize("n", [1, 2, 7, 40])
def test_the_nearest_half_is_upsampled(n):
    network = EcNetwork(generator=torch.Generator().manual_seed(0))
    points = torch.from_numpy(np.random.default_rng(0).normal(size=(3, 2, n))).float()
    for parameter in network.last.parameters():
        torch.nn.init.zeros_(parameter)
    output, distances = network(points)
    kept = -(-n // 2)
    assert distances.shape == (2, 4 * kept)
    torch.testing.assert_close(output, points[:, :, :kept].repeat(1, 1, 4))


# -- the method ------------------------------------------------------------------------------------------------------


def test_the_loss_falls(examples):
    run = Logged(seed=1)
    EcNet(points=24, bases=(0,), steps=21, batch=4, triangles=40, segments=12).fit(examples, run)
    assert run.losses()[-1] < 0.5 * run.losses()[0]


def test_an_interrupted_training_ends_with_the_same_weights(examples, weights):
    again = killed_and_resumed(TINY, examples, at=3)
    assert again.keys() == weights.keys()
    assert all((again[name] == weights[name]).all() for name in weights)


@pytest.mark.parametrize(
    ("ratio", "changes"),
    [
        (1, {}),
        (2, {}),
        (3, {}),
        (4, {}),
        (16, {}),
        (3, {"geodesic": True}),
        (16, {"geodesic": True}),
        (3, {"central": 0}),
    ],
)
def test_counts_are_exact(weights, ratio, changes):
    method, points = replace(TINY, **changes), np.random.default_rng(0).normal(size=(70, 3))
    output = upsampled(method, weights, points, ratio)
    assert output.shape == (70 * ratio, 3) and np.isfinite(output).all()
    if ratio == 3:
        assert (upsampled(method, weights, points, ratio) == output).all()


@pytest.mark.parametrize("name", tiny_clouds())
def test_tiny_clouds(weights, name):
    points = tiny_clouds()[name]
    output = upsampled(TINY, weights, points, 4)
    assert output.shape == (4 * len(points), 3) and np.isfinite(output).all()


def test_every_size_of_cloud_has_enough_points(weights):
    rng = np.random.default_rng(0)
    method = EcNet(points=24, overlap=1.5)
    for count in range(2, 60, 3):
        assert len(upsampled(method, weights, rng.normal(size=(count, 3)), 4)) == 4 * count


def test_coincident_points_are_refused(weights):
    with pytest.raises(BadInput, match="coincide"):
        upsampled(TINY, weights, np.ones((9, 3)), 4)


def test_invalid_parameters_are_refused():
    for wrong in ({"overlap": 1.0}, {"angle": 0}, {"faces": 0}, {"segments": 0}, {"triangles": 0}, {"shift": -1}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            EcNet(**wrong)
