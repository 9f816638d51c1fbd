"""What mean value coordinates cost: 24 x 1,024 points in cages of 80 faces, as in a step of training Neural Cages.

pytest tests/benchmarks/test_cages.py -s
"""

from __future__ import annotations

import time
import tracemalloc

import numpy as np
import pytest
import torch

from bench.methods.cages.coordinates.mean_value import load_compiled, mean_value_coordinates
from bench.methods.cages.meshes.round_cages import sphere_cage

RELEASED = 5.3, 6.5  # seconds forwards and backwards, on two cores


def plain(x, v, faces):
    """The formula of angles (Ju et al. 2005) in operations of torch, all faces at once, as it is usually written."""
    u = v[:, None] - x[:, :, None]
    d = u.norm(dim=3)
    u, d = (u / d[..., None])[:, :, faces], d[:, :, faces]
    ahead, behind = u.roll(-1, 3), u.roll(1, 3)
    theta = 2 * torch.asin(((ahead - behind).norm(dim=4) / 2).clamp(max=1 - 1e-7))
    h = theta.sum(dim=3, keepdim=True) / 2
    sine = theta.sin()
    c = 2 * h.sin() * (h - theta).sin() / (sine.roll(-1, 3) * sine.roll(1, 3)) - 1
    sign = torch.linalg.det(u)[..., None].sign()
    s = sign * (1 - c.square()).clamp(min=1e-10).sqrt()
    w = theta - c.roll(-1, 3) * theta.roll(1, 3) - c.roll(1, 3) * theta.roll(-1, 3)
    w = w / (d * sine.roll(-1, 3) * s.roll(1, 3))
    total = torch.zeros(*x.shape[:2], v.shape[1], dtype=x.dtype)
    total = total.index_add(2, faces.reshape(-1), w.reshape(*x.shape[:2], -1))
    return total / total.sum(dim=2, keepdim=True)


@pytest.fixture(scope="module")
def problem():
    load_compiled()
    vertices, faces = sphere_cage()
    rng = np.random.default_rng(0)
    queries = torch.from_numpy(rng.uniform(-1, 1, (24, 1024, 3))).float().requires_grad_(True)
    cages = torch.from_numpy(vertices).float()[None].repeat(24, 1, 1).requires_grad_(True)
    return queries, cages, torch.from_numpy(faces)


def seconds(function, times=3):
    """The shortest of some calls."""
    found = []
    for _ in range(times):
        begin = time.perf_counter()
        function()
        found.append(time.perf_counter() - begin)
    return min(found)


def test_coordinates_forwards_and_backwards(problem, benchmark):
    queries, cages, faces = problem
    benchmark(lambda: mean_value_coordinates(queries, cages, faces, threads=2).square().sum().backward())


@pytest.mark.study
def test_coordinates_are_many_times_as_fast_as_the_released_ones(problem):
    """20 times, on an idle machine of two cores; a quarter of that is asked for here, whatever else runs."""
    queries, cages, faces = problem
    weights = mean_value_coordinates(queries, cages, faces, threads=2)
    torch.testing.assert_close(weights, plain(queries.double(), cages.double(), faces).float(), atol=2e-4, rtol=1e-3)
    forwards = seconds(lambda: mean_value_coordinates(queries, cages, faces, threads=2))

    def both():
        mean_value_coordinates(queries, cages, faces, threads=2).square().sum().backward()

    backwards = seconds(both) - forwards
    there = seconds(lambda: plain(queries, cages, faces), 1)
    back = seconds(lambda: plain(queries, cages, faces).square().sum().backward(), 1) - there
    print(f"\nforwards {forwards:.3f} s, backwards {backwards:.3f} s; plain torch {there:.2f} s and {back:.2f} s")
    print(f"released: {RELEASED[0] / forwards:.0f} and {RELEASED[1] / backwards:.0f} times as long")
    assert forwards + backwards < there + back


def test_no_temporary_holds_all_faces(problem):
    """Memory is that of the result and a few numbers per query, not a number for each query and face."""
    queries, cages, faces = problem
    result = 24 * 1024 * 42 * 8
    tracemalloc.start()
    mean_value_coordinates(queries, cages, faces, threads=1)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2.5 * result  # a number for each corner of each query would be 5.7 of them
