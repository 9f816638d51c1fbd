"""A cloud doubled level by level: each level cuts its own patches from the whole output of the one before."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch

from bench.geometry.farthest import farthest_points

from ..networks.bilateral import NEIGHBOURS, Nearby
from ..networks.levels import run_levels
from ..networks.unit import Unit, Units
from .cut import centrality, covering, most_central, normalise
from .whole import in_patches, whole

BATCH = 16  # patches at once: 16 of 312 points take 100 MB
STRAY = 5.0  # a point is stray if its squared distance to the next exceeds this many times the mean
COPIES = 1e-5  # points nearer to each other than about this, relative to the radius of the cloud, count as one
SPARE = 1.02  # thinned to this share first, so that stray points can be removed


class Level(NamedTuple):
    """The features for interpolation by the next level."""

    points: np.ndarray
    """(m, 3) array: the input of this level"""
    features: torch.Tensor
    """(m, c) tensor: a point's features are contiguous, for fast access"""


def patch_size(points: int, patch: int, neighbours: int, share: float = 0.25) -> int:
    """Points of a patch: ``patch``, or a share of a small cloud (156 of 625), unless that has too few neighbours."""
    return min(points, patch, max(int(points * share), neighbours + 1))


@torch.no_grad()
def double(points: np.ndarray, network: Units, times: int, size: int, overlap: float, central: int = 0) -> np.ndarray:
    """Upsample a cloud by 2 to the power of ``times``.

    At each level the patches of the whole cloud are merged and thinned, as described in the paper; the released code
    runs all levels within each patch of the first one, which takes four times as many evaluations. Farthest
    points prefer points off the surface, and near the border of its patch a point is upsampled worst: with
    ``central=1`` nothing is thinned, and each point is doubled by the patch in which it is nearest the seed.

    Parameters
    ----------
    points : (m, 3) array
    network : Units
    times : int
        Levels; if the network has fewer units, the last of them is repeated.
    size : int
        Points of a patch, at all levels.
    overlap : float
        The number of patches that a point is in, on average.
    central : int
        The number of patches, of those in which a point is nearest the seed, whose two copies of it count; 0 for all.
        Unless it is 1, strays are removed between levels.

    Returns
    -------
    (m * 2**times, 3) float64 array
        The order of the input makes no difference.
    """
    points, frame = whole(points)
    count, before = len(points), None
    for level in range(times):
        if level and central != 1:
            points = points[~strays(points)]
        last = level == times - 1
        dense, before = _level(points, network[level], before, size, overlap, central, keep=not last)
        count *= 2
        points = dense if len(dense) == count else thin(dense, count)
    return frame.restore(points[None])[0]


@torch.no_grad()
def double_whole(
    points: np.ndarray, network: Units, times: int, size: int, overlap: float, central: int = 0
) -> np.ndarray:
    """As :func:`double`, but each patch of the cloud passes through all levels without further cutting."""
    device = next(network.parameters()).device

    def upsample(patches: np.ndarray) -> np.ndarray:
        dense = []
        for first in range(0, len(patches), BATCH):
            some = torch.from_numpy(patches[first : first + BATCH].astype(np.float32)).permute(2, 0, 1).contiguous()
            out, _ = run_levels(network, some.to(device), [], times, recut=False)
            dense.append(out.permute(1, 2, 0).cpu().numpy().astype(np.float64))
        return np.concatenate(dense)

    return in_patches(points, size, overlap, upsample, len(points) << times, central)


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

    # Copies of a point have distance 0, and would make all points without copies strays.
    distinct, place = np.unique(np.round(points / COPIES), axis=0, return_inverse=True)
    if len(distinct) < 3:
        return np.zeros(len(points), dtype=bool)
    squared = cKDTree(distinct).query(distinct, [2])[0][:, 0] ** 2
    return (squared > STRAY * squared.mean())[place.ravel()]


def thin(points: np.ndarray, count: int) -> np.ndarray:
    """Farthest points without strays, (count, 3); strays are used only if no others are left.

    Farthest points prefer strays, which are easiest to detect among thinned points: all others are evenly spaced.
    """
    if len(points) < count:
        points = np.resize(points, (count, 3))
    chosen = points[farthest_points(points, min(len(points), int(count * SPARE) + 1))]
    apart = strays(chosen)
    return np.concatenate([chosen[~apart], chosen[apart]])[:count]


def _level(
    points: np.ndarray, unit: Unit, before: Level | None, size: int, overlap: float, central: int, keep: bool
) -> tuple[np.ndarray, Level | None]:
    """All patches of a level through its unit: their merged points, and the features for the next level."""
    from scipy.spatial import cKDTree

    device = next(unit.parameters()).device
    patches = covering(points, size, overlap)
    rank = centrality(patches)
    before = before if unit.skip else None
    if before is not None:
        k = min(NEIGHBOURS, len(before.points))
        distance, index = cKDTree(before.points).query(points, np.arange(1, k + 1))
        squared, index = torch.from_numpy((distance**2).astype(np.float32)), torch.from_numpy(index)
    features = torch.zeros(len(points), unit.features.outputs) if keep and unit.skip else None
    dense = []
    for first in range(0, len(patches), BATCH):
        some = patches[first : first + BATCH]
        part, frames = torch.from_numpy(some), normalise(points[some])
        nearby = None
        if before is not None:
            flat = index[part].transpose(1, 2)  # (b, k, n)
            gathered = before.features.index_select(0, flat.reshape(-1)).T.contiguous().reshape(-1, *flat.shape)
            nearby = Nearby(squared[part].transpose(1, 2).to(device), gathered.to(device))
        inputs = torch.from_numpy(frames.points.astype(np.float32)).permute(2, 0, 1).contiguous()
        out, found = unit(inputs.to(device), nearby)
        local = frames.restore(out.permute(1, 2, 0).cpu().numpy().astype(np.float64))
        mine = rank[first : first + BATCH]
        dense.append(most_central(local, mine, central))
        if features is not None:
            # From the patch in which a point is nearest the seed: far from the border, as in training.
            best = torch.from_numpy(mine == 0)
            features[part[best]] = found.cpu()[:, best].T
    return np.concatenate(dense), None if features is None else Level(points, features)
