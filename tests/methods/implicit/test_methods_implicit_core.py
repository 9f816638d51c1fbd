"""Sine networks, implicit displacement fields, their losses, schedules and the training loop."""

from __future__ import annotations

import math
import re
import time
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from bench import BadInput, PointCloud, Run
from bench.methods.implicit.fields.displaced_field import DisplacedField, attenuation
from bench.methods.implicit.idf import Idf
from bench.methods.implicit.losses.oriented import STEEPNESS, OrientedLoss
from bench.methods.implicit.siren import Siren
from bench.methods.learned.networks.sine_network import SineNetwork
from bench.methods.learned.training import files
from bench.methods.learned.training.batches import Batch, DistanceSampler, Sampler
from bench.methods.learned.training.field import Field
from bench.methods.learned.training.loop import Diverged, Progress, fit
from bench.methods.learned.training.schedules import stage
from bench.methods.learned.training.settings import Training
from bench.methods.learned.training.stages import area_about, reserve, seconds_to_extract


def draw(seed: int = 0) -> torch.Generator:
    """A torch generator."""
    return torch.Generator().manual_seed(seed)


def small_network(omega: float = 5.0, seed: int = 0, width: int = 24) -> SineNetwork:
    """A sine network in double precision, to test the formula and not rounding."""
    return SineNetwork(omega, hidden_layers=2, width=width, generator=draw(seed), mixed=False).double()


def small_field(**changes) -> DisplacedField:
    """A displaced field in double precision whose displacement is not small."""
    settings = {"alpha": 0.1, "nu": 0.3, "schedule": "released"} | changes
    return DisplacedField(OrientedLoss(), small_network(3.0), small_network(8.0, 1), **settings)


def points(count: int, seed: int = 0) -> torch.Tensor:
    """Points of the box."""
    return torch.rand(count, 3, generator=draw(seed), dtype=torch.double) * 2 - 1


# -- the sine network --------------------------------------------------------------------------------------------------


def test_parameter_counts_are_those_of_the_thesis():
    """Three layers after the first: 198,657; seven: 461,825; two networks: 397,314."""
    assert Siren(sphere=0).field(draw()).count() == 198_657
    assert Siren(sphere=0, hidden_layers=7).field(draw()).count() == 461_825
    assert Idf(sphere=0).field(draw()).count() == 397_314


def test_sine_network_matches_its_formula():
    """Value by a loop over the layers of the formula."""
    network, x = small_network(), points(7)
    h = x
    for weight, bias in zip(network.weights[:-1], network.biases[:-1], strict=True):
        h = torch.sin(network.omega * (h @ weight.T + bias))
    expected = (h @ network.weights[-1].T + network.biases[-1])[:, 0]
    torch.testing.assert_close(network(x), expected)
    torch.testing.assert_close(network.value_and_gradient(x)[0], expected)


def test_gradient_and_its_derivatives_are_those_of_automatic_differentiation():
    """Gradient by x, and gradients of a loss over both by x and by every weight, against double backward."""
    network, x = small_network(), points(40).requires_grad_()
    f, g = network.value_and_gradient(x)
    f_auto = network(x)
    (g_auto,) = torch.autograd.grad(f_auto.sum(), x, create_graph=True)
    torch.testing.assert_close(g, g_auto)

    def loss(f, g):
        return f.abs().mean() + ((g.norm(dim=1) - 1).abs() * torch.arange(len(f))).mean()

    wanted = [x, *network.parameters()]
    mine = torch.autograd.grad(loss(f, g), wanted)
    theirs = torch.autograd.grad(loss(f_auto, g_auto), wanted)
    for ours, auto in zip(mine, theirs, strict=True):
        torch.testing.assert_close(ours, auto)


def test_frozen_weights_get_no_gradient_but_points_do():
    """A frozen base passes the gradient on to the points of evaluation."""
    network, x = small_network().requires_grad_(False), points(5).requires_grad_()
    f, g = network.value_and_gradient(x)
    (f.sum() + g.square().sum()).backward()
    assert x.grad is not None and x.grad.abs().max() > 0
    assert all(p.grad is None for p in network.parameters())


