"""SIREN with iso-points: its losses against the equations, its batches, and a fit."""

import math

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree

from bench import PointCloud, Run
from bench.methods.isopoints.fitting.batch import RegularisedBatch
from bench.methods.isopoints.fitting.field import RegularisedField, Weights
from bench.methods.isopoints.fitting.guide import GuidedSampler, Plan, outlier_weights, pca_normals
from bench.methods.isopoints.fitting.sheets import lobes, split
from bench.methods.isopoints.sampling.extraction import IsoPoints
from bench.methods.isopoints.siren_iso import SirenIso
from bench.plugins.presets import presets


def ball(count, seed=0, radius=0.8):
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return radius * normals, normals


def even(count, radius=0.8):
    """Evenly spaced points of a sphere: a spiral of golden angles."""
    i = np.arange(count) + 0.5
    z, around = 1 - 2 * i / count, np.pi * (1 + math.sqrt(5)) * i
    ring = np.sqrt(1 - z**2)
    normals = np.stack([ring * np.cos(around), ring * np.sin(around), z], axis=1)
    return radius * normals, normals


class Ball:
    """The distance to a sphere of radius 0.8."""

    def value_and_gradient(self, x):
        length = torch.linalg.vector_norm(x, dim=1)
        return length - 0.8, x / length[:, None]


def plan(**own):
    usual = {"batch": 50, "iso": True, "count": 300, "warm_up": 3, "refresh": 4, "per_step": 40, "pca": 8}
    usual |= {"outliers": True, "sigma": 60.0, "bandwidth": "noise", "sheets": True, "near": 0.0, "facing": 1.0}
    usual["lobes_after"] = 0
    return Plan(**(usual | own))


def sampler(points, normals, **own):
    return GuidedSampler(Ball(), points, normals, plan(**own), Run(), torch.Generator().manual_seed(0))


def some_batch(iso=7, false=0):
    g = torch.Generator().manual_seed(2)
    unit = torch.nn.functional.normalize(torch.randn(10 + iso, 3, generator=g), dim=1)
    return RegularisedBatch(
        x=torch.rand(10 + iso + 12 + false, 3, generator=g) - 0.5,
        on=10,
        normals=unit[:10],
        distances=None,
        total=22 + iso + false,
        weights=torch.rand(10, generator=g),
        iso=iso,
        iso_normals=unit[10:],
        counts=(10, iso, 12, false),
        bounds=torch.rand(false, generator=g) - 0.5,
        facing=torch.rand(12, 3, generator=g) - 0.5,
    )


def written_out(field, batch, weights, t):
    """The objective of section 4.2.2, point by point."""
    f, g = (part.detach().double().numpy() for part in field.network.value_and_gradient(batch.x))
    cosine = lambda i, n: float(g[i] @ n.double().numpy() / np.linalg.norm(g[i]))  # noqa: E731
    on, iso, space = range(10), range(10, 10 + batch.iso), range(10 + batch.iso, 22 + batch.iso)
    v = batch.weights.tolist()
    data = weights.surface * sum(v[i] * abs(f[i]) for i in on) / 10
    data += weights.normal * sum(v[i] * (1 - cosine(i, batch.normals[i])) for i in on) / 10
    regular = 0.0
    if batch.iso:
        regular = weights.surface * sum(abs(f[i]) for i in iso) / batch.iso
        regular += weights.normal * sum(1 - abs(cosine(i, batch.iso_normals[i - 10])) for i in iso) / batch.iso
    false = [(b, f[22 + batch.iso + i]) for i, b in enumerate(batch.bounds.tolist())]
    short = sum(max(0.0, b - value if b > 0 else value - b) for b, value in false) / max(1, len(false))
    if weights.mixing == "by_count" and batch.iso:
        data, regular = data * 10 / (10 + batch.iso), regular * batch.iso / (batch.iso + 8000)
    regular = weights.hold * (regular + weights.surface * short)
    stretch = [abs(np.linalg.norm(g[i]) - 1) for i in range(len(f))]
    if weights.squared:
        eikonal = sum(stretch[i] ** 2 for i in on) / 20 + sum(stretch[i] ** 2 for i in space) / 24
    else:
        eikonal = (sum(stretch[i] for i in on) + sum(stretch[i] for i in space)) / 22
    steep = weights.steepness * (1 + weights.steepening * t)
    against = 0.0
    if t < weights.facing_until:
        turned = [-g[i] @ n / np.linalg.norm(g[i]) for i, n in zip(space, batch.facing.numpy(), strict=True)]
        against = weights.facing * sum(max(0.0, value) for value in turned) / 12
    return (
        data
        + regular
        + against
        + weights.eikonal * eikonal
        + weights.space * sum(math.exp(-steep * abs(f[i])) for i in space) / 12
    )


