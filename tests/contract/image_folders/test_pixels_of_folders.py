"""Lenses, sizes and camera matrices against naive loops and independent libraries; the ball against shapes."""

from functools import cache

import numpy as np
import pytest
import skimage.measure
from layouts import CENTER, RADIUS, ball, write_colmap
from PIL import Image
from scipy.ndimage import binary_dilation
from scipy.optimize import fsolve
from scipy.spatial.transform import Rotation

from bench import BadInput, Frame, Views
from bench.contract.image_folders.bounding import bounding_ball
from bench.contract.image_folders.cameras import decomposed, from_opengl, nearest_rotation, to_opengl
from bench.contract.image_folders.carving import carve
from bench.contract.image_folders.lens import Lens
from bench.contract.image_folders.photos import common_size
from bench.contract.image_folders.pictures import read_image, read_mask
from bench.contract.image_folders.reading import read_views
from bench.contract.image_folders.resizing import area_resized, scaled_intrinsics
from bench.notices import collected

RNG = np.random.default_rng(5)
STRONG = Lens(k1=-0.35, k2=0.15, p1=0.01, p2=-0.02)


# -- lenses ------------------------------------------------------------------------------------------------------------


def test_the_polynomial_is_the_one_of_opencv():
    """Term by term, as the documentation of OpenCV's camera model has it."""
    lens = Lens(0.1, -0.2, 0.3, 0.04, -0.05)
    for x, y in RNG.uniform(-0.5, 0.5, (10, 2)):
        r2 = x * x + y * y
        radial = 1 + lens.k1 * r2 + lens.k2 * r2**2 + lens.k3 * r2**3
        seen = (
            x * radial + 2 * lens.p1 * x * y + lens.p2 * (r2 + 2 * x * x),
            y * radial + lens.p1 * (r2 + 2 * y * y) + 2 * lens.p2 * x * y,
        )
        np.testing.assert_allclose(lens.distort(np.array([x, y])), seen, rtol=1e-13)


def test_the_reach_is_where_the_polynomial_turns():
    assert Lens().reach == Lens(k1=0.1).reach == np.inf
    for lens in (Lens(k1=-0.2), Lens(k1=-0.3, k2=-0.05), Lens(k3=-0.4)):
        radii = np.linspace(0, 3, 30001)
        seen = lens.distort(np.column_stack([radii, np.zeros_like(radii)]))[:, 0]
        assert lens.reach == pytest.approx(radii[np.argmax(np.diff(seen) < 0)], abs=2e-4)


@cache
def straight_images():
    return seen_through(Lens(), ball(4, 44))


def seen_through(lens, views):
    """The images of the ball through a lens, ray by ray: the undistorted direction is found by a solver."""
    images, masks = np.zeros_like(views.images), np.zeros_like(views.masks)
    inverse = np.linalg.inv(views.intrinsics[0])
    pixels = np.stack(np.meshgrid(np.arange(views.width) + 0.5, np.arange(views.height) + 0.5), axis=-1).reshape(-1, 2)
    through = (np.column_stack([pixels, np.ones(len(pixels))]) @ inverse.T)[:, :2]
    straight = np.array([fsolve(lambda q, p=p: lens.distort(q) - p, p) for p in through])
    for view in range(len(views)):
        rotation = views.extrinsics[view, :, :3]
        directions = np.column_stack([straight, np.ones(len(straight))]) @ rotation
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        offset = CENTER - views.centers[view]
        along = directions @ offset
        inside = RADIUS**2 - ((offset - along[:, None] * directions) ** 2).sum(axis=1)
        hit = (along - np.sqrt(np.maximum(inside, 0)))[:, None] * directions - offset
        masks[view] = (inside > 0).reshape(views.masks[view].shape)
        shade = np.where(inside[:, None] > 0, 127 + 40 * hit / RADIUS * [1, 2, 3], 0)
        images[view] = np.rint(np.clip(shade, 0, 255)).reshape(images[view].shape)
    return Views(images, masks, views.extrinsics, views.intrinsics)


