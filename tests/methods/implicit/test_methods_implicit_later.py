"""Methods from after the thesis: the hash grid, HotSpot, Shape as Points."""

from __future__ import annotations

import itertools
import math
import time
from dataclasses import replace

import numpy as np
import pytest
import torch

from bench import BadInput, InvalidOutput, PointCloud, Run
from bench.geometry.mesh_surface import MeshSurface
from bench.methods.implicit.d_sdf import DSdf
from bench.methods.implicit.direct_residual import DirectResidual
from bench.methods.implicit.fields.heat_field import HeatField, heat
from bench.methods.implicit.fourier import Fourier
from bench.methods.implicit.hash_sdf import HashSdf
from bench.methods.implicit.hotspot import Hotspot
from bench.methods.implicit.idf import Idf
from bench.methods.implicit.idf_transfer import IdfTransfer
from bench.methods.implicit.losses.guidance import GuidedSampler, guided_loss
from bench.methods.implicit.losses.oriented import OrientedLoss
from bench.methods.implicit.sap import Sap
from bench.methods.implicit.siren import Siren
from bench.methods.implicit.spectral.lattice_surface import pull, vertices
from bench.methods.implicit.spectral.spectral_poisson import (
    SIDE,
    evenly,
    from_lattice,
    indicator,
    interpolate,
    solve,
    spread,
    to_lattice,
)
from bench.methods.learned.losses.chamfer import ChamferLoss
from bench.methods.learned.networks.hash_grid import PRIMES, HashGrid
from bench.methods.learned.networks.sine_network import SineNetwork
from bench.methods.learned.training.batches import Batch, Sampler
from bench.plugins.registry import snake_case

RADIUS, CENTER = 0.7, np.array([3.0, -1.0, 2.0])


def draw(seed: int = 0) -> torch.Generator:
    """A torch generator."""
    return torch.Generator().manual_seed(seed)


def directions(count: int, seed: int = 0) -> np.ndarray:
    """Unit vectors, uniform."""
    n = np.random.default_rng(seed).standard_normal((count, 3))
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def ball(count: int = 2000, normals: bool = True) -> PointCloud:
    """Points of a sphere that is not at the origin and not of radius 1."""
    n = directions(count)
    return PointCloud(CENTER + RADIUS * n, n if normals else None)


def deviation(mesh) -> float:
    """The mean distance of a mesh to the sphere, relative to the radius; the mesh must be closed and outward."""
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=0.05)
    points, _ = MeshSurface(mesh).sample(2000, np.random.default_rng(0))
    return float(np.abs(np.linalg.norm(points - CENTER, axis=1) - RADIUS).mean() / RADIUS)


def same(a, b) -> bool:
    """Whether two meshes are equal bit for bit."""
    return np.array_equal(a.vertices, b.vertices) and np.array_equal(a.faces, b.faces)


# -- the hash grid -----------------------------------------------------------------------------------------------------


def small_grid(levels: int = 4, table: int = 128) -> HashGrid:
    """Two dense levels (27 and 125 nodes) and two hashed ones, in double precision, with features of size 1."""
    grid = HashGrid(levels, table, 2, 16, generator=draw()).double()
    with torch.no_grad():
        grid.table.normal_(generator=draw(1))
    return grid


def inside(count: int, seed: int = 0) -> torch.Tensor:
    """Points of the box."""
    return torch.rand(count, 3, generator=draw(seed), dtype=torch.double) * 2 - 1


def row_of(grid: HashGrid, level: int, node: tuple[int, int, int]) -> int:
    """The row of a node, from the definition."""
    first, n, rows = sum(grid.rows[:level]), grid.cells[level] + 1, grid.rows[level]
    x, y, z = node
    if rows == n**3:
        return first + x + n * y + n * n * z
    return first + ((x * PRIMES[0]) ^ (y * PRIMES[1]) ^ (z * PRIMES[2])) % rows


