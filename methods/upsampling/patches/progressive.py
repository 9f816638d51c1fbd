"""A cloud doubled level by level: each level cuts patches of its own from all that the one before gave."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch

from bench.geometry.farthest import farthest_points

from ..networks.bilateral import NEIGHBOURS, Nearby
from ..networks.unit import Unit, Units
from .cut import Normalised, normalise
from .whole import patches_of, whole

BATCH = 16  # patches at once: 16 of 312 points take 100 MB
STRAY = 5.0  # a point is stray when its squared distance to the next is so many times the mean
COPIES = 1e-5  # points nearer to each other than about this, relative to the radius of the cloud, are one
SPARE = 1.02  # thinned to this share first: what is stray can then go


class Level(NamedTuple):
    """What the next level interpolates."""

    points: np.ndarray
    """(m, 3) array: the input of this level"""
    features: torch.Tensor
    """(c, m) tensor"""


def patch_size(points: int, patch: int, neighbours: int, share: float = 0.25) -> int:
    """Points of a patch: ``patch``, or a share of a small cloud (156 of 625), unless that has too few neighbours."""
    return min(points, patch, max(int(points * share), neighbours + 1))


@torch.no_grad()
def double(points: np.ndarray, network: Units, times: int, size: int, overlap: float) -> np.ndarray:
    """Upsample a cloud by 2 to the power of ``times``.

    At each level the patches of the whole cloud are put together and thinned, as the paper reads; the released code
    goes through all levels within each patch of the first one, which takes four times as many evaluations.

    Parameters
    ----------
    points : (m, 3) array
    network : Units
    times : int
        Levels; where the network has fewer units, the last of them goes on.
    size : int
        Points of a patch, at all levels.
    overlap : float
        How many patches a point is in, on average.

    Returns
    -------
    (m * 2**times, 3) float64 array
        The order of the input makes no difference.
    """
    points, frame = whole(points)
    count, before = len(points), None
    for level in range(times):
        if level:
            points = points[~strays(points)]
        last = level == times - 1
        dense, before = _level(points, network[level], before, size, overlap, keep=not last)
        count *= 2
        points = thin(dense, count)
    return frame.restore(points[None])[0]


def strays(points: np.ndarray) -> np.ndarray:
    """Which points lie apart from all others, by the rule of the released code.

    Parameters
    ----------
    points : (m, 3) array
        Of a cloud with radius 1.

    Returns
    -------
    (m,) bool array
    """
    from scipy.spatial import cKDTree

    # Copies of a point have no distance to each other, and would make strays of all points without one.
    distinct, place = np.unique(np.round(points / COPIES), axis=0, return_inverse=True)
    if len(distinct) < 3:
        return np.zeros(len(points), dtype=bool)
    squared = cKDTree(distinct).query(distinct, [2])[0][:, 0] ** 2
    return (squared > STRAY * squared.mean())[place.ravel()]


def thin(points: np.ndarray, count: int) -> np.ndarray:
    """Farthest points without strays, (count, 3); strays come back where nothing else is left.

    Farthest points prefer what is stray, and among thinned points it shows best: all others are evenly far apart.
    """
    if len(points) < count:
        points = np.resize(points, (count, 3))
    chosen = points[farthest_points(points, min(len(points), int(count * SPARE) + 1))]
    apart = strays(chosen)
    return np.concatenate([chosen[~apart], chosen[apart]])[:count]


def _level(
    points: np.ndarray, unit: Unit, before: Level | None, size: int, overlap: float, keep: bool
) -> tuple[np.ndarray, Level | None]:
    """All patches of a level through its unit: their points together, and what the next level interpolates."""
    from scipy.spatial import cKDTree

    device = next(unit.parameters()).device
    patches = patches_of(points, size, overlap)
    frames = normalise(points[patches])
    if before is not None and unit.skip:
        k = min(NEIGHBOURS, len(before.points))
        distance, index = cKDTree(before.points).query(points, np.arange(1, k + 1))
        squared, index = torch.from_numpy((distance**2).astype(np.float32)), torch.from_numpy(index)
    owner = _central(patches, len(points))
    features = torch.zeros(unit.features.outputs, len(points)) if keep and unit.skip else None
    dense = []
    for first in range(0, len(patches), BATCH):
        some = slice(first, first + BATCH)
        part = torch.from_numpy(patches[some])
        nearby = None
        if before is not None and unit.skip:
            flat = index[part].transpose(1, 2)  # (b, k, n)
            gathered = before.features[:, flat.reshape(-1)].reshape(-1, *flat.shape)
            nearby = Nearby(squared[part].transpose(1, 2).to(device), gathered.to(device))
        inputs = torch.from_numpy(frames.points[some].astype(np.float32)).permute(2, 0, 1).contiguous()
        out, found = unit(inputs.to(device), nearby)
        local = Normalised(
            out.permute(1, 2, 0).cpu().numpy().astype(np.float64), frames.centres[some], frames.radii[some]
        )
        dense.append(local.restore(local.points).reshape(-1, 3))
        if features is not None:
            mine = owner[part.numpy()] == np.arange(first, first + len(part))[:, None]
            features[:, part[torch.from_numpy(mine)]] = found.cpu()[:, torch.from_numpy(mine)]
    kept = None
    if features is not None:
        covered = owner >= 0
        kept = Level(points[covered], features[:, torch.from_numpy(covered)])
    return np.concatenate(dense), kept


def _central(patches: np.ndarray, count: int) -> np.ndarray:
    """For each of ``count`` points the patch (of (h, n)) in which it is nearest the seed; -1 without any.

    Its features are taken from there: far from the border, as in training.
    """
    owner = np.full(count, -1)
    numbers = np.arange(len(patches))
    for column in patches.T[::-1]:  # from the farthest to the seeds: the last one to write stays
        owner[column] = numbers
    return owner
