"""One training step of IDF against Eq. 4.3 as automatic differentiation would have it; and who gets there first."""

import os
import time

import numpy as np
import pytest
import torch
from turns import medians_by_turns

from bench import PointCloud, Run
from bench.methods.implicit.fields.displaced_field import DisplacedField, attenuation
from bench.methods.implicit.hash_sdf import HashSdf
from bench.methods.implicit.idf import Idf
from bench.methods.implicit.losses.oriented import OrientedLoss
from bench.methods.implicit.siren import Siren
from bench.methods.learned.networks.sphere import begin_as_sphere
from bench.methods.learned.training.batches import Sampler
from bench.plugins.registry import registry

SHORT = "DETAILBENCH_SHORT" in os.environ
ROUNDS = 3 if SHORT else 9
POINTS = 512 if SHORT else 4096  # of a step
LEAST_STEP = 1.5
SECONDS = 60  # of siren
LEAST_SOONER = 5
CHUNK = 2048


def direct(field: DisplacedField, batch) -> torch.Tensor:
    """L_f^ with every term on every point, every derivative by double backward."""

    def value(network, x):
        for weight, bias in zip(network.weights[:-1], network.biases[:-1], strict=True):
            x = torch.sin(network.omega * torch.nn.functional.linear(x, weight, bias))
        return torch.nn.functional.linear(x, network.weights[-1], network.biases[-1])[:, 0]

    x = batch.x.clone().requires_grad_()
    f = value(field.base, x)
    (gradient,) = torch.autograd.grad(f.sum(), x, create_graph=True)
    n = torch.nn.functional.normalize(gradient, dim=1).detach()
    chi = attenuation(f.detach(), field.nu)
    f_hat = value(field.base, x + (field.alpha * torch.tanh(value(field.displacement, x)) * chi)[:, None] * n)
    (by_x,) = torch.autograd.grad(f_hat.sum(), x, create_graph=True)
    return field._loss(f_hat, by_x, batch)


def a_field() -> DisplacedField:
    """IDF's networks on their way: the base is a sphere, the displacement is small."""
    field = Idf(nu=0.02).field(torch.Generator().manual_seed(0))
    assert isinstance(field, DisplacedField) and isinstance(field._loss, OrientedLoss)
    begin_as_sphere(field.base)
    return field


def sphere_cloud(count: int) -> np.ndarray:
    """Directions, which are points and normals of the unit sphere."""
    x = np.random.default_rng(0).normal(size=(count, 3))
    return x / np.linalg.norm(x, axis=1, keepdims=True)


def gradients(field: DisplacedField) -> torch.Tensor:
    """Of the displacement's weights, in one row."""
    return torch.cat([p.grad.ravel() for p in field.displacement.parameters()])


def test_a_step_of_idf(benchmark, capsys):
    torch.set_num_threads(2)
    field, u = a_field(), sphere_cloud(100_000)
    batch = Sampler(0.5 * u, u, POINTS, torch.Generator().manual_seed(1)).draw()
    for parameter in field.base.parameters():
        parameter.requires_grad_(False)

    def ours():
        field.zero_grad()
        for chunk in batch.chunks(CHUNK):
            field.loss(chunk, 0.75).backward()  # the base is frozen in the second half of the schedule

    def directly():
        field.zero_grad()
        direct(field, batch).backward()

    directly()
    expected = gradients(field).clone()
    ours()
    difference = float((gradients(field) - expected).norm() / expected.norm())
    medians = medians_by_turns({"ours": ours, "direct": directly}, ROUNDS)
    ratio = medians["direct"] / medians["ours"]
    with capsys.disabled():
        print(
            f"\na step of idf, {len(batch.x):,} points: {medians['ours'] * 1e3:.0f} ms, direct "
            f"{medians['direct'] * 1e3:.0f} ms: {ratio:.2f} times as fast; gradients differ by {difference:.1e}"
        )
    benchmark.extra_info["ratio"] = ratio
    benchmark.pedantic(ours, rounds=1)
    assert difference < 0.02
    assert ratio >= LEAST_STEP


def test_the_steps_before(capsys):
    """While both networks learn there is less to leave out, and yet no step is slower than the direct one."""
    torch.set_num_threads(2)
    field, u = a_field(), sphere_cloud(100_000)
    batch = Sampler(0.5 * u, u, POINTS, torch.Generator().manual_seed(1)).draw()

    def ours():
        field.zero_grad()
        for chunk in batch.chunks(CHUNK):
            field.loss(chunk, 0.35).backward()

    def directly():
        field.zero_grad()
        direct(field, batch).backward()

    medians = medians_by_turns({"ours": ours, "direct": directly}, ROUNDS)
    with capsys.disabled():
        print(f"\nwith both losses: {medians['direct'] / medians['ours']:.2f} times as fast as L_f^ alone, direct")
    assert medians["direct"] > medians["ours"]


@pytest.mark.study
def test_hash_sdf_is_there_sooner(capsys):
    """The error that siren has at the end of its time, hash_sdf has in a fifth of it."""
    shapes = registry().find("dataset", "reliefs").cls().shapes("train")
    shape = [next(shapes) for _ in range(3)][2].framed()[0]
    cloud = PointCloud(*shape.surface.sample(100_000, np.random.default_rng(0)))
    fresh, _ = shape.surface.sample(10_000, np.random.default_rng(1))

    def error(method) -> float:
        field, frame = method.fit_to(cloud, Run(seed=0, threads=2))
        x = torch.as_tensor(frame.apply(fresh), dtype=torch.float32)
        values = torch.as_tensor(field.values(x.numpy()))
        step = 1e-3
        slopes = [
            field.values((x + step * axis).numpy()) - field.values((x - step * axis).numpy()) for axis in torch.eye(3)
        ]
        length = np.linalg.norm(np.stack(slopes, axis=1) / (2 * step), axis=1)
        return float(np.mean(np.abs(values.numpy()) / np.maximum(length, 0.1)))

    begin = time.perf_counter()
    siren = error(Siren(steps=10**6, seconds=SECONDS))
    hashed = error(HashSdf(steps=10**6, seconds=SECONDS / LEAST_SOONER))
    with capsys.disabled():
        print(
            f"\nsiren after {SECONDS} s: {siren:.2e}; hash_sdf after {SECONDS / LEAST_SOONER:g} s: {hashed:.2e} "
            f"({time.perf_counter() - begin:.0f} s in all)"
        )
    assert hashed <= siren