@pytest.mark.parametrize(
    ("model", "lens", "names"),
    [
        ("OPENCV", STRONG, ("k1", "k2", "p1", "p2")),
        ("RADIAL", Lens(k1=0.3, k2=-0.1), ("k1", "k2")),
        ("SIMPLE_RADIAL", Lens(k1=-0.2), ("k1",)),
    ],
)
def test_images_through_a_lens_come_back(tmp_path, model, lens, names):
    straight = straight_images()
    bent = seen_through(lens, straight)
    write_colmap(bent, tmp_path, model, [getattr(lens, name) for name in names])
    views, frame = read_views(tmp_path)
    around = np.ones((3, 3), dtype=bool)
    for found, true, raw in zip(views.masks, straight.masks, bent.masks, strict=True):
        border = binary_dilation(true, around) & binary_dilation(~true, around)  # a pixel on both sides
        assert not (found != true)[~border].any()
        assert (found != true).sum() < (raw != true).sum()
    inner = views.masks & straight.masks
    for view in range(4):
        inner[view] &= ~binary_dilation(~straight.masks[view], around, iterations=3)
    off = np.abs(views.images[inner].astype(int) - straight.images[inner])
    assert off.mean() < 1 and np.quantile(off, 0.99) <= 3
    assert np.linalg.norm(np.array(frame.center) - CENTER) < 0.1 * RADIUS


# -- sizes -------------------------------------------------------------------------------------------------------------


def test_shrinking_is_the_mean_of_blocks():
    image = RNG.integers(0, 256, (12, 18, 3)).astype(np.uint8)
    expected = skimage.measure.block_reduce(image, (3, 2, 1), np.mean)
    assert np.abs(area_resized(image, (9, 4)) - expected).max() <= 0.5 + 1e-9


def test_shrinking_by_any_factor_is_the_mean_over_areas():
    """The same from an image that is first enlarged until both sizes divide it."""
    image = RNG.integers(0, 256, (7, 9, 3)).astype(np.uint8)
    large = image.repeat(5, axis=0).repeat(4, axis=1)
    expected = skimage.measure.block_reduce(large, (7, 9, 1), np.mean)
    assert np.abs(area_resized(image, (4, 5)) - expected).max() <= 0.5 + 1e-9
    mask = image[..., 0] > 100
    inside = skimage.measure.block_reduce(mask.repeat(5, axis=0).repeat(4, axis=1), (7, 9), np.mean)
    np.testing.assert_array_equal(area_resized(mask, (4, 5)), inside > 0.5)


def test_intrinsics_follow_the_size():
    views = ball(3, 60)
    points = CENTER + RNG.normal(size=(5, 3))
    small = np.stack([scaled_intrinsics(k, (60, 60), (20, 15)) for k in views.intrinsics])
    images = np.stack([area_resized(image, (20, 15)) for image in views.images])
    masks = np.stack([area_resized(mask, (20, 15)) for mask in views.masks])
    shrunk = Views(images, masks, views.extrinsics, small)
    np.testing.assert_allclose(shrunk.project(points)[0], views.project(points)[0] / [3, 4])


def test_the_most_frequent_size_counts():
    sizes = [(80, 60), (40, 30), (40, 30), (20, 15)]
    names = ["a", "b", "c", "d"]
    assert common_size(sizes, names, 0) == (40, 30) and common_size(sizes, names, 100) == (40, 30)
    assert common_size(sizes, names, 20) == (20, 15) and common_size([(1600, 1200)], ["a"], 512) == (512, 384)
    with pytest.raises(BadInput, match="d: has 30 x 40 pixels, while most images have 40 x 30"):
        common_size([*sizes[:3], (30, 40)], names, 0)


# -- pictures ----------------------------------------------------------------------------------------------------------


def test_pictures_of_all_kinds(tmp_path):
    file = tmp_path / "a.png"
    pixels = RNG.integers(0, 256, (4, 5, 4)).astype(np.uint8)
    Image.fromarray(pixels).save(file)
    image, alpha = read_image(file)
    np.testing.assert_array_equal(alpha, pixels[..., 3])
    np.testing.assert_allclose(image, pixels[..., :3] * (pixels[..., 3:] / 255), atol=0.5)
    exif = Image.Exif()
    exif[0x0112] = 6  # to be turned when it is shown
    Image.fromarray(pixels[..., :3]).save(file, exif=exif)
    np.testing.assert_array_equal(read_image(file)[0], pixels[..., :3])  # as stored: cameras are found so
    gray = pixels[..., 0]
    for stored, expected in [
        (gray, gray > 127),
        (gray % 2, gray % 2 > 0),
        (gray.astype(np.uint16) * 257, gray > 127),
        (np.where(gray > 99, True, False), gray > 99),
    ]:
        Image.fromarray(stored).save(file)
        np.testing.assert_array_equal(read_mask(file), expected)


