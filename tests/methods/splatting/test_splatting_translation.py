"""The learned filter: its networks, its training pairs, its training, and the shipped weights."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import torch
import trimesh

from bench import Case, PointCloud, Run, Shape, TrainingData, generator
from bench.geometry.poisson_disk import sample_poisson_disk
from bench.methods.splatting.dss_pix2pix import DssPix2pix
from bench.methods.splatting.translation.anew import with_rough_normals
from bench.methods.splatting.translation.crops import Crops
from bench.methods.splatting.translation.discriminator import Discriminator
from bench.methods.splatting.translation.generator import Dropout, Generator, PixelNorm, smoothed
from bench.methods.splatting.translation.pairs import drawn_pairs
from bench.methods.splatting.translation.stored import LIGHTEST, stored
from bench.methods.splatting.translation.training import Plan, Training
from bench.methods.splatting.translation.translate import translated
from bench.plugins.registry import registry
from bench.plugins.schema import parameters
from bench.plugins.weights import load, shipped

TINY = DssPix2pix(
    ngf=4, dropout=0.5, adversarial=0.01, steps=6, batch=2, crop=32, examples_views=2, examples_pixels=40, neighbours=12
)
BALL = Shape("ball", trimesh.creation.icosphere(4, radius=0.8), exactness="mesh")
CUBE = Shape("cube", trimesh.creation.box((1, 1, 1)), exactness="polyhedron")


def seeded(seed=0):
    return torch.Generator().manual_seed(seed)


def count(network):
    return sum(parameter.numel() for parameter in network.parameters())


def noisy(shape, points=3000, sigma=0.02, seed=0):
    """Noisy points of a shape with tilted normals of the surface below them, and the exact normals."""
    rng = np.random.default_rng(seed)
    clean, _ = sample_poisson_disk(shape, points, rng)
    moved = clean + sigma * rng.normal(size=clean.shape)
    normals = shape.surface.closest(moved)[1]
    tilted = normals + 0.3 * rng.normal(size=normals.shape)
    return PointCloud(moved, tilted / np.linalg.norm(tilted, axis=1, keepdims=True)), normals


def degrees(normals, others):
    return float(np.degrees(np.arccos(np.clip((normals * others).sum(1), -1, 1))).mean())


@pytest.fixture(scope="module")
def examples():
    cases = [Case(shape.id, {"cloud": noisy(shape, 400)[0]}, shape) for shape in (BALL, CUBE)]
    recipes = [SimpleNamespace(build=lambda case=case: case) for case in cases]
    return TINY.examples(TrainingData(lambda: iter(recipes), sensor=lambda item: None, count=2), Run())


# -- the networks ------------------------------------------------------------------------------------------------------


def test_the_published_networks_have_the_published_sizes():
    assert count(Generator(64)) == 11_372_931
    assert count(Generator(16)) == 714_339
    # 4 x 4 windows: 6, 64, 128, 256 and 512 channels, with biases
    layers = [(6, 64), (64, 128), (128, 256), (256, 512), (512, 1)]
    assert count(Discriminator(64)) == sum(16 * before * after + after for before, after in layers)


def test_features_of_a_pixel_have_a_mean_square_of_one():
    features = torch.randn(2, 5, 4, 3, generator=seeded()) * 7
    found = PixelNorm()(features)
    torch.testing.assert_close(found.square().mean(1), torch.ones(2, 4, 3))
    torch.testing.assert_close(found * features.square().mean(1, keepdim=True).sqrt(), features)


def test_dropout_keeps_the_mean_and_draws_from_its_own_generator():
    layer, ones = Dropout(0.3), torch.ones(1, 10, 100, 100)
    layer.generator = seeded(1)
    state = torch.get_rng_state()
    found = layer(ones)
    assert torch.equal(state, torch.get_rng_state())
    assert sorted(found.unique().tolist()) == pytest.approx([0, 1 / 0.7])
    assert float(found.mean()) == pytest.approx(1, abs=0.01)
    layer.generator = seeded(1)
    assert torch.equal(layer(ones), found)
    assert torch.equal(layer.eval()(ones), ones)


@pytest.mark.parametrize("size", [(5, 3), (33, 46), (40, 64), (7, 101)])
def test_images_of_any_size_keep_it(size):
    image = torch.rand(2, 3, *size, generator=seeded())
    network = Generator(2, generator=seeded())
    with torch.no_grad():
        found = network(image)
    assert found.shape == image.shape
    assert found.min() >= -0.5 and found.max() <= 1.5
    # A network that corrects a smoothed image starts without corrections (near the border, it smooths a padded image).
    found = Generator(2, smoothing=1.5, normalisation="batch", generator=seeded())(image)
    torch.testing.assert_close(found[:, :, :-5, :-5], smoothed(image, 1.5)[:, :, :-5, :-5])


def test_smoothing_averages_covered_pixels():
    image = np.random.default_rng(0).uniform(0.3, 1.2, (12, 30, 3))
    image[3:5, 4:9] = image[:, 20:] = 0
    found = smoothed(torch.from_numpy(image).permute(2, 0, 1)[None], 1.0)[0].permute(1, 2, 0).numpy()
    rows, columns = np.nonzero(image.any(axis=2))
    for row, column in [(0, 0), (4, 6), (5, 19), (7, 21), (11, 3)]:
        apart = np.stack([rows - row, columns - column])
        weight = np.exp(-(apart**2).sum(0) / 2) * (np.abs(apart).max(0) <= 3)
        np.testing.assert_allclose(found[row, column], weight @ image[rows, columns] / weight.sum(), rtol=1e-9)
    np.testing.assert_array_equal(found[:, 24:], 0.5)  # no covered pixel is near


def test_the_receptive_field_of_the_discriminator_is_70_pixels():
    network = Discriminator(4, seeded())
    for layer in network.modules():
        if isinstance(layer, torch.nn.InstanceNorm2d):
            layer.forward = lambda features: features  # it depends on all pixels
    image = torch.randn(1, 3, 160, 160, generator=seeded(), requires_grad=True)
    answers = network(image.detach(), image)
    assert answers.shape == (1, 1, 18, 18)
    answers[0, 0, 9, 9].backward()
    rows, columns = (image.grad[0].abs().sum(0) > 0).nonzero().T
    assert int(rows.max() - rows.min()) + 1 == int(columns.max() - columns.min()) + 1 == 70


# -- pairs of images ---------------------------------------------------------------------------------------------------


def test_eight_bits_store_an_image_and_its_coverage():
    image = np.random.default_rng(0).uniform(0.3, 1.2, (9, 8, 3))
    image[2:4] = 0
    image[5, 5] = (1e-5, 0.0, 0.0)
    found = stored(image)
    assert found.dtype == np.uint8
    np.testing.assert_array_equal((found > 0).any(axis=2), (image > 0).any(axis=2))
    np.testing.assert_allclose(found * LIGHTEST / 255, image, atol=0.006)


def test_a_cloud_without_noise_looks_like_the_clean_one():
    points, normals = sample_poisson_disk(BALL, 2000, np.random.default_rng(0))
    pairs = list(drawn_pairs(PointCloud(points, normals), BALL, 3, 48, np.random.default_rng(1), 1))
    assert len(pairs) == 3
    for before, after in pairs:
        assert before.shape == after.shape == (48, 48, 3)
        covered = (before > 0).any(axis=2)
        assert covered.mean() > 0.3
        np.testing.assert_array_equal(covered, (after > 0).any(axis=2))
        assert np.abs(before - after)[covered].mean() < 0.03
        assert before.max() <= 1.2 + 1e-9


def test_rough_normals_are_oriented_like_the_given_ones():
    cloud, normals = noisy(BALL, 800, sigma=0.005)
    found = with_rough_normals(cloud, 12)
    assert (found.normals * cloud.normals).sum(1).min() >= 0
    assert degrees(found.normals, normals) < 0.7 * degrees(cloud.normals, normals)
    np.testing.assert_allclose(with_rough_normals(cloud, 0).normals, cloud.normals, atol=1e-12)


def test_examples_are_pairs_of_each_shape(examples):
    assert examples["noisy"].shape == examples["clean"].shape == (4, 40, 40, 3)
    assert examples["noisy"].dtype == np.uint8
    assert examples["shapes"].tolist() == [0, 0, 1, 1]
    np.testing.assert_array_equal((examples["noisy"] > 0).any(-1), (examples["clean"] > 0).any(-1))


def test_crops_are_parts_of_pairs_or_their_mirror_images(examples):
    crops = Crops(examples, 32, "cpu").draw(6, np.random.default_rng(1))
    images = {name: examples[name].astype(np.float32) * np.float32(LIGHTEST / 255) for name in ("noisy", "clean")}

    def is_part(a, b):
        parts = (np.s_[n, i : i + 32, j : j + 32] for n, i, j in np.ndindex(2, 9, 9))  # the second shape is held out
        return any(np.allclose(images["noisy"][p], a) and np.allclose(images["clean"][p], b) for p in parts)

    seen = set()
    for pair in zip(crops.noisy, crops.clean, strict=True):
        plain = is_part(*(crop.permute(1, 2, 0).numpy() for crop in pair))
        # A mirror image exchanges rows and columns, and so the light from the right (green) and from below (blue).
        assert plain or is_part(*(crop[[0, 2, 1]].permute(2, 1, 0).numpy() for crop in pair))
        seen.add(plain)
    assert seen == {False, True}
    assert torch.equal(crops.covered[:, 0], (crops.noisy > 0).any(1))


def test_the_error_is_over_covered_pixels_only(examples):
    batch = Crops(examples, 32, "cpu").draw(3, np.random.default_rng(0))
    assert float(batch.error(batch.clean)) == 0
    assert float(batch.error(batch.clean + 0.1 * batch.covered)) == pytest.approx(0.1, rel=1e-4)
    assert float(batch.error(torch.where(batch.covered, batch.clean, 9.0))) == 0


# -- training ----------------------------------------------------------------------------------------------------------


class Recorded(Run):
    """A run that records the checkpoints and validations of a training."""

    def __init__(self, resumed=None, seed=3):
        super().__init__(seed=seed)
        self.resumed, self.checkpoints, self.validations = resumed, {}, []

    def log(self, step, **numbers):
        self.validations += [numbers["validation"]] if "validation" in numbers else []

    def checkpoint(self, make):
        arrays = make()
        self.checkpoints[int(arrays["step"])] = {name: np.array(array) for name, array in arrays.items()}


def test_an_interrupted_training_ends_with_the_same_weights(examples):
    whole = Recorded()
    wanted = TINY.fit(examples, whole)
    assert (
        whole.parameters
        == count(Generator(4))
        == sum(array.size for name, array in wanted.items() if name.endswith(("weight", "bias")))
    )
    for step in (2, 5):
        found = TINY.fit(examples, Recorded(resumed=whole.checkpoints[step]))
        assert set(found) == set(wanted)
        for name in wanted:
            np.testing.assert_array_equal(found[name], wanted[name])
    other = TINY.fit(examples, Recorded(seed=4))
    assert any((other[name] != wanted[name]).any() for name in wanted)


def test_a_training_lowers_the_validation(examples):
    run = Recorded()
    method = DssPix2pix(ngf=4, steps=50, batch=2, crop=32, learning_rate=3e-3, smoothing=0, normalisation="pixel")
    own = {name: getattr(method, name) for name in Plan.__dataclass_fields__}
    start = Training(Generator(4, generator=seeded()), None, examples, Plan(**own), Run()).validate()
    method.fit(examples, run)
    assert min(run.validations) < 0.8 * start


def test_each_network_learns_from_its_own_part_of_the_loss(examples):
    def gradients(adversarial):
        plan = Plan(adversarial, 6, 2, 32, 1e-3)
        training = Training(Generator(2, generator=seeded()), Discriminator(2, seeded(1)), examples, plan, Run())
        training.loss(0).backward()
        return [
            torch.cat([p.grad.flatten() for p in network.parameters()])
            for network in (training.both.generator, training.both.discriminator)
        ]

    (made, judged), (strongly_made, strongly_judged) = gradients(0.0), gradients(100.0)
    torch.testing.assert_close(judged, strongly_judged)  # the adversarial weight does not affect the discriminator
    assert float((made - strongly_made).norm()) > 0.1 * float(made.norm())
    # With zero weight the generator learns from the distance alone, as without a discriminator.
    plan = Plan(0.0, 6, 2, 32, 1e-3)
    alone = Training(Generator(2, generator=seeded()), None, examples, plan, Run())
    alone.loss(0).backward()
    torch.testing.assert_close(torch.cat([p.grad.flatten() for p in alone.both.parameters()]), made)


@pytest.mark.parametrize(
    "wrong",
    [
        {"ngf": 0},
        {"dropout": 1.0},
        {"adversarial": -1},
        {"crop": 8},
        {"learning_rate": 0},
        {"neighbours": 2},
        {"smoothing": -1},
    ]
    + [{"steps": -1}, {"batch": 0}, {"examples_views": 0}, {"cycles": 0}],
)
def test_wrong_parameters_of_the_learned_filter_are_named(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        DssPix2pix(**wrong)


# -- the filter, with the shipped weights ------------------------------------------------------------------------------


def weights_of(**values):
    plugin = registry().find("method", "dss_pix2pix")
    file = shipped(plugin, parameters(plugin, DssPix2pix(**values)))
    assert file is not None and file.stat().st_size < 1.5e6
    return load(file)


def network_of(**values):
    network = Generator(16, smoothing=DssPix2pix(**values).smoothing, normalisation="batch")
    network.load_state_dict({name: torch.from_numpy(array) for name, array in weights_of(**values).items()})
    return network.eval()


@pytest.fixture(scope="module")
def network():
    return network_of()


def test_colours_stay_within_those_of_the_image(network):
    image = np.random.default_rng(0).uniform(0.3, 1.2, (30, 41, 3)) * [1, 0.5, 0.8]
    image[:9] = 0
    found = translated(image, network)
    assert found.shape == image.shape
    for channel in range(3):
        assert found[..., channel].min() >= image[9:, :, channel].min()
        assert found[..., channel].max() <= image[9:, :, channel].max()
    np.testing.assert_array_equal(translated(image, network), found)
    np.testing.assert_array_equal(translated(np.zeros((9, 9, 3)), network), np.zeros((9, 9, 3)))


def test_a_uniform_image_does_not_change(network):
    flat = np.broadcast_to([1.1, 0.4, 0.35], (32, 32, 3))
    np.testing.assert_allclose(translated(flat, network), flat, atol=1e-6)
    with torch.no_grad():  # and approximately even before clamping to the colours of the image
        found = network(torch.tensor(flat.transpose(2, 0, 1)[None], dtype=torch.float32))[0].permute(1, 2, 0)
    assert np.abs(found.numpy() - flat).mean() < 0.05


@pytest.mark.parametrize(
    ("neighbours", "smoothing", "size", "sigma"), [(32, 6.0, 0.7, 0.0346), (15, 3.0, 0.35, 0.0104)]
)
def test_translated_images_are_nearer_to_the_clean_ones(neighbours, smoothing, size, sigma):
    """For a small box with the sampling density and noise of a large one of 20,000 or 100,000 points."""
    shape = Shape("box", trimesh.creation.box((size, 0.9 * size, 1.1 * size)), exactness="polyhedron")
    cloud, normals = noisy(shape, 6000, sigma)
    cloud = with_rough_normals(PointCloud(cloud.points, normals), neighbours)
    network = network_of(neighbours=neighbours, smoothing=smoothing)
    before = after = 0.0
    span = 0.9 * size  # as many pixels per length as in the filter
    views = drawn_pairs(cloud, shape, 2, int(256 * span / 0.93), generator(1), 1, spans=(span, 1.01 * span))
    for image, wanted in views:
        covered = (image > 0).any(axis=2)
        before += np.abs(image - wanted)[covered].mean()
        after += np.abs(translated(image, network) - wanted)[covered].mean()
    assert after < 0.8 * before  # true normals at noisy points: 0.4 to 0.7, because the points are displaced


def test_a_noisy_cube_becomes_flatter_and_its_normals_better():
    cloud, normals = noisy(CUBE, 2000, sigma=0.04)
    method = DssPix2pix(cycles=2, views=6, pixels=112, span=1.2, depth_limit=0.1)
    run = Run(seed=1, weights=weights_of())
    found = method.denoise(cloud, run)
    assert len(found) == len(cloud) and run.parameters == 714_339

    def height(points):
        return float(np.abs(np.abs(points).max(axis=1) - 0.5).mean())

    assert height(found.points) < 0.55 * height(cloud.points)
    rough = with_rough_normals(cloud, method.neighbours)
    assert degrees(found.normals, normals) < 0.95 * degrees(rough.normals, normals)
    assert degrees(found.normals, normals) < 0.8 * degrees(cloud.normals, normals)