def test_levels_are_dense_where_they_fit():
    """Geometric growth; in a dense level no two nodes share a row; in a hashed one every row is used."""
    grid = small_grid()
    assert grid.cells == [2, 4, 8, 16]
    assert grid.rows == [27, 125, 128, 128]
    lattice = torch.tensor(list(itertools.product(range(17), repeat=3)), dtype=torch.double) / 8 - 1
    found = grid._locate(lattice)[0]
    for level, count in enumerate(grid.rows):
        rows = found[..., level, :].unique()
        first = sum(grid.rows[:level])
        assert rows.tolist() == list(range(first, first + count))
    assert HashGrid(12, 2**15, 8, 256).cells[::11] == [8, 256]


def test_interpolation_matches_a_loop_over_the_corners():
    """Value at points, against nested loops."""
    grid, x = small_grid(), inside(20)
    expected = torch.zeros(2, 4, len(x), dtype=torch.double)
    for level, (k, point) in itertools.product(range(4), enumerate(x.tolist())):
        place = [(c + 1) / 2 * grid.cells[level] for c in point]
        for corner in itertools.product((0, 1), repeat=3):
            node = tuple(int(c) + up for c, up in zip(place, corner, strict=True))
            weight = math.prod(c - int(c) if up else 1 - c + int(c) for c, up in zip(place, corner, strict=True))
            expected[:, level, k] += weight * grid.table[:, row_of(grid, level, node)].detach()
    torch.testing.assert_close(grid(x), expected.flatten(0, 1))
    torch.testing.assert_close(grid.with_derivatives(x)[0], expected.flatten(0, 1))
    torch.testing.assert_close(grid(x * 10), grid((x * 10).clamp(-1, 1)))  # outside: as at the nearest point


def test_derivatives_match_the_interpolation():
    """By x against differences; by the table against the interpolation, which is linear in it."""
    grid, x = small_grid(), inside(50)
    values, slopes = grid.with_derivatives(x)
    for axis, step in enumerate(1e-6 * torch.eye(3, dtype=torch.double)):
        torch.testing.assert_close(slopes[axis], (grid(x + step) - grid(x - step)) / 2e-6, rtol=1e-5, atol=1e-6)
    of_values, of_slopes = torch.randn_like(values), torch.randn_like(slopes)

    def number() -> torch.Tensor:
        values, slopes = grid.with_derivatives(x)
        return (values * of_values).sum() + (slopes * of_slopes).sum()

    number().backward()
    direction = torch.randn_like(grid.table)
    with torch.no_grad():
        before = number()
        grid.table += direction
        change = number() - before
    torch.testing.assert_close((grid.table.grad * direction).sum(), change)


@pytest.mark.parametrize("layers", [1, 2])
def test_hash_field_gradient(layers):
    """Value and gradient against differences; their derivatives by all parameters against differences."""
    method = HashSdf(levels=3, coarsest=2, finest=8, log2_table=7, width=8, hidden_layers=layers)
    field = method.field(draw()).double()
    with torch.no_grad():
        field.grid.table.normal_(generator=draw(1))
    x = inside(30)
    f, gradient = field.value_and_gradient(x)
    with torch.no_grad():
        torch.testing.assert_close(f.detach(), field(x))
        for axis, step in enumerate(1e-6 * torch.eye(3, dtype=torch.double)):
            expected = (field(x + step) - field(x - step)) / 2e-6
            torch.testing.assert_close(gradient[:, axis].detach(), expected, rtol=1e-5, atol=1e-6)

    def number() -> torch.Tensor:
        f, gradient = field.value_and_gradient(x)
        return f.square().sum() + (gradient.norm(dim=1) - 1).square().sum()

    number().backward()
    for parameter in field.parameters():
        direction = torch.randn(parameter.shape, generator=draw(2), dtype=torch.double)
        with torch.no_grad():
            parameter += 1e-6 * direction
            change = number()
            parameter -= 2e-6 * direction
            change = (change - number()) / 2e-6
            parameter += 1e-6 * direction
        torch.testing.assert_close((parameter.grad * direction).sum(), change, rtol=1e-4, atol=1e-6)


