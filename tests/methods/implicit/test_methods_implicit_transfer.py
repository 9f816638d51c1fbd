"""The transferable displacement: encoder, grid, FiLM, the field of Eq. 4.5, and the method."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import torch
import trimesh

from bench import BadInput, Run
from bench.methods.implicit.fields.descriptor import Cloud, Descriptor, Query, cell_numbers
from bench.methods.implicit.fields.transfer_field import NearSampler, TransferField
from bench.methods.implicit.fitting.oriented_samples import frame_of, on_base
from bench.methods.implicit.idf_transfer import IdfTransfer
from bench.methods.implicit.losses.oriented import OrientedLoss
from bench.methods.learned.networks.film import FilmNetwork, JoinedNetwork
from bench.methods.learned.networks.point_encoder import PointEncoder
from bench.methods.learned.networks.sine_network import SineNetwork
from bench.methods.learned.networks.unet import UNet
from bench.methods.learned.training.batches import Batch
from bench.methods.learned.training.stages import Stages
from bench.tasks.detail_transfer import DetailTransfer

VARIANTS = {
    "default": {},
    "phi alone": {"normal": False},
    "no mapping": {"mapping": False},
    "normal as context": {"grid": False},
    "neither": {"mapping": False, "grid": False},
    "f unscaled": {"scale": False},
}


def draw(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def uniform(count: int, seed: int = 0, side: float = 1.0) -> torch.Tensor:
    """Points of the box, in double precision."""
    return (torch.rand(count, 3, generator=draw(seed), dtype=torch.double) * 2 - 1) * side


def ball_cloud(count: int, seed: int = 0) -> Cloud:
    normals = torch.nn.functional.normalize(uniform(count, seed), dim=1)
    return Cloud(0.6 * normals, normals)


def small_field(seed: int = 0, mapping: bool = True, grid: bool = True, normal: bool = True, **changes):
    """A field in double precision whose displacement is not small."""
    base = SineNetwork(2.0, hidden_layers=1, width=16, generator=draw(seed), mixed=False)
    descriptor = Descriptor(8, 8, draw(seed + 1), mixed=False) if grid else None
    condition = 8 * grid + 3 * (normal or not grid)
    network = FilmNetwork if mapping else JoinedNetwork
    settings = {"alpha": 0.2, "nu": 0.5, "encoded": 150, "negligible": 0.0, "generator": draw(9)} | changes
    return TransferField(
        OrientedLoss(),
        base.requires_grad_(False),
        network(condition, width=16, omega=5.0, generator=draw(seed + 2)),
        descriptor,
        ball_cloud(200),
        normal=normal,
        **settings,
    ).double()


def batch_of(count: int) -> Batch:
    normals = torch.nn.functional.normalize(uniform(count, 5), dim=1)
    return Batch(torch.cat([0.6 * normals, uniform(count, 6)]), count, normals, None, 2 * count)


# -- parts -------------------------------------------------------------------------------------------------------------


def count(module: torch.nn.Module) -> int:
    return sum(p.numel() for p in module.parameters())


def test_parameter_counts_are_those_of_the_released_code():
    film = FilmNetwork(19)
    assert count(PointEncoder()) == 6_960
    assert count(UNet()) == 256_656
    assert count(film.mapping) == 76_416
    assert count(film) - count(film.mapping) == 18_913
    bases = [count(SineNetwork(5.0, hidden_layers=layers, width=96)) for layers in (3, 2)]
    assert bases == [28_417, 19_105]


def test_weights_are_drawn_from_the_generator_alone():
    for make in (PointEncoder, UNet):
        one, two, other = make(16, draw(1)), make(16, draw(1)), make(16, draw(2))
        assert all(torch.equal(a, b) for a, b in zip(one.parameters(), two.parameters(), strict=True))
        assert not torch.equal(next(p for p in one.parameters()), next(p for p in other.parameters())) or make is UNet
    one, two = FilmNetwork(generator=draw(1)), FilmNetwork(generator=draw(1))
    assert all(torch.equal(a, b) for a, b in zip(one.parameters(), two.parameters(), strict=True))


def test_encoder_pools_within_cells():
    """Against a loop over the cells: maxima between the blocks, the mean at the end."""
    encoder = PointEncoder(4, draw()).double()
    for block in encoder.blocks:  # initialised to zero, which would hide errors
        torch.nn.init.normal_(block.second.weight, generator=draw(3))
    normals, cells = uniform(30), torch.randint(0, 6, (30,), generator=draw(1)) * 7
    occupied, features = encoder(normals, cells)
    assert torch.equal(occupied, cells.unique())
    h = encoder.blocks[0](encoder.first(normals))
    for block in list(encoder.blocks)[1:]:
        pooled = torch.stack([h[cells == cell].amax(dim=0) for cell in cells])
        h = block(torch.cat([h, pooled], dim=1))
    h = encoder.last(h)
    torch.testing.assert_close(features, torch.stack([h[cells == cell].mean(dim=0) for cell in occupied]))


def test_invariances_of_the_descriptor():
    """Order and position within a cell; and a shift by whole cells moves the features of the encoder with it."""
    descriptor, side = Descriptor(8, 8, draw(), mixed=False).double(), 8
    cells = torch.randint(1, 6, (60, 3), generator=draw(1))
    place, other = (torch.rand(60, 3, generator=draw(s), dtype=torch.double) for s in (2, 3))
    normals = torch.nn.functional.normalize(uniform(60, 4), dim=1)
    points, moved = ((cells + p * 0.98 + 0.01) * 2 / side - 1 for p in (place, other))
    features = descriptor(Cloud(points, normals))
    assert features.shape == (side**3, 8)
    torch.testing.assert_close(descriptor(Cloud(moved, normals)), features)
    order = torch.randperm(60, generator=draw(5))
    torch.testing.assert_close(descriptor(Cloud(points[order], normals[order])), features)
    before = descriptor.encoder(normals, cell_numbers(points, side))
    after = descriptor.encoder(normals, cell_numbers(points + 2 / side, side))
    assert torch.equal(after[0], before[0] + side**2 + side + 1)
    torch.testing.assert_close(after[1], before[1])
    assert (descriptor(Cloud(points, -normals)) - features).abs().max() > 1e-3


def test_points_are_in_their_cells():
    points = torch.tensor([[-1.0, -1, -1], [-1, -1, -0.74], [0.99, 0.99, 0.99], [3, -3, 0]])
    assert cell_numbers(points, 8).tolist() == [0, 1, 511, 7 * 64 + 4]


def naive_query(features: torch.Tensor, side: int, x: torch.Tensor) -> torch.Tensor:
    """Trilinear interpolation between the centres of cells, point by point."""
    values = []
    for point in ((x + 1) * side / 2 - 0.5).clamp(0, side - 1):
        value = 0
        for cell in itertools.product(range(side), repeat=3):
            weight = (1 - (point - torch.tensor(cell)).abs()).clamp(min=0).prod()
            value = value + weight * features[(cell[0] * side + cell[1]) * side + cell[2]]
        values.append(value)
    return torch.stack(values)


def test_query_is_trilinear_and_its_gradient_matches_finite_differences():
    side = 4
    features = torch.randn(side**3, 3, generator=draw(), dtype=torch.double)
    x = torch.cat([uniform(12), uniform(4, 1, side=1.3)])  # some are beyond the outermost centres, or outside the box
    query = Query(features, side, x)
    torch.testing.assert_close(query.values, naive_query(features, side, x))
    by_values = torch.randn(len(x), 3, generator=draw(2), dtype=torch.double)
    h = 1e-6
    for axis in range(3):
        step = h * torch.eye(3, dtype=torch.double)[axis]
        difference = (Query(features, side, x + step).values - Query(features, side, x - step).values) / (2 * h)
        torch.testing.assert_close(query.pull(by_values)[:, axis], (difference * by_values).sum(1), atol=1e-7, rtol=0)


def test_a_linear_function_is_interpolated_exactly_between_centres():
    side = 8
    centres = (torch.stack(torch.meshgrid(*[torch.arange(side)] * 3, indexing="ij"), dim=-1) + 0.5) * 2 / side - 1
    slope = torch.tensor([[0.3], [-2.0], [0.7]], dtype=torch.double)
    features = centres.double().reshape(-1, 3) @ slope
    x = uniform(50, side=1 - 1 / side)
    torch.testing.assert_close(Query(features, side, x).values, x @ slope)


def test_film_matches_its_formula():
    film = FilmNetwork(5, width=8, layers=2, omega=30.0, generator=draw()).double()
    c, f = torch.randn(6, 5, generator=draw(1), dtype=torch.double), uniform(6, 2)[:, 0]
    m = c
    for layer in film.mapping[:-1]:
        m = torch.log1p(torch.exp(layer(m)))
    modulations = film.mapping[-1](m)
    gamma, beta = modulations[:, :16], modulations[:, 16:]
    h = f[:, None]
    for i, layer in enumerate(film.layers):
        part = slice(8 * i, 8 * i + 8)
        h = torch.sin((30 + 15 * gamma[:, part]) * layer(h) + beta[:, part])
    torch.testing.assert_close(film(c, f), film.last(h)[:, 0])


# -- the field ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("variant", VARIANTS.values(), ids=VARIANTS)
def test_gradient_is_that_of_the_frozen_normal_form(variant):
    """Central differences of f^ with n and chi fixed at their values at x, but not phi and f-bar."""
    field, x = small_field(**variant), uniform(25, 3, side=0.9)
    with torch.no_grad():
        f_hat, gradient = field.value_and_gradient(x)
        f, g = field.base.value_and_gradient(x)
        n, chi = torch.nn.functional.normalize(g, dim=1), 1 / (1 + (f / 0.5) ** 4)
        features = field.encode() if field.descriptor else None

        def frozen(y):
            scaled = torch.tanh(field.base(y) / 0.5) if variant.get("scale", True) else field.base(y)
            condition = n
            if features is not None:
                phi = Query(features, 8, y).values
                condition = torch.cat([phi, n], dim=1) if variant.get("normal", True) else phi
            d = 0.2 * torch.tanh(field.displacement(condition, scaled)) * chi
            return field.base(y + d[:, None] * n)

        torch.testing.assert_close(f_hat, frozen(x))
        torch.testing.assert_close(field(x), f_hat)
        h = 1e-6
        differences = []
        for axis in range(3):
            step = h * torch.eye(3, dtype=torch.double)[axis]
            differences.append((frozen(x + step) - frozen(x - step)) / (2 * h))
        torch.testing.assert_close(gradient, torch.stack(differences, dim=1), atol=1e-7, rtol=1e-5)


def test_loss_reaches_every_network_but_the_base():
    field = small_field()
    field.loss(batch_of(20), 0.5).backward()
    base = {id(p) for p in field.base.parameters()}
    for name, parameter in field.named_parameters():
        assert (parameter.grad is None) == (id(parameter) in base), name
    assert len(field.groups()[0]) == len(list(field.parameters())) - len(base)
    with torch.no_grad():
        assert not field.loss(batch_of(20), 1.0).requires_grad


def test_gradient_of_the_loss_matches_finite_differences():
    """By one weight of each network. All points of the cloud are equal, so the drawn ones do not matter."""
    field = small_field()
    field._cloud = Cloud(field._cloud.points[:1].repeat(50, 1), field._cloud.normals[:1].repeat(50, 1))
    field.loss(batch_of(20), 0.5).backward()
    for network in (field.descriptor.encoder, field.descriptor.unet, field.displacement):
        parameter = max((p for p in network.parameters() if p.grad is not None), key=lambda p: p.grad.abs().max())
        i, h = parameter.grad.abs().argmax(), 1e-7  # small, because a ReLU has a kink
        values = []
        for step in (h, -2 * h):
            parameter.data.view(-1)[i] += step
            with torch.no_grad():
                values.append(float(field.loss(batch_of(20), 0.5)))
        parameter.data.view(-1)[i] += h
        assert (values[0] - values[1]) / (2 * h) == pytest.approx(float(parameter.grad.view(-1)[i]), rel=1e-3)


def test_descriptor_learns_only_in_every_nth_step():
    field = small_field(every=3, noise=0.01)
    learned = []
    for _ in range(7):
        field.zero_grad(set_to_none=True)
        field.loss(batch_of(10), 0.0).backward()
        learned.append(any(p.grad is not None for p in field.descriptor.parameters()))
        assert all(p.grad is not None for p in field.displacement.parameters())
    assert learned == [True, False, False, True, False, False, True]


def test_the_base_can_be_replaced():
    field, other, x = small_field(), small_field(seed=20), uniform(30, 4)
    moved = field.onto(other.base, ball_cloud(100, seed=7))
    assert moved.displacement is field.displacement and moved.descriptor is field.descriptor
    f, d = moved.parts(x)
    torch.testing.assert_close(f, other.base(x))
    assert 0 < d.abs().max() <= 0.2
    # The descriptor sees the other cloud.
    assert (d - field.onto(other.base, ball_cloud(100, seed=8)).parts(x)[1]).abs().max() > 1e-6
    # Without displacement the field is the base.
    moved.alpha = 1e-9
    torch.testing.assert_close(moved(x), other.base(x), atol=1e-7, rtol=0)


def test_near_sampler_stays_near():
    cloud = ball_cloud(500)
    sampler = NearSampler(cloud.points.numpy(), cloud.normals.numpy(), 400, draw(), spread=0.05)
    batch = sampler.draw()
    radius = batch.x.norm(dim=1)
    assert batch.x.shape == (800, 3) and batch.on == 400 and batch.total == 800
    torch.testing.assert_close(radius[:400], torch.full((400,), 0.6))
    assert (batch.x[400:].norm(dim=1) - 0.6).std() == pytest.approx(0.05, rel=0.2)
    torch.testing.assert_close(batch.normals * 0.6, batch.x[:400])


# -- the method --------------------------------------------------------------------------------------------------------


def test_frame_contains_the_details_on_either_base():
    ball = trimesh.creation.icosphere(2)
    grown = trimesh.Trimesh(1.3 * ball.vertices, ball.faces, process=False)
    frame = frame_of(grown, ball, trimesh.Trimesh(2 * ball.vertices, ball.faces, process=False))
    # Details 0.3 high on the source of radius 1: the target of radius 2 grows to 2.3.
    assert frame.radius == pytest.approx(2.3 / 0.98, rel=0.02)
    assert frame_of(grown, None, ball).radius == pytest.approx(1.3 / 0.98, rel=0.02)


def test_a_cloud_moves_onto_the_base():
    base = SineNetwork(5.0, hidden_layers=3, width=96)
    from bench.methods.learned.networks.sphere import begin_as_sphere

    begin_as_sphere(base, 0.5)
    cloud = ball_cloud(50)
    moved = on_base(base, Cloud(cloud.points.float(), -cloud.normals.float()))
    assert base(moved.points).abs().max() < 1e-3
    assert (moved.normals * cloud.normals).sum(1).min() > 0.98  # the normals of the base, not those of the cloud


def test_stages_share_time_and_progress():
    seen = []
    run = Run(seconds=100, on_progress=lambda done, total: seen.append(done / total))
    stages = Stages(run, 50, (0.2, 0.2, 0.6))
    assert stages.next() == pytest.approx(10, abs=0.5)
    stages.progress(1, 2)
    stages.progress(2, 2)
    assert stages.next() == pytest.approx(12.5, abs=0.5)  # a quarter of the remaining time: the first stage took none
    stages.progress(1, 1)
    assert stages.next(reserve=70) == pytest.approx(30, abs=0.5)  # the limit of the run is nearer
    stages.progress(1, 1)
    assert seen == pytest.approx([0.1, 0.2, 0.4, 1.0])


# A narrow nu: the displacement, the slowest part, is only evaluated near the base.
TINY = {"steps": 2, "base_steps": 15, "batch": 64, "resolution": 16, "cells": 8, "points": 300, "nu": 0.02}


@pytest.fixture
def toy(monkeypatch) -> dict:
    """The toy input, with fewer samples than by default and a coarser initial search for the surface."""
    monkeypatch.setattr("bench.methods.implicit.fitting.oriented_samples.CLOUD", 2000)
    monkeypatch.setattr("bench.methods.learned.meshing.marching.COARSE", 32)
    return dict(DetailTransfer().toy().input)


def test_method_gives_the_same_mesh_for_a_seed(toy):
    """With and without traces of intermediate results."""
    meshes = []
    for traces in (1, 0):
        seen, traced = [], []
        run = Run(
            seed=3,
            on_progress=lambda done, total, seen=seen: seen.append(done / total),
            on_trace=lambda output, seconds, traced=traced: traced.append(output),
        )
        meshes.append(IdfTransfer(**TINY, traces=traces).detail_transfer(**toy, run=run))
        assert seen == sorted(seen) and seen[-1] == 1.0
        assert len(traced) == traces
        assert run.parameters == 28_417 + 6_960 + 256_656 + 76_416 + 18_913
    assert len(meshes[0].faces) and np.isfinite(meshes[0].vertices).all()
    assert np.array_equal(meshes[0].vertices, meshes[1].vertices) and np.array_equal(meshes[0].faces, meshes[1].faces)


@pytest.mark.parametrize(
    "changes, parameters",
    [
        ({"mapping": False, "context": "normal"}, 28_417 + 480 + 3 * 9312 + 97),
        (
            {"normals": False, "scale_f": False, "cloud": "detailed"},
            28_417 + 6_960 + 256_656 + 76_416 - 3 * 96 + 18_913,
        ),
    ],
)
def test_switches_change_the_networks_and_the_base_is_optional(toy, changes, parameters):
    run = Run()
    mesh = IdfTransfer(**TINY, **changes).detail_transfer(**toy | {"source_base": None}, run=run)
    assert len(mesh.faces) and np.isfinite(mesh.vertices).all()
    assert run.parameters == parameters


def test_a_tiny_alpha_gives_the_base(toy):
    settings = TINY | {"alpha": 1e-6, "context": "normal", "base_steps": 80}
    mesh = IdfTransfer(**settings).detail_transfer(**toy, run=Run())
    sizes = np.ptp(mesh.vertices, axis=0) / np.ptp(toy["target_base"].vertices, axis=0)
    assert sizes == pytest.approx(np.ones(3), abs=0.1)  # a base of 100 steps


def test_errors_name_the_mesh_or_the_parameter(toy):
    base = toy["target_base"]
    broken = base.vertices.copy()
    broken[3] = np.nan
    empty = trimesh.Trimesh(base.vertices, np.empty((0, 3), dtype=int), process=False)
    for name, mesh, words in (
        ("source", empty, "source: has 642 vertices but no faces"),
        ("target_base", trimesh.Trimesh(broken, base.faces, process=False), "target_base: 1 of 642 vertices are NaN"),
    ):
        with pytest.raises(BadInput, match=words):
            IdfTransfer().detail_transfer(**toy | {name: mesh}, run=Run())
    for name, value in (("steps", 0), ("cells", 10), ("alpha", -1.0), ("resolution", 8), ("omega", 0.0), ("every", 0)):
        with pytest.raises(ValueError, match=f"{name}: expected .*, got {value}"):
            IdfTransfer(**{name: value})
