"""ALIGNet: control grids, volumes, and the training."""

import numpy as np
import pytest
import torch
from learned_deformation_toys import (
    SHARED_MISTAKES,
    assert_deforms,
    assert_learns,
    assert_refuses,
    assert_resumes,
    examples,
    generator,
    number_of_parameters,
    points,
)

from bench import Run
from bench.methods.deformation.alignnet import Alignnet
from bench.methods.deformation.networks.grid_network import GridNetwork, monotone, occupancy, spacing, warp
from bench.methods.deformation.training.grid_training import GridTraining
from bench.methods.deformation.training.terms import chamfer

TOY = Alignnet(cells=4, voxels=8, channels=4, points=64, steps=3, batch=2)


def even(cells, count=1):
    return monotone(torch.full((count, 3, cells, cells, cells), spacing(cells)))


def test_even_increments_are_the_identity():
    grid, x = even(8, 2), points((2, 50, 3))
    torch.testing.assert_close(warp(grid, x), x, atol=1e-6, rtol=0)
    corner = torch.tensor([-1.0, 1.0])
    torch.testing.assert_close(grid[0, :, 0, -1, 0], torch.tensor([-1.0, 1.0, -1.0]), atol=1e-6, rtol=0)
    assert corner.tolist() == pytest.approx([float(grid[0, 2].min()), float(grid[0, 2].max())], abs=1e-6)


def test_an_untrained_network_is_the_identity():
    network = GridNetwork(8, 16, 4, 5, generator())
    source, target = points((3, 50, 3)), points((3, 40, 3), 1)
    torch.testing.assert_close(network(source, network.encode(source, target)), source, atol=1e-6, rtol=0)
    assert 2 * number_of_parameters(Alignnet()._network()) < 1.5e6


def test_monotone_grids_preserve_order():
    """For any increments, neighbours keep their order, and so do points on a line along an axis."""
    grid = monotone(torch.randn(4, 3, 5, 5, 5, generator=generator()))
    for axis in range(3):
        assert (grid[:, axis].diff(dim=1 + axis) >= 0).all()
        line = points((4, 1, 3)).repeat(1, 200, 1)
        line[:, :, axis] = torch.linspace(-1, 1, 200)
        assert (warp(grid, line)[:, :, axis].diff(dim=1) >= -1e-6).all()


def test_a_grid_without_shears_never_folds():
    """Without shears the map is a monotone function per axis: its Jacobian has a positive determinant."""
    steps = torch.rand(3, 6, generator=generator()) + 0.01
    increments = torch.stack(
        [steps[axis].reshape([6 if k == axis else 1 for k in range(3)]).expand(6, 6, 6) for axis in range(3)]
    )
    x = points((40, 3)).double() * 0.99
    slopes = torch.autograd.functional.jacobian(lambda p: warp(monotone(increments[None].double()), p[None]).sum(1), x)
    determinants = torch.linalg.det(slopes[0].permute(1, 0, 2))
    assert (determinants > 0).all()


def test_a_warp_is_trilinear():
    grid, x = monotone(torch.randn(1, 3, 4, 4, 4, generator=generator())), points((1, 20, 3), 1)
    expected = []
    for p in x[0].numpy():
        place = (p + 1) / 2 * 3
        low = np.minimum(place.astype(int), 2)
        part = place - low
        value = np.zeros(3)
        for corner in np.ndindex(2, 2, 2):
            weight = np.prod(np.where(corner, part, 1 - part))
            value += weight * grid[0][(slice(None), *(low + corner))].numpy()
        expected.append(value)
    np.testing.assert_allclose(warp(grid, x)[0].numpy(), expected, atol=1e-5)


def test_a_point_outside_the_box_moves_like_the_nearest_one_inside():
    grid = monotone(torch.randn(1, 3, 4, 4, 4, generator=generator()))
    edge = torch.tensor([[[1.0, 0.3, -1.0]]])
    away = torch.tensor([[[0.5, 0.0, -2.0]]])
    torch.testing.assert_close(warp(grid, edge + away) - away, warp(grid, edge))


def test_cells_that_hold_a_point_are_occupied():
    volume = occupancy(torch.tensor([[[-1.0, -1, -1], [0.99, -0.99, 0.1], [1, 1, 1]]]), 4)
    assert volume.sum() == 3 and volume[0, 0, 0, 0] == volume[0, 3, 0, 2] == volume[0, 3, 3, 3] == 1


def test_the_loss_is_zero_for_equal_shapes_and_an_even_grid():
    training = GridTraining(TOY._network(generator()), examples(), TOY, Run())
    shapes = points((2, 1, 128, 3)).expand(-1, 2, -1, -1)
    assert training.terms(shapes, np.random.default_rng(0), 0.0).item() == pytest.approx(0, abs=1e-6)


def test_uneven_increments_add_their_mean_deviation_to_the_loss():
    """The first increments along x are larger: all points move along x, and the loss gains the deviation."""
    method = Alignnet(cells=4, voxels=8, channels=4, points=64, even=0.5)
    training = GridTraining(method._network(generator()), examples(), method, Run())
    with torch.no_grad():
        training.network.last.bias.reshape(3, 4, 4, 4)[0, 0] += 0.3
    shapes = points((2, 1, 128, 3)).expand(-1, 2, -1, -1).clone()
    first, second = training.terms(shapes, np.random.default_rng(0), 0.0), shapes[:, :, :64] + torch.tensor([0.3, 0, 0])
    moved = chamfer(second[:, 0], shapes[:, 0, :64])
    assert first.item() == pytest.approx(moved.item() + 0.09 + 0.5 * 0.3 / 12, rel=1e-4)


def test_an_interrupted_training_resumes_exactly():
    assert_resumes(TOY, examples())


def test_a_training_learns():
    method = Alignnet(cells=4, voxels=16, channels=8, points=64, batch=2, learning_rate=3e-3)
    assert_learns(GridTraining(method._network(generator()), examples(), method, Run()), 30, 0.8)


def test_a_source_keeps_its_faces_in_any_frame():
    assert_deforms(TOY, TOY.fit(examples(), Run()))


def test_invalid_parameters_are_refused():
    own = {"cells": 1, "voxels": 10, "channels": 0, "narrow": 0, "even": -1.0}
    assert_refuses(Alignnet, SHARED_MISTAKES | own)