def test_hash_parameters_are_counted():
    """Rows times features, and the layers of the network."""
    method = HashSdf(levels=5, coarsest=4, finest=64, log2_table=10, features=2, width=16, hidden_layers=2)
    cells = [4, 8, 16, 32, 64]
    rows = sum(min((n + 1) ** 3, 1024) for n in cells)
    assert method.field(draw()).count() == 2 * rows + (10 * 16 + 16) + (16 * 16 + 16) + (16 + 1)
    assert HashSdf().field(draw()).count() == 540_029


def test_hash_begins_as_a_sphere():
    """Of the requested radius, positive outside, with outward gradients."""
    field = HashSdf(sphere=0.4).field(draw())
    n = torch.as_tensor(directions(100), dtype=torch.float32)
    f, gradient = field.value_and_gradient(0.4 * n)
    assert f.abs().max() < 1e-3
    assert torch.cosine_similarity(gradient, n).min() > 0.99
    assert field(0.9 * n).min() > 0.4
    assert field(0.1 * n).max() < -0.2


def test_guesses_of_distances_have_the_right_sign():
    """For a sphere whose points are four times as dense on one side: the distance, or unknown near the surface."""
    n = directions(8000)
    n = n[(n[:, 2] > 0) | (np.arange(len(n)) % 4 == 0)]
    guided = GuidedSampler(0.6 * n, n, 64, draw())
    space = torch.rand(4000, 3, generator=draw()) * 2 - 1
    guesses, truth = guided.guess(space), space.norm(dim=1) - 0.6
    known = ~guesses.isnan()
    assert known.float().mean() > 0.9
    assert known[truth.abs() > 0.1].all()
    assert (guesses - truth)[known].abs().max() < 0.05
    batch = guided.draw()
    torch.testing.assert_close(batch.distances[64:], guided.guess(batch.x[64:]), equal_nan=True)
    assert not torch.equal(batch.x[64:], guided.draw().x[64:])
    assert batch.on == 64
    assert len(batch.x) == len(batch.distances) == batch.total == 128
    assert (batch.distances[:64] == 0).all()


def test_guidance_corrects_the_sign_in_space_and_ignores_unknown_points():
    """With a wrong sign in space, Eq. 4.4 drives f further from zero on the wrong side; guesses correct it."""
    f = torch.tensor([0.0, -0.01, -0.01, 0.01], requires_grad=True)  # one point on the surface, three in space
    gradient, normals = torch.tensor([[0.0, 0.0, 1.0]]).expand(4, 3), torch.tensor([[0.0, 0.0, 1.0]])
    batch = Batch(torch.zeros(4, 3), 1, normals, torch.tensor([0.0, 0.5, torch.nan, -0.5]), 4)
    loss = OrientedLoss()
    (plain,) = torch.autograd.grad(guided_loss(loss, f, gradient, batch, False), f)
    assert plain[1:3].min() > 0 > plain[3]  # a step goes against the gradient: away from zero
    (guided,) = torch.autograd.grad(guided_loss(loss, f, gradient, batch, True), f)
    assert guided[1] < 0 < guided[3]
    assert guided[2] == 0


@pytest.mark.parametrize("method", [Siren, Idf, Fourier, HashSdf])
def test_guidance_ends_at_its_share_of_the_training(method):
    n = directions(400)
    field = method(guided=0.3).field(draw())
    batch = GuidedSampler(0.6 * n, n, 64, draw()).draw()
    plain = replace(batch, distances=None)
    with torch.no_grad():
        assert field.loss(batch, 0.29) != field.loss(plain, 0.29)
        assert field.loss(batch, 0.3) == field.loss(plain, 0.3)


