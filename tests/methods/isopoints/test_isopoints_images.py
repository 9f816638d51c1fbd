"""The samples of a fit to images, against closed forms and naive loops."""

import math
from functools import cache

import numpy as np
import pytest
import torch

from bench import Frame, Run
from bench.contract.ball_views import views_of_a_ball
from bench.geometry.spiral import golden_spiral
from bench.methods.isopoints.images.buried import buried
from bench.methods.isopoints.images.by_points import Plan, PointSampler
from bench.methods.isopoints.images.by_rays import RaySampler
from bench.methods.isopoints.images.field import ImageField, Terms
from bench.methods.isopoints.images.least import about, least
from bench.methods.isopoints.images.saliency import averaged, children, curvatures, salient
from bench.methods.isopoints.images.scene import Rays, Scene
from bench.methods.isopoints.images.visibility import visible
from bench.methods.isopoints.images.volume import VolumeSampler, opacities, weights_of
from bench.methods.learned.networks.sine_network import SineNetwork
from bench.methods.learned.networks.sphere import begin_as_sphere

TERMS = Terms(color=1.0, mask=30.0, eikonal=0.1, steepness=50.0, motion="normal", most=0.1)


def spiral(count):
    return torch.as_tensor(golden_spiral(count), dtype=torch.float32)


def two_balls(count=3000):
    """A small ball beside a large one: each occludes part of the other."""
    unit = spiral(count)
    points = torch.cat([0.25 * unit + torch.tensor([0.8, 0, 0]), 0.5 * unit])
    return points, torch.cat([unit, unit])


def in_front(camera, points, center, radius):
    """Whether a ball lies between points (n, 3) and a camera, in closed form."""
    towards = camera - points
    length = towards.norm(dim=1)
    direction = towards / length[:, None]
    middle = ((center - points) * direction).sum(1)
    closest = (points + middle[:, None] * direction - center).norm(dim=1)
    return (closest < radius) & (middle > 0) & (middle < length)


def test_visibility_of_points_matches_the_closed_form():
    scene, (points, normals) = Scene(views_of_a_ball(8, 128), "cpu"), two_balls()
    seen = visible(scene, torch.arange(8), points, normals, radius=0.04)
    wrong = total = 0
    for view in range(8):
        camera = scene.centers[view]
        hidden = torch.cat(
            [
                in_front(camera, points[:3000], torch.zeros(3), 0.5),
                in_front(camera, points[3000:], torch.tensor([0.8, 0, 0]), 0.25),
            ]
        )
        wanted = (((camera - points) * normals).sum(1) > 0) & ~hidden
        found = torch.zeros(6000, dtype=torch.bool)
        found[seen.point[seen.row == view]] = True
        wrong, total = wrong + int((wanted != found).sum()), total + int(wanted.sum())
        place, _ = scene.project(torch.full((6000,), view), points)
        assert torch.allclose(place[seen.point[seen.row == view]], seen.place[seen.row == view])
    assert wrong < 0.01 * total


def test_rays_are_searched_near_the_nearest_points():
    points = 0.6 * spiral(2000)
    generator = torch.Generator().manual_seed(0)
    origins = 3 * torch.nn.functional.normalize(torch.randn(50, 3, generator=generator), dim=1)
    targets = 0.2 * torch.randn(50, 3, generator=generator)
    rays = Rays(origins, torch.nn.functional.normalize(targets - origins, dim=1))
    t = about(rays, points, 0.0, 9)
    middle = -(rays.origins * rays.directions).sum(1)
    half = (0.36 - rays.origins.square().sum(1) + middle**2).sqrt()
    # from the entry into the ball to the exit, up to the spacing of points
    assert torch.allclose(t[:, 0], middle - half, atol=0.15) and torch.allclose(t[:, -1], middle + half, atol=0.15)
    assert torch.allclose(t.diff(dim=1), t.diff(dim=1)[:, :1].expand(-1, 8), atol=1e-5)
    found, entered = (least(lambda x: x.norm(dim=1) - 0.5, rays, t, first) for first in (False, True))
    x = rays.origins[:, None] + t[..., None] * rays.directions[:, None]
    entries = 0
    for k in range(50):
        f = x[k].norm(dim=1) - 0.5
        assert torch.equal(found.points[k], x[k, f.argmin()]) and found.values[k] == f.min()
        first = next((i for i in range(9) if f[i] < 0), int(f.argmin()))
        assert torch.equal(entered.points[k], x[k, first])
        entries += int((f < 0).any())
    assert entries > 10


