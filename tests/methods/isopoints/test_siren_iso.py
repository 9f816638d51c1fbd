"""SIREN with iso-points: its losses against the equations, its batches, and a fit."""

import math

import numpy as np
import pytest
import torch

from bench import PointCloud, Run
from bench.methods.isopoints.fitting.batch import RegularisedBatch
from bench.methods.isopoints.fitting.field import RegularisedField, Weights
from bench.methods.isopoints.fitting.guide import GuidedSampler, Plan, outlier_weights, pca_normals
from bench.methods.isopoints.sampling.extraction import IsoPoints
from bench.methods.isopoints.siren_iso import SirenIso


def ball(count, seed=0, radius=0.8):
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return radius * normals, normals


class Ball:
    """The distance to a sphere of radius 0.8."""

    def value_and_gradient(self, x):
        length = torch.linalg.vector_norm(x, dim=1)
        return length - 0.8, x / length[:, None]


def plan(**own):
    usual = {"batch": 50, "iso": True, "count": 300, "warm_up": 3, "refresh": 4, "per_step": 40, "pca": 8}
    return Plan(**(usual | {"outliers": True, "sigma": 60.0, "near": 0.0} | own))


def sampler(points, normals, **own):
    return GuidedSampler(Ball(), points, normals, plan(**own), Run(), torch.Generator().manual_seed(0))


def some_batch(iso=7):
    g = torch.Generator().manual_seed(2)
    unit = torch.nn.functional.normalize(torch.randn(10 + iso, 3, generator=g), dim=1)
    return RegularisedBatch(
        x=torch.rand(10 + iso + 12, 3, generator=g) - 0.5,
        on=10,
        normals=unit[:10],
        distances=None,
        total=22 + iso,
        weights=torch.rand(10, generator=g),
        iso=iso,
        iso_normals=unit[10:],
        counts=(10, iso, 12),
    )


def written_out(field, batch, weights, t):
    """The objective of section 4.2.2, point by point."""
    f, g = (part.detach().double().numpy() for part in field.network.value_and_gradient(batch.x))
    cosine = lambda i, n: float(g[i] @ n.double().numpy() / np.linalg.norm(g[i]))  # noqa: E731
    on, iso, space = range(10), range(10, 10 + batch.iso), range(10 + batch.iso, len(f))
    v = batch.weights.tolist()
    data = weights.surface * sum(v[i] * abs(f[i]) for i in on) / 10
    data += weights.normal * sum(v[i] * (1 - cosine(i, batch.normals[i])) for i in on) / 10
    regular = 0.0
    if batch.iso:
        regular = weights.surface * sum(abs(f[i]) for i in iso) / batch.iso
        regular += weights.normal * sum(1 - abs(cosine(i, batch.iso_normals[i - 10])) for i in iso) / batch.iso
    if weights.mixing == "by_count" and batch.iso:
        data, regular = data * 10 / (10 + batch.iso), regular * batch.iso / (batch.iso + 8000)
    stretch = [abs(np.linalg.norm(g[i]) - 1) for i in range(len(f))]
    if weights.squared:
        eikonal = sum(stretch[i] ** 2 for i in on) / 20 + sum(stretch[i] ** 2 for i in space) / 24
    else:
        eikonal = (sum(stretch[i] for i in on) + sum(stretch[i] for i in space)) / 22
    steep = weights.steepness * (1 + weights.steepening * t)
    return (
        data
        + regular
        + weights.eikonal * eikonal
        + weights.space * sum(math.exp(-steep * abs(f[i])) for i in space) / 12
    )


@pytest.mark.parametrize("iso", [0, 7])
@pytest.mark.parametrize("own", [{}, {"squared": True, "steepening": 1.0, "mixing": "by_count"}])
def test_the_loss_is_the_objective(iso, own):
    weights = Weights(**own)
    field = RegularisedField(weights, 15.0, hidden_layers=1, width=16, generator=torch.Generator().manual_seed(1))
    batch = some_batch(iso)
    wanted = written_out(field, batch, weights, 0.4)
    assert field.loss(batch, 0.4).item() == pytest.approx(wanted, rel=1e-5)
    parts = list(batch.chunks(8))
    assert len(parts) > 2 and sum(len(part.x) for part in parts) == len(batch.x)
    assert sum(field.loss(part, 0.4) for part in parts).item() == pytest.approx(wanted, rel=1e-5)


