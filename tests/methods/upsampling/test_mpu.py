"""MPU applied to clouds: exact counts for every ratio and cloud, and invariances."""

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from bench import BadInput, PointCloud, Run, Shape
from bench.methods.upsampling.mpu import Mpu

LIGHT = {"growth": 4, "convolutions": 2, "neighbours": 8}
RNG = np.random.default_rng(0)


def sphere(count):
    points = RNG.normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def upsampled(method, points, ratio):
    run = Run()
    network = method._network(torch.Generator().manual_seed(0))
    run.weights = {name: tensor.numpy() for name, tensor in network.state_dict().items()}
    result = method.upsample(PointCloud(points), ratio, run).points
    assert np.isfinite(result).all()
    return result


def test_the_number_of_parameters():
    run = Run()
    run.weights = {name: tensor.numpy() for name, tensor in Mpu()._network().state_dict().items()}
    Mpu().upsample(PointCloud(sphere(40)), 2, run)
    assert run.parameters == 304_108


@pytest.mark.parametrize("ratio", [1, 2, 3, 4, 16, 32])
def test_the_count_is_exact(ratio):
    assert upsampled(Mpu(**LIGHT), sphere(60), ratio).shape == (60 * ratio, 3)


@pytest.mark.parametrize(
    "changes",
    [
        *({"single": True}, {"features": "pu_net"}, {"expansion": "pu_net"}, {"skip": 0.0}),
        *({"central": 0}, {"central": 2}, {"recut": False}, {"recut": False, "central": 0}),
    ],
)
def test_the_count_is_exact_for_every_variant(changes):
    assert upsampled(Mpu(**{**LIGHT, **changes}), sphere(100), 4).shape == (400, 3)


@pytest.mark.parametrize("points", [2, 5, 32, 33, 34])
def test_tiny_clouds(points):
    assert upsampled(Mpu(**LIGHT), sphere(points), 4).shape == (4 * points, 3)


def test_clouds_of_copies():
    assert upsampled(Mpu(**LIGHT), sphere(20).repeat(10, axis=0), 4).shape == (800, 3)


def test_points_that_are_not_finite_are_refused():
    with pytest.raises(BadInput, match="NaN"):
        upsampled(Mpu(**LIGHT), np.full((50, 3), np.nan), 4)
    with pytest.raises(BadInput, match="coincide"):
        upsampled(Mpu(**LIGHT), np.full((50, 3), 0.3), 4)


def test_625_points_sixteenfold():
    assert upsampled(Mpu(**LIGHT), sphere(625), 16).shape == (10_000, 3)


def test_runs_are_repeatable_for_any_order_of_the_input():
    points = sphere(200)
    first = upsampled(Mpu(**LIGHT), points, 4)
    np.testing.assert_array_equal(upsampled(Mpu(**LIGHT), points, 4), first)
    np.testing.assert_array_equal(upsampled(Mpu(**LIGHT), points[RNG.permutation(200)], 4), first)


def test_scale_and_position_make_no_difference():
    points = sphere(200)
    first = upsampled(Mpu(**LIGHT), points, 4)
    np.testing.assert_allclose(upsampled(Mpu(**LIGHT), points * 4, 4), first * 4, atol=1e-12)
    moved = upsampled(Mpu(**LIGHT), points + 8, 4) - 8
    assert cKDTree(first).query(moved)[0].mean() < 0.02


def test_a_network_without_offsets_is_equivariant_to_rotations():
    """Only the network is not equivariant: with zero offsets each point stays, up to thinning."""
    points, turn = sphere(200), Rotation.from_euler("xyz", [0.3, 1.0, 2.0]).as_matrix()

    def copied(points):
        method, run = Mpu(**LIGHT), Run()
        state = method._network().state_dict()
        zero = {name for name in state if ".offset." in name}
        run.weights = {name: t.numpy() * (name not in zero) for name, t in state.items()}
        return method.upsample(PointCloud(points), 4, run).points

    found = copied(points @ turn.T) @ turn
    assert cKDTree(points).query(found)[0].max() < 1e-6
    assert cKDTree(copied(points)).query(found)[0].max() < 1e-6


@pytest.mark.parametrize(
    "wrong",
    [{"levels": 0}, {"skip": -1}, {"central": -1}, {"patch": 1}, {"bases": ()}, {"scans": ("a",)}, {"convolutions": 1}],
)
def test_wrong_parameters_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Mpu(**wrong)


def test_without_offsets_each_point_is_repeated_by_the_ratio():
    """No point is lost and none preferred: with zero offsets, each input point is repeated four times."""
    method, run, points = Mpu(**LIGHT), Run(), sphere(200)
    state = method._network().state_dict()
    run.weights = {name: t.numpy() * (".offset." not in name) for name, t in state.items()}
    found = method.upsample(PointCloud(points), 4, run).points
    distance, index = cKDTree(points).query(found)
    assert distance.max() < 1e-6 and (np.bincount(index, minlength=200) == 4).all()


def test_examples_are_clouds_of_doubling_density():
    from types import SimpleNamespace

    import trimesh

    case = SimpleNamespace(
        id="ball",
        input={"cloud": PointCloud(sphere(30))},
        reference=Shape("ball", trimesh.creation.icosphere(3)),
    )

    def sense(case, sensor, rng):
        return PointCloud(rng.normal(size=(int(sensor), 3)))

    data = SimpleNamespace(cases=[case, case], count=2, seed=0, sense=sense)
    made = Mpu(levels=2, bases=(50, 0)).examples(data, Run())
    assert made["counts"].tolist() == [[50, 100, 200], [30, 60, 120]] * 2
    assert made["shapes"].tolist() == [0, 0, 1, 1]
    again = Mpu(levels=2, bases=(50, 0)).examples(data, Run())
    assert all(np.array_equal(made[name], again[name]) for name in made)
    scanned = Mpu(levels=2, scans=("10", "20", "40")).examples(data, Run())
    assert scanned["counts"].tolist() == [[10, 20, 40]] * 2
