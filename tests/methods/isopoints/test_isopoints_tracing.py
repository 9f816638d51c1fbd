"""Rays against closed forms, and derivatives of intersections against finite differences."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from bench.contract.ball_views import views_of_a_ball
from bench.methods.isopoints.images.field import ImageField, Terms
from bench.methods.isopoints.images.moving import moving
from bench.methods.isopoints.images.samples import Samples, Surface
from bench.methods.isopoints.images.scene import Pixels, Rays, Scene
from bench.methods.isopoints.images.tracing import Tracing, ball_span, trace

EXACT = Tracing(steps=80, tolerance=1e-11, samples=400, secants=60)


def random_rays(count, distance=2.5, spread=0.35, seed=0, dtype=torch.float32):
    generator = torch.Generator().manual_seed(seed)
    origins = torch.nn.functional.normalize(torch.randn(count, 3, generator=generator, dtype=dtype), dim=1) * distance
    targets = spread * torch.randn(count, 3, generator=generator, dtype=dtype)
    return Rays(origins, torch.nn.functional.normalize(targets - origins, dim=1))


def sphere(x):
    return torch.linalg.vector_norm(x, dim=1) - 0.7


def torus(x):
    return torch.stack([torch.linalg.vector_norm(x[:, :2], dim=1) - 0.6, x[:, 2]], 1).norm(dim=1) - 0.25


def meets_sphere(origin, direction):
    """The distance along a ray to the sphere, or infinity."""
    b, c = origin @ direction, origin @ origin - 0.49
    return -b - math.sqrt(b * b - c) if b * b > c else math.inf


def meets_torus(origin, direction):
    """The least positive real root of the quartic of the torus, or infinity."""
    whole = np.array([direction @ direction, 2 * origin @ direction, origin @ origin + 0.36 - 0.0625])
    flat = np.array([direction[:2] @ direction[:2], 2 * origin[:2] @ direction[:2], origin[:2] @ origin[:2]])
    roots = np.roots(np.polysub(np.polymul(whole, whole), 4 * 0.36 * flat))
    real = roots[np.abs(roots.imag) < 1e-7].real
    return min(real[real > 0], default=math.inf)


@pytest.mark.parametrize(("function", "closed"), [(sphere, meets_sphere), (torus, meets_torus)])
def test_traced_rays_hit_the_surface_at_the_closed_form(function, closed):
    rays = random_rays(2000)
    traced = trace(function, rays)
    origins, directions = (part.double().numpy() for part in rays)
    wanted = np.array([closed(o, d) for o, d in zip(origins, directions, strict=True)])
    hit = np.isfinite(wanted)
    assert 500 < hit.sum() < 1900
    assert np.array_equal(traced.hit.numpy(), hit)
    points = origins[hit] + wanted[hit, None] * directions[hit]
    assert np.linalg.norm(points - traced.points[traced.hit].numpy(), axis=1).max() < 5e-5


def test_a_field_that_is_not_a_distance_is_searched():
    """Three times the distance: sphere tracing oversteps; samples and regula falsi find the hits."""
    rays = random_rays(1000)
    traced = trace(lambda x: 3 * torus(x), rays)
    exact = trace(torus, rays)
    assert (traced.hit == exact.hit).float().mean() > 0.99
    both = traced.hit & exact.hit
    error = (traced.points - exact.points)[both].norm(dim=1)
    assert (error < 5e-5).float().mean() > 0.95  # others hit a thin part behind the first


def test_a_ray_without_a_hit_ends_at_the_minimum_of_the_field():
    rays = random_rays(500, spread=0.8)
    traced = trace(sphere, rays)
    missed = ~traced.hit & traced.reaches
    assert missed.sum() > 50
    closest = rays.origins - (rays.origins * rays.directions).sum(1, keepdim=True) * rays.directions
    step = 2 / 99  # a hundred samples on at most a length of 2
    assert (traced.points - closest)[missed].norm(dim=1).max() <= step
    beyond = ~traced.reaches
    assert beyond.any() and torch.allclose(traced.points[beyond], closest[beyond], atol=1e-5)


def test_rays_that_are_not_searched_have_no_hits_by_samples():
    """Training searches only within the mask: other rays get the point of least value, inside."""
    rays = random_rays(500)

    def steep(x):
        return 10 * sphere(x)

    nowhere = torch.zeros(500, dtype=torch.bool)
    all_of_them, none = trace(steep, rays), trace(steep, rays, search=nowhere)
    assert none.hit.sum() < all_of_them.hit.sum()
    assert (sphere(none.points)[all_of_them.hit & ~none.hit] < 0).all()


def test_the_span_in_the_ball():
    rays = Rays(torch.tensor([[0.0, 0, -3], [0, 2, -3], [0, 0, 0.5]]), torch.tensor([[0.0, 0, 1]] * 3))
    near, far, reaches = ball_span(rays, 1.0)
    assert reaches.tolist() == [True, False, True]
    assert torch.allclose(near[[0, 2]], torch.tensor([2.0, 0.0])) and torch.allclose(
        far[[0, 2]], torch.tensor([4, 0.5])
    )


@pytest.mark.parametrize("motion", ["ray", "normal"])
def test_the_motion_of_points_matches_finite_differences(motion):
    """For a sphere with variable centre and radius, whose points move along rays or normals."""
    rays = random_rays(40, dtype=torch.float64)

    def field(free):
        return lambda x: torch.linalg.vector_norm(x - free[:3], dim=1) - free[3]

    start = torch.tensor([0.05, -0.1, 0.02, 0.6], dtype=torch.float64)
    traced = trace(field(start), rays, EXACT)
    grazing = ((traced.points - start[:3]) * rays.directions).sum(1).abs() < 0.15
    rows = traced.hit & ~grazing
    rays, points = Rays(rays.origins[rows], rays.directions[rows]), traced.points[rows]
    gradients = torch.nn.functional.normalize(points - start[:3], dim=1)

    def found(free):
        if motion == "ray":
            return trace(field(free), rays, EXACT).points
        x = points
        for _ in range(20):  # onto the new sphere, along the old normals
            x = x - field(free)(x)[:, None] * gradients
        return x

    free = start.clone().requires_grad_()
    moved = moving(field(free)(points), points, gradients, rays.directions, motion, most=0)
    assert torch.equal(moved.detach(), points)
    weights = torch.randn(points.shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    (slope,) = torch.autograd.grad((weights * moved).sum(), free)
    for k in range(4):
        step = torch.zeros(4, dtype=torch.float64)
        step[k] = 1e-6
        difference = ((found(start + step) - found(start - step)) * weights).sum() / 2e-6
        assert float(slope[k]) == pytest.approx(float(difference), rel=1e-5, abs=1e-6)


def test_long_derivatives_are_clipped():
    points = torch.tensor([[0.0, 0, 1], [1, 0, 0]])
    values = torch.zeros(2, requires_grad=True)
    for most, wanted in ((0.0, [-5.0, -0.1]), (1.0, [-1.0, -0.1])):
        moved = moving(values, points, points, -points, "normal", most)
        (slope,) = torch.autograd.grad((moved * torch.tensor([[0.0, 0, 5], [0.1, 0, 0]])).sum(), values)
        assert slope.tolist() == pytest.approx(wanted)


def test_the_derivative_of_the_colour_loss_matches_traced_images():
    """Pixels are traced again for each change of a weight; the loss changes by its derivative."""
    scene = Scene(views_of_a_ball(3, 24), "cpu", torch.float64)
    terms = Terms(color=1.0, mask=0.0, eikonal=0.0, steepness=50.0, motion="ray", most=0.0)
    generator = torch.Generator().manual_seed(2)
    form = {"hidden_layers": 1, "width": 16, "generator": generator, "mixed": False}
    field = ImageField(scene, terms, None, 1.0, **form).double()
    field.network.weights[-1].data *= 0.1
    view = torch.arange(3).repeat_interleave(30)
    place = 9 + 6 * torch.rand(90, 2, generator=generator, dtype=torch.float64)
    rays, colors = scene.rays(view, place), torch.rand(90, 3, generator=generator, dtype=torch.float64)
    bump = field.network.forward
    # a ball plus a small network: so nearly a distance that every ray is traced up to rounding
    field.network.forward = lambda x: torch.linalg.vector_norm(x, dim=1) - 0.6 + bump(x)
    both = field.network.value_and_gradient

    def with_ball(x):
        f, g = both(x)
        length = torch.linalg.vector_norm(x, dim=1)
        return f + length - 0.6, g + x / length[:, None]

    field.network.value_and_gradient = with_ball

    def batch():
        traced = trace(field.network.forward, rays, EXACT)
        assert traced.hit.all()
        with torch.no_grad():
            _, gradients = field.network.value_and_gradient(traced.points)
        surface = Surface(traced.points, gradients, view, rays.directions, colors)
        empty = torch.zeros(0, 3, dtype=torch.float64)
        return Samples(surface, empty, empty, empty, 90)

    field.loss(batch(), 0.0).backward()
    for parameter in (field.network.weights[1], field.network.biases[-1]):
        place = tuple(0 for _ in parameter.shape)
        before, step, losses = float(parameter.data[place]), 1e-5, []
        for sign in (1, -1):
            parameter.data[place] = before + sign * step
            with torch.no_grad():
                losses.append(float(field.loss(batch(), 0.0)))
        parameter.data[place] = before
        assert float(parameter.grad[place]) == pytest.approx((losses[0] - losses[1]) / (2 * step), rel=2e-3, abs=1e-6)


@pytest.mark.parametrize("rim", [0.0, 0.5])
def test_pixels_are_drawn_from_their_region(rim):
    scene, generator = Scene(views_of_a_ball(4, 24), "cpu"), torch.Generator().manual_seed(0)
    pixels, views = Pixels(scene, generator, rim), torch.tensor([2, 0])
    for draw, wanted in ((pixels.inside, True), (pixels.outside, False)):
        view, place, weight = draw(views, 50)
        assert view.tolist() == [2] * 50 + [0] * 50
        assert (scene.inside(view, place) == wanted).all()
        assert torch.equal(place % 1, torch.full_like(place, 0.5))
        assert weight[:50].sum() == pytest.approx(50, rel=1e-5) == weight[50:].sum()
    view, place, weight = pixels.any(views, 500)
    assert float(scene.inside(view, place).float().mean()) == pytest.approx(float(scene.masks.float().mean()), abs=0.06)
    assert (weight == 1).all()


@pytest.mark.parametrize("rim", [0.0, 0.3, 0.8])
@pytest.mark.parametrize("count", [2, 7, 4000])
def test_more_pixels_are_drawn_near_the_rim_with_smaller_weights(rim, count):
    """A weighted mean equals that of all pixels of the region."""
    scene = Scene(views_of_a_ball(1, 64), "cpu")
    pixels, view = Pixels(scene, torch.Generator().manual_seed(0), rim), torch.zeros(1, dtype=torch.long)
    drawn = [pixels.inside(view, count) for _ in range(max(1, 1000 // count))]
    place, weight = torch.cat([one.place for one in drawn]), torch.cat([one.weight for one in drawn])
    distances = (place - 32).norm(dim=1)  # from the centre of the image of the ball
    rows, columns = np.nonzero(scene.masks[0].numpy())
    truth = np.hypot(columns - 31.5, rows - 31.5)
    assert float((weight * distances).sum() / weight.sum()) == pytest.approx(truth.mean(), rel=0.05)
    if rim and count == 4000:
        assert float((distances > truth.max() - 2).float().mean()) > rim > (truth > truth.max() - 2).mean()


def test_pixels_can_be_drawn_from_masks_without_a_rim():
    """A full mask and an empty one."""
    views = views_of_a_ball(2, 16)
    scene = Scene(replace(views, masks=np.stack([np.ones_like(views.masks[0]), np.zeros_like(views.masks[0])])), "cpu")
    pixels, both = Pixels(scene, torch.Generator().manual_seed(0), 0.5), torch.tensor([0, 1])
    view, _, weight = pixels.inside(both, 10)
    assert view.tolist() == [0] * 10 and weight.tolist() == [1] * 10
    assert pixels.outside(both, 10).view.tolist() == [1] * 10


def test_the_scene_projects_and_casts_rays_like_the_views():
    views = views_of_a_ball(5, 24)
    scene = Scene(views, "cpu", torch.float64)
    points = torch.rand(20, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64) - 0.5
    pixels, depth = views.project(points.numpy())
    for number in range(5):
        view = torch.full((20,), number)
        place, deep = scene.project(view, points)
        assert np.allclose(place, pixels[number]) and np.allclose(deep, depth[number])
        rays = scene.rays(view, place)
        away = (points - rays.origins).norm(dim=1, keepdim=True)
        assert torch.allclose(rays.origins + away * rays.directions, points)
    behind = scene.project(torch.zeros(1, dtype=torch.long), 2 * scene.centers[:1])[0]
    assert not scene.shown(behind).any()


def test_colours_are_exact_at_pixel_centres_and_never_mix_with_the_background():
    views = views_of_a_ball(2, 24)
    scene = Scene(views, "cpu")
    row, column = np.nonzero(views.masks[1])
    view, middles = torch.ones(len(row), dtype=torch.long), torch.tensor(np.stack([column, row], 1) + 0.5).float()
    assert np.allclose(scene.colors(view, middles), views.images[1][row, column] / 255, atol=1e-6)
    rim = scene.colors(view, middles + 0.4)
    assert (rim.sum(1) > 0.1).all()  # ambient light of three channels: black would be less


def test_shading_with_true_normals_gives_the_image():
    views = views_of_a_ball(3, 48)
    scene = Scene(views, "cpu")
    view, place, _ = Pixels(scene, torch.Generator().manual_seed(0)).inside(torch.arange(3), 200)
    traced = trace(lambda x: torch.linalg.vector_norm(x, dim=1) - 1, scene.rays(view, place), Tracing(radius=1.1))
    assert traced.hit.float().mean() > 0.99
    shaded = scene.shaded(view, torch.nn.functional.normalize(traced.points, dim=1))
    assert ((shaded - scene.colors(view, place)).abs()[traced.hit] < 0.01).all()