def test_reduced_precision_affects_only_the_backward_pass():
    """Values and spatial gradients have full precision bit for bit; gradients of weights differ by rounding at most."""
    full, mixed = (SineNetwork(15, generator=draw(), mixed=m) for m in (False, True))
    x = points(512).float()
    results = []
    for network in (full, mixed):
        f, g = network.value_and_gradient(x)
        (f.abs().mean() + (g.norm(dim=1) - 1).abs().mean()).backward()
        results.append((f.detach(), g.detach(), [p.grad for p in network.parameters()]))
    assert torch.equal(results[0][0], results[1][0]) and torch.equal(results[0][1], results[1][1])
    for ours, reduced in zip(results[0][2], results[1][2], strict=True):
        assert (ours - reduced).norm() <= 2e-2 * ours.norm()
    assert torch.get_float32_matmul_precision() == "highest"


@pytest.mark.parametrize("omega", [15.0, 60.0])
def test_initial_weights_have_the_published_ranges(omega):
    """Range and variance: first layer U(+-1/3), others U(+-sqrt(6/256)/omega), biases U(+-1/sqrt(fan in))."""
    network = SineNetwork(omega, generator=draw())
    bounds = [1 / 3, *[math.sqrt(6 / 256) / omega] * 4]
    for weight, bound in zip(network.weights, bounds, strict=True):
        assert weight.abs().max() <= bound
        assert weight.abs().max() > 0.95 * bound
        if weight.numel() > 1000:
            assert weight.var().item() == pytest.approx(bound**2 / 3, rel=0.05)
    for bias, fan_in in zip(network.biases, [3, *[256] * 4], strict=True):
        assert bias.abs().max() <= 1 / math.sqrt(fan_in)
    # Measured on the released code with omega = 15: mean -0.08, deviation 0.05, |grad| about 0.34.
    f, g = network.value_and_gradient(points(4000).float())
    assert f.std() < 0.2 and 0.1 < g.norm(dim=1).mean() < 1


# -- the displaced field -----------------------------------------------------------------------------------------------


def test_displaced_gradient_is_that_of_the_frozen_normal_form():
    """Central differences of f^ with n and chi fixed at their values at x; and f^ itself by its formula."""
    field, x = small_field(negligible=0.0), points(20)
    with torch.no_grad():
        f_hat, gradient = field.value_and_gradient(x)
        f, g = field.base.value_and_gradient(x)
        n, chi = g / g.norm(dim=1, keepdim=True), 1 / (1 + (f / 0.3) ** 4)

        def frozen(y):
            d = 0.1 * torch.tanh(field.displacement(y)) * chi
            return field.base(y + d[:, None] * n)

        torch.testing.assert_close(f_hat, frozen(x))
        torch.testing.assert_close(field(x), f_hat)
        h = 1e-5
        for axis in range(3):
            step = torch.zeros(3, dtype=torch.double)
            step[axis] = h
            torch.testing.assert_close(
                gradient[:, axis], (frozen(x + step) - frozen(x - step)) / (2 * h), atol=1e-7, rtol=1e-6
            )


def test_displacement_is_bounded_and_attenuated():
    """|d| < alpha chi everywhere; chi is 1 at the base, 1/2 at nu, and falls with the fourth power."""
    field = small_field(negligible=0.0)
    with torch.no_grad():
        field.displacement.weights[-1] *= 1e3  # as large as possible
        f, d = field.parts(points(2000))
    chi = attenuation(f, 0.3)
    assert (d.abs() <= 0.1 * chi).all() and d.abs().max() > 0.09
    values = attenuation(torch.tensor([0.0, 0.3, -0.3, 3.0], dtype=torch.double), 0.3)
    torch.testing.assert_close(values, torch.tensor([1, 0.5, 0.5, 1 / 10001], dtype=torch.double))


@pytest.mark.parametrize(("bounded", "nu"), [(False, 0.3), (True, 0.0), (False, 0.0)])
def test_components_can_be_switched_off(bounded, nu):
    """Without tanh, d is linear in the output of the network; without nu nothing is attenuated."""
    field, x = small_field(bounded=bounded, nu=nu), points(50)
    with torch.no_grad():
        f, d = field.parts(x)
        raw = field.displacement(x)
    expected = 0.1 * (torch.tanh(raw) if bounded else raw) * (1 / (1 + (f / nu) ** 4) if nu else 1)
    torch.testing.assert_close(d, expected)