def test_a_ray_that_misses_is_searched_near_the_nearest_part():
    points = 0.5 * spiral(2000)
    rays = Rays(torch.tensor([[0.0, 0.7, -3]]), torch.tensor([[0.0, 0, 1]]))
    t = about(rays, points, 0.05, 5)
    assert float(t.min()) > 2.7 and float(t.max()) < 3.3  # the ball is nearest at z = 0


def test_curvature_matches_the_laplacian_by_naive_loops():
    points = torch.rand(60, 3, generator=torch.Generator().manual_seed(0))
    found = curvatures(points)
    for k in range(60):
        near = (points - points[k]).norm(dim=1).argsort()[1:9]
        assert float(found[k]) == pytest.approx(float((points[k] - points[near].mean(0)).norm()), abs=1e-6)


def test_losses_are_averaged_over_the_views_that_see_a_point():
    mean = averaged(torch.tensor([1.0, 3, 5]), torch.tensor([2, 2, 0]), 4)
    assert mean.tolist() == [5, 0, 2, 0]


def test_salient_points():
    metric = torch.ones(200)
    metric[[3, 50]] = 10
    assert salient(metric).tolist() == [3, 50]  # above min(2 median, max / 2)
    assert len(salient(torch.linspace(0, 1, 400))) == 20  # at most a twentieth
    assert len(salient(torch.ones(400))) == 20  # even if none stands out


def test_children_lie_between_salient_points_and_their_neighbours():
    points = spiral(1000)
    metric = torch.zeros(1000)
    metric[500] = 1
    new = children(points, metric)
    reach = 2 * math.sqrt(2 * math.sqrt(3) / 1000)  # D, the diagonal of the box, is nearly that of the cube
    assert len(new) % 8 == 0 and len(new) > 0
    assert (new - points[500]).norm(dim=1).max() < 1.6 * reach
    fathers = int(((points - points[500]).norm(dim=1) < reach).sum())
    assert len(new) == 8 * fathers


@cache
def sphere_weights():
    network = SineNetwork(5.0, hidden_layers=3, width=96, generator=torch.Generator().manual_seed(0))
    begin_as_sphere(network, 0.5)
    return network.state_dict()


def toy_field(scene, kind=ImageField):
    field = kind(scene, TERMS, None, 5.0, hidden_layers=3, width=96, generator=torch.Generator())
    field.network.load_state_dict(sphere_weights())
    return field


def point_sampler(scene, field, importance="uniform", fill=True):
    rest = {"surface": 0.5, "share": 0.2, "inner": 0.1, "lowest": 4, "rim": 0.5}
    plan = Plan(importance, 800, 1600, warm_up=0, refresh=4, fill=fill, **rest)
    return PointSampler(field, scene, 3, 300, 60, plan, Run(), torch.Generator().manual_seed(1))


def sampler_of(kind, scene, field):
    if kind == "rays":
        return RaySampler(field.network, scene, 3, 300, 60, torch.Generator().manual_seed(1))
    return point_sampler(scene, field, kind)


