"""The visual hull and space carving: balls in closed form, masks that are reproduced, what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from bench import BadInput, Frame, Run, Views
from bench.contract.ball_views import views_of_a_ball
from bench.methods.classical.carving.silhouettes import Silhouettes, mask_distances
from bench.methods.classical.visual_hull import VisualHull

RADIUS = 0.6
PIXEL = 0.6 * 3 / (1.3 * 96)  # of balls(): depth by focal length


def balls(count: int, center=(0.0, 0.0, 0.0), pixels: int = 96) -> Views:
    """Images of a ball of radius 0.6."""
    return views_of_a_ball(count, pixels).in_frame(Frame(-np.asarray(center) / RADIUS, 1 / RADIUS))


def changed(views: Views, **arrays) -> Views:
    return Views.of(views.arrays() | arrays)


def on_sphere(count: int, seed: int = 0) -> np.ndarray:
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return RADIUS * points / np.linalg.norm(points, axis=1, keepdims=True)


# -- the field of the hull ---------------------------------------------------------------------------------------------


def test_mask_distances_are_those_to_the_border_of_pixels():
    """Of a half plane, the distance to the line between two columns; of a full mask, that nothing is outside."""
    mask = np.zeros((6, 9), dtype=bool)
    mask[:, :4] = True
    assert mask_distances(mask) == pytest.approx(np.broadcast_to(np.arange(9) + 0.5 - 4, (6, 9)))
    assert (mask_distances(np.ones((3, 4), dtype=bool)) == -5).all()


def test_the_field_is_what_a_naive_loop_finds():
    views = balls(3, pixels=24)
    field = Silhouettes(views, Run(), "keep")
    points = np.random.default_rng(0).uniform(-1, 1, (200, 3))
    pixels, depth = views.project(points)
    for index, found in enumerate(field.values(points)):
        values = [np.linalg.norm(points[index]) - 1]
        for view in range(3):
            image, (x, y) = mask_distances(views.masks[view]).astype(float), np.clip(pixels[view, index] - 0.5, 0, 23)
            j, i = min(int(x), 22), min(int(y), 22)
            rows = (1 - (y - i)) * image[i] + (y - i) * image[i + 1]
            distance = (1 - (x - j)) * rows[j] + (x - j) * rows[j + 1]
            column, row = pixels[view, index]
            distance = min(distance, column, row, 24 - column, 24 - row)
            values.append(distance * depth[view, index] / views.intrinsics[view, 0, 0])
        assert found == pytest.approx(max(values), abs=1e-6)


def test_the_hull_of_a_ball_holds_the_ball():
    values = Silhouettes(balls(40), Run()).values(on_sphere(5000))
    assert values.max() < PIXEL
    assert Silhouettes(balls(40), Run()).values(1.2 * on_sphere(5000)).min() > PIXEL


def test_the_volume_falls_towards_the_balls():
    ball = 4 / 3 * np.pi * RADIUS**3
    hulls = [VisualHull(resolution=48).multiview(balls(count, pixels=192), Run()) for count in (3, 6, 12, 40)]
    assert all(hull.is_watertight for hull in hulls)
    ratios = [hull.volume / ball for hull in hulls]
    assert ratios == sorted(ratios, reverse=True)
    assert ratios[0] > 1.15
    assert 0.99 < ratios[-1] < 1.02  # up to the error of the distance transform


def test_two_views_at_a_right_angle_far_away_have_the_closed_form():
    """The hull of two crossed cylinders of radius r has the volume 16 r^3 / 3 (Archimedes)."""
    views = balls(2, pixels=192)
    away = 400.0
    rotations = np.array([[[1.0, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 0, -1.0], [0, 1, 0], [1, 0, 0]]])
    extrinsics = np.concatenate([rotations, np.tile([[[0.0], [0], [away]]], (2, 1, 1))], axis=2)
    focal = 90 * away  # 90 pixels are a length of 1
    middle = (np.stack(np.meshgrid(np.arange(192), np.arange(192)), axis=-1) + 0.5 - 96) / 90
    masks = np.tile(np.linalg.norm(middle, axis=2) < RADIUS, (2, 1, 1))
    intrinsics = np.array([[focal, 0, 96], [0, focal, 96], [0, 0, 1]])
    hull = VisualHull(resolution=64).multiview(Views(views.images, masks, extrinsics, intrinsics), Run())
    assert hull.volume == pytest.approx(16 / 3 * RADIUS**3, rel=0.01)


@pytest.mark.parametrize("center", [(0, 0, 0), (0.2, -0.1, 0.15)])
def test_every_mask_is_reproduced(center):
    """No vertex of the hull projects a pixel outside a mask, and the pixels within are all covered."""
    views = balls(10, center)
    hull = VisualHull(resolution=128).multiview(views, Run())
    assert np.linalg.norm(hull.vertices.mean(axis=0) - center) < 0.02
    rows, columns, shown = views.pixels_at(hull.vertices)
    assert shown.all()
    for mask, row, column in zip(views.masks, rows, columns, strict=True):
        distances = mask_distances(mask)
        assert distances[row, column].max() <= 1
        covered = np.zeros(mask.shape, dtype=bool)
        covered[row, column] = True
        assert covered[distances < -1].all()


# -- the border of the image -------------------------------------------------------------------------------------------


def cut_off() -> Views:
    """Images of the ball that show its middle only: a border of 30 pixels is cut away."""
    views = balls(20)
    shift = views.intrinsics - np.array([[0, 0, 30], [0, 0, 30], [0, 0, 0]])
    return Views(views.images[:, 30:-30, 30:-30], views.masks[:, 30:-30, 30:-30], views.extrinsics, shift)


def test_what_an_image_does_not_show_does_not_carve():
    """Masks that the border cuts off say nothing of what lies beyond; then the unit ball is the bound."""
    views = cut_off()
    assert views.masks.all()
    assert VisualHull(resolution=32).multiview(views, Run()).volume == pytest.approx(4 / 3 * np.pi, rel=0.01)
    carved = VisualHull(resolution=32, beyond="carve").multiview(views, Run())
    assert np.abs(carved.vertices).max() < 0.5
    assert views.pixels_at(0.99 * carved.vertices)[2].all()


def test_one_view_that_is_cut_off_leaves_what_the_others_show():
    views = balls(20)
    masks = views.masks.copy()
    half = views.intrinsics.copy()
    half[0, 0, 2] += 48  # the first image shows the left half of the ball, in its right half
    masks[0] = np.roll(masks[0], 48, axis=1)
    masks[0, :, :48] = False
    hull = VisualHull(resolution=48).multiview(changed(views, masks=masks, intrinsics=half), Run())
    whole = VisualHull(resolution=48).multiview(views, Run())
    assert hull.volume == pytest.approx(whole.volume, rel=0.01)


# -- what is refused ---------------------------------------------------------------------------------------------------


def test_masks_that_disagree_are_refused():
    views = balls(2)
    masks = views.masks.copy()
    masks[0, 44:], masks[1, :52] = False, False
    views = changed(views, masks=masks, extrinsics=np.repeat(views.extrinsics[:1], 2, axis=0))
    with pytest.raises(BadInput, match="the masks disagree"):
        VisualHull().multiview(views, Run())


def test_empty_masks_are_left_out_and_noted():
    views, run = balls(8), Run()
    masks = views.masks.copy()
    masks[[2, 5]] = False
    hull = VisualHull(resolution=32).multiview(changed(views, masks=masks), run)
    assert run.notes == ["views without a pixel in the mask are left out: 2, 5"]
    rest = np.setdiff1d(np.arange(8), [2, 5])
    others = Views.of({name: array[rest] for name, array in views.arrays().items()})
    assert np.array_equal(hull.vertices, VisualHull(resolution=32).multiview(others, Run()).vertices)
    with pytest.raises(BadInput, match="all masks are empty"):
        VisualHull().multiview(changed(views, masks=np.zeros_like(masks)), Run())


@pytest.mark.parametrize(("name", "value"), [("resolution", 7), ("beyond", "some")])
def test_parameters_of_the_hull(name, value):
    with pytest.raises(ValueError, match=f"{name}: expected"):
        VisualHull(**{name: value})
