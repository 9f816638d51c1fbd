"""The visual hull and space carving: balls in closed form, reproduced masks, refused input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from trimesh.creation import revolve

from bench import BadInput, Frame, Run, Shape, Views
from bench.contract.ball_views import views_of_a_ball
from bench.datasets.sensors.rig import Rig
from bench.geometry.mesh_surface import MeshSurface
from bench.methods.classical.carving.agreement import agreement
from bench.methods.classical.carving.rounds import Carver
from bench.methods.classical.carving.sight import count_covers, depth_buffers, pixels_seen, take
from bench.methods.classical.carving.silhouettes import Silhouettes, mask_distances
from bench.methods.classical.carving.voxels import Voxels, surface_of
from bench.methods.classical.space_carving import SpaceCarving
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


def test_mask_distances_are_to_the_boundary_between_pixels():
    """For a half plane, the distance to the line between two columns; for a full mask, a negative constant."""
    mask = np.zeros((6, 9), dtype=bool)
    mask[:, :4] = True
    assert mask_distances(mask) == pytest.approx(np.broadcast_to(np.arange(9) + 0.5 - 4, (6, 9)))
    assert (mask_distances(np.ones((3, 4), dtype=bool)) == -5).all()


def test_the_field_matches_a_naive_loop():
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


def test_the_hull_of_a_ball_contains_the_ball():
    values = Silhouettes(balls(40), Run()).values(on_sphere(5000))
    assert values.max() < PIXEL
    assert Silhouettes(balls(40), Run()).values(1.2 * on_sphere(5000)).min() > PIXEL


def test_the_volume_decreases_to_that_of_the_ball():
    ball = 4 / 3 * np.pi * RADIUS**3
    hulls = [VisualHull(resolution=48).multiview(balls(count, pixels=192), Run()) for count in (3, 6, 36)]
    assert all(hull.is_watertight for hull in hulls)
    ratios = [hull.volume / ball for hull in hulls]
    assert ratios == sorted(ratios, reverse=True)
    assert ratios[0] > 1.15
    assert 0.99 < ratios[-1] < 1.02  # up to the error of the distance transform


def test_the_hull_of_two_far_views_at_a_right_angle_has_its_closed_form():
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
    """No vertex of the hull projects more than a pixel outside a mask, and all pixels within are covered."""
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
    """Images of the ball that show only its middle: a border of 30 pixels is cropped."""
    views = balls(20)
    shift = views.intrinsics - np.array([[0, 0, 30], [0, 0, 30], [0, 0, 0]])
    return Views(views.images[:, 30:-30, 30:-30], views.masks[:, 30:-30, 30:-30], views.extrinsics, shift)


def test_regions_outside_an_image_are_not_carved():
    """Masks cut off by the border give no information beyond it; then the unit ball is the bound."""
    views = cut_off()
    assert views.masks.all()
    assert VisualHull(resolution=32).multiview(views, Run()).volume == pytest.approx(4 / 3 * np.pi, rel=0.01)
    carved = VisualHull(resolution=32, beyond="carve").multiview(views, Run())
    assert np.abs(carved.vertices).max() < 0.5
    assert views.pixels_at(0.99 * carved.vertices)[2].all()


def test_a_view_that_is_cut_off_does_not_carve_what_the_others_show():
    views = balls(20)
    masks = views.masks.copy()
    half = views.intrinsics.copy()
    half[0, 0, 2] += 48  # the right half of the first image shows the left half of the ball
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


# -- visibility of voxels-----------------------------------------------------------------------------------------------


def boxes() -> tuple[np.ndarray, float, Views, Silhouettes]:
    """Some voxels, their side, and views of them."""
    views = balls(3, pixels=24)
    return np.random.default_rng(2).uniform(-0.5, 0.5, (40, 3)), 0.1, views, Silhouettes(views, Run())


def drawn(points, cell, views, margin):
    """By naive loops: for each view, the pixels whose centres lie in the square of each voxel, and its depth."""
    pixels, depth = views.project(points)
    middles = np.stack(np.meshgrid(np.arange(24) + 0.5, np.arange(24) + 0.5), axis=-1)
    for view in range(len(views)):
        for k in range(len(points)):
            half = 0.5 * cell * views.intrinsics[view, 0, 0] / depth[view, k] + margin
            yield view, k, (np.abs(middles - pixels[view, k]) <= half).all(axis=2), depth[view, k]


def test_depth_buffers_and_visible_pixels_match_naive_loops():
    points, cell, views, known = boxes()
    wanted = np.full((3, 24, 24), np.inf)
    for view, _, square, depth in drawn(points, cell, views, 0.5):
        wanted[view, square] = np.minimum(wanted[view, square], depth)
    buffers = depth_buffers(points, known.matrices, known.focal, cell, 24, 24)
    assert buffers == pytest.approx(wanted, rel=1e-6)
    found = pixels_seen(points, known.matrices, buffers, views.masks, 0.05)
    rows, columns, shown = views.pixels_at(points)
    _, depth = views.project(points)
    for view in range(3):
        seen = shown[view] & views.masks[view, rows[view], columns[view]]
        seen &= depth[view] <= buffers[view, rows[view], columns[view]] + 0.05
        assert np.array_equal(found[:, view], np.where(seen, rows[view] * 24 + columns[view], -1))
    assert 0.2 < (found >= 0).mean() < 0.9


def test_voxels_are_removed_only_while_the_masks_stay_covered():
    points, cell, views, known = boxes()
    covers = count_covers(points, known.matrices, known.focal, cell, 24, 24)
    wanted = np.zeros((3, 24, 24), dtype=int)
    for view, _, square, _ in drawn(points, cell, views, 0):
        wanted[view] += square
    assert np.array_equal(covers, wanted)
    gone = take(points, known.matrices, known.focal, cell, covers, views.masks)
    assert 0 < gone.sum() < len(points)
    assert np.array_equal(covers, count_covers(points[~gone], known.matrices, known.focal, cell, 24, 24))
    assert np.array_equal((covers > 0)[views.masks], (wanted > 0)[views.masks])


def test_the_surface_of_voxels_matches_a_naive_loop():
    filled = np.zeros((7, 6, 8), dtype=bool)
    filled[1:-1, 1:-1, 1:-1] = np.random.default_rng(0).random((5, 4, 6)) < 0.8
    wanted = []
    for i, j, k in np.argwhere(filled):
        sides = filled[i - 1, j, k], filled[i + 1, j, k], filled[i, j - 1, k], filled[i, j + 1, k]
        if not all((*sides, filled[i, j, k - 1], filled[i, j, k + 1])):
            wanted.append([i, j, k])
    assert np.array_equal(surface_of(filled), wanted)


def test_the_grid_contains_the_hull():
    voxels = Voxels.over(Silhouettes(balls(12, (0.2, -0.1, 0.15)), Run()), 24)
    ball = voxels.middles(np.argwhere(voxels.hull < 0))
    assert voxels.cell**3 * len(ball) == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=0.2)
    assert min((voxels.hull[part] > 0).all() for part in (0, -1, np.s_[:, [0, -1]], np.s_[:, :, [0, -1]]))


# -- agreement of views ------------------------------------------------------------------------------------------------


def seen(colors: np.ndarray, **lights) -> Views:
    """Views of 1 x 1 pixels with some colours (v, 3)."""
    count = len(colors)
    camera = np.tile(np.eye(3, 4), (count, 1, 1))
    return Views(colors.reshape(count, 1, 1, 3), np.ones((count, 1, 1), dtype=bool), camera, np.eye(3), **lights)


def lit(normals: np.ndarray, seed: int) -> Views:
    """The colours of normals (v, 3) under three orthogonal lights, the first roughly along the normal."""
    rng = np.random.default_rng(seed)
    first = normals + 0.4 * rng.normal(size=normals.shape)
    lights = np.linalg.qr(np.concatenate([first[:, :, None], rng.normal(size=(len(normals), 3, 2))], axis=2))[0]
    lights = lights.transpose(0, 2, 1)
    lights[:, 0] = first / np.linalg.norm(first, axis=1, keepdims=True)  # QR may have flipped it
    colors, ambient = np.tile(0.9 * np.eye(3), (len(normals), 1, 1)), np.full((len(normals), 3), 0.1)
    shade = np.maximum(np.einsum("vki,vi->vk", lights, normals), 0) * 0.9 + 0.1
    images = np.rint(255 * shade).astype(np.uint8)
    return seen(images, light_directions=lights, light_colors=colors, ambient=ambient)


def test_views_of_one_normal_agree():
    """Up to the rounding of colours; a view of another normal is detected, and left out where a share allows it."""
    rng = np.random.default_rng(0)
    for seed in range(6):
        normal = rng.normal(size=3)
        normals = np.tile(normal / np.linalg.norm(normal), (6, 1))
        pixels = np.zeros((1, 6), dtype=np.int32)
        assert agreement(lit(normals, seed), 1, 0)(pixels) < 0.004
        normals[2] = np.cross(normals[0], [0.6, 0, 0.8])
        normals[2] /= np.linalg.norm(normals[2])
        views = lit(normals, seed)
        assert agreement(views, 1, 0)(pixels) > 0.1
        assert agreement(views, 0.8, 0)(pixels) < 0.004
        pixels[0, 2] = -1  # this view does not see the point
        assert agreement(views, 1, 0)(pixels) < 0.004


def test_without_lights_the_agreement_is_the_standard_deviation():
    colors = np.random.default_rng(0).integers(256, size=(7, 3)).astype(np.uint8)
    pixels = np.zeros((1, 7), dtype=np.int32)
    wanted = np.sqrt((colors / 255).var(axis=0).mean())
    assert agreement(seen(colors), 1, 0)(pixels) == pytest.approx(wanted)
    colors[:6] = 100
    assert agreement(seen(colors), 0.8, 0)(pixels) == pytest.approx(0, abs=1e-12)


# -- carving -----------------------------------------------------------------------------------------------------------

BOWL = revolve([[0, -0.4], [0.7, -0.1], [0.8, 0.4], [0.7, 0.4], [0.6, 0.0], [0, -0.25]], sections=48)
QUICK = SpaceCarving(cells=56)


@pytest.fixture(scope="module")
def bowl() -> tuple[Views, MeshSurface, float]:
    """Images of a bowl, the bowl, and its volume."""
    shape, _ = Shape("bowl", BOWL).framed()
    views = Rig(views=24, resolution=128).sense(shape, np.random.default_rng(0))
    return views, MeshSurface(shape.mesh), abs(shape.mesh.volume)


@pytest.fixture(scope="module")
def carved(bowl):
    """The carved hull of the bowl."""
    return QUICK.multiview(bowl[0], Run())


def test_the_hollow_of_a_bowl_is_carved(bowl, carved):
    """The visual hull fills it."""
    views, surface, volume = bowl
    hull = VisualHull(resolution=32).multiview(views, Run())
    assert carved.is_watertight
    far = [surface.project(np.asarray(mesh.vertices)).distance.mean() for mesh in (hull, carved)]
    assert far[1] < 0.65 * far[0]
    assert hull.volume > 1.8 * volume
    assert volume < carved.volume < 1.5 * volume


def test_the_masks_stay_reproduced(bowl, carved):
    """By the carved bowl, and by voxels even if all that may be removed are."""
    views = bowl[0]
    rows, columns, _ = views.pixels_at(carved.sample(100_000, seed=0))
    for mask, row, column in zip(views.masks, rows, columns, strict=True):
        covered = np.zeros(mask.shape, dtype=bool)
        covered[row, column] = True
        assert covered[mask].mean() > 0.98
        assert mask_distances(mask)[row, column].max() <= 1.5
    silhouettes = Silhouettes(views, Run())
    voxels = Voxels.over(silhouettes, 24)
    hull = voxels.hull < 0
    least = Carver(silhouettes, voxels, lambda pixels: np.ones(len(pixels)), 0.5, 1).carve(hull, 100, Run())
    assert least.sum() < 0.5 * hull.sum()
    camera = silhouettes.matrices, silhouettes.focal, voxels.cell, views.height, views.width
    before, after = (count_covers(voxels.middles(np.argwhere(filled)), *camera) for filled in (hull, least))
    assert np.array_equal((after > 0)[views.masks], (before > 0)[views.masks])


def test_a_ball_is_not_carved():
    views = balls(24)
    carved, hull = QUICK.multiview(views, Run()), replace(QUICK, rounds=0).multiview(views, Run())
    assert np.linalg.norm(carved.vertices, axis=1).mean() == pytest.approx(RADIUS, abs=0.01)
    assert carved.volume == pytest.approx(hull.volume, rel=0.01)


def test_it_stops_in_time_and_returns_the_hull_where_colours_do_not_agree(bowl):
    views, run = bowl[0], Run(seconds=0)
    early = QUICK.multiview(views, run)
    assert "0 rounds were done" in run.notes[0]
    run = Run()
    refused = replace(QUICK, least_left=1.0).multiview(views, run)
    assert "of the visual hull, which is returned instead" in run.notes[0]
    assert np.array_equal(early.vertices, refused.vertices)
    arrays = views.arrays()
    for name in ("light_directions", "light_colors", "ambient"):
        del arrays[name]
    assert QUICK.multiview(Views.of(arrays), Run()).is_watertight


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("cells", 4),
        ("cells", 5000),
        ("tolerance", -1.0),
        ("share", 0.0),
        ("reach", -1),
        ("views", 1),
        ("least_left", 2.0),
    ],
)
def test_parameters_of_carving(name, value):
    with pytest.raises(ValueError, match=f"{name}: expected"):
        SpaceCarving(**{name: value})
