"""Rigs at several distances and under white light, and effects on images: closed forms and naive statistics."""

import numpy as np
import pytest
from trimesh.creation import icosphere

from bench import BadInput, Shape, Views, generator
from bench.contract.ball_views import views_of_a_ball
from bench.datasets.sensors.camera_noise import CameraNoise
from bench.datasets.sensors.chain import Chain
from bench.datasets.sensors.mask_errors import MaskErrors, signed_distance, smooth_field
from bench.datasets.sensors.pixel_noise import PixelNoise
from bench.datasets.sensors.rig import Rig
from bench.datasets.sensors.view_few import ViewFew
from bench.plugins import presets

BALL = Shape("ball", icosphere(4)).framed()[0]
VIEWS = views_of_a_ball(20, 48)


def same(views, others, *but):
    for name, array in views.arrays().items():
        if name not in but:
            np.testing.assert_array_equal(array, getattr(others, name))


# -- the rig -----------------------------------------------------------------------------------------------------------


def test_distances_are_uniform_and_directions_unchanged():
    near = Rig(views=400, resolution=4, placement="random", distance=1.5).sense(BALL, generator(2))
    far = Rig(views=400, resolution=4, placement="random", distance=1.5, farthest=4.5).sense(BALL, generator(2))
    distances = np.sort(np.linalg.norm(far.centers, axis=1))
    assert distances[0] >= 1.5 and distances[-1] <= 4.5
    assert np.abs((distances - 1.5) / 3 - (np.arange(400) + 0.5) / 400).max() < 1.63 / 20  # Kolmogorov-Smirnov, 1 %
    np.testing.assert_allclose(far.extrinsics[:, :, :3], near.extrinsics[:, :, :3], atol=1e-12)
    np.testing.assert_array_equal(far.intrinsics, near.intrinsics)
    np.testing.assert_allclose(far.light_directions, near.light_directions, atol=1e-12)
    level = Rig(views=4, resolution=16, distance=1.5, farthest=1.5).sense(BALL, generator(2))
    same(Rig(views=4, resolution=16, distance=1.5).sense(BALL, generator(2)), level)


def test_white_light_shades_by_the_formula():
    rig = Rig(views=6, resolution=48, distance=2.5, normals="smooth", ambient=0.2, lights="white")
    views = rig.sense(Shape("fine", icosphere(5)).framed()[0], generator(4))
    assert views.light_directions.shape == (6, 1, 3)
    np.testing.assert_allclose(views.light_colors, 0.8)
    np.testing.assert_allclose(views.ambient, 0.2)
    for view in range(6):
        origins, directions = views.rays(view)
        along = -(origins * directions).sum(-1)
        inside = 1 - ((origins + along[..., None] * directions) ** 2).sum(-1)
        seen = (inside > 0.05) & views.masks[view]
        normals = (origins + (along - np.sqrt(np.maximum(inside, 0)))[..., None] * directions)[seen]
        expected = 255 * (0.2 + 0.8 * np.maximum(normals @ views.light_directions[view, 0], 0))
        assert np.abs(views.images[view][seen] - expected[:, None]).max() < 3


def test_white_lights_are_uniform_on_the_side_of_the_camera():
    views = Rig(views=500, resolution=4, lights="white").sense(BALL, generator(5))
    cosine = np.sort(np.einsum("vi,vi->v", views.light_directions[:, 0], -views.extrinsics[:, 2, :3]))
    assert cosine[0] >= 0
    assert np.abs(cosine - (np.arange(500) + 0.5) / 500).max() < 1.63 / np.sqrt(500)  # Archimedes


@pytest.mark.parametrize(
    ("wrong", "message"), [({"farthest": 2.0}, "farthest: expected"), ({"lights": "red"}, "lights")]
)
def test_invalid_rigs_are_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        Rig(**wrong)


@pytest.mark.parametrize("name", ["multiview_24", "multiview_48", "multiview_thesis"])
def test_presets_show_the_whole_shape_or_cut_it_off_as_published(name):
    preset = presets.presets("sensor")[name]
    assert preset.plugin == "rig"
    rig = Rig(**(dict(preset.values) | {"resolution": 32}))
    masks = rig.sense(BALL, generator(0)).masks
    cut = (masks[:, 0] | masks[:, -1] | masks[:, :, 0] | masks[:, :, -1]).any(axis=1)
    # Beyond 2 radii, the sphere is within 60 degrees; at 1.2 to 2.2 radii, that is a fifth of the cameras.
    assert cut.mean() == pytest.approx(0.8 if name == "multiview_thesis" else 0, abs=0.12)