@pytest.mark.parametrize("t", [0.0, 0.35, 0.9])
def test_skipping_points_changes_gradients_only_where_chi_is_negligible(t):
    """Gradients of the loss with and without the skip differ by at most the effect of the skipped points."""
    gradients = []
    x = points(400)
    for negligible in (1e-3, 0.0):
        field = small_field(nu=0.02, negligible=negligible)
        batch = Batch(x, 100, torch.nn.functional.normalize(points(100, 3), dim=1), None, 400)
        for group, rate in zip(field.groups(), field.rates(t), strict=True):
            for parameter in group:
                parameter.requires_grad_(rate > 0)
        field.loss(batch, t).backward()
        gradients.append([p.grad for p in field.parameters() if p.grad is not None])
    assert len(gradients[0]) == len(gradients[1]) > 0
    for skipped, whole in zip(*gradients, strict=True):
        assert (skipped - whole).norm() <= 0.02 * whole.norm() + 1e-9


def test_a_frozen_base_does_not_change():
    """In the second half of the released schedule the base keeps its weights exactly; the displacement learns."""
    field = small_field()
    before = {name: p.detach().clone() for name, p in field.named_parameters()}
    sampler = SimpleNamespace(draw=lambda: Batch(points(40), 20, points(20, 1), None, 40))
    from bench.methods.learned.training.loop import _step

    groups = [{"params": p, "lr": 0.0} for p in field.groups()]
    _step(field, sampler.draw(), torch.optim.Adam(groups, lr=1e-3), 0.7, Training(steps=1, learning_rate=1e-3))
    moved = {name: not torch.equal(before[name], p) for name, p in field.named_parameters()}
    assert not any(hit for name, hit in moved.items() if name.startswith("base"))
    assert any(hit for name, hit in moved.items() if name.startswith("displacement"))


# -- losses and schedules ----------------------------------------------------------------------------------------------


def test_loss_is_the_sum_of_its_terms_over_all_points():
    """Eq. 4.4 by a loop over the points."""
    loss = OrientedLoss(surface=7, space=5, eikonal=3, normal=2)
    f, g, normals = points(6)[:, 0], points(6, 1), torch.nn.functional.normalize(points(4, 2), dim=1)
    batch = Batch(points(6), 4, normals, None, 12)  # half of a step of 12 points
    total = 0.0
    for i in range(6):
        total += 3 * abs(g[i].norm() - 1)
        if i < 4:
            total += 7 * abs(f[i]) + 2 * (1 - g[i] @ normals[i] / g[i].norm())
        else:
            total += 5 * torch.exp(-STEEPNESS * abs(f[i]))
    torch.testing.assert_close(loss(f, g, batch), total / 12)


@pytest.mark.parametrize(
    ("t", "base_loss", "loss", "base_rate", "rate"),
    [
        (0.0, 1, 0, 1, 0),
        (0.2, 1, 0, 1, 0),
        (0.35, 0.5, 0.5, 0.5, 0.5),
        (0.5, 0, 1, 0, 1),
        (0.75, 0, 1, 0, 0.55),
        (1, 0, 1, 0, 0.1),
    ],
)
def test_released_schedule(t, base_loss, loss, base_rate, rate):
    """Base alone, half and half in mid-blend, base frozen, and the rate of the displacement down to a tenth."""
    now = stage(t, "released")
    assert (now.base_loss, now.loss, now.base_rate) == pytest.approx((base_loss, loss, base_rate))
    assert now.rate == pytest.approx(rate)


def test_thesis_schedule():
    """kappa = (1 + cos(pi (t - 0.2)/0.8))/2, for weights and rates, which fall to a tenth over the last fifth."""
    for t in (0.2, 0.35, 0.5, 0.8, 1.0):
        kappa = 0.5 * (1 + math.cos(math.pi * (t - 0.2) / 0.8))
        now = stage(t, "thesis")
        assert (now.base_loss, now.loss) == pytest.approx((kappa, 1 - kappa))
    assert stage(0.6, "thesis").rate == pytest.approx(0.5)
    assert stage(1.0, "thesis").rate == pytest.approx(0.1)
    assert stage(0.1, "thesis").rate == 0


def test_chunks_make_up_the_batch():
    """Chunks cover a batch once, surface points first, and their losses add up to that of the batch."""
    sampler = Sampler(np.eye(3), np.eye(3), 50, draw())
    batch = sampler.draw()
    parts = list(batch.chunks(24))
    assert len(parts) > 3 and sum(len(p.x) for p in parts) == 100 and sum(p.on for p in parts) == 50
    torch.testing.assert_close(torch.cat([p.normals for p in parts]), batch.normals)
    network = SineNetwork(5, hidden_layers=1, width=8, generator=draw())
    loss = OrientedLoss()
    whole = loss(*network.value_and_gradient(batch.x), batch)
    torch.testing.assert_close(sum(loss(*network.value_and_gradient(p.x), p) for p in parts), whole)


