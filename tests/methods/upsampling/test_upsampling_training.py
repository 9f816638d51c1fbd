"""The training of MPU: loss, schedule, patches of the examples, and resumption after an interruption."""

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree

from bench import Run
from bench.methods.upsampling.mpu import Mpu
from bench.methods.upsampling.networks.levels import run_levels
from bench.methods.upsampling.networks.unit import Form, Units
from bench.methods.upsampling.training.clouds import Clouds, Draw, pack, rotations
from bench.methods.upsampling.training.fit import Plan, Training
from bench.methods.upsampling.training.loss import chamfer
from bench.methods.upsampling.training.schedule import moment

SMALL = {"levels": 2, "growth": 2, "convolutions": 2, "neighbours": 4, "patch": 16, "batch": 2, "bases": (64,)}


def sphere(count, rng):
    points = rng.normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def examples(levels=2, shapes=3, base=64):
    rng = np.random.default_rng(0)
    return pack((shape, [sphere(base << k, rng) for k in range(levels + 1)]) for shape in range(shapes))


class Recorded(Run):
    """A run that records the logs and checkpoints of a training."""

    def __init__(self, resumed=None, seed=0):
        super().__init__(seed=seed)
        self.resumed, self.checkpoints, self.lines = resumed, {}, []

    def log(self, step, **numbers):
        self.lines.append((step, numbers))

    def checkpoint(self, make):
        arrays = make()
        self.checkpoints[int(arrays["step"])] = {name: np.array(array) for name, array in arrays.items()}


def training(method, run=None, levels=2):
    own = {name: getattr(method, name) for name in Plan.__dataclass_fields__}
    return Training(method._network(torch.Generator().manual_seed(0)), examples(levels), Plan(**own), run or Recorded())


# --- loss -------------------------------------------------------------------------------------------------------------


def test_identical_sets_have_no_loss():
    points = torch.randn(3, 2, 50, generator=torch.Generator().manual_seed(0))
    assert chamfer(points, points.flip(2)).abs().max() < 1e-12


def test_loss_is_the_mean_squared_distance_in_both_directions():
    points, truth = torch.zeros(3, 1, 2), torch.zeros(3, 1, 1)
    points[0, 0] = torch.tensor([1.0, 2.0])
    assert chamfer(points, truth).item() == pytest.approx((1 + 4) / 2 + 1)


def test_an_outlier_does_not_count_once_levels_are_trusted():
    truth = torch.zeros(3, 1, 10)
    truth[0, 0] = torch.arange(10.0)
    points = truth + 0.1
    points[1, 0, 3] = 4.0
    points.requires_grad_()
    chamfer(points, truth, outliers=False).sum().backward()
    assert points.grad[:, 0, 3].abs().max() == 0 and points.grad[:, 0, 4].abs().max() > 0
    assert chamfer(points, truth) > chamfer(points, truth, outliers=False) + 1


# --- schedule ---------------------------------------------------------------------------------------------------------


def test_stages_are_those_of_the_paper():
    found = [moment(step, 800, 4, "progressive") for step in range(0, 800, 100)]
    assert [(m.first, m.level) for m in found] == [(1, 1), (2, 2), (1, 2), (3, 3), (1, 3), (4, 4), (1, 4), (1, 4)]
    assert [m.rate for m in found] == [0.5, 1, 0.5, 1, 0.5, 1, 0.5, 0.5]
    assert [m.outliers for m in found] == [True, True, False, True, False, True, False, False]
    assert not moment(165, 800, 4, "progressive").outliers


def test_each_level_opens_once():
    for stages in ("progressive", "apart"):
        opened = [m.level for step in range(70) if (m := moment(step, 70, 4, stages)).opens]
        assert opened == [1, 2, 3, 4]


def test_higher_levels_are_drawn_more_often():
    rng = np.random.default_rng(0)
    drawn = [moment(799, 800, 4, "progressive").draw(rng) for _ in range(4000)]
    np.testing.assert_allclose(np.bincount(drawn)[1:] / 4000, [0.1, 0.2, 0.3, 0.4], atol=0.03)


