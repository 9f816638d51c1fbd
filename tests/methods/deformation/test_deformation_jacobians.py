"""Matrices of faces, and the surface that solves the Poisson equation for them."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from registration_shapes import cloud_of, far_from, moved, stool, turn, with_accidents
from trimesh.creation import icosphere

from bench import Run
from bench.methods.deformation.jacobians import Jacobians
from bench.methods.deformation.registration.poisson import Poisson
from bench.methods.deformation.registration.welded import Welded

SOURCES = {"ball": lambda: icosphere(subdivisions=2), "stool": stool, "accidents": with_accidents}


def solver_of(source):
    welded = Welded(source, 0.15, 0.1)
    return welded, Poisson(welded)


def centred(welded, vertices):
    return vertices - welded.masses @ vertices / welded.masses.sum()


@pytest.mark.parametrize("name", SOURCES)
def test_identities_give_the_source_and_a_constant_matrix_its_linear_map(name):
    welded, poisson = solver_of(SOURCES[name]())
    for A in (np.eye(3), turn(70), np.random.default_rng(0).normal(size=(3, 3))):
        found = poisson.solve(np.broadcast_to(A, (len(welded.faces), 3, 3)))
        np.testing.assert_allclose(found, centred(welded, welded.vertices @ A.T), atol=1e-8)


def test_the_gradients_of_any_deformation_reproduce_it():
    welded, poisson = solver_of(icosphere(subdivisions=2))
    there = welded.vertices + 0.2 * np.sin(3 * welded.vertices[:, [1, 2, 0]])
    before, after = (V[welded.faces[:, 1:]] - V[welded.faces[:, :1]] for V in (welded.vertices, there))
    # The matrix that maps two edges of the source to the deformed edges, and its normal to zero.
    normal = np.cross(before[:, 0], before[:, 1])[:, None]
    matrices = np.linalg.solve(np.concatenate([before, normal], axis=1), np.concatenate([after, 0 * normal], axis=1))
    np.testing.assert_allclose(poisson.solve(np.swapaxes(matrices, 1, 2)), centred(welded, there), atol=1e-10)


def test_the_solution_matches_a_dense_least_squares_problem():
    welded, poisson = solver_of(stool(rounds=1))
    assert len(welded.springs) >= 10
    V, F, rng = welded.vertices, welded.faces, np.random.default_rng(0)
    J = np.eye(3) + 0.3 * rng.normal(size=(len(F), 3, 3))
    areas, around = welded.areas, [[] for _ in V]
    for f, face in enumerate(F):
        for i in face:
            around[i].append(f)
    mean = np.stack([np.average(J[faces], axis=0, weights=areas[faces]) for faces in around])
    rows, right = [], []
    for f, face in enumerate(F):  # the gradient of the hat functions, times the root of the area
        a, b, c = V[face]
        n = np.cross(b - a, c - a)
        hats = np.stack([np.cross(n, c - b), np.cross(n, a - c), np.cross(n, b - a)]) / (n @ n)
        plane = np.eye(3) - np.outer(n, n) / (n @ n)
        block = np.zeros((3, len(V)))
        block[:, face] = hats.T
        rows.append(np.sqrt(areas[f]) * block)
        right.append(np.sqrt(areas[f]) * plane @ J[f].T)
    for i, j in welded.springs:
        block = np.zeros((1, len(V)))
        block[0, [i, j]] = 1, -1
        rows.append(np.sqrt(welded.spring) * block)
        right.append(np.sqrt(welded.spring) * ((V[i] - V[j]) @ ((mean[i] + mean[j]) / 2).T)[None])
    M, b = np.concatenate(rows), np.concatenate(right)
    expected = np.linalg.lstsq(M.T @ M, M.T @ b, rcond=1e-12)[0]
    np.testing.assert_allclose(poisson.solve(J), centred(welded, expected), atol=1e-8)


@pytest.mark.parametrize("name", SOURCES)
def test_the_pull_back_is_the_adjoint(name):
    welded, poisson = solver_of(SOURCES[name]())
    rng = np.random.default_rng(0)
    J, g = rng.normal(size=(len(welded.faces), 3, 3)), rng.normal(size=welded.vertices.shape)
    assert (poisson.solve(J) * g).sum() == pytest.approx((J * poisson.pull_back(g)).sum(), rel=1e-8)


def test_the_derivative_matches_finite_differences():
    welded, poisson = solver_of(icosphere(subdivisions=0))
    J = torch.eye(3, dtype=torch.float64).repeat(len(welded.faces), 1, 1)
    J = (
        J + 0.1 * torch.randn(J.shape, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    ).requires_grad_()
    assert torch.autograd.gradcheck(lambda matrices: poisson(matrices) ** 2, (J,))
    poisson(J).sin().sum().backward()
    step = torch.zeros_like(J)
    step[7, 1, 2] = 1e-6
    with torch.no_grad():
        slope = float(poisson(J + step).sin().sum() - poisson(J - step).sin().sum()) / 2e-6
    assert float(J.grad[7, 1, 2]) == pytest.approx(slope, rel=1e-6)
    single = poisson(J.detach().float())
    assert single.dtype == torch.float32
    np.testing.assert_allclose(single, poisson(J).detach(), atol=1e-6)


@pytest.mark.parametrize("kind", ["cloud", "mesh"])
def test_an_affine_motion_is_reached(kind):
    source = icosphere(subdivisions=2)
    wanted = moved(source, turn(10) @ np.diag([1.15, 0.8, 1.0]), (0.05, 0, 0.1))
    target = wanted if kind == "mesh" else cloud_of(wanted, 1000)
    output = Jacobians(samples=1000, steps=60, identity=0.001).deform(source, target, Run(seed=0))
    np.testing.assert_array_equal(output.faces, source.faces)
    assert far_from(source, wanted) > 0.08 and far_from(output, wanted) < 0.008


def test_parts_stay_together():
    source = stool()
    wanted = moved(source, np.diag([1.25, 1.0, 0.85]), (0, 0.05, 0))
    output = Jacobians(samples=1000, steps=40).deform(source, cloud_of(wanted, 1000), Run(seed=0))
    count = len(source.vertices) // 3
    board, legs = output.vertices[:count], output.vertices[count:]
    tops = legs[source.vertices[count:, 2] > 0.3 - 1e-9]
    assert tops[:, 2].max() < board[:, 2].max() and tops[:, 2].min() > board[:, 2].min()
    assert far_from(output, wanted) < 0.3 * far_from(source, wanted)


def test_the_weight_keeps_matrices_near_identity():
    source = icosphere(subdivisions=2)
    cloud = cloud_of(moved(source, np.diag([1.3, 0.8, 1.0]), (0.1, 0, 0)), 1000)
    strong, weak = (
        Jacobians(samples=500, steps=50, identity=identity).deform(source, cloud, Run(seed=0)) for identity in (100, 0)
    )
    shift = strong.vertices - source.vertices
    assert np.ptp(shift, axis=0).max() < 0.02 and 0.05 < shift[:, 0].mean() < 0.15  # only translated
    assert np.ptp((weak.vertices - source.vertices)[:, 0]) > 0.4


def test_runs_are_repeatable_and_stop_at_the_time_limit():
    source, cloud = with_accidents(), cloud_of(moved(icosphere(2), np.diag([1.2, 1, 0.9])), 500)
    method = Jacobians(steps=5, samples=300)
    first, again = (method.deform(source, cloud, Run(seed=1)).vertices for _ in range(2))
    np.testing.assert_array_equal(first, again)
    assert np.isfinite(first).all()
    run = Run(seconds=0)
    np.testing.assert_array_equal(method.deform(source, cloud, run).vertices, source.vertices)
    assert run.notes == ["the time limit ended the steps after 0 of 5"]


@pytest.mark.parametrize(("name", "value"), [("steps", 0), ("rate", 0), ("identity", -1), ("reach", 0), ("samples", 3)])
def test_parameters_are_checked(name, value):
    with pytest.raises(ValueError, match=f"^{name}: expected"):
        Jacobians(**{name: value})