def test_batches_are_half_surface_and_half_space():
    """Surface points come from the cloud with their normals; the others fill the box uniformly."""
    rng = np.random.default_rng(0)
    cloud, normals = rng.normal(size=(2, 500, 3)).astype(np.float32)
    batch = Sampler(cloud, normals, 4000, draw()).draw()
    where = {tuple(p): i for i, p in enumerate(cloud)}
    rows = [where[tuple(p)] for p in batch.x[:4000].numpy()]
    np.testing.assert_array_equal(batch.normals.numpy(), normals[rows])
    space = batch.x[4000:].numpy()
    assert np.abs(space).max() <= 1
    counts = np.histogramdd(space, bins=2, range=[(-1, 1)] * 3)[0]
    assert counts.min() > 400 and counts.max() < 600


def test_distances_belong_to_their_points():
    """Every point of a batch has the distance given by the function; two fifths lie on the surface."""
    rng = np.random.default_rng(0)
    cloud = rng.normal(size=(300, 3))
    cloud /= np.linalg.norm(cloud, axis=1, keepdims=True)
    sampler = DistanceSampler(cloud, cloud, 1000, draw(), lambda p: np.linalg.norm(p, axis=1) - 1, count=5000)
    batch = sampler.draw()
    assert (batch.on, len(batch.x), batch.total) == (800, 2000, 2000)
    np.testing.assert_allclose(batch.distances, batch.x.norm(dim=1) - 1, atol=1e-6)
    np.testing.assert_allclose(batch.normals, batch.x[:800], atol=1e-6)


