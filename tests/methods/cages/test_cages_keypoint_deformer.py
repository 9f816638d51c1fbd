"""KeypointDeformer: its cage, its network, its loss and training, and deformations by it."""

import numpy as np
import pytest
import torch
from trainings import Logged, killed_and_resumed
from trimesh.creation import box, icosphere

from bench import PointCloud, Run
from bench.geometry.farthest import farthest_points
from bench.methods.cages.coordinates.mean_value import mean_value_coordinates
from bench.methods.cages.keypoint_deformer import KeypointDeformer
from bench.methods.cages.losses.terms import asymmetry, chamfer
from bench.methods.cages.meshes.round_cages import ball_cage
from bench.methods.cages.meshes.shrunk_cages import shrunk_cage
from bench.methods.cages.training.keypoints import KeypointTraining, Plan
from bench.tasks.deform import Deform

TINY = KeypointDeformer(keypoints=5, points=64, code=16, batch=2, steps=6)


def generator(seed=0):
    return torch.Generator().manual_seed(seed)


def clouds(count, points=60):
    """Uniform points of boxes of several sizes."""
    size = 0.4 + 0.6 * torch.rand(count, 1, 3, generator=generator(1))
    return size * (2 * torch.rand(count, points, 3, generator=generator(2)) - 1)


def network(method=TINY):
    """A network with nonzero influence: that of a new one is 0."""
    made = method._network(generator())
    torch.nn.init.normal_(made.influence, std=0.3, generator=generator(3))
    torch.nn.init.normal_(made.offsets[-1].weight, std=0.1, generator=generator(4))
    return made


def examples(pairs=4, corresponding=False):
    """Boxes of several sizes as sources and targets; with correspondences, wide boxes that become high."""
    rng = np.random.default_rng(0)
    inside = rng.uniform(-1, 1, (pairs, 1, 4096, 3)).repeat(2, axis=1)
    size = np.array([[[1, 0.4, 0.4]], [[0.4, 1, 0.4]]]) if corresponding else rng.uniform(0.3, 1, (pairs, 2, 1, 3))
    return {
        "points": np.round(inside * size * 32767).astype(np.int16),
        "scale": np.array(1 / 32767),
        "corresponding": np.full(pairs, corresponding),
    }


def training(method, run=None, corresponding=False, made=None):
    plan = Plan(**{name: getattr(method, name) for name in Plan.__dataclass_fields__})
    return KeypointTraining(made or network(method), examples(corresponding=corresponding), plan, run or Run(seed=0))


# --- the cage ---------------------------------------------------------------------------------------------------------


def test_a_vertex_stops_where_its_distance_to_the_points_is_the_gap():
    directions, faces = (torch.from_numpy(array) for array in ball_cage(1, 1.0))
    steps = torch.arange(2.5, 0, -0.01)
    walked = steps[:, None, None] * directions[None]  # (steps, vertices, 3), from outside
    for points in (clouds(1, 20)[0].double(), torch.from_numpy(box().vertices)):
        radii = shrunk_cage(directions, faces, points[None], 0.5)[0].norm(dim=1)
        stops = torch.cat([points, torch.zeros(1, 3)])
        near = (torch.cdist(walked, stops.expand(len(steps), -1, -1)) <= 0.5).any(dim=2)
        stopped = steps[near.byte().argmax(dim=0)]
        assert (radii > stopped - 1e-6).all()  # farther out where faces would cut off points
        assert (radii < stopped + 0.011).sum() > 10


def test_cages_leave_no_point_outside():
    directions, faces = (torch.from_numpy(array) for array in ball_cage(1, 1.0))
    thin = torch.from_numpy(box((2, 2, 0.02)).subdivide().subdivide().vertices)
    for points in (*clouds(3).double(), thin):
        for gap in (0.01, 0.4):
            cage = shrunk_cage(directions, faces, points[None], gap)[0]
            corners = cage[faces][None] - points[:, None, None]
            length = corners.norm(dim=3)
            a, b, c = corners.unbind(dim=2)
            volume = (a * torch.linalg.cross(b, c)).sum(dim=2)
            dots = [(p * q).sum(dim=2) * length[..., k] for p, q, k in ((a, b, 2), (b, c, 0), (c, a, 1))]
            angle = 2 * torch.atan2(volume, length.prod(dim=2) + sum(dots)).sum(dim=1)
            torch.testing.assert_close(angle, torch.full_like(angle, 4 * np.pi))  # the solid angle of all faces