def test_a_saved_hash_field_stores_its_sphere(tmp_path):
    path = str(tmp_path / "ball.safetensors")
    saved = quick_hash(steps=1, sphere=0.4, resolution=16, save=path)
    saved.reconstruct(ball(), Run(seed=1))
    with pytest.raises(BadInput, match=r"sphere is now 0.5; use method.sphere=0.4"):
        quick_hash(steps=0, resolution=16, load=path).reconstruct(ball(), Run(seed=1))


def quick_hash(**changes) -> HashSdf:
    """A small field, for tests."""
    settings = {
        "steps": 120,
        "batch": 256,
        "levels": 4,
        "coarsest": 4,
        "finest": 24,
        "log2_table": 12,
        "resolution": 32,
    }
    return HashSdf(**settings | changes)


def test_hash_fits_a_sphere_repeatably():
    """To half a per cent of the radius, and bit for bit."""
    assert deviation(quick_hash().reconstruct(ball(), Run(seed=1))) < 0.005
    assert same(*(quick_hash(steps=10).reconstruct(ball(), Run(seed=1)) for _ in range(2)))


# -- HotSpot -----------------------------------------------------------------------------------------------------------


def test_heat_is_the_energy_of_the_screened_poisson_equation():
    """(|grad h|^2 + lambda^2 h^2) / (2 lambda^2) for h = exp(-lambda |f|), by automatic differentiation."""
    network = SineNetwork(5.0, hidden_layers=1, width=16, generator=draw(), mixed=False).double()
    x = inside(40).requires_grad_()
    h = torch.exp(-7 * network(x).abs())
    (slope,) = torch.autograd.grad(h.sum(), x)
    expected = (slope.square().sum(1) + 49 * h.square()) / (2 * 49)
    torch.testing.assert_close(heat(*network.value_and_gradient(x), 7.0), expected)


def test_hotspot_loss_matches_its_formula():
    """Four terms over all points of the step; the absorption grows by equal factors; chunks add up."""
    network = SineNetwork(5.0, hidden_layers=1, width=16, generator=draw())
    field = HeatField(network, surface=3.0, eikonal=0.5, heat=2.0, absorption=(4.0, 36.0))
    assert [field.absorption(t) for t in (0, 0.5, 1)] == pytest.approx([4, 12, 36])
    n = directions(200)
    batch = Sampler(0.5 * n, n, 50, draw()).draw()
    f, gradient = network.value_and_gradient(batch.x)
    length = gradient.norm(dim=1)
    warm = torch.exp(-24 * f[50:].abs()) * (length[50:] ** 2 + 1) / 2
    beyond = f[50:][batch.x[50:].norm(dim=1) > 1]
    assert (beyond < 0).any()
    expected = (
        3 * (f[:50].abs().sum() - beyond[beyond < 0].sum()) + 0.5 * (length - 1).abs().sum() + 2 * warm.sum()
    ) / 100
    torch.testing.assert_close(field.loss(batch, 0.5), expected)
    torch.testing.assert_close(sum(field.loss(part, 0.5) for part in batch.chunks(30)), expected)


def quick_hotspot(**changes) -> Hotspot:
    """A small field, for tests, whose initial sphere is shipped."""
    settings = {"steps": 120, "batch": 256, "width": 96, "omega": 5.0, "learning_rate": 5e-4, "resolution": 32}
    return Hotspot(**settings | changes)


def test_hotspot_fits_a_sphere_without_normals():
    """To one per cent of the radius; normals, even wrong ones, change nothing; outside is positive."""
    assert deviation(quick_hotspot().reconstruct(ball(normals=False), Run(seed=1))) < 0.01
    cloud, short = ball(), quick_hotspot(steps=10)
    wrong = PointCloud(cloud.points, -cloud.normals)
    assert same(*(short.reconstruct(given, Run(seed=1)) for given in (ball(normals=False), wrong)))


# -- Shape as Points ---------------------------------------------------------------------------------------------------


