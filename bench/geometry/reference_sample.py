"""Samples of a reference: independent of each other, or evenly spread as the ground truth of papers on clouds is.

Poisson-disk samples take seconds where there are many of them (80,000 take some 7 s of processor time), so each is made
once per case and number of points, for all methods and metrics; a sweep's cache stores it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..seeds import generator
from .cloud import PointCloud
from .cloud_surface import CloudSurface
from .poisson_disk import sample_poisson_disk

if TYPE_CHECKING:
    from trimesh import Trimesh

    from ..contract.case import Case

UNIFORM, POISSON_DISK = "uniform", "poisson_disk"
MOST = 200_000  # Poisson-disk points; beyond them their time, some 0.1 ms a point, exceeds that of most methods


def sample_reference(case: Case, count: int, sampling: str, stream: str) -> Mapping[str, np.ndarray]:
    """Points of a case's reference, uniform by area, and their unit normals.

    Parameters
    ----------
    case : Case
        Its seed and id seed the sample.
    count : int, >= 1
    sampling : str
        ``uniform``: independent of each other. ``poisson_disk``: evenly spread, at most :data:`MOST` of them; a
        reference that is a cloud is then taken as it is, all of it.
    stream : str
        Samples of different streams are independent of each other.

    Returns
    -------
    mapping
        ``points`` and ``normals``: (count, 3) arrays; without the normals that a cloud lacks.
    """
    shape, surface = case.reference, case.reference.surface
    if sampling == UNIFORM:
        rng = generator(case.seed, case.id, stream)
        return case.remember(f"{stream} {count}", lambda: _named(surface.sample(count, rng)))
    if isinstance(surface, CloudSurface):
        arrays = surface.cloud.arrays()
        return {name: arrays[name] for name in ("points", "normals") if name in arrays}
    count = min(count, MOST)
    rng = generator(case.seed, case.id, f"{sampling} {stream}")
    return case.remember(f"{sampling} {stream} {count}", lambda: _named(sample_poisson_disk(shape, count, rng)))


def evenly_perfect(output: PointCloud | Trimesh, case: Case) -> PointCloud | Trimesh:
    """The output of a perfect method in place of ``output`` if the ground truth is a Poisson-disk sample.

    Another such sample, as large as the output but for :data:`MOST`; for a mesh, the reference mesh. Beside an evenly
    spread ground truth the usual perfect cloud, uniform points, would score worse than good methods do.
    """
    if not isinstance(output, PointCloud) or not len(output):
        return case.perfect(output)
    key = f"{POISSON_DISK} perfect {len(output)}"
    if key not in case._cache:
        case._cache[key] = PointCloud.of(sample_reference(case, len(output), POISSON_DISK, "perfect"))
    return case._cache[key]


def _named(sample: tuple[np.ndarray, np.ndarray]) -> dict[str, np.ndarray]:
    return dict(zip(("points", "normals"), sample, strict=True))
