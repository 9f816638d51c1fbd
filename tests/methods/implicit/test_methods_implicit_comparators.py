"""The learned comparators of chapter 4.1: Fourier features, direct residual, D-SDF and NGLOD."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import torch
from torch.nn import functional as F

from bench import PointCloud, Run, UsageError
from bench.methods.implicit.d_sdf import DSdf
from bench.methods.implicit.direct_residual import DirectResidual
from bench.methods.implicit.fields.displaced_field import attenuation
from bench.methods.implicit.fields.nglod_field import NglodField
from bench.methods.implicit.fields.warped_field import ReluNetwork, WarpedField
from bench.methods.implicit.fourier import Fourier
from bench.methods.implicit.losses.oriented import OrientedLoss
from bench.methods.implicit.nglod import Nglod
from bench.methods.learned.networks.feature_grid import FeatureGrid
from bench.methods.learned.networks.fourier_network import FourierNetwork, window
from bench.methods.learned.training.batches import Batch
from bench.methods.learned.training.settings import Training

SUPERVISED = (DirectResidual, DSdf, Nglod)
CENTER, RADIUS = np.array([3.0, -1.0, 0.5]), 2.5  # of the fitted sphere: the frame differs from that of the input


def draw(seed: int = 0) -> torch.Generator:
    """A torch generator."""
    return torch.Generator().manual_seed(seed)


def points(count: int, seed: int = 0) -> torch.Tensor:
    """Points of the box, in double precision."""
    return torch.rand(count, 3, generator=draw(seed), dtype=torch.double) * 2 - 1


def loss_of(f: torch.Tensor, g: torch.Tensor) -> torch.Tensor:
    """A number that depends on every value and every gradient."""
    weights = torch.arange(1, len(f) + 1, dtype=f.dtype)
    return (f.sin() * weights).mean() + ((g.norm(dim=1) - 1).square() * weights).mean()


def assert_same_derivatives(mine, theirs, wanted) -> None:
    """Compares value, gradient, and the derivatives of a loss over both by ``wanted``."""
    for ours, auto in zip(mine, theirs, strict=True):
        torch.testing.assert_close(ours, auto)
    grads = {"allow_unused": True, "retain_graph": True}
    found, expected = (torch.autograd.grad(loss_of(*pair), wanted, **grads) for pair in (mine, theirs))
    for ours, auto in zip(found, expected, strict=True):
        assert (ours is None) == (auto is None)
        if ours is not None:
            torch.testing.assert_close(ours.to_dense(), auto.to_dense())


def by_autograd(function, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Value and gradient of a function by automatic differentiation."""
    x = x if x.requires_grad else x.clone().requires_grad_()
    f = function(x)
    return f, torch.autograd.grad(f.sum(), x, create_graph=True)[0]


def sphere(count: int = 400, seed: int = 0) -> PointCloud:
    """Oriented points of a sphere away from the origin."""
    normals = np.random.default_rng(seed).normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return PointCloud(CENTER + RADIUS * normals, normals)


def sphere_distances(x: np.ndarray) -> np.ndarray:
    """Its true distances, in the coordinates of the input."""
    return np.linalg.norm(x - CENTER, axis=1) - RADIUS


def with_truth(seed: int = 0) -> Run:
    """A run that knows the true distances to the sphere."""
    return Run(seed=seed, on_distances=sphere_distances)


TINY = {  # settings of each method that fit a sphere in a second
    Fourier: {"bands": 2, "progressive": 0.4, "hidden_layers": 3, "width": 48, "learning_rate": 2e-3, "steps": 120},
    DirectResidual: {"hidden_layers": 1, "width": 32, "omega_detail": 20.0, "sphere": 0, "steps": 200},
    DSdf: {"bands": 3, "layers": 4, "width": 48, "learning_rate": 3e-3, "steps": 150},
    Nglod: {"levels": 2, "base": 2, "learning_rate": 1e-2, "steps": 150},
}
TINY[DirectResidual]["learning_rate"] = 1e-3


