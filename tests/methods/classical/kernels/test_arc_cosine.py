"""The arc-cosine kernel: against random ReLU features, finite differences, dense solutions and closed forms."""

import numpy as np
import pytest

from bench import Run
from bench.methods.classical.kernels import arc_cosine
from bench.methods.classical.kernels.nystrom import KernelField, fitted


def some(seed=0):
    """Points, centres, some of them equal to points or close, and directions."""
    rng = np.random.default_rng(seed)
    x, z = rng.uniform(-0.8, 0.8, (6, 3)), rng.uniform(-0.8, 0.8, (5, 3))
    z[0], z[1] = x[0], x[1] + 1e-5
    return x, z, rng.standard_normal((5, 3))


def rows(x, z, n):
    out = np.empty((4, len(x), 2 * len(z)))
    arc_cosine.rows(x, np.ascontiguousarray(z.T), np.ascontiguousarray(n.T), out)
    return out


def kernel(x, z):
    """The kernel by its definition with an arccosine: (len(x), len(z))."""
    u, v = np.column_stack([x, np.ones(len(x))]), np.column_stack([z, np.ones(len(z))])
    sizes = np.linalg.norm(u, axis=1)[:, None] * np.linalg.norm(v, axis=1)
    angle = np.arccos(np.clip(u @ v.T / sizes, -1, 1))
    return sizes * (np.sin(angle) + (np.pi - angle) * np.cos(angle)) / (2 * np.pi)


def test_values_match_the_definition_also_far_away():
    x, z, n = some()
    assert np.abs(rows(x, z, n)[0, :, :5] - kernel(x, z)).max() < 1e-14
    far = 50 * x
    np.testing.assert_allclose(rows(far, -z, n)[0, :, :5], kernel(far, -z), rtol=1e-8)


def test_rows_are_means_over_random_relu_units():
    x, z, n = some()
    w = np.random.default_rng(1).standard_normal((400_000, 4))
    at_x, at_z = w @ np.column_stack([x, np.ones(6)]).T, w @ np.column_stack([z, np.ones(5)]).T
    along = (at_z > 0) * (w[:, :3] @ n.T)
    functions = np.concatenate([np.maximum(at_z, 0), along], axis=1) / len(w)
    found = rows(x, z, n)
    assert np.abs(np.maximum(at_x, 0).T @ functions - found[0]).max() < 0.02
    for axis in range(3):
        assert np.abs(((at_x > 0) * w[:, axis : axis + 1]).T @ functions - found[1 + axis]).max() < 0.02


def test_derivatives_match_finite_differences():
    x, z, n = some()
    step, found = 1e-6, rows(x, z, n)
    directional = (kernel(x, z + step * n) - kernel(x, z - step * n)) / (2 * step)
    np.testing.assert_allclose(found[0, :, 5:], directional, atol=1e-7)
    for axis in range(3):
        move = step * np.eye(3)[axis]
        difference = (rows(x + move, z, n)[0] - rows(x - move, z, n)[0]) / (2 * step)
        # The second derivative has a kink where a point is a centre.
        np.testing.assert_allclose(found[1 + axis], difference, atol=2e-6)


def test_a_field_is_the_product_of_rows_and_weights():
    x, z, n = some(3)
    alpha, beta = np.random.default_rng(4).standard_normal((2, 5))
    field = KernelField(np.ascontiguousarray(z.T), np.ascontiguousarray(n.T), alpha, beta)
    np.testing.assert_allclose(field(x), rows(x, z, n)[0] @ np.concatenate([alpha, beta]), atol=1e-14)
    threaded = KernelField(field.centers, field.directions, alpha, beta, threads=3)
    assert np.array_equal(field(np.tile(x, (50, 1))), threaded(np.tile(x, (50, 1))))


@pytest.mark.parametrize("chosen", [60, 25])
def test_a_fit_is_the_dense_solution(chosen):
    rng = np.random.default_rng(5)
    x, n = rng.uniform(-0.8, 0.8, (60, 3)), rng.standard_normal((60, 3))
    regularisation, reach = 1e-4, 0.3
    field = fitted(x, n, np.arange(chosen), regularisation, reach, "toy", Run())
    z, m = x[:chosen], n[:chosen]
    of_centers = rows(z, z, m)
    gram = np.concatenate([of_centers[0], np.einsum("anm,na->nm", of_centers[1:], m)])
    assert np.abs(gram - gram.T).max() < 1e-14
    design = rows(x, z, m) * np.array([1, reach, reach, reach])[:, None, None]
    wanted = np.concatenate([np.zeros((1, 60)), reach * n.T]).ravel()
    flat = design.reshape(-1, 2 * chosen)
    weights = np.linalg.solve(flat.T @ flat + regularisation * 60 * gram, flat.T @ wanted)
    queries = rng.uniform(-1, 1, (30, 3))
    np.testing.assert_allclose(field(queries), rows(queries, z, m)[0] @ weights, atol=1e-6)
