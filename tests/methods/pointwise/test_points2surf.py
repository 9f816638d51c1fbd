"""Points2Surf: the layers of the network, its inputs, the grid, the training, and the shipped weights."""

from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree
from trainings import killed_and_resumed
from trimesh.creation import icosphere

from bench import BadInput, InvalidOutput, PointCloud, Run
from bench.methods.pointwise.networks.surface_network import SurfaceNetwork
from bench.methods.pointwise.points2surf import Points2surf
from bench.methods.pointwise.queries.asking import Asking
from bench.methods.pointwise.queries.grid import Grid, spread_signs
from bench.methods.pointwise.queries.inputs import patches_of, wholes_of
from bench.methods.pointwise.training.surface_training import surface_loss
from bench.methods.pointwise.training.surfaces import Surfaces, radius_of
from bench.plugins.registry import registry
from bench.plugins.schema import parameters
from bench.plugins.weights import load, shipped

METHODS = Path(__file__).resolve().parents[3] / "methods"
SMALL = Points2surf(width=16, points=16, subsample=16, counts=(100, 200), steps=6, batch=20, resolution=16)


def ball(count=3000):
    """Evenly spread points of the unit sphere (Fibonacci): (count, 3)."""
    k = np.arange(count) + 0.5
    z, angle = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    return np.column_stack([np.cos(angle) * np.sqrt(1 - z**2), np.sin(angle) * np.sqrt(1 - z**2), z])


def examples(shapes=3):
    """Training examples of balls only."""
    places = 1.3 * np.random.default_rng(0).uniform(-1, 1, (shapes, 300, 3))
    distances = np.linalg.norm(places, axis=2) - 1
    arrays = {"points": np.stack([ball(300)] * shapes), "places": places, "distances": distances}
    return {name: array.astype(np.float32) for name, array in arrays.items()}


def generator():
    return torch.Generator().manual_seed(0)


# --- network ----------------------------------------------------------------------------------------------------------


def test_the_networks_have_the_published_numbers_of_parameters():
    def count(network):
        return sum(parameter.numel() for parameter in network.parameters())

    assert count(SurfaceNetwork(1024, turn=True, transforms=True)) == 6_167_814
    assert count(SurfaceNetwork(1024, turn=False, transforms=True)) == 5_366_018
    assert count(Points2surf()._network()) == 55_404


@pytest.mark.parametrize("turn, transforms", [(True, True), (False, False)])
def test_the_order_of_points_does_not_matter(turn, transforms):
    network = SurfaceNetwork(32, turn, transforms, generator()).eval()
    for module in network.modules():
        if isinstance(module, torch.nn.Linear):
            torch.nn.init.normal_(module.weight, std=0.2)
    patches, wholes = torch.randn(5, 12, 3), torch.randn(5, 20, 3)
    distances, logits = network(patches, wholes)
    assert distances.shape == logits.shape == (5,) and (distances >= 0).all()
    again = network(patches.flip(1), wholes[:, torch.randperm(20)])
    torch.testing.assert_close((distances, logits), again)


def test_a_network_draws_only_from_its_generator():
    one, two = (SurfaceNetwork(16, generator=generator()).state_dict() for _ in range(2))
    assert all(torch.equal(one[name], two[name]) for name in one)


def test_the_loss_in_closed_form():
    truth, distances = torch.tensor([-1.0, 2.0]), torch.tensor([1.0, 0.0])
    found = surface_loss(distances, torch.tensor([0.0, 0.0]), truth)
    assert found.item() == pytest.approx(np.tanh(2.0) ** 2 / 2 + np.log(2), rel=1e-6)
    sure = surface_loss(truth.abs(), torch.tensor([50.0, -50.0]), truth)
    assert sure.item() == pytest.approx(0, abs=1e-6)


# --- inputs -----------------------------------------------------------------------------------------------------------


def test_patches_are_relative_and_of_radius_one():
    points, queries = ball(200), np.array([[0, 0, 1.1], [0.5, 0, 0]])
    nearest = cKDTree(points).query(queries, 9)[1]
    patches, radii = patches_of(points, nearest, queries)
    np.testing.assert_allclose(np.linalg.norm(patches, axis=2).max(axis=1), 1, rtol=1e-6)
    np.testing.assert_allclose(patches * radii[:, None, None] + queries[:, None], points[nearest], atol=1e-6)


@pytest.mark.parametrize("near", [False, True])
def test_global_samples_are_points_of_the_cloud(near):
    points, queries, rng = ball(400), np.array([[0, 0, 1.0], [0, 0, -1.0]]), np.random.default_rng(0)
    wholes = 2.0 * wholes_of(points, queries, 150, near, 2.0, rng) + queries[:, None]
    distance, index = cKDTree(points).query(wholes.reshape(-1, 3))
    assert distance.max() < 1e-6
    for row in index.reshape(2, 150):
        assert len(set(row)) == 150
    heights = wholes[..., 2].mean(axis=1)
    if near:  # more points near the query
        assert heights[0] > 0.1 and heights[1] < -0.1
    else:
        assert heights[0] == pytest.approx(heights[1], abs=1e-6)
    assert wholes_of(points[:20], queries, 64, near, 1.0, rng).shape == (2, 64, 3)


