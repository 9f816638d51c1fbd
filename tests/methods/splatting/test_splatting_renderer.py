"""The renderer of splats, against a plain one of loops, closed forms and finite differences."""

from __future__ import annotations

from dataclasses import replace

import naive_splats as naive
import numpy as np
import pytest
import torch
from splat_scenes import ball, crooked_camera, random_splats

from bench import Views
from bench.methods.splatting.renderer.camera import Camera
from bench.methods.splatting.renderer.differentiable import render
from bench.methods.splatting.renderer.drawn import draw
from bench.methods.splatting.renderer.settings import Drawing
from bench.methods.splatting.renderer.shading import diffuse, of_depths
from bench.methods.splatting.renderer.weights import weights_at

SETTINGS = {
    "as it is": {},
    "no culling": {"cull": False},
    "two layers": {"layers": 2},
    "all in front": {"depth_limit": 10.0},
    "thin layers": {"depth_limit": 1e-3},
    "wide": {"cutoff": 3.0, "blur": 0.4},
    "no occlusion": {"occlusion": False, "epsilon": 1e-5},
}


def facing_camera(width=32, height=32, focal=40.0, distance=2.0):
    return Camera.looking_at(np.array([0.0, 0, -distance]), np.zeros(3), np.array([0.0, -1, 0]), focal, width, height)


def both(settings, count=60, seed=0):
    """A scene drawn by the renderer, and the inputs of the plain one for it."""
    points, normals, colors, sigma = random_splats(count, seed)
    camera, how = crooked_camera(), Drawing(opening=0.0, **settings)
    drawn = draw(points, normals, colors, sigma, camera, how)
    look = naive.Look(camera.intrinsics, camera.extrinsics, camera.width, camera.height)
    plain = naive.How(**settings)
    splats = naive.splats(points, normals, sigma, look, plain)
    return drawn, splats, naive.lists(splats, look, plain), colors, look, plain


def some_gradient(drawn, seed=1):
    """A gradient of an image, zero at some pixels."""
    rng = np.random.default_rng(seed)
    gradient = rng.normal(size=drawn.image.shape)
    gradient[rng.random(gradient.shape[:2]) < 0.2] = 0
    return gradient


# -- against the plain renderer ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS)
def test_lists_and_images_match_the_plain_renderer(settings):
    drawn, splats, lists, colors, look, how = both(settings)
    assert [splat is not None for splat in splats] == drawn.ellipses.shown.tolist()
    for (i, j), entries in lists.items():
        count = len(entries)
        assert drawn.lists.index[i, j, :count].tolist() == [k for k, _, _ in entries]
        assert (drawn.lists.index[i, j, count:] == -1).all()
        np.testing.assert_allclose(drawn.lists.depth[i, j, :count], [depth for _, depth, _ in entries], rtol=1e-12)
        np.testing.assert_allclose(drawn.lists.rho[i, j, :count], [rho for _, _, rho in entries], rtol=1e-9)
    np.testing.assert_allclose(drawn.image, naive.image(lists, colors, look, how), atol=1e-12)
    assert 0.3 < drawn.covered.mean() < 1 and drawn.lists.front.max() > (1 if how.depth_limit > 0.01 else 0)


@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS)
def test_gradients_of_positions_match_the_plain_renderer(settings):
    drawn, splats, lists, colors, look, how = both(settings, count=40)
    gradient = some_gradient(drawn)
    wanted = naive.position_gradients(splats, lists, colors, gradient, look, how)
    for kind, expected in wanted.items():
        found = replace(drawn, how=replace(drawn.how, gradient=kind)).position_gradient(gradient)
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-9 * np.abs(expected).max())
        assert (found[drawn.ellipses.shown] != 0).any(axis=1).mean() > 0.8


def test_gradients_of_attributes_match_the_plain_renderer():
    drawn, _, lists, colors, _, how = both({})
    gradient = some_gradient(drawn)
    expected = naive.attribute_gradient(lists, gradient, len(colors), how)
    np.testing.assert_allclose(drawn.attribute_gradient(gradient), expected, atol=1e-12)


def test_the_scene_covers_all_cases():
    drawn, splats, lists, _, _, how = both({}, count=40)
    kinds = set()
    for entries in lists.values():
        for k, splat in enumerate(splats):
            if splat is not None:
                kinds.add(naive.case_of(k, splat, entries, how).__name__)
    assert kinds == {"case_a", "case_b", "case_c", "case_d"}
    assert drawn.occlusions().sum() > 30


# -- closed forms ------------------------------------------------------------------------------------------------------