# -- effects -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("effect", [PixelNoise(), MaskErrors(holes=0.5, blobs=0.5), ViewFew(), CameraNoise()])
def test_effects_work_in_chains_and_are_repeatable(effect):
    name, values = {
        PixelNoise: ("pixel_noise", {}),
        MaskErrors: ("mask_errors", {"holes": 0.5, "blobs": 0.5}),
        ViewFew: ("view_few", {}),
        CameraNoise: ("camera_noise", {}),
    }[type(effect)]
    chain = Chain(steps=({"rig": {"views": 8, "resolution": 24}}, {name: values}))
    views, again = (chain.sense(BALL, generator(7)) for _ in range(2))
    same(views, again)
    source, stream = generator(7).spawn(2)
    by_hand = effect.spoil(Rig(views=8, resolution=24).sense(BALL, source), BALL, stream)
    same(views, by_hand)
    with pytest.raises(ValueError, match=f"{name}, only degrades views; put a sensor before it.*rig"):
        Chain(steps=(name,))


def test_pixel_noise_has_its_moments():
    gray = np.full((4, 60, 60, 3), 128, np.uint8)
    gray[3] = 0
    views = Views(gray, np.ones(gray.shape[:3], bool), VIEWS.extrinsics[:4], VIEWS.intrinsics[:4])
    noisy = PixelNoise(sigma=0.05).spoil(views, BALL, generator(1))
    off = noisy.images[:3].astype(float) - 128
    assert off.mean() == pytest.approx(0, abs=0.3)
    assert off.std() == pytest.approx(np.sqrt((255 * 0.05) ** 2 + 1 / 12), rel=0.02)  # plus the deviation of rounding
    assert np.abs(np.corrcoef(off.reshape(-1, 3).T) - np.eye(3)).max() < 0.05  # channels are independent
    assert (noisy.images[3] == 0).mean() == pytest.approx(0.5, abs=0.03)  # clipped, not wrapped around
    same(noisy, views, "images")
    same(PixelNoise(sigma=0.0).spoil(VIEWS, BALL, generator(1)), VIEWS)


def test_few_views():
    first = ViewFew(count=3, choice="first").spoil(VIEWS, BALL, generator(0))
    same(first, Views.of({name: array[:3] for name, array in VIEWS.arrays().items()}))
    counts = np.zeros(20)
    for seed in range(300):
        left = ViewFew(count=5, choice="random").spoil(VIEWS, BALL, generator(seed))
        found = [int(np.flatnonzero((VIEWS.extrinsics == e).all(axis=(1, 2)))[0]) for e in left.extrinsics]
        assert found == sorted(set(found)) and len(found) == 5
        counts[found] += 1
    assert np.abs(counts - 75).max() < 4 * np.sqrt(300 * 0.25 * 0.75)
    same(ViewFew(count=20).spoil(VIEWS, BALL, generator(0)), VIEWS)
    with pytest.raises(BadInput, match="expected at least count=21 views, got 20"):
        ViewFew(count=21).spoil(VIEWS, BALL, generator(0))


def test_few_views_that_are_evenly_spread():
    """Against a naive loop over angles."""
    directions = VIEWS.centers / np.linalg.norm(VIEWS.centers, axis=1, keepdims=True)
    chosen = [0]
    while len(chosen) < 6:
        left = [v for v in range(20) if v not in chosen]
        chosen.append(max(left, key=lambda v: min(np.arccos(directions[v] @ directions[c]) for c in chosen)))
    even = ViewFew(count=6).spoil(VIEWS, BALL, generator(0))
    np.testing.assert_array_equal(even.extrinsics, VIEWS.extrinsics[sorted(chosen)])


def test_camera_noise_has_its_moments():
    many = Views.of({name: np.repeat(array, 100, axis=0) for name, array in views_of_a_ball(20, 4).arrays().items()})
    noisy = CameraNoise(rotation=2.0, shift=0.03).spoil(many, BALL, generator(3))
    moved = noisy.centers - many.centers
    np.testing.assert_allclose(moved.std(axis=0), 0.03, rtol=0.06)
    assert np.abs(moved.mean(axis=0)).max() < 4 * 0.03 / np.sqrt(2000)
    turns = noisy.extrinsics[:, :, :3] @ many.extrinsics[:, :, :3].transpose(0, 2, 1)
    angles = np.degrees(np.arccos(np.clip((np.trace(turns, axis1=1, axis2=2) - 1) / 2, -1, 1)))
    assert np.sqrt((angles**2).mean()) == pytest.approx(2.0, rel=0.06)
    axes = np.stack([turns[:, 2, 1] - turns[:, 1, 2], turns[:, 0, 2] - turns[:, 2, 0], turns[:, 1, 0] - turns[:, 0, 1]])
    axes = axes.T[angles > 0.1] / np.linalg.norm(axes.T[angles > 0.1], axis=1, keepdims=True)
    np.testing.assert_allclose(axes.T @ axes / len(axes), np.eye(3) / 3, atol=0.04)
    same(noisy, many, "extrinsics")
    still = CameraNoise(rotation=0.0, shift=0.0).spoil(VIEWS, BALL, generator(3))
    np.testing.assert_allclose(still.extrinsics, VIEWS.extrinsics, atol=1e-12)