def test_the_cage_of_a_small_ball_is_round():
    directions, faces = (torch.from_numpy(array) for array in ball_cage(1, 1.0))
    ball = torch.from_numpy(np.array(icosphere(3, 0.8).vertices))[None]
    radii = shrunk_cage(directions, faces, ball, 0.4).norm(dim=2)
    torch.testing.assert_close(radii, torch.full_like(radii, 1.2), rtol=0, atol=1e-6)


# --- the network ------------------------------------------------------------------------------------------------------


def test_the_number_of_parameters_is_that_of_the_layers():
    def layers(*sizes):
        return sum((size + 1) * following for size, following in zip(sizes, sizes[1:], strict=False))

    encoder = layers(3, 64, 128, 256) + layers(256, 256)
    count = {
        "encoder": encoder,
        "source_encoder": encoder,
        "pointing": layers(256, 256, 12 * 3),
        "offsets": layers(256, 256, 12 * 42),
    }
    made = KeypointDeformer()._network()
    assert {name: sum(p.numel() for p in part.parameters()) for name, part in made.named_children()} == count
    assert made.influence.numel() == 12 * 42
    assert sum(p.numel() for p in made.parameters()) == sum(count.values()) + 12 * 42 == 485_652


def test_a_shape_as_its_own_target_stays():
    source = clouds(3)
    made = network()
    keyed = made(source, source)
    assert torch.equal(keyed.cage, keyed.moved) and keyed.offset.abs().max() > 1e-3
    moved = mean_value_coordinates(source, keyed.cage, made.faces) @ keyed.moved
    torch.testing.assert_close(moved, source, rtol=0, atol=1e-5)
    again = made(source, source.flip(1))  # the order of points does not matter
    torch.testing.assert_close(again.moved, keyed.moved, rtol=0, atol=1e-5)


def test_a_new_network_moves_nothing():
    keyed = TINY._network(generator())(*clouds(4).split(2))
    assert torch.equal(keyed.cage, keyed.moved) and (keyed.keypoints != keyed.wanted).any()


@pytest.mark.parametrize("influenced", [0, 1, 7, 100])
def test_vertices_follow_keypoints_by_their_influence(influenced):
    made = network(KeypointDeformer(keypoints=5, code=16, influenced=influenced))
    source = clouds(2)
    keypoints, there = torch.randn(2, 2, 5, 3, generator=generator())
    with torch.no_grad():
        keyed = made.follow(source, keypoints, there)
    expected = keyed.cage.clone()
    count = min(influenced or 42, 42)
    for b in range(2):
        for k in range(5):
            apart = (keyed.cage[b] - keypoints[b, k]).norm(dim=1)
            for n in apart.argsort()[:count]:
                weight = made.influence[k, n].detach() + keyed.offset[b, k, n]
                expected[b, n] += weight * (there[b, k] - keypoints[b, k])
    torch.testing.assert_close(keyed.moved, expected, rtol=1e-5, atol=1e-5)
    with torch.no_grad():
        twice = made.follow(source, keypoints, 2 * there - keypoints)
    torch.testing.assert_close(twice.moved - twice.cage, 2 * (keyed.moved - keyed.cage), rtol=1e-4, atol=1e-5)


# --- the loss and the training ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("corresponding", [False, True])
def test_the_loss_is_the_sum_of_its_terms(corresponding):
    weights = {"farthest": 0.3, "offset": 0.7, "symmetry": 0.2, "partners": not corresponding}
    taught = training(KeypointDeformer(keypoints=5, points=64, code=16, **weights), corresponding=corresponding)
    rng = np.random.default_rng(0)
    pairs = [taught._train.drawn(k, 64, 0.0, False, rng) for k in (0, 1)]
    with torch.no_grad():
        loss, cold = (taught._loss(pairs, alone) for alone in (False, True))
        terms, kept = [], []
        for one, other in [*pairs, *(pair[::-1] for pair in pairs)]:
            spread = one[farthest_points(one, 5, taken=1)]
            one, other = torch.from_numpy(one)[None], torch.from_numpy(other)[None]
            keyed = taught.network(one, other)
            moved = mean_value_coordinates(one, keyed.cage, taught.network.faces) @ keyed.moved
            kept.append(chamfer(keyed.keypoints, torch.from_numpy(spread)[None]))
            apart = (moved - other).square().sum(dim=2).mean() if corresponding else chamfer(moved, other)
            mirrored = asymmetry(moved) + asymmetry(keyed.keypoints)
            terms.append(apart + 0.3 * kept[-1] + 0.7 * keyed.offset.square().sum() + 0.2 * mirrored)
    torch.testing.assert_close(loss, torch.stack(terms).mean())
    torch.testing.assert_close(cold, 0.3 * torch.stack(kept).mean())


