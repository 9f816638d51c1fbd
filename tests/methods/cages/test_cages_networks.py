"""Neural cages: networks, templates, losses, training, and deformations by the shipped weights."""

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree
from trainings import Logged, killed_and_resumed
from trimesh.creation import box, icosphere

from bench import PointCloud, Run
from bench.datasets.furniture import Furniture
from bench.geometry.sampling import sample_uniform
from bench.methods.cages.cage_per_pair import CagePerPair
from bench.methods.cages.losses.planes import neighbourhoods, planes
from bench.methods.cages.losses.terms import asymmetry, chamfer, laplacian_term, negative_weights, plane_terms
from bench.methods.cages.meshes.boxes import boxed
from bench.methods.cages.meshes.round_cages import ball_cage, sphere_cage
from bench.methods.cages.networks.cage_network import CageNetwork, PoseNetwork
from bench.methods.cages.neural_cages import NeuralCages
from bench.methods.cages.training.pairs import Pairs
from bench.plugins.registry import registry
from bench.plugins.schema import parameters
from bench.plugins.weights import load, shipped
from bench.tasks.deform import Deform

TINY = NeuralCages(points=64, code=16, batch=2, steps=6, neighbours=6)


def generator():
    return torch.Generator().manual_seed(0)


def examples(pairs=3, corresponding=False):
    """Boxes of several sizes as sources and targets."""
    rng = np.random.default_rng(0)
    clouds = []
    for _ in range(pairs):
        source = rng.uniform(-1, 1, (4096, 3))
        clouds.append((source * [1, 0.5, 0.5], source * [0.5, 1, 0.7]))
    points = np.array(clouds)
    return {
        "points": np.round(points * 32767).astype(np.int16),
        "scale": np.array(1 / 32767),
        "corresponding": np.full(pairs, corresponding),
    }


# --- networks and templates -------------------------------------------------------------------------------------------


def test_the_networks_have_the_published_numbers_of_parameters():
    template, _ = sphere_cage()
    network = CageNetwork(torch.from_numpy(template).float(), 256, "predicted")
    count = {name: sum(p.numel() for p in part.parameters()) for name, part in network.named_children()}
    assert count == {"encoder": 107_392, "caging": 41_731, "merger": 262_656, "deforming": 165_379}
    assert sum(p.numel() for p in PoseNetwork(torch.zeros(77, 3), 512).parameters()) == 1_362_023


def test_the_template_is_a_flat_icosahedron():
    vertices, faces = sphere_cage()
    radii = np.linalg.norm(vertices, axis=1)
    assert (len(vertices), len(faces)) == (42, 80)
    np.testing.assert_allclose(np.sort(radii), [1.7013016] * 30 + [2.0] * 12, atol=1e-6)
    corners = vertices[faces]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    distance = np.einsum("fa,fa->f", outward / np.linalg.norm(outward, axis=1, keepdims=True), corners[:, 0])
    np.testing.assert_allclose(distance, 1.589309, atol=1e-5)  # of a face from the centre; all look outwards
    assert len(ball_cage(2)[0]) == 162


@pytest.mark.parametrize(("cage", "trained"), [("predicted", 2), ("invariant", 1), ("identity", 0)])
def test_which_cages_are_learned(cage, trained):
    template, _ = sphere_cage()
    network = CageNetwork(torch.from_numpy(template).float(), 16, cage, generator())
    clouds = torch.randn(2, 3, 50, 3, generator=generator())
    around, _ = network(*clouds)
    apart = (around - network.template).abs().amax()
    assert (apart > 1e-3) == (trained == 2)
    assert isinstance(network.template, torch.nn.Parameter) == (trained == 1)
    assert (around[0] != around[1]).any() == (trained == 2)
    again, _ = network(clouds[0][:, torch.randperm(50, generator=generator())], clouds[1])
    torch.testing.assert_close(again, around)  # the order of points does not matter