FACING = {"facing": 20.0, "facing_until": 0.5}


@pytest.mark.parametrize(("iso", "false"), [(0, 0), (7, 0), (7, 5)])
@pytest.mark.parametrize(
    "own", [{}, {"hold": 0.3}, {"squared": True, "steepening": 1.0, "mixing": "by_count"}, FACING, {"facing": 0.0}]
)
def test_the_loss_matches_the_objective(iso, false, own):
    weights = Weights(**own)
    field = RegularisedField(weights, 15.0, hidden_layers=1, width=16, generator=torch.Generator().manual_seed(1))
    batch = some_batch(iso, false)
    wanted = written_out(field, batch, weights, 0.4)
    assert field.loss(batch, 0.4).item() == pytest.approx(wanted, rel=1e-5)
    parts = list(batch.chunks(8))
    assert len(parts) > 2 and sum(len(part.x) for part in parts) == len(batch.x)
    assert sum(field.loss(part, 0.4) for part in parts).item() == pytest.approx(wanted, rel=1e-5)


def test_gradients_in_space_are_unconstrained_later_in_the_training():
    batch, fields = some_batch(), []
    for own in ({"facing": 0.0}, FACING):
        form = {"hidden_layers": 1, "width": 16, "generator": torch.Generator().manual_seed(1)}
        fields.append(RegularisedField(Weights(**own), 15.0, **form))
    early, late = ([field.loss(batch, t).item() for field in fields] for t in (0.49, 0.5))
    assert early[1] > early[0] and late[1] == late[0]


def test_points_in_space_have_the_normal_of_the_nearest_point():
    points, normals = even(400)
    batch = sampler(points, normals).draw()
    space = batch.x[batch.on + batch.iso :].double().numpy()
    away = np.linalg.norm(space[:, None] - points, axis=2)
    wanted = np.exp(-2 * away.min(1) ** 2)[:, None] * normals[away.argmin(1)]
    np.testing.assert_allclose(batch.facing.numpy(), wanted, atol=1e-5)


def test_iso_points_are_computed_after_the_warm_up_and_refreshed():
    draws = sampler(*ball(500))
    had, made = [], []
    for _ in range(12):  # the first batch is held out; then follow steps 0 to 10
        batch = draws.draw()
        had.append(batch.iso)
        made.append(draws.refreshed)
    assert had == [0] * 4 + [40] * 8
    assert made == [0] * 4 + [1] * 4 + [2] * 4
    assert batch.counts == (50, 40, 50, 0) and len(batch.x) == 140
    on_level = Ball().value_and_gradient(batch.x[50:90])[0]
    assert on_level.abs().max() <= 1e-5
    cosine = torch.nn.functional.cosine_similarity(batch.x[50:90], batch.iso_normals).abs()
    assert cosine.min() > 0.99
    assert all(sampler(*ball(500), iso=False).draw().iso == 0 for _ in range(6))


def test_points_in_space_can_be_near_the_surface():
    far, near = (sampler(*ball(500), batch=2000, near=share).draw().x[2000:] for share in (0.0, 1.0))
    distance = [float(Ball().value_and_gradient(x)[0].abs().mean()) for x in (far, near)]
    assert distance[1] == pytest.approx(0.1 * math.sqrt(2 / math.pi), rel=0.2) and distance[0] > 2 * distance[1]


def test_pca_normals_of_a_plane():
    points = torch.rand(80, 3, generator=torch.Generator().manual_seed(0))
    points[:, 2] = 0.3 * points[:, 0]
    wanted = torch.tensor([-0.3, 0, 1]) / math.hypot(0.3, 1)
    assert (pca_normals(points, 8) @ wanted).abs().min() > 1 - 1e-5


def test_outliers_have_smaller_weights():
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