def test_poisson_of_a_known_function():
    """The solution for the gradient of a sum of waves is that sum, or its smoothed form."""
    r = 16
    u = torch.arange(r, dtype=torch.double) / r * 2 * math.pi
    x, y, z = torch.meshgrid(u, u, u, indexing="ij")
    f = torch.cos(x + 2 * y) + 0.3 * torch.sin(3 * z - x)
    by_x = -torch.sin(x + 2 * y) - 0.3 * torch.cos(3 * z - x)
    by_y = -2 * torch.sin(x + 2 * y)
    by_z = 0.9 * torch.cos(3 * z - x)
    v = 2 * math.pi * torch.stack([by_x, by_y, by_z])
    torch.testing.assert_close(solve(v, 0.0), f)
    smoothed = [math.exp(-2 * (1.5 / r) ** 2 * k) for k in (5, 10)]
    expected = smoothed[0] * torch.cos(x + 2 * y) + smoothed[1] * 0.3 * torch.sin(3 * z - x)
    torch.testing.assert_close(solve(v, 1.5), expected)


def test_spreading_is_the_transpose_of_interpolation():
    """<spread(v), c> = <v, interpolate(c)>; linear functions are interpolated exactly; sums are preserved."""
    places = torch.rand(50, 3, generator=draw(), dtype=torch.double) * 7
    values = torch.randn(50, 2, generator=draw(), dtype=torch.double)
    lattice = torch.randn(8, 8, 8, generator=draw(), dtype=torch.double)
    shared = spread(places, values, 8)
    for channel in range(2):
        expected = (values[:, channel] * interpolate(lattice, places)).sum()
        torch.testing.assert_close((shared[channel] * lattice).sum(), expected)
    torch.testing.assert_close(shared.sum((1, 2, 3)), values.sum(0))
    i, j, k = torch.meshgrid(*[torch.arange(8, dtype=torch.double)] * 3, indexing="ij")
    torch.testing.assert_close(interpolate(i + 2 * j - k, places), places @ places.new_tensor([1, 2, -1]))


@pytest.mark.parametrize("uneven", [False, True])
def test_indicator_of_a_sphere(uneven):
    """1/2 outside and -1/2 inside, to a few hundredths, farther than three cells from the surface."""
    n = directions(30_000)
    if uneven:
        n = n[(n[:, 0] > 0) | (np.arange(len(n)) % 4 == 0)]
    n = torch.as_tensor(n, dtype=torch.float32)
    points = 0.5 * n + 0.1
    chi = indicator(points, n * evenly(points)[:, None], 48, sigma=2.0)
    axis = from_lattice(torch.arange(48), 48)
    torch.testing.assert_close(to_lattice(axis, 48), torch.arange(48.0))
    x = torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij"), -1)
    distance = (x - 0.1).norm(dim=-1) - 0.5
    far = distance.abs() > 3 * SIDE / 48
    error = (chi - distance.sign() / 2)[far].abs()
    assert error.mean() < 0.02
    assert error.quantile(0.99) < 0.1


def test_vertices_follow_the_surface():
    """For f = |x - c| - r: on the sphere; a change of chi moves them as the implicit function theorem states."""
    r = 24
    axis = torch.arange(r, dtype=torch.double)
    x = torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij"), -1) - 11.3
    chi = (x.norm(dim=-1) - 7).requires_grad_()
    places, gradient, values = vertices(chi)
    p = places - 11.3
    assert (p.norm(dim=1) - 7).abs().max() < 0.02
    assert torch.cosine_similarity(gradient, p).min() > 0.99
    assert values.abs().max() < 1e-9
    # The mean of |p|^2 over the vertices falls by 2 |p| per unit added to chi, because the radius falls.
    pull(values, gradient, 2 * p / len(p)).backward()
    assert float(chi.grad.sum()) == pytest.approx(-2 * 7, rel=0.01)


