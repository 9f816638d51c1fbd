"""Estimated normals against planes through 30 and 100 neighbours.

    PYTHONPATH=tests/geometry python tests/benchmarks/normals_bar.py ["sphere 20000" rings ...]

One line a cloud: mean and median angle to the exact normals, in degrees, of the estimate, of 30 and of 100 neighbours,
and the ratio to the better of these two; a star marks ratios above 1.1, of errors above 0.05 degrees. The arguments
choose lines by the beginnings of their names.
"""

from __future__ import annotations

import functools
import sys
import time
from collections.abc import Callable, Iterator

import numpy as np
from normal_cases import Cloud, degrees, noisy, plain, rings, scans

from bench.geometry.normals import estimate_normals


def clouds() -> Iterator[tuple[str, Callable[[], Cloud]]]:
    """The names of the lines, and what makes their clouds."""
    for name in ("sphere", "cube", "bumps", "humanoids"):
        for count in (5000, 20_000, 60_000):
            for noise in (0, 0.005, 0.01, 0.02, 0.03, 0.05):
                yield f"{name} {count} {noise}", functools.partial(noisy, name, count, noise)
    for ratio in (1, 2, 4, 6, 8, 12, 16):
        yield f"rings {ratio}", functools.partial(rings, ratio)
    for ratio in (2, 8):
        for along in ("any", "ray"):
            yield f"rings {ratio} noise {along}", functools.partial(rings, ratio, noise=0.01, along=along)
    for name in ("bumps", "humanoids", "cad"):
        yield f"scans {name}", functools.partial(scans, name, "triangulation", 5, 1.0, 0.005)
    for name in ("torus", "plate", "furniture", "vases"):
        for noise in (0, 0.01):
            yield f"other {name} {noise}", functools.partial(noisy, name, 20_000, noise)
            yield f"other {name} {noise} laplace", functools.partial(noisy, name, 20_000, noise, kind="laplace")


def line(name: str, cloud: Cloud) -> str:
    """The comparison of one cloud."""
    points, truth = cloud
    began = time.process_time()
    found = estimate_normals(points)
    seconds = time.process_time() - began
    errors = [degrees(normals, truth) for normals in (found.normals, plain(points, 30), plain(points, 100))]
    text, above = f"{name:28s}{len(points):8,d}{seconds:6.1f} s  k {int(np.median(found.sizes)):4d}", False
    for average in (np.mean, np.median):
        ours, *others = (float(average(error)) for error in errors)
        ratio = ours / max(min(others), 1e-9)
        above |= ratio > 1.1 and ours > 0.05
        text += f"  {average.__name__} {ours:6.2f} of {others[0]:6.2f} {others[1]:6.2f}" + f" = {min(ratio, 99):5.2f}"
    return text + (" *" if above else "")


if __name__ == "__main__":
    for title, make in clouds():
        if not sys.argv[1:] or title.startswith(tuple(sys.argv[1:])):
            print(line(title, make()), flush=True)