@pytest.mark.parametrize(
    ("stages", "step", "frozen"),
    [
        ("progressive", 0, {1}),
        ("progressive", 10, {0}),
        ("progressive", 25, set()),
        ("apart", 30, {0}),
        ("at_once", 0, set()),
    ],
)
def test_frozen_units_get_no_gradient(stages, step, frozen):
    trained = training(Mpu(**SMALL, steps=40, stages=stages))
    trained.prepare(step)
    for number in range(8):  # joint stages draw one level
        trained.loss(step + number).backward()
    for level in range(2):
        gradients = [p.grad for p in trained.network[level].parameters()]
        if level in frozen:
            assert all(gradient is None for gradient in gradients)
        else:
            assert sum(float(gradient.abs().sum()) for gradient in gradients) > 0


def test_a_unit_starts_with_the_weights_of_the_previous_one():
    trained = training(Mpu(**SMALL, steps=40))
    trained.prepare(10)
    first, second = (trained.network[level].state_dict() for level in range(2))
    assert all(torch.equal(first[name], second[name]) for name in first)
    apart = training(Mpu(**SMALL, steps=40, inherit=False))
    apart.prepare(10)
    assert not torch.equal(apart.network[0].offset.weight, apart.network[1].offset.weight)


# --- patches ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("apart", [False, True])
@pytest.mark.parametrize("levels", [1, 2, 3])
def test_output_and_truth_have_twice_the_points_of_a_patch_at_every_level(levels, apart):
    network = Units(3, Form(growth=2, layers=2, neighbours=4), torch.Generator().manual_seed(0))
    clouds = Clouds(examples(3), lambda points: 16, "cpu")
    rng = np.random.default_rng(0)
    wanted = list(range(1, levels + 1)) if apart else [levels]
    points, *truths = clouds.batch(0, 2, wanted, rng, Draw())
    assert points.shape == (3, 2, 16) and [t.shape[2] for t in truths] == [16 << level for level in wanted]
    output, truth = run_levels(network, points, truths, levels, rng, apart=apart)
    assert output.shape == truth.shape == (3, 2, 32)


def test_patches_are_normalised_with_their_truth():
    rng = np.random.default_rng(0)
    clouds = Clouds(examples(), lambda points: 16, "cpu")
    points, truth = clouds.batch(0, 5, [2], rng, Draw())
    torch.testing.assert_close(points.mean(2), torch.zeros(3, 5), atol=1e-5, rtol=0)
    torch.testing.assert_close(points.norm(dim=0).amax(1), torch.ones(5))
    assert chamfer(points, truth).max() < 0.3
    scaled, _ = clouds.batch(0, 50, [2], rng, Draw(scale=0.2))
    radius = scaled.norm(dim=0).amax(1)
    assert 0.8 <= radius.min() < 0.85 and 1.15 < radius.max() <= 1.2