def tiny(method, **changes):
    """The method with these settings."""
    samples = {} if method is Fourier else {"samples": 4000}
    return method(**{"batch": 128, "resolution": 16, **samples, **TINY[method], **changes})


# -- numbers of parameters ---------------------------------------------------------------------------------------------


def test_parameter_counts_are_those_of_the_references():
    """Counted in the released code; for D-SDF, by the formula of its layers."""
    assert Fourier().field(draw()).count() == 461_006
    assert DirectResidual(sphere=0).field(draw()).count() == 397_314
    assert DSdf().field(draw()).count() == 493_313 + 493_827 == 987_140
    assert Nglod().field(draw()).count() == 1_353_476


@pytest.mark.parametrize(("bands", "width", "outputs"), [(10, 256, 1), (10, 256, 3), (2, 8, 3)])
def test_d_sdf_has_the_layers_of_d_nerf(bands, width, outputs):
    """Eight layers, of which the sixth reads the encoding again, and a linear one: the formula of the docstring."""
    network = ReluNetwork(outputs, bands=bands, width=width, generator=draw())
    e = 3 + 6 * bands
    expected = (e + 1) * width + 7 * (width + 1) * width + e * width + (width + 1) * outputs
    assert sum(p.numel() for p in network.parameters()) == expected
    assert [weight.shape[1] for weight in network.weights] == [e, *[width] * 4, width + e, *[width] * 3]


@pytest.mark.parametrize(
    ("base", "levels", "finest", "dense"),
    [(2, 4, 32, 1_353_476), (2, 5, 64, 10_146_213), (2, 6, 128, 78_844_998), (3, 4, 64, 10_137_476)],
)
def test_nglod_counts(base, levels, finest, dense):
    """Dense: 32 features per vertex and 4,737 parameters per decoder."""
    grid = FeatureGrid(levels, base, width=1, generator=draw())
    assert 32 * grid.table.numel() + 4737 * levels == dense
    assert int(grid.sides[-1]) == finest


def test_active_parameters_of_a_sphere():
    """As documented for the method; fewer points miss a few cells of the finest grid."""
    field = Nglod().field(draw())
    on_sphere = F.normalize(torch.randn(100_000, 3, generator=draw()), dim=1)
    assert 0.95 * 420_036 < field.count_active(on_sphere) <= 420_036
    assert "1,353,476   420,036" in (Nglod.__doc__ or "")


def test_active_vertices_by_a_loop():
    """Corners of the cells that contain a point; a point on the upper boundary belongs to the last cell."""
    field = Nglod(levels=2, base=1).field(draw())
    x = torch.cat([points(6).float(), torch.ones(1, 3)])
    found = set()
    for p in x:
        for side in (2, 4):
            cell = [min(int((c + 1) / 2 * side), side - 1) for c in p.tolist()]
            found |= {(side, *(c + d for c, d in zip(cell, corner, strict=True))) for corner in np.ndindex(2, 2, 2)}
    assert field.grid.active(x) == len(found)
    assert field.count_active(x) == 32 * len(found) + 2 * 4737 < field.count()


# -- Fourier features --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("hidden_layers", [1, 2, 5])
def test_fourier_network_and_its_derivatives_match_the_formula(hidden_layers):
    """Against layers, skip and Softplus from torch's own functions, differentiated twice."""
    network = FourierNetwork(3, hidden_layers=hidden_layers, width=27, generator=draw(), mixed=False).double()
    with torch.no_grad():
        network.window.copy_(torch.tensor([1.0, 0.7, 0.2]))
        for p in network.parameters():
            p += 0.1 * torch.randn(p.shape, generator=draw(), dtype=p.dtype)

    def formula(x):
        bands = list(zip(network.window, (1.0, 2.0, 4.0), strict=True))
        e = h = torch.cat([x, *(w * torch.sin(k * x) for w, k in bands), *(w * torch.cos(k * x) for w, k in bands)], 1)
        for k in range(hidden_layers):
            if k == hidden_layers // 2 > 0:
                h = torch.cat([h, e], 1) / math.sqrt(2)
            h = F.softplus(F.linear(h, network.weights[k], network.biases[k]), beta=100, threshold=1000)
        return F.linear(h, network.weights[-1], network.biases[-1])[:, 0]

    x = points(20).requires_grad_()
    torch.testing.assert_close(network(x), formula(x))
    mine, theirs = network.value_and_gradient(x), by_autograd(formula, x)
    assert_same_derivatives(mine, theirs, [x, *network.parameters()])