@pytest.mark.parametrize("noise", [0.01, 0.08])
def test_the_outlier_weight_adapts_to_the_noise(noise):
    """A point at s standard deviations has the weight exp(-s^2 / 8) for any number of iso-points."""
    iso, unit = (torch.from_numpy(part).float() for part in ball(20_000))
    at = IsoPoints(iso, unit, 0)
    q, normals = (torch.from_numpy(part).float() for part in ball(3000, seed=1))
    deviation = torch.randn(3000, 1, generator=torch.Generator().manual_seed(0))
    weights = outlier_weights(q + noise * deviation * normals, normals, at, bandwidth="noise")
    inner = deviation[:, 0].abs() < 3  # reach = 6 s, and the nearest iso-point is not exactly below
    assert (weights - torch.exp(-deviation[:, 0].square() / 8))[inner].abs().max() < 0.1
    if noise == 0.08:
        published = outlier_weights(q + noise * deviation * normals, normals, at)
        assert published.mean() < 0.5 * weights.mean()


def test_sheets_without_points_are_detected():
    """A ball on the cloud, one inside and a small one beside it: only the first is kept."""
    own, unit = even(2000)
    inner, inner_unit = even(300, radius=0.3)
    beside = 0.1 * inner / 0.3 + [1.2, 0, 0]
    points = torch.from_numpy(np.concatenate([own, inner, beside])).float()
    normals = torch.from_numpy(np.concatenate([unit, -inner_unit, inner_unit])).float()
    cloud = torch.from_numpy(np.concatenate([ball(990, seed=2)[0], beside[:10]])).float()
    kept, false = split(IsoPoints(points, normals, 0), cloud)
    assert torch.equal(kept.points, points[:2000]) and torch.equal(false.points, points[2000:])
    distance = (torch.linalg.vector_norm(false.points, dim=1) - 0.8).numpy()
    assert false.bounds.numpy() == pytest.approx(distance / 2, abs=0.01)
    assert len(split(kept, cloud)[1].points) == 0


def bag_on_a_ball(turned=1.0):
    """A ball of radius 0.8 and a bag of radius 0.3 attached by a neck: iso-points, and which belong to the bag."""
    large, unit = even(2000)
    small, small_unit = even(281, radius=0.3)
    small = small + [1.05, 0, 0]
    outer = np.linalg.norm(small, axis=1) > 0.8
    own = np.linalg.norm(large - [1.05, 0, 0], axis=1) > 0.3
    points, normals = np.concatenate([large[own], small[outer]]), np.concatenate([unit[own], small_unit[outer]])
    iso = IsoPoints(torch.from_numpy(points).float(), torch.from_numpy(turned * normals).float(), 0)
    return iso, torch.arange(len(points)) >= own.sum()


@pytest.mark.parametrize("turned", [1.0, -1.0])
def test_a_bag_attached_to_the_surface_is_a_lobe(turned):
    """Solid or void: the rim of its neck is short for its area. Points of the cloud surround the neck."""
    iso, bag = bag_on_a_ball(turned)
    cloud = ball(6000, seed=3)[0]
    cloud = torch.from_numpy(cloud[np.linalg.norm(cloud - [1.05, 0, 0], axis=1) > 0.35]).float()
    kept, false = split(iso, cloud, with_lobes=True)
    missed = bag & (iso.points[:, :1] == false.points[:, 0]).any(1).logical_not()
    assert len(false.points) >= 0.9 * bag.sum() and missed.sum() <= 0.15 * bag.sum()
    assert (false.bounds.sign() == turned).all()
    assert torch.linalg.vector_norm(false.points, dim=1).min() > 0.79
    assert len(split(iso, cloud)[1].points) == 0


@pytest.mark.parametrize("degrees", [20, 40, 60, 75])
def test_a_patch_that_spans_a_hole_is_not_a_lobe(degrees):
    """The vector area of a spherical cap is (1 + cos) / 2 of its area: more than half up to a hemisphere."""
    points, normals = even(2000)
    cloud, _ = ball(6000, seed=4)
    cloud = cloud[cloud[:, 2] < 0.8 * math.cos(math.radians(degrees))]
    iso = IsoPoints(torch.from_numpy(points).float(), torch.from_numpy(normals).float(), 0)
    voted = torch.from_numpy(cKDTree(points).query(cloud)[1])
    assert (lobes(iso, voted) == 0).all()