def test_constant_colours_stay_constant():
    points, normals, _, sigma = random_splats(80)
    drawn = draw(points, normals, np.full((80, 1), 0.7), sigma, crooked_camera())
    np.testing.assert_allclose(drawn.image[drawn.covered], 0.7, rtol=1e-12)
    assert (drawn.image[~drawn.covered] == 0).all()


def test_a_splat_from_the_front_is_a_disc():
    for sigma, distance, cutoff in [(0.1, 2.0, 1.0), (0.05, 3.0, 2.5)]:
        camera = facing_camera(distance=distance)
        one = (np.zeros((1, 3)), np.array([[0.0, 0, -1]]), np.ones((1, 1)), sigma)
        drawn = draw(*one, camera, Drawing(cutoff=cutoff))
        radius = np.sqrt(2 * cutoff * ((40 * sigma / distance) ** 2 + 1))
        middles = np.arange(32) + 0.5 - 16
        assert (drawn.covered == (middles[:, None] ** 2 + middles**2 <= radius**2)).all()
        np.testing.assert_allclose(drawn.ellipses.half, radius)


def test_weights_integrate_to_the_area_of_a_pixel_on_the_surface():
    # A Gaussian in the tangent plane has the integral 1; in pixels, the integral is the ratio of areas.
    camera = crooked_camera(200, 200)
    one = (np.array([[0.1, 0.2, 0.1]]), np.array([[0.3, 0.1, -0.9486832980505138]]), np.ones((1, 1)), 0.05)
    drawn = draw(*one, camera, Drawing(cutoff=25.0))
    (fx, fy, *_), position = camera.lens(), drawn.ellipses.position[0]
    factor = fx * fy * abs(position @ drawn.ellipses.normal[0]) / position[2] ** 3
    np.testing.assert_allclose(drawn.total.sum(), factor, rtol=1e-6)


def test_the_depth_is_that_of_the_tangent_plane():
    drawn, *_ = both({"cutoff": 2.0})
    camera, seen = drawn.camera, drawn.lists.index[..., 0] >= 0
    views = Views(
        np.zeros((1, 20, 24, 3), np.uint8), np.zeros((1, 20, 24), bool), camera.extrinsics[None], camera.intrinsics
    )
    rows, columns = np.nonzero(seen)
    k, depth = drawn.lists.index[rows, columns, 0], drawn.lists.depth[rows, columns, 0]
    places = views.unproject(0, np.column_stack([columns, rows]) + 0.5, depth)
    points, normals, _, sigma = random_splats(60)
    off = np.abs(((places - points[k]) * normals[k]).sum(axis=1))
    clipped = np.abs(depth - drawn.ellipses.position[k, 2]) > 0.999 * sigma[k] * 2
    assert off[~clipped].max() < 1e-12 and clipped.mean() < 0.2


def test_a_point_of_any_width_is_pulled_to_an_empty_pixel():
    gradient = np.zeros((32, 32, 1))
    gradient[20, 25] = -2.0
    found = []
    for sigma in (0.02, 0.05, 0.1):
        one = (np.zeros((1, 3)), np.array([[0.0, 0, -1]]), np.full((1, 1), 0.5), sigma)
        found.append(draw(*one, facing_camera(), Drawing(opening=0.0)).position_gradient(gradient)[0])
    dx, dy, focal = 25.5 - 16, 20.5 - 16, 40.0
    expected = -2.0 * 0.5 * np.array([dx, dy, 0]) / (dx * dx + dy * dy + 0.01) * focal / 2.0
    # Up is -y for this camera, so rows grow with y.
    for each in found:
        np.testing.assert_allclose(each, expected, rtol=1e-9, atol=1e-12)
    away = draw(*one, facing_camera()).position_gradient(-gradient)
    assert (away == 0).all()  # Eq. 3.13


def test_the_pull_of_gaussians_depends_on_the_width_and_is_bounded_in_reach():
    gradient = np.zeros((32, 32, 1))
    gradient[16, 25] = -1.0
    found = []
    for sigma in (0.02, 0.1, 0.3):
        one = (np.zeros((1, 3)), np.array([[0.0, 0, -1]]), np.full((1, 1), 0.5), sigma)
        found.append(abs(draw(*one, facing_camera(), Drawing(gradient="rbf")).position_gradient(gradient)[0, 0]))
    assert found[0] < 1e-9 and found[2] > 100 * found[0] and len(set(found)) == 3


def test_symmetric_errors_around_a_point_cancel():
    one = (np.zeros((1, 3)), np.array([[0.0, 0, -1]]), np.full((1, 1), 0.5), 0.1)
    drawn = draw(*one, facing_camera())
    assert drawn.covered.sum() > 4
    gradient = np.ones((32, 32, 1))
    np.testing.assert_allclose(drawn.position_gradient(gradient), 0, atol=1e-9)