def test_bands_open_from_coarse_to_fine():
    """(1 - cos(pi clamp(a - k, 0, 1)))/2 with a = 7 t/0.8: a = 0 at the start, 3.5 half-way, 7 at t = 0.8."""
    assert window(0.0, 8, 0.8) == [0.0] * 8
    assert window(0.4, 8, 0.8) == pytest.approx([1, 1, 1, 0.5, 0, 0, 0, 0])
    assert window(0.8, 8, 0.8) == pytest.approx([1, 1, 1, 1, 1, 1, 1, 0])
    assert window(0.25 * 0.8 / 7, 8, 0.8) == pytest.approx([(1 - math.cos(math.pi / 4)) / 2, *[0] * 7])
    assert window(0.8 * 8 / 7, 8, 0.8) == pytest.approx([1] * 8) == window(1.0, 8, 0.8)


def test_fourier_network_begins_as_a_sphere():
    """One zero in each direction, negative inside, at the radius up to random variation (a tenth per layer)."""
    directions = F.normalize(points(20).float(), dim=1)
    steps = torch.linspace(0.1, 1.7, 41)
    radii = []
    for seed in range(5):
        network = FourierNetwork(generator=draw(seed))
        with torch.no_grad():
            inside = network((steps[:, None, None] * directions).reshape(-1, 3)).reshape(41, 20) < 0
        assert inside[0].all() and (inside.diff(dim=0).sum(0) == 1).all()
        found = steps[inside.sum(0)]
        assert found.std() < 0.3 * found.mean()
        radii.append(found.mean().item())
    assert np.mean(radii) == pytest.approx(0.6, rel=0.15) and np.std(radii) < 0.2
    _, gradient = network.value_and_gradient(0.6 * directions)
    assert torch.cosine_similarity(gradient, directions).mean() > 0.95


def test_bands_that_were_never_open_have_no_effect():
    """The initial function is the same for any window."""
    network, x = FourierNetwork(generator=draw()), points(20).float()
    before = network(x)
    network.window.zero_()
    assert torch.equal(network(x), before)


def test_window_follows_the_training():
    """In training it follows the progress; validation and evaluation of the field do not change it."""
    field = tiny(Fourier, progressive=0.4).field(draw())
    x = points(8).float()
    batch = Batch(x, 4, F.normalize(x[:4], dim=1), None, 8)
    field.loss(batch, 0.2)
    assert field.network.window.tolist() == pytest.approx([0.5, 0])
    with torch.no_grad():
        before = field(x)
        field.loss(batch, 1.0)
        assert torch.equal(field(x), before)
    at_once = tiny(Fourier, progressive=0.0).field(draw())
    at_once.loss(batch, 0.0)
    assert at_once.network.window.tolist() == [1, 1]
    loaded = tiny(Fourier, progressive=0.4, load="field.safetensors").field(draw())
    loaded.loss(batch, 0.0)
    assert loaded.network.window.tolist() == [1, 1]  # learned bands stay open


# -- the grid and its decoders -----------------------------------------------------------------------------------------