@pytest.mark.parametrize("kind", ["rays", "uniform", "curvature", "loss"])
def test_samples_are_on_the_surface_and_in_the_right_space(kind):
    """A sphere of radius 0.5 against images of a ball of 0.6: its surface lies within all masks."""
    scene = Scene(views_of_a_ball(6, 48).in_frame(Frame(radius=1 / 0.6)), "cpu")
    field = toy_field(scene)
    samples = sampler_of(kind, scene, field).draw()
    surface = samples.surface
    assert 50 < len(surface) <= 300 and samples.pixels == pytest.approx(300, abs=2) and len(samples.space) == 60
    with torch.no_grad():
        assert field(surface.points).abs().max() < 2e-4
    place, _ = scene.project(surface.views, surface.points)
    assert scene.inside(surface.views, place).all()
    assert torch.allclose(surface.colors, scene.colors(surface.views, place), atol=2e-3)
    away = torch.nn.functional.normalize(surface.points - scene.centers[surface.views], dim=1)
    assert torch.allclose(away, surface.directions, atol=1e-5)
    assert ((surface.directions * surface.gradients).sum(1) < 0).all()  # seen from outside
    masked = float(scene.masks.float().mean())
    outside = float(samples.free.weights.sum())
    if kind == "rays":  # rays that miss the ball count too
        assert outside == pytest.approx((1 - masked) * 300, rel=0.25)
    else:
        assert 0.2 * (1 - masked) * 300 < outside < 1.1 * (1 - masked) * 300
    if kind != "rays":
        assert 0 < float(samples.occupied.weights.sum()) < 1.1 * masked * 300
    for some in (samples.occupied, samples.free):
        assert torch.isfinite(some.points).all()


def test_iso_points_outside_a_mask_are_free_space():
    """A sphere larger than the ball of the images: its visible part outside the masks is free space."""
    views = views_of_a_ball(6, 48)
    scene = Scene(views, "cpu")
    scene.masks = scene.masks & (torch.arange(48) < 24)  # half of each mask is gone
    field = toy_field(scene)
    samples = point_sampler(scene, field).draw()
    with torch.no_grad():
        on = field(samples.free.points).abs() < 2e-4
    assert on.sum() > 20
    # each counts as the pixels that it represents: together about the part of the sphere outside the masks,
    # half of its disc, whose radius is 0.48 of that of the ball in the masks
    covered = (math.tan(math.asin(0.5 / 3)) / math.tan(math.asin(1 / 3))) ** 2 / 2
    disc = float(torch.tensor(views.masks).float().mean())
    assert float(samples.free.weights[on].sum()) == pytest.approx(covered * disc * 300, rel=0.5)


def test_sheets_that_no_view_sees_are_marked_as_inside():
    """A visible ball with a void in it; besides, a ball outside the masks, and one outside all images."""
    scene = Scene(views_of_a_ball(8, 128), "cpu")
    unit = spiral(2000)
    centers = torch.tensor([[0.0, 0.0, 0.0], [0.0, 0.0, 1.3], [0.0, 0.0, 40.0]])
    void, outside, away = 0.4 * unit[::8], centers[1] + 0.1 * unit[::20], centers[2] + 0.1 * unit[::20]
    points = torch.cat([0.95 * unit, void, outside, away])
    normals = torch.cat([unit, -unit[::8], unit[::20], unit[::20]])
    seen = visible(scene, torch.arange(8), points, normals, 0.12)
    found = buried(scene, points, normals, seen)
    assert found[2000:2250].all() and found.sum() == 250


@pytest.mark.parametrize("fill", [True, False])
def test_a_void_is_marked_as_inside(fill):
    """A field with a void of radius 0.2 in a ball of radius 0.6, which the masks show."""

    class Hollow:
        def value_and_gradient(self, x):
            length = x.norm(dim=1, keepdim=True)
            value = torch.where(length > 0.4, length - 0.6, 0.2 - length)
            return value[:, 0], torch.where(length > 0.4, x, -x) / length

        def __call__(self, x):
            return self.value_and_gradient(x)[0]

    scene = Scene(views_of_a_ball(6, 48).in_frame(Frame(radius=1 / 0.6)), "cpu")
    field = Hollow()
    field.network = field
    occupied = point_sampler(scene, field, fill=fill).draw().occupied
    on_void = (occupied.points.norm(dim=1) - 0.2).abs() < 1e-3
    assert bool(on_void.any()) == fill and (occupied.weights[on_void] == 1).all()