def test_a_pair_is_scaled_by_the_box_of_the_target():
    source, target = box((1, 2, 3)), box((4, 2, 2))
    source.apply_translation((5, 5, 5))
    target.apply_translation((0, 0, 9))
    for given in (target, PointCloud(target.vertices)):
        pair = boxed(source, given, 500, np.random.default_rng(0))
        assert np.allclose(pair.vertices.min(axis=0), [-0.25, -0.5, -0.75])
        assert np.abs(pair.source).max() <= 0.75 and np.abs(pair.target).max() <= 1 and pair.scale == 2
        back = pair.restored(source, pair.vertices)
        assert np.allclose(back.bounds.mean(axis=0), (0, 0, 9)) and np.allclose(back.extents, (1, 2, 3))


# --- losses -----------------------------------------------------------------------------------------------------------


def test_chamfer_matches_kd_trees_and_its_gradient_finite_differences():
    a, b = torch.randn(2, 30, 3, dtype=torch.float64, generator=generator()), torch.randn(2, 20, 3, dtype=torch.float64)
    there = [cKDTree(q).query(p)[0] ** 2 for p, q in zip(a.numpy(), b.numpy(), strict=True)]
    back = [cKDTree(p).query(q)[0] ** 2 for p, q in zip(a.numpy(), b.numpy(), strict=True)]
    assert float(chamfer(a, b)) == pytest.approx(np.mean(there) + np.mean(back))
    assert torch.autograd.gradcheck(chamfer, (a.requires_grad_(True), b.requires_grad_(True)))


def test_fitted_planes_of_a_plane_and_of_a_ball():
    rng = np.random.default_rng(1)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    flat = torch.from_numpy(np.column_stack([rng.uniform(-1, 1, (200, 2)), np.zeros(200)]) @ turn)[None]
    _, normal = planes(flat, neighbourhoods(flat, 8))
    np.testing.assert_allclose(np.abs(normal[0].numpy() @ turn[2]), 1, atol=1e-9)
    ball = torch.from_numpy(np.array(icosphere(subdivisions=3).vertices))[None]
    _, normal = planes(ball, neighbourhoods(ball, 8))
    assert ((normal * ball).sum(dim=2).abs() > 0.99).all()


def test_the_gradient_of_normals_matches_finite_differences_and_is_always_finite():
    points = torch.randn(1, 12, 3, dtype=torch.float64, generator=generator()).requires_grad_(True)
    index = neighbourhoods(points, 5)
    look = torch.randn(1, 12, 3, dtype=torch.float64, generator=generator())
    assert torch.autograd.gradcheck(lambda x: (planes(x, index)[1] * look).sum(dim=2).square(), (points,))
    corners = torch.tensor([[[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]]], requires_grad=True)
    (planes(corners, neighbourhoods(corners, 4))[1] * look[:, :4].float()).sum().backward()
    assert corners.grad.isfinite().all()


def test_shape_losses_are_zero_for_rigid_motions_and_positive_for_bends():
    rng = np.random.default_rng(2)
    points = torch.from_numpy(rng.uniform(-1, 1, (300, 3)) * [1, 1, 0.01])[None]
    near = neighbourhoods(points, 8)
    assert max(float(term) for term in plane_terms(points, points + 5, near)) < 1e-12
    turn = torch.from_numpy(np.linalg.qr(rng.normal(size=(3, 3)))[0])
    distance, normal = plane_terms(points, points @ turn, near)
    assert float(distance) < 1e-12 and float(normal) > 1e-3  # Eq. 5.6 depends on directions, Eq. 5.5 does not
    assert float(laplacian_term(points, points @ turn, near)) < 1e-12
    bent = points.clone()
    bent[..., 2] += bent[..., 0] ** 2
    assert all(float(term) > 1e-6 for term in (*plane_terms(points, bent, near), laplacian_term(points, bent, near)))


def test_negative_weights_and_asymmetry_in_closed_form():
    assert float(negative_weights(torch.tensor([[[0.5, -0.5, 1.0], [2.0, 0.0, -1.0]]]))) == pytest.approx(1.25 / 6)
    one = torch.tensor([[[0.5, 0.0, 0.0], [-0.5, 0.0, 0.0]]])
    assert float(asymmetry(one)) == 0
    assert float(asymmetry(torch.tensor([[[0.5, 0.0, 0.0]]]))) == pytest.approx(2.0)


# --- training and deformation -----------------------------------------------------------------------------------------