def test_an_occluded_point_is_pulled_to_the_front():
    points = np.array([[0.0, 0, 0], [0, 0, 1.0]])
    normals = np.array([[0.0, 0, -1], [0, 0, -1]])
    drawn = draw(points, normals, np.array([[0.2], [1.0]]), 0.1, facing_camera())
    gradient = np.zeros((32, 32, 1))
    gradient[16, 16] = -1.0  # brighter
    back = drawn.position_gradient(gradient)
    assert back[1, 2] > 0  # descent moves it towards the camera, which is at negative z
    assert drawn.occlusions()[1] > 0 and drawn.occlusions()[0] == 0


def test_more_layers_change_nothing_where_few_overlap():
    points, normals, colors, sigma = ball(300)
    few, many = (draw(points, normals, colors, sigma, crooked_camera(), Drawing(layers=k)) for k in (5, 60))
    one_layer = (many.lists.front <= 5)[..., None]
    assert one_layer.mean() > 0.5
    np.testing.assert_allclose(np.where(one_layer, few.image - many.image, 0), 0, atol=1e-12)


# -- blocks of pixels, threads -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("shift", [3, 12])
def test_blocks_of_pixels_approximate_single_pixels(shift):
    points, normals, colors, sigma = ball(400)
    camera = crooked_camera(97, 83)
    drawn = draw(points, normals, colors, sigma, camera, Drawing(opening=0.0))
    wanted = np.roll(drawn.image, shift, axis=1)
    gradient = np.sign(drawn.image - wanted) / (drawn.image + wanted + 0.01)
    exact = drawn.position_gradient(gradient)
    for opening, bound in [(1.0, 0.06), (2.0, 0.03)]:
        by_blocks = replace(drawn, how=Drawing(opening=opening)).position_gradient(gradient)
        assert 0 < np.linalg.norm(by_blocks - exact) < bound * np.linalg.norm(exact)
    everything = replace(drawn, how=Drawing(opening=1e6)).position_gradient(gradient)
    np.testing.assert_allclose(everything, exact, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("window", [5.0, 12.0, 30.0])
def test_a_window_limits_the_pull(window):
    points, normals, colors, sigma = ball(300)
    camera = crooked_camera(97, 83)
    drawn = draw(points, normals, colors, sigma, camera, Drawing(opening=0.0, window=window))
    gradient = some_gradient(drawn)
    found, place = drawn.position_gradient(gradient), drawn.ellipses.place
    everywhere = replace(drawn, how=Drawing(opening=0.0))
    for k in np.flatnonzero(drawn.ellipses.shown)[::29]:
        rows, columns = np.mgrid[:83, :97] + 0.5
        near = np.maximum(np.abs(columns - place[k, 0]), np.abs(rows - place[k, 1])) <= window
        alone = everywhere.position_gradient(np.where(near[..., None], gradient, 0))
        np.testing.assert_allclose(found[k], alone[k], rtol=1e-9, atol=1e-12)
    by_blocks = replace(drawn, how=Drawing(window=window)).position_gradient(np.abs(gradient) * -1)
    exact = drawn.position_gradient(np.abs(gradient) * -1)
    assert np.linalg.norm(by_blocks - exact) < 0.2 * np.linalg.norm(exact)


def test_threads_change_nothing():
    points, normals, colors, sigma = ball(400)
    found = []
    for threads in (1, 2):
        drawn = draw(points, normals, colors, sigma, crooked_camera(60, 60), threads=threads)
        found.append((drawn.image, drawn.position_gradient(some_gradient(drawn)), drawn.lists.index))
    assert all((a == b).all() for a, b in zip(*found, strict=True))


# -- weights, torch, shading -------------------------------------------------------------------------------------------


def test_differentiable_weights_match_the_drawn_ones():
    drawn, *_ = both({})
    rows, columns = np.nonzero(drawn.lists.index[..., 0] >= 0)
    k = drawn.lists.index[rows, columns, 0]
    known = (drawn.ellipses.position[k], drawn.ellipses.normal[k], drawn.sigma[k])
    tensors = [torch.from_numpy(array) for array in (*known, np.column_stack([columns, rows]) + 0.5)]
    weights = weights_at(*tensors, drawn.camera.lens(), drawn.how.blur)
    np.testing.assert_allclose(weights, drawn.lists.rho[rows, columns, 0], rtol=1e-9)


@pytest.mark.parametrize("cull", [True, False])
def test_gradients_through_weights_match_finite_differences(cull):
    points, normals, colors, sigma = random_splats(30, seed=3)
    camera, how = crooked_camera(), Drawing(cull=cull, depth_limit=0.5, cutoff=8.0, layers=30, weights=True)
    tensors = [torch.from_numpy(array).requires_grad_() for array in (points, normals, colors)]
    image, drawn = render(*tensors, torch.from_numpy(sigma), camera, how)
    gradient = some_gradient(drawn)
    _, by_normal, _ = torch.autograd.grad((image * torch.from_numpy(gradient)).sum(), tensors)
    by_position, _ = drawn.weight_gradients(gradient)
    checked, step = 0, 1e-6
    for k in range(30):
        for axis in range(3):
            for which, found in ((0, by_position), (1, by_normal)):
                values, pictures = [], []
                for sign in (-1, 1):
                    moved = [points.copy(), normals.copy()]
                    moved[which][k, axis] += sign * step
                    moved[1] /= np.linalg.norm(moved[1], axis=1, keepdims=True)
                    picture = draw(*moved, colors, sigma, camera, how)
                    pictures.append((picture.lists.index, picture.lists.front))
                    values.append((picture.image * gradient).sum())
                if all((a == b).all() for a, b in zip(*pictures, strict=True)):  # no change of visibility
                    slope = (values[1] - values[0]) / (2 * step)
                    assert float(found[k, axis]) == pytest.approx(slope, rel=1e-4, abs=1e-6)
                    checked += slope != 0
    assert checked > 60


def test_torch_gets_the_gradients_of_the_renderer():
    points, normals, colors, sigma = random_splats(40)
    tensors = [torch.from_numpy(array).requires_grad_() for array in (points, 2 * normals, colors)]
    image, drawn = render(*tensors, torch.from_numpy(sigma), crooked_camera(), Drawing())
    np.testing.assert_array_equal(image.detach(), drawn.image)
    gradient = some_gradient(drawn)
    (image * torch.from_numpy(gradient)).sum().backward()
    np.testing.assert_allclose(tensors[0].grad, drawn.position_gradient(gradient))
    np.testing.assert_allclose(tensors[2].grad, drawn.attribute_gradient(gradient))
    assert tensors[1].grad is None or (tensors[1].grad == 0).all()


def test_normals_get_gradients_through_shading():
    points, normals, _, sigma = random_splats(40)
    free = torch.from_numpy(normals).requires_grad_()
    lights = torch.eye(3, dtype=torch.float64) * -1
    colors = diffuse(torch.nn.functional.normalize(free, dim=1), lights, 0.9 * torch.eye(3, dtype=torch.float64), 0.1)
    image, drawn = render(torch.from_numpy(points), free, colors, torch.from_numpy(sigma), crooked_camera())
    image.square().sum().backward()
    seen = np.unique(drawn.lists.index[drawn.lists.front > 0, 0])
    assert (free.grad[seen].abs().sum(1) > 0).float().mean() > 0.8


def test_shading_in_closed_form():
    normals = torch.tensor([[0.0, 0, 1], [0, 0, -1], [0, 0.6, 0.8]])
    towards, color = torch.tensor([[0.0, 0, 1], [0, 1, 0]]), torch.tensor([[1.0, 0, 0], [0, 0.5, 0]])
    expected = torch.tensor([[1.1, 0.1, 0.1], [0.1, 0.1, 0.1], [0.9, 0.4, 0.1]])
    torch.testing.assert_close(diffuse(normals, towards, color, 0.1), expected)
    depths = of_depths(torch.tensor([[0.0, 0, 2], [0, 1, 4]]), torch.zeros(3), torch.tensor([0.0, 0, 1]))
    assert depths[:, 0].tolist() == [1.0, 0.0]


@pytest.mark.parametrize("wrong", [{"cutoff": 0}, {"layers": 0}, {"grazing": 1}, {"opening": -1}, {"gradient": "x"}])
def test_wrong_settings_are_named(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Drawing(**wrong)


def test_empty_clouds_and_points_behind_the_camera_give_empty_images():
    camera = facing_camera()
    nothing = draw(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 2)), 0.1, camera)
    assert nothing.image.shape == (32, 32, 2) and not nothing.covered.any()
    assert nothing.position_gradient(np.ones((32, 32, 2))).shape == (0, 3)
    behind = draw(np.array([[0.0, 0, -5]]), np.array([[0.0, 0, 1]]), np.ones((1, 1)), 0.1, camera, Drawing(cull=False))
    assert not behind.covered.any() and (behind.position_gradient(-np.ones((32, 32, 1))) == 0).all()