def test_a_step_in_chunks_has_the_loss_of_the_whole():
    scene = Scene(views_of_a_ball(6, 48).in_frame(Frame(radius=1 / 0.6)), "cpu")
    field = toy_field(scene)
    samples = point_sampler(scene, field).draw()
    whole = field.loss(samples, 0.5).detach()
    parts = list(samples.chunks(100))
    assert len(parts) >= 3
    assert float(sum(field.loss(part, 0.5).detach() for part in parts)) == pytest.approx(float(whole), rel=1e-4)


def test_iso_points_are_recomputed_and_grow_in_number():
    scene = Scene(views_of_a_ball(6, 48), "cpu")
    sampler = point_sampler(scene, toy_field(scene))
    counts = []
    for _ in range(9):
        sampler.draw()
        counts.append(len(sampler.iso.points))
    assert counts == [800] * 4 + [960] * 4 + [1152]  # SOON is larger than `refresh`


def test_without_a_surface_there_are_no_iso_points_and_rays_are_traced():
    scene = Scene(views_of_a_ball(6, 48), "cpu")
    field = toy_field(scene)
    field.network.biases[-1].data += 5  # everything is outside
    sampler = point_sampler(scene, field)
    samples = sampler.draw()
    assert sampler.iso is None and not len(samples.surface) and len(samples.occupied)
    assert "no iso-points" in sampler._run.notes[0]


# -- volume rendering --------------------------------------------------------------------------------------------------


def test_opacities_match_the_formula():
    before, after = torch.tensor([0.3, -0.1, 0.2]), torch.tensor([0.1, -0.3, 0.4])
    s = torch.sigmoid
    wanted = (1 - s(20 * after) / s(20 * before)).clamp(min=0)
    assert torch.allclose(opacities(before, after, 20.0), wanted, atol=1e-6)


def test_weights_of_a_ray_that_enters_follow_the_logistic_density():
    """For a plane at 0.4: the weights of fine intervals sum to 1, and their mean is at the plane (unbiased)."""
    t = torch.linspace(0, 1, 2001)[None]
    f = 0.4 - t
    weights = weights_of(opacities(f[:, :-1], f[:, 1:], 60.0))
    middle = (t[:, 1:] + t[:, :-1]) / 2
    assert float(weights.sum()) == pytest.approx(1, abs=1e-3)
    assert float((weights * middle).sum()) == pytest.approx(0.4, abs=2e-3)
    density = 60 * torch.sigmoid(60 * (0.4 - middle)) * (1 - torch.sigmoid(60 * (0.4 - middle)))
    assert torch.allclose(weights * 2000, density, atol=0.05)


def test_samples_of_a_ray_concentrate_at_the_surface():
    scene = Scene(views_of_a_ball(6, 48), "cpu")
    sampler = VolumeSampler(
        lambda x: x.norm(dim=1) - 0.5, lambda: 20.0, scene, 3, 90, 16, 16, torch.Generator().manual_seed(0)
    )
    batch = sampler.draw()
    assert batch.t.shape[1] == 33 and (batch.t.diff(dim=1) >= 0).all() and batch.total == 90
    middle = -(batch.rays.origins * batch.rays.directions).sum(1)
    squared = 0.25 - batch.rays.origins.square().sum(1) + middle**2
    hit = squared > 0.01
    enter = (middle - squared.clamp(min=0).sqrt())[hit]
    near = (batch.t[hit] - enter[:, None]).abs() < 0.08
    assert near.float().mean() > 0.3  # evenly spread: 0.08
    assert np.array_equal(batch.inside.numpy(), scene.inside(batch.views, _places(scene, batch)).numpy())


def _places(scene, batch):
    return scene.project(batch.views, batch.rays.origins + 3 * batch.rays.directions)[0]