def stalk():
    """Two balls on the x axis and a tube between them."""
    angle = np.pi * (1 + math.sqrt(5)) * np.arange(400)
    tube = np.stack([np.linspace(-0.5, 0.5, 400), 0.1 * np.cos(angle), 0.1 * np.sin(angle)], axis=1)
    sphere, unit = even(600, radius=0.3)
    own = np.linalg.norm(sphere[:, 1:], axis=1) > 0.1
    left, right = own | (sphere[:, 0] < 0), own | (sphere[:, 0] > 0)
    points = np.concatenate([tube, sphere[right] + [0.7, 0, 0], sphere[left] - [0.7, 0, 0]])
    return points, np.concatenate([tube * [0, 10, 10], unit[right], unit[left]])


def lobes_where_bare(points, normals, bare):
    """The lobes if the cloud has points at all iso-points except those in the middle."""
    iso = IsoPoints(torch.from_numpy(points).float(), torch.from_numpy(normals).float(), 0)
    return lobes(iso, torch.nonzero(torch.from_numpy(np.abs(points[:, 0]) > bare))[:, 0].repeat(3))


@pytest.mark.parametrize("bare", [0.2, 0.4, 0.5])
def test_a_tube_between_two_parts_is_not_a_lobe(bare):
    """A stalk whose middle no sensor sees."""
    assert (lobes_where_bare(*stalk(), bare) == 0).all()


def test_a_bulging_tube_is_a_lobe():
    """A ball of radius 0.35 in the middle of the tube."""
    points, normals = stalk()
    bulge, unit = (part[np.linalg.norm(even(900)[1][:, 1:], axis=1) > 0.1 / 0.35] for part in even(900, radius=0.35))
    tube = np.linalg.norm(points, axis=1) > 0.35
    found = lobes_where_bare(np.concatenate([points[tube], bulge]), np.concatenate([normals[tube], unit]), 0.4)
    assert (found[tube.sum() :] == 1).float().mean() > 0.95
    assert (found[: tube.sum()][np.abs(points[tube, 0]) > 0.45] == 0).all()


def test_points_of_false_sheets_are_in_the_batches():
    """A field with a second ball that no point of the cloud is near: its points have positive bounds."""

    class Two:
        def value_and_gradient(self, x):
            away = x - torch.tensor([0.9, 0.9, 0.9])
            large, small = (torch.linalg.vector_norm(part, dim=1, keepdim=True) for part in (x, away))
            first = (large - 0.5) < (small - 0.2)
            value = torch.where(first, large - 0.5, small - 0.2)
            return value[:, 0], torch.where(first, x / large, away / small)

    own = {"batch": 100, "per_step": 40, "warm_up": 0, "count": 500}
    draws = GuidedSampler(Two(), *ball(500, radius=0.5), plan(**own), Run(), torch.Generator().manual_seed(0))
    draws.draw()
    batch = draws.draw()
    assert batch.counts == (100, 40, 100, 10) and len(batch.x) == 250
    centre = torch.tensor([0.9, 0.9, 0.9])
    assert (torch.linalg.vector_norm(batch.x[-10:] - centre, dim=1) - 0.2).abs().max() < 1e-4
    assert batch.bounds.min() > 0
    assert sum(len(part.bounds) for part in batch.chunks(60)) == 10


@pytest.mark.parametrize(("name", "steps"), [("thesis", (300, 2000, 0.125)), ("released", (500, 2000, 0.0625))])
def test_presets_have_the_published_sizes(name, steps):
    values = presets("method")[f"siren_iso_{name}"].values
    assert (values["warm_up"], values["refresh"], values["share"]) == steps
    assert values["learning_rate"] == 1e-4 and values["width"] == 256 and values["facing"] in (0, 2)
    assert values["bandwidth"] == "spacing" and values["sheets"] is False and values["per_step"] == 5000


def test_a_fit_computes_iso_points_and_is_repeatable():
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
        ({"facing_until": 2}, "facing_until: expected 0 to 1, got 2"),
        ({"refresh": 0}, "refresh: expected at least 1"),
        ({"pca": 2}, "pca: expected at least 3"),
    ],
)
def test_parameters_are_checked(own, message):
    with pytest.raises(ValueError, match=message):
        SirenIso(**own)