def test_training_queries_have_the_distance_to_the_ball():
    surfaces = Surfaces(examples())
    batch = surfaces.queries(30, (250, 250), (1e-5, 2e-5), 8, 200, False, np.random.default_rng(1))
    unit = radius_of(ball(250))
    from_centre = np.linalg.norm(batch.wholes.mean(axis=1) * unit, axis=1)  # up to the random choice
    inside = batch.distances < 0
    assert (from_centre[inside] < 1.1).all() and (from_centre[~inside] > 0.9).all()
    assert (np.abs(batch.distances) <= 1 + 1e-5).all()  # the surface is no farther than the whole patch
    assert surfaces.shapes == [0, 1] and Surfaces(examples(), held_out=True).shapes == [2]


# --- grid -------------------------------------------------------------------------------------------------------------


def test_the_grid_is_evaluated_at_nodes_around_points():
    points = ball(500)
    grid = Grid.around(points, 24)
    steps = np.abs((points[:, None] - grid.places) / grid.spacing).max(axis=2)
    assert (steps.min(axis=0) < 1.5 + 1e-9).all()
    for point in points[::25]:  # the 27 nodes around the nearest node of each point
        assert (np.abs((grid.places - point) / grid.spacing).max(axis=1) < 1.5).sum() >= 27
    assert grid.spacing == pytest.approx(np.ptp(points, axis=0).max() / 23)


def test_a_grid_of_exact_distances_gives_the_ball():
    grid = Grid.around(ball(4000), 32)
    mesh = grid.mesh(np.linalg.norm(grid.places, axis=1) - 1)
    assert mesh.is_watertight and mesh.volume == pytest.approx(4 / 3 * np.pi, rel=0.02)
    assert np.abs(np.linalg.norm(mesh.vertices, axis=1) - 1).max() < 0.01


def test_signs_spread_into_the_hollow_and_the_outside():
    away = np.linalg.norm(np.stack(np.meshgrid(*[np.arange(40) - 19.5] * 3, indexing="ij")), axis=0)
    known = np.abs(away - 13) < 2
    wrong = known & (np.random.default_rng(0).random(known.shape) < 0.05) & (np.abs(away - 13) < 1.5)
    signs = np.where(away < 13, -1.0, 1.0)
    spread = spread_signs(np.where(wrong, -signs, signs) * known, known)
    assert (spread[~known] == signs[~known]).all()
    assert (spread_signs(np.zeros((9, 9, 9)), np.zeros((9, 9, 9), bool)) == 1).all()


def test_a_grid_without_an_inside_has_no_surface():
    grid = Grid.around(ball(500), 16)
    with pytest.raises(InvalidOutput, match="inside"):
        grid.mesh(np.ones(len(grid.places)))


def test_distances_are_in_the_unit_of_the_cloud():
    """A network that returns the distance of the farthest point of the patch, and always inside."""

    class Farthest(torch.nn.Module):
        def forward(self, patches, wholes):
            return patches.norm(dim=2).amax(1), torch.ones(len(patches))

    points, places = 5 * ball(300), np.random.default_rng(0).uniform(-6, 6, (300, 3))
    ask = Asking(Farthest(), points, 5.0, 10, 20, False, Run(seed=0))
    np.testing.assert_allclose(ask(places), -cKDTree(points).query(places, 10)[0][:, -1], rtol=1e-5)
    assert np.array_equal(ask(places), ask(places))


# --- training and reconstruction --------------------------------------------------------------------------------------


def test_an_interrupted_training_ends_with_the_same_weights():
    data = examples()
    whole = SMALL.fit(data, Run(seed=3))
    again = killed_and_resumed(SMALL, data, 3)
    assert whole.keys() == again.keys() and all((whole[name] == again[name]).all() for name in whole)


@pytest.fixture(scope="module")
def shipped_weights():
    plugin = registry().find("method", "points2surf")
    file = shipped(plugin, parameters(plugin, plugin.cls()))
    assert file == METHODS / "pointwise" / "weights" / "points2surf.safetensors" and file.stat().st_size < 350_000
    return load(file)


def test_the_shipped_weights_reconstruct_a_noisy_ball(shipped_weights):
    scale = 7.0  # a cloud that is neither centred nor of radius 1
    noisy = ball(3000) + np.random.default_rng(1).normal(scale=0.005, size=(3000, 3))
    run = Run(weights=shipped_weights, threads=1, seed=0)
    mesh = Points2surf(resolution=24).reconstruct(PointCloud(scale * noisy + scale), run)
    assert mesh.volume / scale**3 == pytest.approx(icosphere(4).volume, rel=0.1)
    away = np.linalg.norm(mesh.vertices / scale - 1, axis=1) - 1
    assert np.abs(away).mean() < 0.03


def test_a_short_time_limit_makes_the_grid_coarser_and_is_reported(shipped_weights):
    run = Run(weights=shipped_weights, threads=1, seed=0, seconds=1e-3)
    mesh = Points2surf(resolution=40).reconstruct(PointCloud(ball(1000)), run)
    assert len(mesh.faces) and "a resolution of 16 instead of 40" in run.notes[0]


def test_bad_parameters_and_inputs_are_refused():
    for wrong in ({"noise": (0.1, 0.01)}, {"counts": (600, 200)}, {"points": 2}, {"batch": 1}, {"resolution": 8}):
        with pytest.raises(ValueError, match=next(iter(wrong)) + ": expected"):
            Points2surf(**wrong)
    run = Run(weights={})
    for points in (np.full((9, 3), np.nan), np.zeros((3, 3))):
        with pytest.raises(BadInput):
            Points2surf().reconstruct(PointCloud(points), run)