def test_points_with_distances_are_redrawn_on_request():
    asked = []

    def distances(x):
        asked.append(x)
        return np.linalg.norm(x, axis=1) - 1

    cloud = np.eye(3)
    sampler = DistanceSampler(cloud, cloud, 10, draw(), distances, count=50, redraw=2)
    batches = [sampler.draw() for _ in range(5)]  # from three draws: two batches each, and one
    assert len(asked) == 3 and all(len(x) == 50 for x in asked)
    for i, batch in enumerate(batches):
        near, known = batch.x[batch.on :].double().numpy(), asked[i // 2]
        assert (np.abs(near[:, None] - known).max(axis=2).min(axis=1) == 0).all()
        np.testing.assert_allclose(batch.distances, batch.x.norm(dim=1) - 1, atol=1e-6)
    kept = DistanceSampler(cloud, cloud, 10, draw(), distances, count=50)
    [kept.draw() for _ in range(5)]
    assert len(asked) == 4


# -- the training loop -------------------------------------------------------------------------------------------------


class Parabola(Field):
    """One number whose optimum is 3; its loss can become NaN."""

    def __init__(self, spoilt_from: float = 2.0):
        super().__init__()
        self.number = torch.nn.Parameter(torch.zeros(1))
        self.spoilt_from = spoilt_from

    def loss(self, batch: Batch, t: float) -> torch.Tensor:
        """The loss, NaN from a given t on."""
        return ((self.number - 3) ** 2).sum() * (math.nan if t >= self.spoilt_from and torch.is_grad_enabled() else 1)


NOTHING = SimpleNamespace(draw=lambda: Batch(torch.zeros(2, 3), 1, torch.zeros(1, 3), None, 2))


def test_training_reaches_its_minimum_and_reports_progress():
    """The steps are counted, and progress grows to 1."""
    said = []
    run = Run(on_progress=lambda done, total: said.append(done / total))
    field = Parabola()
    assert fit(field, NOTHING, run, Training(steps=200, learning_rate=0.1, betas=(0.9, 0.999))) == (200, True)
    assert field.number.item() == pytest.approx(3, abs=0.05)
    assert said == sorted(said) and said[-1] == 1


def test_the_best_state_is_kept():
    """A training that leaves its optimum returns the best state."""

    class Worse(Parabola):
        def rates(self, t):
            return [1.0 if t < 0.5 else -1.0]  # away from the minimum

        def loss(self, batch, t):
            return super().loss(batch, t)

    field = Worse()
    for parameter in field.parameters():
        parameter.requires_grad_(True)
    offered = []
    fit(field, NOTHING, Run(), Training(steps=400, learning_rate=0.05, checkpoints=40), lambda: offered.append(1))
    assert field.number.item() == pytest.approx(3, abs=0.2)


def test_the_mean_of_the_last_states_is_returned_and_traced():
    """The mean of a number that alternates, in closed form; the training continues from the number itself."""

    class Jumping(Parabola):
        def loss(self, batch, t):
            states.append(self.number.item())
            return super().loss(batch, t) * 0 + self.number.sum() * (1 if len(states) % 2 else -1)

        def optimizer(self, training):
            return torch.optim.SGD(self.parameters(), lr=training.learning_rate)

    def mean_of(numbers):
        mean = 0.0  # the state before the training
        for count, number in enumerate(numbers, 1):
            share = 1 / min(50, 1 + count / 3)
            mean = (1 - share) * mean + share * number
        return mean

    states, offered, field = [], [], Jumping()
    training = Training(steps=300, learning_rate=0.5, traces=3, keep="mean")
    fit(field, NOTHING, Run(), training, lambda: offered.append((len(states), field.number.item())))
    after = [*states[1:], 0.0]  # the end of a step is the start of the next one
    assert set(states) == {0.0, -0.5} and len(offered) == 2
    for count, value in (*offered, (300, field.number.item())):
        assert value == pytest.approx(mean_of(after[:count]), abs=1e-6)
        assert value == pytest.approx(-0.25, abs=0.03)


def test_a_loss_that_is_not_finite_is_reported():
    """The error gives the number of steps, and advice."""
    with pytest.raises(Diverged, match=r"diverged: the loss is nan after 50 of 100 steps.*learning_rate"):
        fit(Parabola(spoilt_from=0.5), NOTHING, Run(), Training(steps=100, learning_rate=1e-3))


def test_progress_follows_steps_as_long_as_they_fit():
    """With time to spare, t depends on the steps alone."""
    clock = Clock()
    progress = Progress(10, clock, 1e6)
    for i in range(10):
        assert progress.t == pytest.approx(i / 10)
        clock.now += 1.0
        progress.step()
    assert progress.t == 1


class Clock:
    """A clock that only moves when it is set."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.mark.parametrize("steps_in_time", [3, 6, 20, 1000])
def test_a_schedule_is_completed_even_if_there_is_time_for_few_steps(steps_in_time):
    """Without jumps: if time is very short, the first step gives the speed."""
    clock, seen = Clock(), [0.0]
    progress = Progress(10**6, clock, steps_in_time * 2.0)
    while progress.t < 1:
        clock.now += 2.0
        progress.step()
        seen.append(progress.t)
    assert len(seen) == pytest.approx(steps_in_time, abs=2)
    assert np.diff(seen).max() < 2.5 / steps_in_time + 0.01 if steps_in_time > 6 else np.diff(seen).max() < 0.7


def test_a_pause_of_the_clock_does_not_shorten_a_training():
    """The clock of the run is paused while true distances are redrawn."""

    class Pausing(Parabola):
        def loss(self, batch, t):
            if torch.is_grad_enabled():
                begin = time.perf_counter()
                time.sleep(0.25)
                run._paused += time.perf_counter() - begin
            return super().loss(batch, t)

    run = Run()
    assert fit(Pausing(), NOTHING, run, Training(steps=12, seconds=1.5, learning_rate=1e-3)).steps == 12


def test_a_loaded_field_begins_at_its_place_in_the_schedule():
    seen = []

    class Listening(Parabola):
        def loss(self, batch, t):
            seen.append(t)
            return super().loss(batch, t)

    fit(Listening(), NOTHING, Run(), Training(steps=10, learning_rate=1e-3, checkpoints=0, begin=0.5))
    assert seen[1:] == pytest.approx([0.5 + 0.05 * i for i in range(10)])
    assert Idf().begin_on_load == 0.5 and stage(0.5, "released").base_rate == 0


def test_a_schedule_is_completed_within_the_time_limit():
    """A million steps in a second: every part of the schedule is reached, and it ends in time."""
    seen = []

    class Slow(Parabola):
        def loss(self, batch, t):
            time.sleep(0.002)
            seen.append(t)
            return super().loss(batch, t)

    run = Run()
    fit(Slow(), NOTHING, run, Training(steps=10**6, seconds=1.0, learning_rate=1e-3, checkpoints=0))
    assert run.elapsed() < 10
    assert np.diff(sorted(seen)).max() < 0.5 and max(seen) > 0.8


def test_intermediate_results_are_traced():
    """As often as requested, and before the end."""
    offered = []
    fit(Parabola(), NOTHING, Run(), Training(steps=100, learning_rate=1e-3, traces=5), lambda: offered.append(1))
    assert len(offered) == 4


# -- whole fits --------------------------------------------------------------------------------------------------------


def ball(count: int = 4000, radius: float = 1.0) -> PointCloud:
    """Points of a sphere with normals."""
    rng = np.random.default_rng(0)
    x = rng.normal(size=(count, 3))
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return PointCloud(radius * x + [5, 0, 0], x)


def torus(count: int = 8000) -> PointCloud:
    """Points of a torus of radii 0.7 and 0.3."""
    rng = np.random.default_rng(0)
    u, v = rng.uniform(0, 2 * np.pi, (2, count))
    ring = np.stack([np.cos(u), np.sin(u), 0 * u], axis=1)
    n = ring * np.cos(v)[:, None] + np.array([0, 0, 1]) * np.sin(v)[:, None]
    return PointCloud(0.7 * ring + 0.3 * n, n)


# The smallest network whose initial sphere is shipped.
SMALL = {"omega": 5.0, "width": 96, "batch": 256, "resolution": 24, "learning_rate": 1e-3}


def test_a_torus_is_fitted_by_both():
    """Every vertex is within 0.05 of the torus, 0.01 on average; the mesh is closed, of genus 1."""
    for method in (Siren(steps=150, **SMALL), Idf(steps=150, omega_detail=15, **SMALL)):
        run = Run(seed=1)
        mesh = method.reconstruct(torus(), run)
        x, y, z = mesh.vertices.T
        distance = np.hypot(np.hypot(x, y) - 0.7, z) - 0.3
        assert np.abs(distance).max() < 0.05 and np.abs(distance).mean() < 0.01, type(method)
        assert mesh.is_watertight and mesh.euler_number == 0 and mesh.volume > 0
        assert run.parameters == method.field(draw()).count()


def test_a_sphere_at_any_position_of_any_size():
    """The result is in the coordinates of the input."""
    mesh = Siren(steps=80, **SMALL).reconstruct(ball(radius=20.0), Run(seed=1))
    distance = np.linalg.norm(mesh.vertices - [5, 0, 0], axis=1) - 20
    assert np.abs(distance).mean() < 0.5 and mesh.is_watertight


def test_the_same_seed_gives_the_same_mesh_and_another_seed_does_not():
    """Bit for bit."""
    method = Siren(steps=5, **SMALL)
    first, again, other = (method.reconstruct(ball(), Run(seed=s)) for s in (1, 1, 2))
    np.testing.assert_array_equal(first.vertices, again.vertices)
    assert first.vertices.shape != other.vertices.shape or not np.array_equal(first.vertices, other.vertices)


def test_a_saved_field_is_the_same_field(tmp_path):
    """Through a safetensors file, bit for bit."""
    form = SMALL | {"omega_detail": 15.0, "resolution": 16}
    method = Idf(steps=5, save=str(tmp_path / "ball.safetensors"), **form)
    mesh = method.reconstruct(ball(), Run(seed=1))
    again = Idf(steps=0, load=method.save, **form).reconstruct(ball(), Run(seed=3))
    np.testing.assert_array_equal(mesh.vertices, again.vertices)


def test_a_field_is_loaded_only_by_the_method_and_settings_that_saved_it(tmp_path):
    """The same weights with another omega are another function, although nothing else would show it."""
    method = Idf(steps=1, **SMALL)
    path = tmp_path / "ball.safetensors"
    files.save(method.field(draw()), path, method.name, method.form(), ball().points)
    for other, message in (
        (Siren(steps=0, load=str(path), **SMALL), "ball.safetensors: was saved by idf, not by siren; use method=idf"),
        (Idf(steps=0, load=str(path), **SMALL, omega_detail=30.0), "omega_detail is now 30.0; use .*_detail=60.0"),
        (Idf(steps=0, load=str(path), **SMALL, bounded=False), "use method.bounded=True"),
    ):
        with pytest.raises(BadInput, match=message):
            other.reconstruct(ball(), Run())
    Idf(steps=0, load=str(path), **SMALL, schedule="none", sphere=0.3).reconstruct(ball(), Run())
    with pytest.raises(BadInput, match="belongs to another network"):
        files.load(Siren(**SMALL).field(draw()), path)
    save_file({"weight": torch.zeros(3)}, str(path))
    with pytest.raises(BadInput, match=r"expected a field that a method saved \(method.save=FILE\)"):
        files.saved_as(path)
    path.write_bytes(b"not what it says")
    with pytest.raises(BadInput, match=r"ball.safetensors: expected a safetensors file"):
        files.saved_as(path)


def test_the_time_for_a_surface_is_estimated_from_its_area():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(50_000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    assert area_about(points) == pytest.approx(24, rel=0.01)  # of the box; the area of the unit sphere is 12.6
    floors = rng.uniform(-1, 1, (300_000, 3))
    floors[:, 2] = np.round(5 * floors[:, 2]) / 5
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    for turned in (floors, floors @ turn.T):
        assert 44 * 0.9 < area_about(turned) < 44 * 1.8  # eleven floors of area 4
    assert seconds_to_extract(None, points, 256, Run()) == 0  # nothing is measured without a time limit


def test_a_surface_that_takes_too_long_leaves_half_of_the_time_for_training():
    """A machine that is busy for a moment must not take nearly all the time from the training."""

    class Slow:
        def values(self, points):
            time.sleep(0.05)

    points = np.random.default_rng(0).normal(size=(10_000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    assert seconds_to_extract(Slow(), points, 512, Run(seconds=100.0)) > 100
    assert 49 < reserve(Slow(), points, 512, Run(seconds=100.0)) <= 50
    assert 2 < reserve(Slow(), points, 64, Run(seconds=100.0)) < 20


def test_the_time_is_measured_where_a_field_is_slowest():
    """Before its training IDF displaces points near a sphere of half the radius, and none elsewhere."""

    class Two:
        def values(self, points):
            time.sleep(0.05 if (np.linalg.norm(points, axis=1) < 0.6).all() else 0.001)

    points = np.random.default_rng(0).normal(size=(10_000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    assert seconds_to_extract(Two(), points, 512, Run(seconds=100.0)) > 100


def test_a_file_that_cannot_be_written_is_refused_before_the_training(tmp_path):
    for path in (tmp_path / "missing" / "field.safetensors", tmp_path):
        run = Run()
        with pytest.raises(BadInput, match=r"method.save=.*(no folder|cannot be written)"):
            Siren(steps=10**6, save=str(path), **SMALL).reconstruct(ball(), run)


def test_a_training_never_makes_a_loaded_field_worse(tmp_path):
    """On the batch by which states are compared; with a far too large learning rate the field does not change."""
    path = str(tmp_path / "field.safetensors")
    fitted, _ = Siren(steps=100, save=path, **SMALL).fit_to(ball(), Run(seed=1))
    run = Run(seed=2)
    spoilt, _ = Siren(steps=5, load=path, **SMALL | {"learning_rate": 1.0}).fit_to(ball(), run)
    assert run.notes == [f"5 further steps did not improve the field of {path}; it is unchanged"]
    for name, tensor in fitted.state_dict().items():
        assert torch.equal(tensor, spoilt.state_dict()[name])


def test_a_loaded_field_can_be_trained_for_a_time(tmp_path):
    path = str(tmp_path / "field.safetensors")
    Siren(steps=1, save=path, **SMALL).fit_to(ball(), Run(seed=1))
    said = []
    run = Run(on_progress=lambda done, total: said.append(done))
    Siren(steps=0, seconds=0.5, load=path, **SMALL).fit_to(ball(), run)
    assert len(said) >= 2


def test_a_field_loaded_for_other_points_is_reported(tmp_path):
    """A field is in the frame of its points: for a cropped cloud the surface would be moved and scaled."""
    path = str(tmp_path / "field.safetensors")
    cloud = ball()
    method = Siren(steps=50, save=path, **SMALL)
    method.fit_to(cloud, Run(seed=1))
    asked = Siren(steps=0, load=path, **SMALL)
    half = cloud.points[:, 0] > 5
    cropped = PointCloud(cloud.points[half], cloud.normals[half])
    for points, notes in ((cloud, 0), (PointCloud(7 * cloud.points[::-1], cloud.normals[::-1]), 0), (cropped, 1)):
        run = Run()
        asked.fit_to(points, run)
        assert len(run.notes) == notes
    assert "was fitted to other points: their boxes differ by" in run.notes[0]


def test_a_training_that_the_time_limit_cuts_short_is_reported():
    """For a number of steps, for a number of seconds, and for hardly any time."""
    run = Run(seed=1, seconds=2.0)
    Siren(steps=10**6, **SMALL).reconstruct(ball(), run)
    assert re.fullmatch(r"trained for [\d,]+ of 1,000,000 steps: limit.seconds=2 is too short", run.notes[0])
    run = Run(seed=1, seconds=2.0)
    Siren(seconds=60.0, **SMALL).reconstruct(ball(), run)
    assert re.fullmatch(r"trained for [\d.]+ of 60 s: limit.seconds=2 is too short", run.notes[0])
    run = Run(seed=1)
    Siren(seconds=0.01, **SMALL).reconstruct(ball(), run)
    assert re.fullmatch(r"trained for only \d steps, in 0.01 s", run.notes[0])
    run = Run(seed=1, seconds=100.0)
    Siren(steps=5, **SMALL).reconstruct(ball(), run)
    assert not run.notes


def test_of_very_many_points_without_normals_a_subset_is_used(monkeypatch):
    monkeypatch.setattr("bench.methods.learned.fitting.fitted.MOST_ESTIMATED", 1000)
    run = Run(seed=1)
    mesh = Siren(steps=30, **SMALL).reconstruct(PointCloud(ball().points), run)
    assert run.notes == ["normals were estimated for 1,000 of the 4,000 points; only these are used"]
    assert np.abs(np.linalg.norm(mesh.vertices - [5, 0, 0], axis=1) - 1).mean() < 0.2
    run = Run(seed=1)
    Siren(steps=1, **SMALL).reconstruct(ball(), run)
    assert not run.notes


def test_an_initial_sphere_is_fitted_once_outside_the_measured_time(tmp_path, monkeypatch):
    """By ``prepare``, which the engine calls before the measured call; cached on disk and in the process."""
    from bench.methods.learned.networks import sphere

    made = []
    weights = {name: tensor.half() for name, tensor in SineNetwork(7, hidden_layers=1, width=8).state_dict().items()}
    monkeypatch.setattr(sphere, "make", lambda *form: made.append(form) or weights)
    monkeypatch.setattr(sphere, "_of_this_process", {})
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    method = Siren(omega=7.0, hidden_layers=1, width=8, sphere=0.4)
    method.prepare()
    method.prepare()
    assert made == [(7.0, 1, 8, 0.4)]
    assert torch.equal(method.field(draw()).network.weights[0], weights["weights.0"].float())
    sphere._of_this_process.clear()
    method.prepare()
    next(tmp_path.rglob("*.safetensors")).write_bytes(b"damaged")
    assert len(made) == 1
    sphere._of_this_process.clear()
    method.prepare()
    assert len(made) == 2
    Siren(sphere=0.0).prepare()
    Siren(load="field.safetensors").prepare()
    assert len(made) == 2


def test_a_surface_without_enough_time_is_coarser_and_reported():
    """With the time limit already reached: the base level of 32 cells, and a note for the row."""
    run = Run(seconds=0.0)
    mesh = Siren(steps=1, **SMALL | {"resolution": 129}).reconstruct(ball(), run)
    assert mesh.metadata["coarser"] == 4
    assert run.notes == ["the surface has 1/4 of the requested resolution: limit.seconds=0 is too short"]
    run = Run()
    Siren(steps=1, **SMALL).reconstruct(ball(), run)
    assert not run.notes


def test_a_short_limit_still_gives_a_surface():
    """A run of a few seconds stops in time with its current result."""
    run = Run(seed=1, seconds=10.0)
    mesh = Siren(steps=10**6, **SMALL).reconstruct(ball(), run)
    assert run.elapsed() < 10
    distance = np.linalg.norm(mesh.vertices - [5, 0, 0], axis=1) - 1
    assert np.abs(distance).mean() < 0.3  # initially a sphere of half the radius


def test_intermediate_results_are_meshes_that_improve():
    """Traces come in order; the mean distance falls."""
    traced = []
    run = Run(seed=1, on_trace=lambda output, seconds: traced.append((seconds, output())))
    Siren(steps=60, traces=3, **SMALL | {"resolution": 16}).reconstruct(ball(), run)
    errors = [np.abs(np.linalg.norm(mesh.vertices - [5, 0, 0], axis=1) - 1).mean() for _, mesh in traced]
    assert len(errors) == 3 and errors[-1] < errors[0]


@pytest.mark.parametrize(
    ("change", "message"),
    [({"steps": 0}, "steps"), ({"alpha": 0.0}, "alpha"), ({"resolution": 8}, "resolution"), ({"batch": 0}, "batch")],
)
def test_wrong_parameters_are_refused(change, message):
    """By their names."""
    with pytest.raises(ValueError, match=message):
        Idf(**change)


def test_too_few_points_are_refused():
    """With the name of the method."""
    with pytest.raises(BadInput, match="idf"):
        Idf().reconstruct(PointCloud(np.eye(3), np.eye(3)), Run())
