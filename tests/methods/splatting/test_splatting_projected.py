"""Points as smoothed depths: plain loops, finite differences, the visual hull of a ball, and the reach of gradients."""

from __future__ import annotations

import numpy as np
import pytest
from splat_scenes import crooked_camera

from bench import Run, Views
from bench.contract.ball_views import views_of_a_ball
from bench.methods.splatting.depth_points import DepthPoints
from bench.methods.splatting.projected.depth_image import Blur, draw
from bench.methods.splatting.projected.fitting import DepthImages
from bench.methods.splatting.projected.hull import carved, hull_depths
from bench.tasks.fit_shape import FitShape


@pytest.fixture(scope="module")
def views():
    return views_of_a_ball(20, 40)


def test_the_image_matches_plain_loops():
    rng = np.random.default_rng(0)
    place, depth = rng.uniform(-2, 22, (60, 2)), rng.uniform(1, 2, 60)
    depth[:3] = -1
    value, blur = 3 - depth, Blur(1.3, 0.4)
    image, total, nearest = draw(place, depth, value, (22, 18), blur)
    for i in range(18):
        for j in range(22):
            away = np.linalg.norm(place - [j + 0.5, i + 0.5], axis=1)
            near = (away <= 2.6) & (depth > 0)
            front = depth[near].min() if near.any() else np.inf
            assert nearest[i, j] == front
            weight = np.exp(-0.5 * (away / 1.3) ** 2) * (near & (depth <= front + 0.4))
            assert total[i, j] == pytest.approx(weight.sum())
            assert image[i, j] == pytest.approx((weight * value).sum() / max(weight.sum(), 1))
    assert 0.2 < (total > 1).mean() < 0.9


def test_gradients_match_finite_differences_without_changes_of_visibility():
    rng = np.random.default_rng(1)
    camera = crooked_camera(30, 26)
    empty = np.zeros((1, 26, 30))
    views = Views(np.zeros((1, 26, 30, 3), np.uint8), empty > 0, camera.extrinsics[None], np.asarray(camera.intrinsics))
    images = DepthImages(views, np.full(empty.shape, np.inf), Blur(1.5, 0.3))
    images.wanted = rng.random(empty.shape)
    points = rng.uniform(-0.7, 0.7, (40, 3))
    _, gradient = images.look(points, 0)
    differences = []
    for place in range(points.size):
        ends = []
        for sign in (-1, 1):
            moved = points.copy()
            moved.flat[place] += sign * 1e-8
            ends.append(images.look(moved, 0)[0])
        differences.append((ends[1] - ends[0]) / 2e-8)
    np.testing.assert_allclose(gradient.ravel(), differences, rtol=1e-4, atol=1e-7)
    assert (np.abs(differences) > 1e-5).sum() > 60


def test_pixels_that_a_point_does_not_cover_give_it_no_gradient(views):
    # The reason why the baseline fails (thesis, figure 3.24): a ball that is too small gets no gradient from a ring.
    images = DepthImages(views, hull_depths(views, 32), Blur(1.0, 0.1))
    point = np.zeros((1, 3)) - 0.2 * views.extrinsics[0, 2, :3]
    before = images.look(point, 0)[1]
    column, row = np.floor(views.project(point)[0][0, 0]).astype(int)
    keep = images.wanted[0, row - 3 : row + 4, column - 3 : column + 4].copy()
    images.wanted[0] = 0.7
    images.wanted[0, row - 3 : row + 4, column - 3 : column + 4] = keep
    np.testing.assert_array_equal(images.look(point, 0)[1], before)
    assert np.abs(before).max() > 0


def test_the_hull_of_a_ball_is_nearly_the_ball(views):
    inside, depths = carved(views, 40), hull_depths(views, 40)
    assert inside.mean() == pytest.approx(np.pi / 6, rel=0.05)
    origins, directions = views.rays(0)
    along = -(origins * directions).sum(-1)
    within = 1 - ((origins + along[..., None] * directions) ** 2).sum(-1)
    exact = (along - np.sqrt(np.maximum(within, 0))) * (directions @ views.extrinsics[0, 2, :3])
    clear = within > 0.2
    assert np.abs(depths[0] - exact)[clear].mean() < 0.06
    assert np.isinf(depths[0][~views.masks[0]]).all()


def test_points_move_towards_the_ball(views):
    start = FitShape(points=300, size=0.85).beginning()
    method = DepthPoints(steps=40, views=3, cells=30, sigma=1.5)
    first, again = (method.fit_shape(views, start, Run(seed=3)) for _ in range(2))
    np.testing.assert_array_equal(first.points, again.points)
    assert first.normals is None and len(first) == 300
    off = [np.sqrt(((np.linalg.norm(c.points, axis=1) - 1) ** 2).mean()) for c in (start, first)]
    assert off[1] < 0.7 * off[0]
    stopped = method.fit_shape(views, start, Run(seconds=0.0))
    np.testing.assert_array_equal(stopped.points, start.points)


@pytest.mark.parametrize("wrong", [{"steps": 0}, {"rate": 0}, {"sigma": -1}, {"depth_limit": 0}, {"cells": 0}])
def test_wrong_parameters_are_named(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        DepthPoints(**wrong)
