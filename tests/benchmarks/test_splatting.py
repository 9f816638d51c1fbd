"""What the renderer of splats costs: a view of 256 x 256, at the thesis's numbers of points (table 3.4).

pytest tests/benchmarks/test_splatting.py -s
"""

from __future__ import annotations

import time
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from bench.methods.splatting.fitting.smape import smape
from bench.methods.splatting.fitting.warm import load_compiled
from bench.methods.splatting.renderer.camera import Camera
from bench.methods.splatting.renderer.drawn import draw
from bench.methods.splatting.renderer.settings import Drawing
from bench.tasks.fit_shape import FitShape

# Milliseconds for a view: forwards, and backwards, on a GTX 1080 Ti
THESIS = {8003: (19.3, 79.9), 20000: (42.8, 164.6), 100000: (258.0, 680.0)}


def view(count, how=None, threads=2, size=256):
    """A ball that fills the image, and the derivative of the loss against one that is a tenth larger."""
    points = FitShape(points=count, size=1.0).beginning().points
    normals, sigma = points, np.full(count, 2 / np.sqrt(count))
    colors = 0.1 + 0.9 * np.clip(points, 0, 1)
    camera = Camera.looking_at(np.array([1.0, 2, 3]), np.zeros(3), np.array([0.0, 0, 1]), 1.6 * size, size, size)
    known = (points, normals, colors, sigma, camera, how or Drawing(), threads)
    wanted = draw(1.1 * points, normals, colors, 1.1 * sigma, camera, threads=threads)
    return known, smape(draw(*known).image, wanted.image)[1]


def milliseconds(function, times=5):
    """The shortest of some calls."""
    found = []
    for _ in range(times):
        begin = time.perf_counter()
        function()
        found.append(1000 * (time.perf_counter() - begin))
    return min(found)


@pytest.fixture(scope="module", autouse=True)
def compiled():
    load_compiled()


@pytest.mark.study
def test_a_view_takes_less_than_on_the_thesis_gpu():
    print()
    for count, (forward, backward) in THESIS.items():
        known, gradient = view(count)
        drawn = draw(*known)
        there = milliseconds(lambda known=known: draw(*known))
        back = milliseconds(lambda drawn=drawn, gradient=gradient: drawn.position_gradient(gradient))
        windowed = replace(drawn, how=Drawing(window=64.0))
        near = milliseconds(lambda drawn=windowed, gradient=gradient: drawn.position_gradient(gradient))
        print(
            f"{count:7,} points: forwards {there:6.1f} ms (thesis {forward}), backwards {back:6.1f} ms, "
            f"within 64 pixels {near:6.1f} ms (thesis {backward})"
        )


@pytest.mark.study
def test_blocks_against_pixels_one_by_one():
    known, gradient = view(2000)
    drawn = draw(*known)
    exact = replace(drawn, how=Drawing(opening=0.0))
    slow, fast = (milliseconds(lambda d=d: d.position_gradient(gradient), 2) for d in (exact, drawn))
    off = np.linalg.norm(drawn.position_gradient(gradient) - exact.position_gradient(gradient))
    off /= np.linalg.norm(exact.position_gradient(gradient))
    print(f"\n2,000 points, all pixels: {slow:.0f} ms one by one, {fast:.0f} ms in blocks, {off:.1%} apart")
    assert fast < slow / 5 and off < 0.05


def test_memory_stays_far_below_that_of_all_pairs():
    known, gradient = view(8003)
    tracemalloc.start()
    draw(*known).position_gradient(gradient)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    pairs = 8003 * 256 * 256 * 4
    print(f"\npeak {peak / 1e6:.0f} MB; all pairs would be {pairs / 1e6:.0f} MB")
    assert peak < pairs / 20


@pytest.mark.parametrize("count", [8003])
def test_forwards(benchmark, count):
    known, _ = view(count)
    benchmark(lambda: draw(*known))


@pytest.mark.parametrize("window", [0.0, 64.0, 16.0])
def test_backwards(benchmark, window):
    known, gradient = view(8003, Drawing(window=window))
    drawn = draw(*known)
    benchmark(lambda: drawn.position_gradient(gradient))