def test_the_field_that_moves_mask_boundaries_is_smooth_and_of_unit_deviation():
    for smoothness in (1.0, 3.0, 6.0):
        fields = np.stack([smooth_field((96, 96), smoothness, generator(seed)) for seed in range(40)])
        assert fields.std() == pytest.approx(1, rel=0.05)
        # Two pixels s apart correlate by exp(-s^2 / (4 smoothness^2)), the autocorrelation of the kernel.
        for apart in (1, 4):
            found = (fields * np.roll(fields, apart, axis=2)).mean() / fields.var()
            assert found == pytest.approx(np.exp(-(apart**2) / (4 * smoothness**2)), abs=0.04)


def test_signed_distances_match_a_naive_loop():
    mask = np.random.default_rng(2).random((9, 11)) < 0.5
    places = np.argwhere(np.ones_like(mask))
    for row, column in places:
        others = np.argwhere(mask != mask[row, column])
        nearest = np.linalg.norm(others - [row, column], axis=1).min() - 0.5
        assert signed_distance(mask)[row, column] == pytest.approx(nearest if mask[row, column] else -nearest)


def test_boundaries_of_masks_move_by_the_amplitude():
    """A half plane: the shift of its boundary, column by column, has the standard deviation of the field."""
    masks = np.zeros((30, 64, 96), dtype=bool)
    masks[:, 32:] = True
    many = np.tile(VIEWS.extrinsics[:1], (30, 1, 1))
    views = Views(np.zeros((*masks.shape, 3), np.uint8), masks, many, VIEWS.intrinsics[0])
    noisy = MaskErrors(amplitude=3.0, smoothness=12.0).spoil(views, BALL, generator(6))
    shift = noisy.masks.sum(axis=1) - 32.0  # rows gained
    assert shift.std() == pytest.approx(3.0, rel=0.2) and abs(shift.mean()) < 0.6
    assert np.abs(np.diff(shift, axis=1)).mean() < 0.5  # smooth along the boundary
    same(noisy, views, "masks")
    same(MaskErrors(amplitude=0.0).spoil(VIEWS, BALL, generator(6)), VIEWS)
    full = Views(views.images, np.ones_like(masks), many, VIEWS.intrinsics[0])
    same(MaskErrors().spoil(full, BALL, generator(6)), full)  # without a boundary nothing moves


def test_holes_and_blobs_have_the_requested_frequency():
    many = Views.of({name: np.repeat(array, 20, axis=0) for name, array in VIEWS.arrays().items()})
    noisy = MaskErrors(amplitude=0.0, holes=0.3, blobs=0.6, radius=4.0).spoil(many, BALL, generator(8))
    lost, gained = many.masks & ~noisy.masks, noisy.masks & ~many.masks
    assert lost.any(axis=(1, 2)).mean() == pytest.approx(0.3, abs=4 * np.sqrt(0.21 / 400))
    # A blob, made after the hole, may lie mostly inside the mask, but its centre is outside.
    assert gained.any(axis=(1, 2)).mean() == pytest.approx(0.6, abs=4 * np.sqrt(0.24 / 400))
    whole = np.pi * 4**2
    assert lost.sum(axis=(1, 2)).max() <= 1.1 * whole and gained.sum(axis=(1, 2)).max() <= 1.1 * whole
    assert lost.sum(axis=(1, 2)).max() > 0.9 * whole


def test_views_without_any_visible_shape_are_refused():
    with pytest.raises(BadInput, match="none of the 20 remaining views shows the shape"):
        MaskErrors(amplitude=0.0, holes=1.0, radius=1000.0).spoil(VIEWS, BALL, generator(0))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PixelNoise(sigma=-1), "sigma: expected 0 or more"),
        (lambda: MaskErrors(amplitude=-1), "amplitude: expected"),
        (lambda: MaskErrors(smoothness=0), "smoothness: expected at least 1"),
        (lambda: MaskErrors(holes=2), "holes: expected 0 to 1"),
        (lambda: ViewFew(count=0), "count: expected a whole number of at least 1"),
        (lambda: ViewFew(choice="best"), "choice: expected one of even, random, first"),
        (lambda: CameraNoise(rotation=-1), "rotation: expected 0 to 180"),
        (lambda: CameraNoise(shift=float("nan")), "shift: expected"),
    ],
)
def test_wrong_parameters_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
