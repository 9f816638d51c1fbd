"""Gaussian surfels: a naive renderer, finite differences of every gradient, closed forms, and a ball that grows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from splat_scenes import crooked_camera

from bench import BadInput, PointCloud, Run, Views
from bench.contract.ball_views import views_of_a_ball
from bench.geometry.topology import count_topology
from bench.methods.splatting.gaussian_surfels import meshing
from bench.methods.splatting.gaussian_surfels.fitting import Scene, Schedule, Tally, relocate
from bench.methods.splatting.gaussian_surfels.footprints import Surfels
from bench.methods.splatting.gaussian_surfels.losses import Weighting, consistency, loss_of
from bench.methods.splatting.gaussian_surfels.rendering import render
from bench.methods.splatting.gaussian_surfels.state import State
from bench.methods.splatting.projected.beginning import points_on_the_hull
from bench.methods.splatting.renderer.camera import Camera
from bench.methods.splatting.surfels import Surfels as Method
from bench.tasks.fit_shape import FitShape


def scene(count=40, seed=0):
    """Surfels of all sizes and opacities, most of them towards the camera, and their colours."""
    rng = np.random.default_rng(seed)
    frames = Rotation.random(count, random_state=seed).as_matrix()
    normals = rng.normal(size=(count, 3)) + [0, 0, -1.5]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    turned = np.cross(normals, frames[:, :, 0])
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    frames = np.stack([np.cross(turned, normals), turned, normals], axis=2)
    positions, scales = rng.uniform(-0.7, 0.7, (count, 3)), rng.uniform(0.02, 0.2, (count, 2))
    return Surfels(positions, frames, scales, rng.uniform(0.01, 0.95, count)), rng.uniform(0.1, 1, (count, 3))


def naive(surfels, colors, camera):
    """Maps and light by loops over pixels and surfels; ray and plane are intersected by solving a 3 x 3 system."""
    maps, light = np.zeros((camera.height, camera.width, 9)), np.ones((camera.height, camera.width))
    centres = camera.to_camera(surfels.positions)
    axes = camera.rotation @ surfels.frames
    inverse = np.linalg.inv(camera.intrinsics)
    for i in range(camera.height):
        for j in range(camera.width):
            ray = inverse @ [j + 0.5, i + 0.5, 1]
            for k in np.argsort(centres[:, 2]):
                if axes[k, :, 2] @ centres[k] >= 0:
                    continue
                spread = axes[k, :, :2] * surfels.scales[k]
                # centre + spread (u, v) = depth * ray
                u, v, depth = np.linalg.solve(np.column_stack([spread, -ray]), -centres[k])
                away = (camera.intrinsics @ centres[k] / centres[k, 2])[:2] - [j + 0.5, i + 0.5]
                square = u * u + v * v if depth > 0 else np.inf
                if away @ away / 0.5 < square:
                    square, depth = away @ away / 0.5, centres[k, 2]
                alpha = surfels.opacities[k] * np.exp(-square / 2)
                if alpha < 1 / 255:
                    continue
                maps[i, j] += light[i, j] * alpha * np.concatenate([colors[k], axes[k, :, 2], depth ** np.arange(3)])
                light[i, j] *= 1 - alpha
                if light[i, j] < 1e-4:
                    break
    return maps, light


# -- the renderer ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [0, 1])
def test_maps_match_plain_loops(seed):
    surfels, colors = scene(seed=seed)
    camera = crooked_camera()
    maps, light = naive(surfels, colors, camera)
    rendered = render(surfels, colors, camera)
    assert (light < 0.5).mean() > 0.1 < (light > 0.9).mean()
    np.testing.assert_allclose(rendered.maps, maps, atol=1e-11)
    np.testing.assert_allclose(rendered.light, light, atol=1e-12)


def test_weights_and_transmitted_light_sum_to_one():
    surfels, colors = scene(300, seed=3)
    rendered = render(surfels, colors, crooked_camera())
    np.testing.assert_allclose(rendered.covered + rendered.light, 1, atol=1e-12)
    assert rendered.light.min() < 1e-3
    weights = rendered.back(np.zeros(rendered.maps.shape)).weights
    assert weights.sum() == pytest.approx(rendered.covered.sum(), rel=1e-12)


def test_a_frontal_surfel_is_a_gaussian():
    camera = Camera.looking_at(np.array([0.0, 0, -2]), np.zeros(3), np.array([0.0, 1, 0]), 50.0, 33, 33)
    frame = camera.rotation.T @ np.diag([1.0, -1, -1])
    surfels = Surfels(np.zeros((1, 3)), frame[None], np.array([[0.2, 0.1]]), np.array([0.8]))
    rendered = render(surfels, np.ones((1, 3)), camera)
    x, y = (np.meshgrid(np.arange(33), np.arange(33))[axis] - 16.0 for axis in (0, 1))
    expected = 0.8 * np.exp(-0.5 * ((x / 5) ** 2 + (y / 2.5) ** 2))  # 50 / 2 pixels for each unit
    np.testing.assert_allclose(rendered.covered, np.where(expected < 1 / 255, 0, expected), atol=1e-12)
    np.testing.assert_allclose(rendered.maps[..., 7], 2 * rendered.covered, atol=1e-12)
    np.testing.assert_allclose(rendered.maps[..., 5], -rendered.covered, atol=1e-12)


def test_a_tiny_surfel_is_drawn_by_the_low_pass_filter():
    camera = Camera.looking_at(np.array([0.0, 0, -2]), np.zeros(3), np.array([0.0, 1, 0]), 50.0, 33, 33)
    frame = camera.rotation.T @ np.diag([1.0, -1, -1])
    surfels = Surfels(np.zeros((1, 3)), frame[None], np.full((1, 2), 1e-6), np.array([0.8]))
    covered = render(surfels, np.ones((1, 3)), camera).covered
    assert covered[16, 16] == pytest.approx(0.8) and covered[16, 17] == pytest.approx(0.8 * np.exp(-1))
    assert covered.sum() == pytest.approx(0.8 * np.pi, rel=0.01)  # 2 pi / 2 square pixels


def test_surfels_that_face_away_or_lie_behind_the_camera_are_not_drawn():
    surfels, colors = scene()
    camera = crooked_camera()
    away = surfels._replace(frames=surfels.frames * np.where((surfels.frames[:, 2, 2] < 0)[:, None, None], -1, 1))
    towards = ((away.positions - camera.center) * away.frames[:, :, 2]).sum(1) < 0
    drawn = render(away, colors, camera)
    assert not drawn.prints.shown[~towards].any()
    behind = render(surfels._replace(positions=surfels.positions - 10 * camera.rotation[2]), colors, camera)
    assert (behind.light == 1).all()


def test_the_number_of_threads_changes_nothing():
    surfels, colors = scene(100)
    slopes = np.random.default_rng(0).normal(size=(20, 24, 9))
    one, two = (render(surfels, colors, crooked_camera(), threads) for threads in (1, 2))
    np.testing.assert_array_equal(one.maps, two.maps)
    for first, second in zip(one.back(slopes), two.back(slopes), strict=True):
        np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("name", ["positions", "frames", "scales", "opacities", "colors"])
def test_gradients_match_finite_differences(name):
    surfels, colors = scene(30, seed=5)
    camera = crooked_camera()
    slopes = np.random.default_rng(0).normal(size=(camera.height, camera.width, 9))
    found = getattr(render(surfels, colors, camera).back(slopes), name)
    values = colors if name == "colors" else getattr(surfels, name)
    checked = 0
    for place in np.random.default_rng(1).permutation(values.size)[:90]:
        ends = []
        for sign in (-1, 1):
            moved = values.copy()
            moved.flat[place] += sign * 1e-7
            if name == "colors":
                rendered = render(surfels, moved, camera)
            else:
                rendered = render(surfels._replace(**{name: moved}), colors, camera)
            ends.append((rendered.maps * slopes).sum())
        expected = (ends[1] - ends[0]) / 2e-7
        assert found.flat[place] == pytest.approx(expected, rel=1e-5, abs=2e-6)
        checked += abs(expected) > 1e-3
    assert checked > 15


# -- losses ------------------------------------------------------------------------------------------------------------


def test_gradients_of_the_loss_match_finite_differences():
    rng = np.random.default_rng(0)
    camera = crooked_camera(9, 8)
    maps = rng.uniform(0.2, 0.9, (8, 9, 9))
    maps[..., 6] = rng.uniform(0.4, 0.99, (8, 9))
    maps[..., 7] = maps[..., 6] * (3 + 0.1 * rng.random((8, 9)))
    maps[..., 8] = 1.01 * maps[..., 7] ** 2 / maps[..., 6]
    wanted, mask = rng.random((8, 9, 3)), rng.random((8, 9)) < 0.5
    weighting = Weighting(0.7, 0.3, 2.0)
    _, slopes = loss_of(maps, wanted, mask, camera, weighting)
    for place in range(0, maps.size, 3):
        ends = []
        for sign in (-1, 1):
            moved = maps.copy()
            moved.flat[place] += sign * 1e-6
            ends.append(loss_of(moved, wanted, mask, camera, weighting)[0])
        assert slopes.flat[place] == pytest.approx((ends[1] - ends[0]) / 2e-6, rel=1e-4, abs=1e-7)


def test_distortion_is_the_sum_over_pairs():
    rng = np.random.default_rng(0)
    weights, depths = rng.random(6), rng.uniform(2, 3, 6)
    maps = np.zeros((1, 1, 9))
    maps[0, 0, 6:] = [(weights * depths**power).sum() for power in range(3)]
    loss, _ = loss_of(maps, np.zeros((1, 1, 3)), np.zeros((1, 1), bool), crooked_camera(1, 1), Weighting(0, 1, 0))
    pairs = [weights[i] * weights[j] * (depths[i] - depths[j]) ** 2 for i in range(6) for j in range(i)]
    assert loss == pytest.approx(sum(pairs), rel=1e-9)


def test_normals_of_depths_match_a_tilted_plane():
    camera = crooked_camera(12, 12)
    normal = np.array([0.3, -0.2, -0.9]) / np.linalg.norm([0.3, -0.2, -0.9])
    columns, rows = np.meshgrid(np.arange(12) + 0.5, np.arange(12) + 0.5)
    rays = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ np.linalg.inv(camera.intrinsics).T
    depth = (normal @ [0, 0, 3.0]) / (rays @ normal)
    maps = np.zeros((12, 12, 9))
    maps[..., 3:6], maps[..., 6], maps[..., 7] = 0.8 * normal, 0.8, 0.8 * depth
    slopes = np.zeros_like(maps)
    assert consistency(maps, camera.lens(), 1.0, slopes) == pytest.approx(0, abs=1e-9)
    maps[..., 3:6] *= -1
    assert consistency(maps, camera.lens(), 1.0, slopes) == pytest.approx(100 * 1.6, rel=1e-9)


# -- parameters --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def views():
    return views_of_a_ball(12, 40)


def some_state(count=60):
    start = FitShape(points=count, size=0.8).beginning()
    state, rng = State(start.points, start.normals, 0.15, 0.6), np.random.default_rng(0)
    state.logs = state.logs + rng.normal(0, 0.2, state.logs.shape)
    state.logits = state.logits + rng.normal(size=count)
    state.quaternions = (
        Rotation.from_quat(state.quaternions) * Rotation.from_rotvec(rng.normal(0, 0.3, (count, 3)))
    ).as_quat()
    return state


@pytest.mark.parametrize("name", ["positions", "turns", "logs", "logits"])
def test_gradients_of_parameters_match_finite_differences_of_the_loss(views, name):
    # The loss of a view, with shading: rotations change colours, shapes and normals.
    state, scene = some_state(), Scene(views, Weighting(1.0, 0.3, 0.05), 1)
    surfels = state.surfels()
    found = state.gradients(surfels, scene.look(surfels, 4)[1])[name]
    checked = 0
    for place in range(0, found.size, 2):
        ends = []
        for sign in (-1, 1):
            moved = some_state()
            change = np.zeros(found.shape)
            change.flat[place] = sign * 1e-7
            if name == "turns":
                moved.quaternions = (Rotation.from_quat(moved.quaternions) * Rotation.from_rotvec(change)).as_quat()
            else:
                setattr(moved, name, getattr(moved, name) + change)
            ends.append(scene.look(moved.surfels(), 4)[0])
        expected = (ends[1] - ends[0]) / 2e-7
        assert found.flat[place] == pytest.approx(expected, rel=1e-3, abs=1e-7)
        checked += abs(expected) > 1e-5
    assert checked > 10


def test_a_step_of_adam_matches_torch():
    import torch

    state, rng = some_state(), np.random.default_rng(1)
    free = torch.from_numpy(state.logs.copy()).requires_grad_()
    theirs = torch.optim.Adam([free], lr=0.02, betas=(0.9, 0.999), eps=1e-15)
    for _ in range(5):
        gradient = rng.normal(size=state.logs.shape)
        free.grad = torch.from_numpy(gradient)
        theirs.step()
        zero = {"positions": 0 * state.positions, "turns": 0 * state.positions, "logits": 0 * state.logits}
        state.step(zero | {"logs": gradient}, dict.fromkeys(("positions", "turns", "logs", "logits"), 0.02))
    np.testing.assert_allclose(state.logs, free.detach().numpy(), rtol=1e-9)


def test_transparent_surfels_are_relocated_by_splitting_others():
    state = some_state()
    state.logits[:4] = -9
    tally = Tally(len(state))
    tally.weight[:], tally.shown[:] = 1, 1
    tally.pull[10:15] = [5, 4, 3, 2, 1]
    before = state.positions.copy()
    relocate(state, tally, plan(), np.arange(60) == 4)
    np.testing.assert_allclose(0.5 * (state.positions[:5] + state.positions[10:15]), before[10:15], atol=1e-12)
    assert (state.opacities >= 0.05).all() and len(state) == 60
    np.testing.assert_array_equal(state.positions[15:], before[15:])


def test_distances_outside_a_mask_are_in_pixels(views):
    scene = Scene(views, Weighting(1, 0, 0), 1)
    axis = views.extrinsics[3, 0, :3]  # to the right, in the fourth image
    found = scene.outside(np.outer([0.0, 0.9, 1.15], axis))
    assert found[0] == found[1] == 0
    assert found[2] == pytest.approx((1.15 - 3 / np.sqrt(8)) / 3 * 1.3 * 40, abs=1.0)


def plan():
    return Schedule(**{name: getattr(Method(), name) for name in Schedule.__dataclass_fields__})


# -- the method --------------------------------------------------------------------------------------------------------


def test_surfels_grow_to_the_ball(views):
    start = FitShape(points=200, size=0.6).beginning()
    fitted = Method(steps=250).fit_shape(views, start, Run(seed=1))
    radius = np.linalg.norm(fitted.points, axis=1)
    assert np.sqrt(((radius - 1) ** 2).mean()) < 0.2  # from 0.4
    assert (fitted.points / radius[:, None] * fitted.normals).sum(1).mean() > 0.95
    assert 150 < len(fitted) <= 200


def test_runs_are_repeatable_and_stop_at_the_time_limit(views):
    start = FitShape(points=80).beginning()
    method = replace(Method(), steps=12, relocate_every=5)
    first, again = (method.fit_shape(views, start, Run(seed=2)) for _ in range(2))
    np.testing.assert_array_equal(first.points, again.points)
    stopped = method.fit_shape(views, start, Run(seconds=0.0))
    np.testing.assert_array_equal(stopped.points, start.points)
    np.testing.assert_allclose(stopped.normals, start.normals, atol=1e-12)


def test_points_on_the_hull_are_even_and_face_outward(views):
    cloud = points_on_the_hull(views, 300, Run(seed=1))
    radius = np.linalg.norm(cloud.points, axis=1)
    assert len(cloud) == 300
    assert np.abs(radius - 1).mean() < 0.05
    assert ((cloud.points / radius[:, None]) * cloud.normals).sum(1).min() > 0.7
    apart = cKDTree(cloud.points).query(cloud.points, 2)[0][:, 1]
    assert apart.min() > 0.5 * np.sqrt(4 * np.pi / 300)


def test_images_of_a_ball_give_its_mesh(views, monkeypatch):
    """Accurate to a pixel, which is 0.024 wide at the centre of the ball."""
    monkeypatch.setattr(meshing, "DEPTH", 6)  # cells of 0.035
    method = replace(Method(), steps=60, points=600)
    mesh = method.multiview(views_of_a_ball(12, 96), Run(seed=1))
    assert count_topology(mesh.vertices, mesh.faces).boundary_edges == 0 and mesh.volume > 0
    assert np.abs(np.linalg.norm(mesh.vertices, axis=1) - 1).mean() < 0.024
    assert len(method.multiview(views, Run(seconds=0)).faces)  # of the initial surfels
    trimmed = replace(method, steps=1, trim=0.2).multiview(views, Run(seed=1))
    assert count_topology(trimmed.vertices, trimmed.faces).boundary_edges > 0
    dark = Views(views.images, views.masks, views.extrinsics, views.intrinsics)
    with pytest.raises(BadInput, match="no lights"):
        method.multiview(dark, Run())
    empty = Views.of(views.arrays() | {"masks": np.zeros_like(views.masks)})
    with pytest.raises(BadInput, match="the masks disagree"):
        method.multiview(empty, Run())


def test_missing_lights_and_normals_are_named(views):
    start = FitShape(points=50).beginning()
    dark = Views(views.images, views.masks, views.extrinsics, views.intrinsics)
    with pytest.raises(BadInput, match="no lights"):
        Method().fit_shape(dark, start, Run())
    with pytest.raises(BadInput, match="no normals"):
        Method().fit_shape(views, PointCloud(start.points), Run())


@pytest.mark.parametrize(
    "wrong",
    [{"steps": 0}, {"scale": 0}, {"distortion": -1}, {"opacity": 1}, {"transparent": 2}, {"points": 3}, {"trim": 1}],
)
def test_wrong_parameters_are_named(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Method(**wrong)