def test_grid_interpolates_linear_functions_exactly():
    """Features that are linear in the position of their vertex are linear everywhere, with constant slopes."""
    grid = FeatureGrid(3, 1, width=2, generator=draw()).double()
    A = torch.tensor([[1.0, -2.0], [0.5, 3.0], [-1.5, 0.25]], dtype=torch.double)
    start = 0
    for side in (2, 4, 8):
        axis = torch.linspace(-1, 1, side + 1, dtype=torch.double)
        vertices = torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
        grid.table.data[start : start + len(vertices)] = vertices @ A + 0.7
        start += len(vertices)
    assert start == len(grid.table)
    x = torch.cat([points(50), torch.tensor(list(itertools.product((-1.0, 0.0, 1.0), repeat=3)), dtype=torch.double)])
    features, slopes = grid.features_and_slopes(x)
    torch.testing.assert_close(features, (x @ A + 0.7)[:, None].expand(-1, 3, -1))
    torch.testing.assert_close(slopes, A.expand(len(x), 3, 3, 2))
    torch.testing.assert_close(grid(x, 2), 2 * (x @ A + 0.7))


def test_grid_samples_like_torch():
    """Against F.grid_sample with align_corners and border padding, inside the box and outside."""
    grid = FeatureGrid(3, 2, width=5, generator=draw()).double()
    x = 1.3 * points(200)
    start, expected = 0, []
    for side in (4, 8, 16):
        n = side + 1
        volume = grid.table[start : start + n**3].reshape(n, n, n, 5).permute(3, 0, 1, 2)[None]
        start += n**3
        place = x.flip(1)[None, :, None, None]  # grid_sample takes the last axis first
        found = F.grid_sample(volume, place, mode="bilinear", padding_mode="border", align_corners=True)
        expected.append(found[0, :, :, 0, 0].T)
    expected = torch.stack(expected, 1)
    torch.testing.assert_close(grid.features(x), expected)
    torch.testing.assert_close(grid.features_and_slopes(x)[0], expected)
    torch.testing.assert_close(grid(x), expected.sum(1))


def test_nglod_outside_its_box():
    """The value at the nearest point of the box plus its distance: a surface that touches the box is closed."""
    field = Nglod(levels=2, base=1).field(draw())
    corner, face = torch.tensor([[1.0, -1.0, 1.0]]), torch.tensor([[0.3, 1.0, 0.2]])
    out = torch.tensor([[0.03, -0.04, 0.0]])
    torch.testing.assert_close(field(corner + out), field(corner) + 0.05)
    torch.testing.assert_close(field(face + torch.tensor([0, 0.02, 0])), field(face) + 0.02)
    f, gradient = field.levels_and_gradients(corner + out)[-1]
    torch.testing.assert_close(f, field(corner) + 0.05)
    assert gradient[0, :2].tolist() == pytest.approx([0.6, -0.8], abs=1e-5)


@pytest.mark.parametrize("sparse", [False, True])
def test_levels_of_detail_and_their_gradients(sparse):
    """Values of each level match the field at that level; gradients and their derivatives match autograd."""
    field = NglodField(OrientedLoss(), 3, 1, lod=3, features=4, hidden=16, generator=draw(), sparse=sparse).double()
    field.grid.table.data *= 30
    x = 1.1 * points(40)
    plain = field.levels(x)
    by_hand = field.levels_and_gradients(x)

    def at(lod):
        def value(x):
            # Weights by ordinary operations: an embedding bag cannot be differentiated twice.
            rows, u = field.grid._cells(x, lod)
            found = (field.grid.table[rows] * field.grid._weights(u)[..., None]).sum((1, 2))
            inside = x.clamp(-1, 1)
            beyond = (x - inside).square().sum(1)
            distance = torch.where(beyond > 0, beyond, 1).sqrt() * (beyond > 0)
            return field._decode(torch.cat([inside, found], 1), lod - 1)[0] + distance

        return value

    for lod in (1, 2, 3):
        field.lod = lod
        torch.testing.assert_close(field(x), plain[lod - 1])
        wanted = [field.grid.table, field.weight, field.bias, field.out_weight, field.out_bias]
        assert_same_derivatives(by_hand[lod - 1], by_autograd(at(lod), x), wanted)