def test_iso_points_come_after_the_warm_up_and_again():
    draws = sampler(*ball(500))
    had, made = [], []
    for _ in range(12):  # the first batch is held out; then come the steps 0 to 10
        batch = draws.draw()
        had.append(batch.iso)
        made.append(draws.refreshed)
    assert had == [0] * 4 + [40] * 8
    assert made == [0] * 4 + [1] * 4 + [2] * 4
    assert batch.counts == (50, 40, 50) and len(batch.x) == 140
    on_level = Ball().value_and_gradient(batch.x[50:90])[0]
    assert on_level.abs().max() <= 1e-5
    cosine = torch.nn.functional.cosine_similarity(batch.x[50:90], batch.iso_normals).abs()
    assert cosine.min() > 0.99
    assert all(sampler(*ball(500), iso=False).draw().iso == 0 for _ in range(6))


def test_points_of_the_space_may_be_near():
    far, near = (sampler(*ball(500), batch=2000, near=share).draw().x[2000:] for share in (0.0, 1.0))
    distance = [float(Ball().value_and_gradient(x)[0].abs().mean()) for x in (far, near)]
    assert distance[1] == pytest.approx(0.1 * math.sqrt(2 / math.pi), rel=0.2) and distance[0] > 2 * distance[1]


def test_pca_normals_of_a_plane():
    points = torch.rand(80, 3, generator=torch.Generator().manual_seed(0))
    points[:, 2] = 0.3 * points[:, 0]
    wanted = torch.tensor([-0.3, 0, 1]) / math.hypot(0.3, 1)
    assert (pca_normals(points, 8) @ wanted).abs().min() > 1 - 1e-5


def test_outliers_count_less():
    """Eq. 4.15 and 4.16 at the nearest iso-point, in closed form."""
    iso, unit = (torch.from_numpy(part).float() for part in ball(400))
    at = IsoPoints(iso, unit, 0)
    q = torch.stack([iso[0], iso[1] * (1 + 0.05 / 0.8), iso[2], iso[3] * 1.2])
    turned = torch.nn.functional.normalize(unit[2] + torch.linalg.cross(unit[2], unit[5]) * 0.8, dim=0)
    weights = outlier_weights(q, torch.stack([unit[0], unit[1], turned, unit[3]]), at)
    angle = 1 - float(turned @ unit[2])
    wanted = [1, math.exp(-(0.05**2) / (32 * 0.8 / 400)), math.exp(-((angle / 0.5) ** 2)), 0]
    assert weights.tolist() == pytest.approx(wanted, abs=1e-4)
    opposite = outlier_weights(q[:1], -unit[:1], at)
    assert float(opposite) == pytest.approx(math.exp(-16), rel=1e-3)


def test_a_fit_makes_iso_points_and_is_repeatable():
    points, normals = ball(400, radius=1.0)
    noise = np.random.default_rng(1).normal(scale=0.02, size=points.shape)
    cloud, shape = PointCloud(points + noise, normals), ball(500, seed=3, radius=1.0)[0]
    form = {"learning_rate": 1e-3, "omega": 15.0, "width": 32, "hidden_layers": 1, "sphere": 0, "resolution": 32}
    values = {}
    for name, iso in {"with": True, "again": True, "without": False}.items():
        method = SirenIso(steps=80, batch=200, warm_up=20, refresh=30, iso=iso, **form)
        field, frame = method.fit_to(cloud, Run(threads=1, seed=0))
        values[name] = field.values(frame.apply(shape))
    assert np.array_equal(values["with"], values["again"])
    assert not np.array_equal(values["with"], values["without"])
    assert np.abs(values["with"]).mean() < 0.05


@pytest.mark.parametrize(
    ("own", "message"),
    [
        ({"share": 0}, "share: expected more than 0"),
        ({"near": 1.5}, "near: expected 0 to 1, got 1.5"),
        ({"sigma": 200}, "sigma: expected 0 to 180, got 200"),
        ({"refresh": 0}, "refresh: expected at least 1"),
        ({"pca": 2}, "pca: expected at least 3"),
    ],
)
def test_parameters_are_checked(own, message):
    with pytest.raises(ValueError, match=message):
        SirenIso(**own)