def test_an_interrupted_training_ends_with_the_same_weights():
    data = examples()
    whole = TINY.fit(data, Run(seed=3))
    again = killed_and_resumed(TINY, data, 3)
    assert whole.keys() == again.keys() and all((whole[name] == again[name]).all() for name in whole)


@pytest.mark.parametrize("more", [{}, {"cage": "invariant", "laplacian": 1.0}, {"cage": "identity"}])
def test_a_training_lowers_its_loss(more):
    still = {"partners": False, "stretch": 0.0, "warm_up": 0.0}
    method = NeuralCages(points=64, code=16, batch=2, steps=40, neighbours=6, **still, **more)
    run = Logged(seed=0)
    weights = method.fit(examples(corresponding=method.cage == "identity"), run)
    losses = run.losses()
    assert losses[-1] < 0.7 * losses[0] and all(np.isfinite(array).all() for array in weights.values())


def test_in_the_warm_up_cages_do_not_change():
    method = NeuralCages(points=64, code=16, batch=2, steps=3, neighbours=6, warm_up=0.99)
    begin = method._network(generator())[0].state_dict()  # drawn with the seed of the run
    weights = method.fit(examples(), Run(seed=0))
    moved = {name for name in weights if (weights[name] != begin[name].numpy()).any()}
    assert moved and all(name.startswith(("merger", "deforming")) for name in moved)


def test_corresponding_pairs_are_drawn_with_their_correspondence():
    pairs = Pairs(examples(corresponding=True))
    source, target = pairs.drawn(0, 100, 0.0, False, np.random.default_rng(0))
    np.testing.assert_allclose(target, source * np.float32([0.5, 2, 1.4]), atol=2e-4)
    source, target = pairs.drawn(0, 100, 0.25, True, np.random.default_rng(0))
    for cloud in (source, target):
        assert np.ptp(cloud, axis=0).max() == pytest.approx(2, abs=1e-5)


@pytest.mark.parametrize("method", [TINY, CagePerPair(points=64, steps=3)], ids=["neural_cages", "cage_per_pair"])
def test_deformations_keep_faces_and_store_their_cages(method):
    case = Deform().toy()
    run, kept = Run(seed=0), {}
    run.on_keep = lambda name, value: kept.update({name: value() if callable(value) else value})
    if hasattr(method, "fit"):
        run.weights = {name: tensor.numpy() for name, tensor in method._network(generator())[0].state_dict().items()}
    output = method.deform(**case.input, run=run)
    Deform().validate(output, case.input)
    assert set(kept) == {"cage", "deformed_cage"} and len(kept["cage"].vertices) == 42


def test_cage_per_pair_deforms_a_ball_into_an_egg():
    case = Deform().toy()
    output = CagePerPair(points=256, steps=60, learning_rate=0.05).deform(**case.input, run=Run(seed=0))
    apart = [
        cKDTree(mesh.vertices).query(case.reference.mesh.vertices)[0].mean() for mesh in (output, case.input["source"])
    ]
    assert apart[0] < 0.4 * apart[1]


@pytest.mark.parametrize("name", ["neural_cages", "cage_per_pair"])
def test_bad_parameters_are_refused(name):
    plugin = registry().find("method", name).cls
    for parameter, value in (("points", 1), ("p2f", -1.0), ("steps", -1), ("learning_rate", 0.0), ("symmetry", -1.0)):
        with pytest.raises(ValueError, match=parameter):
            plugin(**{parameter: value})


def test_the_shipped_weights_bring_a_chair_nearer_to_another():
    plugin = registry().find("method", "neural_cages")
    method = plugin.cls()
    run = Run(seed=0)
    run.weights = load(shipped(plugin, parameters(plugin, method)))
    pairs = Furniture(category="chair", same_parts=False).pairs("test")
    for pair in (next(pairs), next(pairs)):
        case = Deform()._case_of("a", pair, 0)
        output = method.deform(**case.input, run=run)
        apart = [chamfer(*_clouds(mesh, case.reference.mesh)) for mesh in (output, case.input["source"])]
        assert apart[0] < 0.85 * apart[1]


def _clouds(*meshes):
    return [torch.from_numpy(sample_uniform(mesh, 2000, np.random.default_rng(0))[0])[None] for mesh in meshes]
