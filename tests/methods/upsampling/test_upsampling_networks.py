"""The unit of MPU: numbers of parameters, layers against their textbook forms, gradients."""

import numpy as np
import pytest
import torch

from bench.methods.upsampling.networks.bilateral import Nearby, interpolate
from bench.methods.upsampling.networks.dense_features import DenseBlock, DenseFeatures
from bench.methods.upsampling.networks.neighbours import gather, nearest, nearest_others
from bench.methods.upsampling.networks.unit import Form, Unit, Units

SMALL = Form(growth=2, neighbours=4)


def seeded():
    return torch.Generator().manual_seed(3)


def draw(*shape, dtype=torch.float32):
    return torch.randn(*shape, generator=seeded(), dtype=dtype)


def parameters(module):
    return sum(parameter.numel() for parameter in module.parameters())


@pytest.mark.parametrize(
    ("form", "one"),
    [
        (Form(), 76_027),
        (Form(layers=2), 65_803),
        (Form(features="pu_net"), 466_403),
        (Form(expansion="pu_net"), 226_939),
    ],
)
def test_the_number_of_parameters(form, one):
    assert parameters(Unit(form)) == one
    assert parameters(Units(4, form)) == 4 * one


def test_the_number_of_parameters_of_features():
    assert parameters(DenseFeatures()) == 17_016 and DenseFeatures().outputs == 264


@pytest.mark.parametrize("function", ["others", "points"])
def test_neighbours_match_all_pairs(function):
    x, y = draw(5, 3, 40), draw(5, 3, 60)
    if function == "others":
        index = nearest_others(x, 6)
        distance = (x[:, :, :, None] - x[:, :, None]).norm(dim=0) + torch.eye(40) * 1e9
    else:
        index = nearest(x, y, 6)
        distance = (x[:, :, :, None] - y[:, :, None]).norm(dim=0)
    wanted = distance.topk(6, largest=False).indices
    assert torch.equal(index.transpose(1, 2).sort().values, wanted.sort().values)


@pytest.mark.parametrize("points", [1, 2, 5])
def test_few_points_have_few_neighbours_and_never_themselves(points):
    index = nearest_others(torch.zeros(3, 2, points), 32)
    assert index.shape == (2, max(1, points - 1), points)
    assert points == 1 or not (index == torch.arange(points)).any()


@pytest.mark.parametrize("layers", [2, 3, 4])
def test_factored_layers_equal_those_on_tiled_edges(layers):
    block = DenseBlock(6, 4, layers, 5, seeded()).double()
    for layer in block.layers:
        torch.nn.init.normal_(layer.bias, generator=seeded())
    x = draw(6, 2, 30, dtype=torch.float64)
    index = nearest_others(x, 5)
    own = x[:, :, None].expand(-1, -1, 5, -1)
    value = block.layers[0](torch.cat([own, gather(x, index) - own]))
    y = own
    for layer in block.layers[1:]:
        y = torch.cat([value.relu(), y])
        value = layer(y)
    wanted = torch.cat([value, y]).amax(2)
    torch.testing.assert_close(block(x), wanted)


def naive(features, squared, near):
    """The formula, point by point."""
    b, k, n = squared.shape
    result = np.zeros(features.shape)
    for patch in range(b):
        between = ((near[:, patch] - features[:, patch, None]) ** 2).sum(axis=0)
        h_space = np.mean([squared[patch, :, i].min() for i in range(n)])
        h_features = np.mean([between[:, i].min() for i in range(n)])
        for i in range(n):
            w = np.exp(-squared[patch, :, i] / (h_space / 2)) * np.exp(-between[:, i] / (h_features / 2))
            w = w / (w + 1e-5).sum()
            result[:, patch, i] = sum(w[j] * near[:, patch, j, i] for j in range(k))
    return result


def test_interpolated_features_match_the_formula():
    features, near = draw(7, 2, 20, dtype=torch.float64), draw(7, 2, 5, 20, dtype=torch.float64)
    squared = draw(2, 5, 20, dtype=torch.float64) ** 2
    found = interpolate(features, Nearby(squared, near)).numpy()
    np.testing.assert_allclose(found, naive(features.numpy(), squared.numpy(), near.numpy()), rtol=1e-7)


def test_interpolated_features_are_finite_where_all_points_coincide():
    near = draw(7, 1, 5, 20)
    found = interpolate(near[:, :, 0], Nearby(torch.zeros(1, 5, 20), near))
    assert torch.isfinite(found).all()
    torch.testing.assert_close(found, near[:, :, 0], rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("expansion", ["code", "pu_net"])
def test_gradient_of_a_unit_matches_finite_differences(expansion):
    unit = Unit(Form(growth=6, neighbours=4, expansion=expansion), seeded()).double()
    points, squared = draw(3, 2, 12, dtype=torch.float64), draw(2, 5, 12, dtype=torch.float64) ** 2
    near = draw(unit.features.outputs, 2, 5, 12, dtype=torch.float64)
    inputs = [points, near, *unit.parameters()]
    directions = [torch.randn(x.shape, generator=seeded(), dtype=torch.float64) * 1e-6 for x in inputs]

    def value(at):
        with torch.no_grad():
            for x, start, direction in zip(inputs, starts, directions, strict=True):
                x.copy_(start + at * direction)
        dense, features = unit(points, None)
        # The gradient treats the weights of the interpolation as constants; so do the differences here.
        return dense.sin().sum() + (features + weighted(near)).cos().sum()

    def weighted(near):
        return (near * torch.softmax(-squared, dim=1)).sum(2)

    starts = [x.detach().clone() for x in inputs]
    difference = (value(1.0) - value(-1.0)).item() / 2
    for x in (points, near):
        x.requires_grad_()
    value(0.0).backward()
    slope = sum((x.grad * direction).sum().item() for x, direction in zip(inputs, directions, strict=True))
    assert difference == pytest.approx(slope, rel=1e-5)


def test_features_of_the_previous_level_get_a_gradient_but_not_their_weights():
    unit = Unit(SMALL, seeded())
    points, near = draw(3, 2, 12), draw(unit.features.outputs, 2, 5, 12).requires_grad_()
    squared = draw(2, 5, 12).square().requires_grad_()
    dense, features = unit(points, Nearby(squared, near))
    dense.sum().backward()
    assert near.grad.abs().sum() > 0 and squared.grad is None
    torch.testing.assert_close(
        features - unit(points)[1], unit.skip * interpolate(unit(points)[1], Nearby(squared, near))
    )


def test_a_unit_with_features_of_pu_net_runs_on_few_points():
    unit = Unit(Form(features="pu_net"), seeded())
    for points in (1, 3, 60):
        dense, features = unit(draw(3, 2, points))
        assert dense.shape == (3, 2, 2 * points) and features.shape == (259, 2, points)
        assert torch.isfinite(dense).all()