def test_sparse_adam_moves_only_the_rows_of_the_batch():
    """The first step equals Adam for the rows around the points and is zero for others; decoders use plain Adam."""
    x = 0.2 * points(30).float()
    batch = Batch(x, 0, torch.zeros(0, 3), x.norm(dim=1) - 0.5, len(x))
    fields = [Nglod(levels=2, optimizer=kind).field(draw()) for kind in ("dense", "sparse")]
    before = fields[0].grid.table.detach().clone()
    for field in fields:
        optimizer = field.optimizer(Training(steps=1, learning_rate=1e-3, betas=(0.9, 0.999)))
        assert len(optimizer.param_groups) == len(field.groups()) == len(field.rates(0.0)) == 2
        for group in optimizer.param_groups:
            group["lr"] = 1e-3
        optimizer.zero_grad(set_to_none=True)
        (1e4 * field.loss(batch, 0.0)).backward()  # far from Adam's epsilon
        assert field.grid.table.grad.is_sparse == field.grid.sparse
        optimizer.step()
    dense, sparse = fields
    torch.testing.assert_close(dense.grid.table, sparse.grid.table, atol=2e-5, rtol=0)
    torch.testing.assert_close(dense.weight, sparse.weight)
    moved = (sparse.grid.table != before).any(1)
    assert moved.sum() == sparse.grid.active(x) < len(before) / 2
    assert Nglod(levels=5).field(draw()).grid.sparse is False


# -- direct residual and D-SDF -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("settings", [{}, {"alpha": 0.3, "bounded": True}, {"attenuate": True, "nu": 0.2}])
def test_direct_residual_is_a_sum(settings):
    """The formula of the docstring, and its gradient with constant chi, by automatic differentiation."""
    method = DirectResidual(hidden_layers=1, width=16, sphere=0, **settings)
    field = method.field(draw()).double()
    field.base.mixed = field.residual.mixed = False
    x = points(30)
    base, residual = field.base(x), field.residual(x)
    residual = torch.tanh(residual) if method.bounded else residual
    chi = attenuation(base, 0.2).detach() if method.attenuate else 1.0
    torch.testing.assert_close(field(x), base + method.alpha * chi * residual)

    def frozen(x):
        d = field.residual(x)
        return field.base(x) + method.alpha * chi * (torch.tanh(d) if method.bounded else d)

    assert_same_derivatives(field.value_and_gradient(x), by_autograd(frozen, x), list(field.parameters()))


def test_d_sdf_evaluates_the_base_at_displaced_points():
    """The formula, and the gradient against central differences; without gradients everything is detached."""
    form = {"bands": 2, "layers": 2, "width": 16}
    base, warp = ReluNetwork(1, generator=draw(), **form), ReluNetwork(3, generator=draw(1), **form)
    field = WarpedField(OrientedLoss(), base, warp).double()
    x = points(30)
    assert torch.equal(field(x), base(x + warp(x))[:, 0])
    f, gradient = field.value_and_gradient(x)
    loss_of(f, gradient).backward()
    assert all(p.grad is not None for p in field.parameters())
    steps = 1e-7 * torch.eye(3, dtype=torch.double)
    differences = torch.stack([(field(x + h) - field(x - h)) / 2e-7 for h in steps], 1)
    torch.testing.assert_close(gradient, differences, atol=1e-6, rtol=1e-6)
    with torch.no_grad():
        quiet = field.value_and_gradient(x)
    assert torch.equal(quiet[0], f) and torch.equal(quiet[1], gradient)
    assert not quiet[0].requires_grad and not quiet[1].requires_grad


def test_relu_network_matches_that_of_nerf():
    """Layer by layer: the encoding is appended again after the fifth of eight."""
    network = ReluNetwork(2, bands=2, width=8, generator=draw()).double()
    x = points(5)
    e = h = torch.cat([x, x.sin(), (2 * x).sin(), x.cos(), (2 * x).cos()], 1)
    for k in range(8):
        h = torch.relu(F.linear(h, network.weights[k], network.biases[k]))
        h = torch.cat([e, h], 1) if k == 4 else h
    torch.testing.assert_close(network(x), F.linear(h, network.weights[8], network.biases[8]))


# -- fits --------------------------------------------------------------------------------------------------------------