def test_chamfer_loss_and_its_derivative():
    """Against all pairs, and against differences."""
    rng = np.random.default_rng(0)
    target, v = rng.standard_normal((40, 3)), torch.as_tensor(rng.standard_normal((30, 3)))
    loss = ChamferLoss(target, 100, rng)
    value, derivative = loss(v)
    pairs = np.linalg.norm(v.numpy()[:, None] - target, axis=2) ** 2
    assert value == pytest.approx(pairs.min(1).mean() + pairs.min(0).mean())
    direction = torch.as_tensor(rng.standard_normal((30, 3)))
    change = (loss(v + 1e-6 * direction)[0] - loss(v - 1e-6 * direction)[0]) / 2e-6
    assert float((derivative * direction).sum()) == pytest.approx(change, rel=1e-4)


@pytest.mark.parametrize("normals", [True, False])
def test_one_poisson_reconstruction(normals):
    """Without steps: the surface for given or estimated normals."""
    mesh = Sap(steps=0, resolution=48).reconstruct(ball(normals=normals), Run())
    assert deviation(mesh) < 0.01


def test_sap_improves_its_initial_surface():
    """From the input with wrong normals, bit for bit; and from a sphere of another size, coarse to fine."""
    cloud = ball(3000)
    bent = cloud.normals + 0.7 * directions(3000, 1)
    bent = PointCloud(cloud.points, bent / np.linalg.norm(bent, axis=1, keepdims=True))
    settings = {"resolution": 32, "learning_rate": 2e-3}
    before = Sap(steps=0, **settings).reconstruct(bent, Run(seed=1))
    after = Sap(steps=15, **settings).reconstruct(bent, Run(seed=1))
    assert deviation(after) < 0.8 * deviation(before)
    assert same(after, Sap(steps=15, **settings).reconstruct(bent, Run(seed=1)))
    grown = Sap(steps=40, begin="sphere", points=2000, coarsest=16, resolution=32, learning_rate=1e-2)
    assert grown.levels(32) == [16, 32]
    assert Sap(begin="sphere").levels(256) == [32, 64, 128, 256]
    assert Sap(begin="sphere").levels(24) == [24]
    assert deviation(grown.reconstruct(ball(3000), Run(seed=1))) < 0.02


def test_sap_is_the_same_on_two_threads():
    """With so many points that the gradient of indexing by ``[...]`` would be summed in any order."""
    torch.set_num_threads(2)
    try:
        method = Sap(steps=3, resolution=96)
        assert same(*(method.reconstruct(ball(6000), Run(seed=1, threads=2)) for _ in range(2)))
    finally:
        torch.set_num_threads(1)


def test_sap_keeps_the_best_when_the_surface_is_lost(monkeypatch):
    """With a far too large learning rate the previous surface is returned, and a note says why."""
    from bench.methods.implicit.spectral import lattice_surface

    def vertices(chi, real=lattice_surface.vertices, calls=[]):  # noqa: B006
        calls.append(1)
        if len(calls) > 3:
            raise InvalidOutput("the indicator has no zero crossing any more")
        return real(chi)

    monkeypatch.setattr(lattice_surface, "vertices", vertices)
    run = Run(seed=1)
    assert deviation(Sap(steps=20, resolution=48).reconstruct(ball(), run)) < 0.05
    assert run.notes == [
        "stopped after 3 steps, with the best surface so far: the indicator has no zero crossing any more"
    ]


def test_sap_traces_results_and_stops_in_time():
    """Traces in the coordinates of the input; a limit ends the optimisation."""
    seen = []
    run = Run(seed=1, on_trace=lambda mesh, seconds: seen.append(mesh()))
    Sap(steps=6, resolution=24, traces=2).reconstruct(ball(500), run)
    assert len(seen) == 2
    assert all(deviation(mesh) < 0.05 for mesh in seen)
    mesh = Sap(steps=10**6, resolution=24, seconds=0.5).reconstruct(ball(500), Run(seed=1))
    assert deviation(mesh) < 0.05