# -- matrices ----------------------------------------------------------------------------------------------------------


def test_projections_are_decomposed():
    for _ in range(20):
        rotation = Rotation.random(rng=RNG).as_matrix()
        matrix = np.array([[900.0, 3, 320], [0, 700, 240], [0, 0, 1]])
        pose = np.column_stack([rotation, RNG.normal(size=3)])
        factor = RNG.normal() * 10.0 ** RNG.integers(-3, 4)
        found = decomposed(factor * matrix @ pose, "x")
        np.testing.assert_allclose(found[0], matrix, rtol=1e-9, atol=1e-6)
        np.testing.assert_allclose(found[1], pose, atol=1e-9)


def test_axes_of_opengl():
    """A camera at (0, 0, 5) with the axes of the world looks down, along -z: what is at x > 0 is right, at y > 0 up."""
    camera = np.eye(4)
    camera[2, 3] = 5
    extrinsics = from_opengl(camera, "x")
    np.testing.assert_allclose(extrinsics @ [1, 2, 0, 1], [1, -2, 5])
    np.testing.assert_allclose(to_opengl(extrinsics), camera)
    rounded = np.round(Rotation.random(rng=RNG).as_matrix(), 4)
    turned = nearest_rotation(3 * rounded, "x")
    np.testing.assert_allclose(turned @ turned.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(turned, rounded, atol=1e-4)


# -- the ball ----------------------------------------------------------------------------------------------------------


def of_masks(views, masks):
    return Views(views.images, masks, views.extrinsics, views.intrinsics)


def test_the_carved_cells_are_those_of_a_naive_loop():
    views, frame = ball(5, 32), Frame(tuple(CENTER + [0.5, 0, 0]), 4.0)
    points, cut = carve(views, frame, 8)
    line = ((np.arange(8) + 0.5) / 4 - 1) * 4.4
    half, kept = np.sqrt(3) * 4.4 / 8, []
    for cell in np.stack(np.meshgrid(line, line, line, indexing="ij"), -1).reshape(-1, 3) + frame.center:
        pixels, depth = views.project(cell[None])
        inside = 0
        for view in range(5):  # no mask touches the border, so what is not in the image is outside
            column, row = np.floor(pixels[view, 0]).astype(int)
            if depth[view, 0] > 0 and 0 <= column < 32 and 0 <= row < 32:
                distance = np.linalg.norm(np.argwhere(views.masks[view]) - [row, column], axis=1).min()
                inside += distance <= views.intrinsics[view, 0, 0] * half / depth[view, 0] + 0.5
        if inside == 5:
            kept.append(cell)
    np.testing.assert_allclose(points, kept)
    assert cut == (np.abs(np.array(kept) - frame.center).max() > line[-1] - 1e-9)


def test_one_wrong_mask_of_many_does_no_harm():
    views = ball(24, 64)
    masks = views.masks.copy()
    masks[7, :, :32] = False
    frame = bounding_ball(of_masks(views, masks), "x")
    offset = np.linalg.norm(np.array(frame.center) - CENTER)
    assert offset + RADIUS <= frame.radius < 1.2 * RADIUS


def test_masks_that_are_cut_say_so():
    views = ball(24, 64)
    cropped = Views(
        views.images[:, 8:56, 8:56],
        views.masks[:, 8:56, 8:56],
        views.extrinsics,
        views.intrinsics - [[0, 0, 8], [0, 0, 8], [0, 0, 0]],
    )
    with collected() as notices:
        frame = bounding_ball(cropped, "x")
    assert "24 of 24 masks touch the border" in notices[0]
    assert np.linalg.norm(np.array(frame.center) - CENTER) < 0.1 * RADIUS and 0.9 < frame.radius / RADIUS < 1.6


def test_views_that_tell_nothing_of_the_depth_are_refused():
    views = ball(24, 64)
    same = Views(views.images[[0, 0]], views.masks[[0, 0]], views.extrinsics[[0, 0]], views.intrinsics[[0, 0]])
    with pytest.raises(BadInput, match="all cameras look in one direction"):
        bounding_ball(same, "x")
    one = Views(views.images[:1], views.masks[:1], views.extrinsics[:1], views.intrinsics[:1])
    with pytest.raises(BadInput, match="at least two images"):
        bounding_ball(one, "x")