def test_all_parameters_have_finite_gradients():
    taught = training(KeypointDeformer(keypoints=5, points=64, code=16, batch=2, warm_up=0.0))
    taught.loss(0).backward()
    for name, parameter in taught.network.named_parameters():
        assert parameter.grad is not None and parameter.grad.isfinite().all() and parameter.grad.any(), name


def test_in_the_warm_up_only_keypoints_learn():
    method = KeypointDeformer(keypoints=5, points=64, code=16, batch=2, steps=3, warm_up=0.99)
    begin = method._network(generator()).state_dict()  # drawn with the seed of the run
    weights = method.fit(examples(), Run(seed=0))
    moved = {name for name in weights if (weights[name] != begin[name].numpy()).any()}
    assert moved and all(name.startswith(("encoder", "pointing")) for name in moved)


@pytest.mark.parametrize("at", [1, 4])
def test_an_interrupted_training_ends_with_the_same_weights(at):
    method = KeypointDeformer(keypoints=5, points=64, code=16, batch=2, steps=6, warm_up=0.4)
    data = examples()
    whole = method.fit(data, Run(seed=3))
    again = killed_and_resumed(method, data, at)
    assert whole.keys() == again.keys() and all((whole[name] == again[name]).all() for name in whole)


@pytest.mark.parametrize("corresponding", [False, True])
def test_a_training_lowers_its_loss(corresponding):
    more = {"partners": not corresponding, "influenced": 0, "warm_up": 0.0, "stretch": 0.0}
    method = KeypointDeformer(keypoints=5, points=64, code=16, batch=2, steps=41, learning_rate=3e-3, **more)
    run = Logged(seed=0)
    weights = method.fit(examples(corresponding=corresponding), run)
    losses = run.losses()
    assert losses[-1] < 0.7 * losses[0] and all(np.isfinite(array).all() for array in weights.values())


# --- deformations -----------------------------------------------------------------------------------------------------


def test_deformations_keep_faces_and_store_cages_and_keypoints():
    case = Deform().toy()
    run, kept = Run(seed=0), {}
    run.on_keep = lambda name, value: kept.update({name: value() if callable(value) else value})
    run.weights = {name: tensor.numpy() for name, tensor in network().state_dict().items()}
    output = TINY.deform(**case.input, run=run)
    Deform().validate(output, case.input)
    assert np.array_equal(output.faces, case.input["source"].faces)
    assert set(kept) == {"cage", "deformed_cage", "keypoints", "deformed_keypoints"}
    assert len(kept["cage"].vertices) == len(kept["deformed_cage"].vertices) == 42
    assert all(isinstance(kept[name], PointCloud) and len(kept[name]) == 5 for name in kept if "key" in name)


def test_a_deformation_has_the_position_and_size_of_the_target():
    weights = {name: tensor.numpy() for name, tensor in network().state_dict().items()}
    source, target = box((1, 2, 1)).subdivide(), box((2, 1, 1)).sample(500, seed=0)
    one = TINY.deform(source, PointCloud(target), Run(seed=0, weights=weights))
    grown = source.copy()
    grown.vertices = 3 * source.vertices - 5
    other = TINY.deform(grown, PointCloud(3 * target + 7), Run(seed=0, weights=weights))
    np.testing.assert_allclose(other.vertices, 3 * one.vertices + 7, atol=1e-4)


def test_bad_parameters_are_refused():
    least = {"points": 15, "code": 0, "subdivisions": -1, "influenced": -1, "batch": 0, "steps": -1, "keypoints": 0}
    signs = {"farthest": -1.0, "offset": float("nan"), "symmetry": -1.0}
    above = {"gap": 0.0, "learning_rate": 0.0, "decay": 0.0, "stretch": 1.0, "warm_up": 1.0}
    for name, value in {**least, **signs, **above}.items():
        with pytest.raises(ValueError, match=f"^{name}: expected"):
            KeypointDeformer(**{name: value})
    with pytest.raises(ValueError, match="^keypoints: expected 1 to 16"):
        KeypointDeformer(points=16, keypoints=17)