def test_sap_uses_a_coarser_lattice_where_time_is_short_and_limits_its_points(monkeypatch):
    run = Run(seed=1, seconds=60.0)
    run._started = time.perf_counter() - 56.0  # four seconds remain
    assert deviation(Sap(steps=1).reconstruct(ball(), run)) < 0.05
    assert run.notes == ["the lattice has 128 nodes along an axis: limit.seconds=60 is too short"]
    monkeypatch.setattr("bench.methods.implicit.sap.MOST", 500)
    run = Run(seed=1)
    assert deviation(Sap(steps=2, resolution=48).reconstruct(ball(3000), run)) < 0.05
    assert run.parameters == 6 * 500 and not run.notes


def test_an_open_scan_gets_no_additional_walls():
    """A periodic indicator changes sign at a sheet, and again at the boundary of the lattice."""
    rng = np.random.default_rng(0)
    xy = rng.uniform(-1, 1, (5000, 2))
    sheet = PointCloud(np.column_stack([xy, 0.1 * np.sin(3 * xy[:, 0])]), np.tile([0.0, 0.0, 1.0], (5000, 1)))
    mesh = Sap(steps=0, resolution=64).reconstruct(sheet, Run())
    assert np.abs(mesh.vertices[:, 2]).max() < 0.3
    assert mesh.area < 2 * 2.1**2 * 1.1
    points, normals = (torch.tensor(part, dtype=torch.float32) for part in (sheet.points / 1.5, sheet.normals))
    assert (
        indicator(points, normals, 64, 2.0).abs().max() < 10
    )  # hundreds of times as large in units of the value at a corner, which is almost 0


# -- errors ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: HashSdf(levels=0), "levels: expected at least 1, got 0"),
        (lambda: HashSdf(coarsest=64, finest=32), r"finest: expected 64 \(coarsest\)"),
        (lambda: HashSdf(log2_table=30), "log2_table: expected 4 to 24"),
        (lambda: HashSdf(guided=2.0), "guided: expected 0 to 1"),
        (lambda: HashGrid(2, 100, 2, 4), "table: expected a power of two, got 100"),
        (lambda: Hotspot(absorption=0.0), "absorption: expected more than 0"),
        (lambda: Hotspot(heat=-1.0), "heat: expected at least 0"),
        (lambda: Siren(omega=0.0), "omega: expected more than 0, got 0"),
        (lambda: Siren(width=0), "width: expected at least 1, got 0"),
        (lambda: Idf(hidden_layers=0), "hidden_layers: expected at least 1, got 0"),
        (lambda: DirectResidual(sphere=-1.0), "sphere: expected at least 0"),
        (lambda: Siren(surface=-400.0), "surface: expected at least 0, got -400"),
        (lambda: DSdf(normal=float("nan")), "normal: expected at least 0, got nan"),
        (lambda: IdfTransfer(space=-1.0), "space: expected at least 0"),
        (lambda: Fourier(sphere=-0.6), "sphere: expected at least 0"),
        (lambda: IdfTransfer(base_loss=(1.0, 2.0)), "base_loss: expected four weights"),
        (lambda: IdfTransfer(betas=(0.9, 1.0)), "betas: expected two numbers"),
        (lambda: DSdf(redraw=-1), "redraw: expected at least 0"),
        (lambda: Sap(resolution=8), "resolution: expected 16 to 512"),
        (lambda: Sap(resolution=16, begin="sphere"), r"coarsest: expected 8 to 16 \(resolution\), got 32"),
        (lambda: Sap(steps=0, begin="sphere"), "steps: expected at least 0"),
        (lambda: Sap(begin="cube"), "begin: expected normals or sphere, got 'cube'"),
    ],
)
def test_wrong_parameters_are_refused(make, message):
    """By their names, with the expected values."""
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("method", [HashSdf(), Hotspot(), Sap()], ids=lambda method: type(method).__name__)
def test_degenerate_input_is_refused(method):
    """Too few points, coincident points, and NaN."""
    name = snake_case(type(method).__name__)
    for points in (np.zeros((3, 3)), np.repeat(directions(3), 20, axis=0), np.full((50, 3), np.nan)):
        with pytest.raises(BadInput, match=name):
            method.reconstruct(PointCloud(points, np.ones_like(points)), Run())