def test_clouds_of_different_sizes_can_share_a_batch():
    rng = np.random.default_rng(0)
    sizes = [30, 200, 7, 90]
    alone = [rng.normal(size=(size, 3)) * (1 + number) for number, size in enumerate(sizes)]
    packed = pack((number, [cloud, cloud]) for number, cloud in enumerate(alone))
    stack = Clouds(packed | {"shapes": np.zeros(4, int)}, lambda points: 16, "cpu").stack(np.array([2, 0, 3, 1]), 0)
    seeds = stack.seeds(rng)
    found = stack.around(seeds, 16)
    assert found.shape == (3, 4, 16)
    for number, which in enumerate([2, 0, 3, 1]):
        cloud, seed = alone[which], seeds[:, number, 0].numpy()
        assert np.abs(cloud - seed).max(axis=1).min() < 1e-3  # one of its points
        order = np.linalg.norm(cloud - seed, axis=1).argsort()[:16]
        distance, index = cKDTree(cloud).query(found[:, number].T.numpy())
        assert distance.max() < 1e-3  # rounding to 16 bits
        # Seven points are repeated in turn; of larger clouds the nearest occur once.
        times = np.bincount(index, minlength=len(cloud))
        assert set(index) == set(order) and times.max() == -(-16 // len(order))


def test_held_out_shapes_are_in_no_batch():
    packed = examples(shapes=12)
    training_set, held_out = (Clouds(packed, lambda points: 16, "cpu", held_out=h) for h in (False, True))
    assert set(packed["shapes"][np.concatenate(held_out._groups)]) == {11}
    assert set(packed["shapes"][np.concatenate(training_set._groups)]) == set(range(11))


def test_packed_clouds_are_precise_to_a_thirty_thousandth():
    rng = np.random.default_rng(0)
    cloud = sphere(100, rng) * 3
    packed = pack([(0, [cloud, cloud])])
    np.testing.assert_allclose(packed["points"][:100] * packed["scales"][0], cloud, atol=3 / 60_000)


def test_rotations_are_uniform():
    turns = rotations(20_000, np.random.default_rng(0))
    np.testing.assert_allclose(turns @ turns.transpose(0, 2, 1), np.broadcast_to(np.eye(3), turns.shape), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(turns), 1)
    np.testing.assert_allclose(turns.mean(axis=0), 0, atol=0.02)
    np.testing.assert_allclose((turns**2).mean(axis=0), 1 / 3, atol=0.02)


# --- fit --------------------------------------------------------------------------------------------------------------


def test_an_interrupted_training_ends_with_the_same_weights():
    method = Mpu(**SMALL, steps=24)
    whole = Recorded()
    wanted = method.fit(examples(), whole)
    for step in (3, 17):
        found = method.fit(examples(), Recorded(resumed=whole.checkpoints[step]))
        assert set(found) == set(wanted)
        for name in wanted:
            np.testing.assert_array_equal(found[name], wanted[name])


@pytest.mark.parametrize(
    "changes", [{}, {"single": True}, {"stages": "at_once"}, {"stages": "apart"}, {"recut": False}]
)
def test_a_training_lowers_the_validation(changes):
    run = Recorded()
    Mpu(**SMALL, steps=40, learning_rate=5e-3, **changes).fit(examples(), run)
    scores = [numbers["validation"] for _, numbers in run.lines if "validation" in numbers]
    start = training(Mpu(**SMALL, steps=40, **changes)).validate()
    assert min(scores) < 0.95 * start
    assert run.parameters == (1 if changes.get("single") else 2) * sum(
        p.numel() for p in Mpu(**SMALL)._network()[0].parameters()
    )


class Clocked(Recorded):
    """A run whose clock advances with each reading."""

    def __init__(self, seconds, resumed=None, spent=0.0):
        super().__init__(resumed)
        self.seconds, self.spent, self.now = seconds, spent, 0.0

    def elapsed(self):
        self.now += 0.25
        return self.now


def test_without_a_number_of_steps_the_stages_follow_the_clock():
    method = Mpu(**SMALL, steps=0, learning_rate=5e-3)
    run = Clocked(40.0)
    method.fit(examples(), run)
    assert 30 < max(run.checkpoints) < 160
    trained = training(method, Clocked(40.0))
    seen, opened = [], []
    for step in range(150):
        trained.prepare(step)
        seen.append((trained._now.first, trained._now.level))
        if torch.equal(*(trained.network[level].offset.weight for level in range(2))):
            opened.append(step)
    assert list(dict.fromkeys(seen)) == [(1, 1), (2, 2), (1, 2)] and opened
    # Interrupted after 30 of 40 seconds, it resumes in the last stage.
    late = training(method, Clocked(10.0, spent=30.0))
    late.prepare(60)
    assert (late._now.first, late._now.level) == (1, 2)


def test_a_training_by_the_clock_reports_its_steps():
    run, told = Clocked(10.0), []
    run.on_progress = lambda done, total: told.append((done, total))
    Mpu(**SMALL, steps=0).fit(examples(), run)
    assert [done for done, _ in told] == list(range(1, len(told) + 1))
    assert all(done <= total for done, total in told) and told[-1][0] == run.lines[-1][0]


def test_if_time_is_too_short_for_the_steps_the_stages_follow_the_clock():
    method = Mpu(**SMALL, steps=100_000, learning_rate=5e-3)
    trained = training(method, Clocked(40.0))
    seen, rates = [], []
    for step in range(150):
        trained.prepare(step)
        seen.append((trained._now.first, trained._now.level))
        rates.append(trained.optimizer.param_groups[0]["lr"])
    assert list(dict.fromkeys(seen)) == [(1, 1), (2, 2), (1, 2)]
    assert rates[-1] < 0.2 * max(rates)  # the rate falls at the end


def test_if_time_is_long_enough_the_clock_changes_nothing():
    steps = 60
    in_time, without_clock = (training(Mpu(**SMALL, steps=steps), run) for run in (Clocked(20.0), None))
    for step in range(steps):  # 60 readings of the clock, at most 15 of the 20 seconds
        for each in (in_time, without_clock):
            each.prepare(step)
        assert in_time._now == without_clock._now
        assert in_time.optimizer.param_groups[0]["lr"] == without_clock.optimizer.param_groups[0]["lr"]