# Mean error of the distance near the surface, relative to the radius.
REACHED = {Fourier: 0.02, DirectResidual: 0.02, DSdf: 0.03, Nglod: 0.02}


def near_sphere() -> np.ndarray:
    """Points up to 0.1 from the unit sphere, in the field's frame."""
    rng = np.random.default_rng(5)
    x = rng.normal(size=(500, 3))
    return x / np.linalg.norm(x, axis=1, keepdims=True) * rng.uniform(0.9, 1.1, size=(500, 1))


@pytest.mark.parametrize("method", TINY, ids=lambda m: m.__name__)
def test_each_method_fits_a_sphere_repeatably(method, tmp_path):
    """To a stated accuracy, in the unit of the frame; repeated bit for bit; and a file gives the same field."""
    path = tmp_path / "field.safetensors"
    run = with_truth()
    field, frame = tiny(method, save=str(path)).fit_to(sphere(), run)
    assert run.parameters == field.count()
    assert run.distances_given == (0 if method is Fourier else 4000)
    x = near_sphere()
    expected = sphere_distances(frame.invert(x)) / frame.radius
    found = field.values(x)
    assert np.abs(found - expected).mean() < REACHED[method]
    again, _ = tiny(method, steps=0, load=str(path)).fit_to(sphere(), Run(seed=7))
    assert np.array_equal(again.values(x), found)
    if method is Fourier:
        assert field.network.window.tolist() == [1, 1] == again.network.window.tolist()
    briefly = [tiny(method, steps=12).fit_to(sphere(), with_truth())[0].values(x) for _ in range(2)]
    assert np.array_equal(*briefly)


@pytest.mark.parametrize("changes", [{"optimizer": "sparse"}, {"lod": 1}], ids=["sparse", "coarse"])
def test_nglod_fits_a_sphere_with_other_settings(changes):
    """With the sparse optimizer; and with the coarsest level of detail, a field of its own."""
    field, frame = tiny(Nglod, **changes).fit_to(sphere(), with_truth())
    x = near_sphere()
    error = np.abs(field.values(x) - sphere_distances(frame.invert(x)) / frame.radius).mean()
    assert error < (0.02 if field.lod == 2 else 0.05)
    assert field.lod == changes.get("lod", 2)


@pytest.mark.parametrize("method", SUPERVISED, ids=lambda m: m.__name__)
def test_without_truth_the_parameter_to_change_is_named(method):
    """With that parameter the method fits oriented points."""
    with pytest.raises(UsageError, match=r"true distances.*method\.supervision=oriented"):
        tiny(method).fit_to(sphere(), Run())
    field, _ = tiny(method, supervision="oriented", steps=15).fit_to(sphere(), Run())
    assert np.isfinite(field.values(near_sphere())).all()


@pytest.mark.parametrize(
    ("method", "wrong", "message"),
    [
        (Fourier, {"bands": 0}, "bands: expected at least 1"),
        (Fourier, {"progressive": 0.9}, "progressive: expected 0 to 0.875"),
        (Fourier, {"width": 51}, r"width: expected more than 3 \+ 6 bands = 51"),
        (Fourier, {"hidden_layers": 0}, "hidden_layers: expected at least 1"),
        (DirectResidual, {"alpha": 0.0}, "alpha: expected more than 0"),
        (DirectResidual, {"supervision": "none"}, "supervision: expected distances or oriented"),
        (DSdf, {"layers": 0}, "layers: expected at least 1"),
        (DSdf, {"samples": 0}, "samples: expected at least 5"),
        (Nglod, {"lod": 5}, "lod: expected 0 to 4"),
        (Nglod, {"levels": 8}, "levels: expected at most 7 with base=2.*512 cells a side"),
        (Nglod, {"optimizer": "sgd"}, "optimizer: expected auto, dense or sparse"),
    ],
)
def test_wrong_parameters_are_explained(method, wrong, message):
    """Each names the parameter, what was expected, and what was given."""
    with pytest.raises(ValueError, match=message):
        method(**wrong)
