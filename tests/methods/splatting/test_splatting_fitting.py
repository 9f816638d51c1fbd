"""The task fit_shape, and DSS: loss and descent against torch, and a ball that grows to its size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree
from splat_scenes import ball, crooked_camera

from bench import BadInput, PointCloud, Run, UsageError, Views
from bench.contract.ball_views import views_of_a_ball
from bench.contract.views_file import load_views
from bench.methods.splatting.dss import Dss
from bench.methods.splatting.fitting.cycles import Schedule
from bench.methods.splatting.fitting.descent import Descent
from bench.methods.splatting.fitting.refinement import focus
from bench.methods.splatting.fitting.silhouettes import Silhouettes
from bench.methods.splatting.fitting.smape import smape
from bench.methods.splatting.fitting.views import Gallery, Window
from bench.methods.splatting.renderer.blending import blend
from bench.methods.splatting.renderer.camera import Camera
from bench.methods.splatting.renderer.settings import Drawing
from bench.tasks.fit_shape import FitShape

# -- loss and descent --------------------------------------------------------------------------------------------------


def test_the_loss_and_its_derivative_match_torch():
    rng = np.random.default_rng(0)
    image, wanted = rng.random((5, 4, 3)), rng.random((5, 4, 3))
    image[0], wanted[1] = 0, 0
    free = torch.from_numpy(image).requires_grad_()
    other = torch.from_numpy(wanted)
    expected = ((free - other).abs() / (free.abs() + other.abs() + 0.01)).mean()
    expected.backward()
    loss, slope = smape(image, wanted)
    assert loss == pytest.approx(expected.item(), rel=1e-12)
    np.testing.assert_allclose(slope, free.grad, atol=1e-15)


def test_the_descent_matches_torch():
    rng = np.random.default_rng(0)
    values = rng.normal(size=(4, 3))
    free = torch.from_numpy(values.copy()).requires_grad_()
    theirs = torch.optim.SGD([free], lr=0.3, momentum=0.1, nesterov=True)
    plan = torch.optim.lr_scheduler.ReduceLROnPlateau(theirs, factor=0.5, patience=3, threshold=1e-4)
    ours = Descent(0.3, 0.5, 0.1, patience=3)
    for step in range(30):
        gradient, loss = rng.normal(size=(4, 3)), float(max(1.0, 2 - step / 5))
        free.grad = torch.from_numpy(gradient)
        torch.nn.utils.clip_grad_value_([free], 0.5)
        theirs.step()
        plan.step(loss)
        values = ours.step(values, gradient)
        ours.look(loss)
        np.testing.assert_allclose(values, free.detach(), rtol=1e-12)
        assert ours.rate == theirs.param_groups[0]["lr"]
    assert ours.rate < 0.3


def test_the_window_shrinks_to_its_minimum():
    plan = Schedule(8, 1, 1, 1, 1.0, 1.0, 1.0, 0.1, 2, 1.0, 0.25, 0.5, 0.1, 1.0, 0, 0.3)
    assert [plan.window_at(cycle, 200) for cycle in range(3)] == [50, 25, 20]
    everywhere = Schedule(8, 1, 1, 1, 1.0, 1.0, 1.0, 0.1, 2, 1.0, 0.0, 0.5, 0.1, 1.0, 0, 0.3)
    assert everywhere.window_at(3, 200) == 0


# -- silhouettes -------------------------------------------------------------------------------------------------------


def test_points_outside_a_silhouette_move_to_its_nearest_pixel():
    rng = np.random.default_rng(0)
    camera, points = crooked_camera(), rng.uniform(-0.8, 0.8, (300, 3))
    mask = np.zeros((20, 24), dtype=bool)
    mask[7:12, 9:15] = True
    x, y, _ = (camera.to_camera(points) @ np.asarray(camera.intrinsics).T).T / camera.to_camera(points)[:, 2]
    moved = points + Silhouettes(mask[None], [camera]).offsets(points, np.array([0]))
    there = camera.to_camera(moved) @ np.asarray(camera.intrinsics).T
    np.testing.assert_allclose(there[:, 2], camera.to_camera(points)[:, 2])  # depths do not change
    u, v = there[:, 0] / there[:, 2], there[:, 1] / there[:, 2]
    rows, columns = np.nonzero(mask)
    centers = np.column_stack([columns, rows]) + 0.5
    pixels = np.clip(np.floor([x, y]), 0, [[23], [19]]).T + 0.5  # the silhouette nearest to these pixels counts
    for k, own in enumerate(pixels):
        least = np.linalg.norm(centers - own, axis=1).min()
        if np.array_equal(moved[k], points[k]):
            assert least <= 1.5
        else:
            assert np.linalg.norm(centers - [u[k], v[k]], axis=1).min() < 1e-9
            assert np.linalg.norm(own - [u[k], v[k]]) == pytest.approx(least)


def test_silhouettes_carve_a_cube_of_points_to_a_ball(views):
    points = np.random.default_rng(0).uniform(-1.2, 1.2, (2000, 3))
    silhouettes = Silhouettes(views.masks, [Camera.of(views, number) for number in range(len(views))])
    before = points
    for _ in range(10):
        points = points + silhouettes.offsets(points, np.arange(len(views)))
    radius, was = np.linalg.norm(points, axis=1), np.linalg.norm(before, axis=1)
    assert radius.max() < 1.15 and was.max() > 1.8
    np.testing.assert_array_equal(points[was < 0.95], before[was < 0.95])


def test_views_without_a_silhouette_move_nothing(views):
    silhouettes = Silhouettes(np.zeros_like(views.masks), [Camera.of(views, n) for n in range(len(views))])
    assert not silhouettes.offsets(np.random.default_rng(0).normal(size=(50, 3)), np.arange(len(views))).any()


# -- refinement --------------------------------------------------------------------------------------------------------


def test_a_part_of_an_image_is_drawn_like_the_whole(views):
    points, normals, _, _ = ball(500)
    gallery = Gallery.of(views, Drawing(), 1)
    part = gallery.cropped([Window(3, 7, 11, 20, 16), Window(5, 0, 0, 20, 16)])
    whole = gallery.draw(points, normals, 0.05, 3).image
    np.testing.assert_allclose(part.draw(points, normals, 0.05, 0).image, whole[11:27, 7:27], atol=1e-12)
    np.testing.assert_array_equal(part.wanted[1], gallery.wanted[5][:16, :20])
    np.testing.assert_array_equal(part.lights.directions[0], views.light_directions[3])


def test_the_largest_differences_of_the_images_are_found_one_by_one(views):
    points, normals, _, _ = ball(2000)
    spoilt = normals.copy()
    for spot, size in ((np.array([1.0, 0, 0]), 0.35), (np.array([0, 0, 1.0]), 0.25)):
        near = np.linalg.norm(points - spot, axis=1) < size
        spoilt[near] = np.roll(points[near], 1, axis=1) * 0.8 + 0.6 * spot
        spoilt[near] /= np.linalg.norm(spoilt[near], axis=1, keepdims=True)
    gallery = Gallery.of(views, Drawing(), 1)
    first = focus(gallery, points, spoilt, 0.03, 0.4, 3, [], 0.5)
    assert np.linalg.norm(first.place - [1, 0, 0]) < 0.45 and len(first.gallery.cameras) == 3
    second = focus(gallery, points, spoilt, 0.03, 0.4, 3, [first.place], 0.5)
    assert np.linalg.norm(second.place - [0, 0, 1]) < 0.35
    assert focus(gallery, points, spoilt, 0.03, 0.4, 3, [np.zeros(3)], 9.0) is None
    for view, camera in zip(first.views, first.gallery.cameras, strict=True):  # the position is within the crops
        x, y, z = camera.to_camera(first.place[None])[0] @ np.asarray(camera.intrinsics).T
        assert 0 <= x / z <= camera.width and 0 <= y / z <= camera.height
        assert camera.width == round(0.4 * views.width) and view < len(views)


def test_refinement_lowers_the_error_where_it_is_largest(views):
    start = FitShape(points=400, size=1.0).beginning()
    normals = start.normals.copy()
    near = np.linalg.norm(start.points - [1, 0, 0], axis=1) < 0.4
    normals[near] = np.roll(normals[near], 1, axis=1)
    method = Dss(cycles=1, normal_steps=3, point_steps=0, projection=0, repulsion=0)
    fits = (
        replace(method, refinements=count).fit_shape(views, PointCloud(start.points, normals), Run(seed=1))
        for count in (0, 4)
    )
    off = [np.linalg.norm(fitted.normals - start.normals, axis=1)[near].mean() for fitted in fits]
    assert off[1] < 0.7 * off[0]


# -- gradients of images -----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def views():
    return views_of_a_ball(12, 48)


def test_a_ball_of_the_right_size_looks_like_the_images(views):
    points, normals, _, _ = ball(2000)
    gallery = Gallery.of(views, Drawing(), 1)
    chosen = np.arange(12)
    losses = [gallery.look(size * points, normals, 0.03, chosen, False).loss for size in (0.8, 1.0, 1.2)]
    assert losses[1] < 0.4 * min(losses[0], losses[2])
    drawn = gallery.draw(points, normals, 0.03, 0)
    inside = views.masks[0] & drawn.covered
    assert np.abs(drawn.image - gallery.wanted[0])[inside].mean() < 0.03
    assert (views.masks[0] & ~drawn.covered).mean() < 0.005  # outside, splats are wider by a pixel


def test_points_are_pulled_outwards_if_the_ball_is_too_small_and_inwards_if_too_large(views):
    points, normals, _, _ = ball(500)
    gallery = Gallery.of(views, Drawing(window=12.0), 1)
    for size, sign in ((0.7, -1), (1.3, 1)):
        gradient = gallery.look(size * points, normals, 0.06, np.arange(12), False).gradient
        assert (sign * (gradient * normals).sum(1) > 0).mean() > 0.9


def test_without_a_window_the_pull_of_a_ring_cancels(views):
    # The sum of d / |d|^2 over a ring vanishes inside it, so all pixels together only pull points to the centre.
    points, normals, _, _ = ball(500)
    gradient = Gallery.of(views, Drawing(), 1).look(0.7 * points, normals, 0.06, np.arange(12), False).gradient
    assert ((gradient * normals).sum(1) > 0).mean() > 0.8


def test_the_gradient_of_normals_matches_finite_differences(views):
    points, normals, _, _ = ball(300)
    rng = np.random.default_rng(0)
    normals = normals + 0.3 * rng.normal(size=normals.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    gallery, chosen = Gallery.of(views, Drawing(), 1), np.array([3])
    # The shape of a splat depends on its normal too, but this derivative covers only the shading.
    look = gallery.look(points, normals, 0.08, chosen, True)
    drawn = gallery.draw(points, normals, 0.08, 3)
    checked = 0
    for k in np.flatnonzero(drawn.ellipses.shown)[:40]:
        for axis in range(3):
            values = []
            for sign in (-1, 1):
                moved = normals.copy()
                moved[k, axis] += sign * 1e-6
                image, _ = blend(drawn.lists, gallery.shaded(moved, 3)[0])
                values.append(smape(replace(drawn, image=image).image, gallery.wanted[3])[0])
            slope = (values[1] - values[0]) / 2e-6 / 1.01
            assert look.gradient[k, axis] == pytest.approx(slope, rel=1e-3, abs=1e-8)
            checked += slope != 0
    assert checked > 40


# -- the method and the task -------------------------------------------------------------------------------------------


def spread(cloud):
    """RMS distance from the unit sphere, and the mean cosine of normals with radii."""
    radius = np.linalg.norm(cloud.points, axis=1)
    cosine = (cloud.points / radius[:, None] * cloud.normals).sum(1)
    return float(np.sqrt(((radius - 1) ** 2).mean())), float(cosine.mean())


def test_dss_grows_a_ball_to_its_size(views):
    start = FitShape(points=400, size=0.7).beginning()
    fitted = Dss(cycles=2).fit_shape(views, start, Run(seed=1))
    assert len(fitted) == 400 and spread(start)[0] == pytest.approx(0.3)
    assert spread(fitted)[0] < 0.1 and spread(fitted)[1] > 0.95


def test_runs_are_repeatable_and_stop_at_the_time_limit(views):
    start = FitShape(points=100).beginning()
    method = Dss(cycles=1, point_steps=3, normal_steps=2)
    first, again = (method.fit_shape(views, start, Run(seed=2)) for _ in range(2))
    np.testing.assert_array_equal(first.points, again.points)
    assert not np.array_equal(first.points, start.points)
    stopped = method.fit_shape(views, start, Run(seconds=0.0))
    np.testing.assert_array_equal(stopped.points, start.points)


def test_intermediate_clouds_are_traced(views):
    offered = []
    run = Run()
    run.on_trace = lambda output, keep=False: offered.append(output)
    Dss(cycles=2, point_steps=1, normal_steps=1).fit_shape(views, FitShape(points=50).beginning(), run)
    assert len(offered) == 2 and all(isinstance(cloud, PointCloud) for cloud in offered)


def test_missing_lights_and_normals_are_named(views):
    start = FitShape(points=50).beginning()
    dark = Views(views.images, views.masks, views.extrinsics, views.intrinsics)
    with pytest.raises(BadInput, match="no lights"):
        Dss().fit_shape(dark, start, Run())
    with pytest.raises(BadInput, match="no normals"):
        Dss().fit_shape(views, PointCloud(start.points), Run())


@pytest.mark.parametrize(
    "wrong",
    [
        *({"cycles": 0}, {"width": 0}, {"window": -1}, {"repulsion": -1}),
        *({"silhouettes": 2}, {"loss_epsilon": 0}, {"refinements": -1}, {"refined_part": 0}),
    ],
)
def test_wrong_parameters_are_named(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Dss(**wrong)


def test_the_initial_square_faces_the_first_camera(views):
    cloud = FitShape(start="square", points=400, size=0.5).input(views)["cloud"]
    forward = views.extrinsics[0, 2, :3]
    np.testing.assert_allclose(cloud.normals, np.tile(-forward, (400, 1)))
    np.testing.assert_allclose(cloud.points @ forward, 0, atol=1e-12)
    pixels, _ = views.project(cloud.points)
    assert 0.9 < np.ptp(pixels[0, :, 0]) / np.ptp(pixels[0, :, 1]) < 1.1


@pytest.mark.parametrize("start", ["sphere", "cube"])
def test_the_initial_points_lie_evenly_on_their_surface(start):
    cloud = FitShape(start=start, points=1000, size=0.5).beginning()
    far = np.linalg.norm(cloud.points, axis=1) if start == "sphere" else np.abs(cloud.points).max(axis=1)
    np.testing.assert_allclose(far, 0.5)
    np.testing.assert_allclose(np.linalg.norm(cloud.normals, axis=1), 1)
    assert len(cloud) == 1000 and ((cloud.points * cloud.normals).sum(1) > 0.2).all()
    nearest = cKDTree(cloud.points).query(cloud.points, 2)[0][:, 1]
    assert nearest.std() < 0.35 * nearest.mean()


def test_views_come_from_a_file_and_faults_are_named(tmp_path, views):
    path = tmp_path / "views.npz"
    np.savez(path, **views.arrays())
    input, frame = FitShape(points=40).read([str(path)])
    assert frame.radius == 1 and len(input["cloud"]) == 40
    np.testing.assert_array_equal(input["views"].images, views.images)
    assert load_views(str(path)).light_colors is not None
    np.savez(path, images=views.images)
    with pytest.raises(UsageError, match="no array masks"):
        load_views(str(path))
    path.write_text("no archive")
    with pytest.raises(UsageError, match=r"views\.npz"):
        load_views(str(path))
    with pytest.raises(UsageError, match="3 files"):
        FitShape().read(["a", "b", "c"])


@pytest.mark.parametrize("wrong", [{"start": "cone"}, {"points": 3}, {"size": 0}])
def test_wrong_parameters_of_the_task_are_named(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        FitShape(**wrong)


def test_images_of_the_ball_are_shaded_by_its_normals(views):
    _, directions = views.rays(0)
    origins = views.centers[0]
    along = -(directions @ origins)
    closest = origins + along[..., None] * directions
    mask = (closest**2).sum(-1) < 1
    np.testing.assert_array_equal(views.masks[0], mask)
    assert views.images[0][~mask].max() == 0 and views.images[0][mask].min() >= 25  # ambient
    # Red light comes from the camera: red is brightest in the centre.
    assert views.images[0][24, 24, 0] > 250
