"""Planes of dense clouds, at a cost of about a nearest-neighbour query for each point.

Two shortcuts lose no accuracy. The size of neighbourhoods is chosen at some points, each of
which decides for those around it. And large neighbourhoods are assembled from blocks of a few points: sums of sums.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .neighbourhood_size import SIZES, choose_size
from .neighbours import processors
from .planes import CHUNK, fit_planes

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

SAMPLES = 50_000  # points at which sizes are tried, at least
SHARE = 16  # and at least one of this many
REGION = 16  # samples over which squared differences are averaged; their neighbourhoods hardly overlap
BLOCK = 8  # points of a block, on average
WHOLE = 48  # points of a neighbourhood up to which it is made of points; larger ones are made of blocks
# A block is near or far as a whole, which would tilt the plane: the weight of blocks falls to 0 at the border of the
# neighbourhood. With this factor more points the random error is about that of points of equal weight.
SPREAD = 1.5
NEAR = 8  # neighbours of each point that are kept


class DensePlanes(NamedTuple):
    """The planes of n points."""

    normals: np.ndarray
    """(n, 3) float64 array of unit length, of either sign"""
    offsets: np.ndarray
    """(n,) array: how far along the normal the noise has moved each point off its plane"""
    sizes: np.ndarray
    """(n,) int array: points of the neighbourhood"""
    neighbours: np.ndarray
    """(n, r) int32 array: points near each point, on the same neighbourhood; itself where there are fewer"""
    is_plane: np.ndarray
    """(m,) bool array: whether any size gave a plane, at each of the points at which sizes were tried"""


def dense_planes(points: np.ndarray, far: tuple[int, ...]) -> DensePlanes:
    """The planes of many points, with neighbourhoods of 12 to 256 points.

    Parameters
    ----------
    points : (n, 3) float64 array, sorted along a space-filling curve
    far : ranks of neighbours that are kept besides the nearest, where they are within half a neighbourhood
    """
    from scipy.spatial import cKDTree

    n, tree = len(points), cKDTree(points)
    samples = np.arange(0, n, max(1, min(n // SAMPLES, SHARE)))
    tried = fit_planes(points, tree, SIZES, np.arange(1), at=samples)
    of_samples = cKDTree(points[samples])
    region = of_samples.query(points[samples], REGION, workers=processors())[1]
    chosen, is_plane, noise = choose_size(tried, region)
    nearest = of_samples.query(points, workers=processors())[1]
    sizes, noise = tried.sizes[chosen][nearest], noise.astype(np.float32)[nearest]
    del tried, region, of_samples, nearest
    normals, offsets = np.empty((n, 3)), np.empty(n, dtype=np.float32)
    neighbours = np.repeat(np.arange(n, dtype=np.int32)[:, None], NEAR + len(far), axis=1)
    blocks = _Blocks.of(points) if sizes.max() > WHOLE else None
    for size in np.unique(sizes):
        rows = np.flatnonzero(sizes == size)
        ranks = [rank for rank in far if rank < size // 2]
        kept = slice(0, NEAR + len(ranks))
        if size <= WHOLE:
            planes = fit_planes(points, tree, [int(size)], np.array([*range(1, NEAR + 1), *ranks]), at=rows)
            normals[rows], offsets[rows] = planes.normals[:, 0], planes.offsets[:, 0]
            neighbours[rows, kept] = planes.neighbours
        else:
            assert blocks is not None
            blocks.fit(points, tree, rows, int(size), ranks, (normals, offsets, neighbours))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return DensePlanes(normals, noise * offsets, sizes, neighbours, is_plane)


class _Blocks(NamedTuple):
    """Blocks of points: each of some points, and all that are nearest to it."""

    seeds: np.ndarray  # (b,) indices of these points
    tree: cKDTree  # of them
    moments: np.ndarray  # (b, 10): count, sum (3), and sums of products xx xy xz yy yz zz, relative to the seed

    @classmethod
    def of(cls, points: np.ndarray) -> _Blocks:
        """The blocks of points that are sorted along a space-filling curve."""
        from scipy.spatial import cKDTree

        seeds = np.arange(0, len(points), BLOCK)
        tree = cKDTree(points[seeds])
        block = tree.query(points, workers=processors())[1]
        local = points - points[seeds[block]]
        values = [np.ones(len(points)), *local.T, *(local[:, a] * local[:, b] for a, b in PAIRS)]
        return cls(seeds, tree, np.stack([np.bincount(block, v, minlength=len(seeds)) for v in values], axis=1))

    def fit(
        self,
        points: np.ndarray,
        tree: cKDTree,
        rows: np.ndarray,
        size: int,
        ranks: list[int],
        into: tuple[np.ndarray, np.ndarray, np.ndarray],
    ) -> None:
        """The planes of about ``size`` points around each of the points ``rows``, and their neighbours."""
        normals, offsets, neighbours = into
        count = round(SPREAD * size / BLOCK)
        step = max(1, CHUNK // (4 * count))
        for part in (rows[begin : begin + step] for begin in range(0, len(rows), step)):
            centers = points[part]
            distances, found = self.tree.query(centers, count + 1, workers=processors())
            weights = 1 - (distances[:, :-1] / distances[:, -1:]) ** 2
            normals[part], offsets[part] = self._planes(points, centers, found[:, :-1], weights)
            near = tree.query(centers, NEAR + 1, workers=processors())[1][:, 1:]
            beyond = self.seeds[found[:, [rank // BLOCK for rank in ranks]]]
            neighbours[part, : NEAR + len(ranks)] = np.hstack([near, beyond])

    def _planes(
        self, points: np.ndarray, centers: np.ndarray, found: np.ndarray, weights: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Normals and offsets of planes through the blocks ``found`` (m, c) around ``centers`` (m, 3)."""
        moments = weights[:, :, None] * self.moments[found]
        shift = points[self.seeds[found]] - centers[:, None]
        mass, first = moments[:, :, :1], moments[:, :, 1:4]
        total = mass.sum(axis=1)
        mean = (first + mass * shift).sum(axis=1) / total
        second = np.swapaxes(first, 1, 2) @ shift
        second += np.swapaxes(second, 1, 2) + np.swapaxes(mass * shift, 1, 2) @ shift
        own = moments[:, :, 4:].sum(axis=1)
        for k, (a, b) in enumerate(PAIRS):
            second[:, a, b] += own[:, k]
            if a != b:
                second[:, b, a] += own[:, k]
        covariance = second / total[:, :, None] - mean[:, :, None] * mean[:, None]
        normals = np.linalg.eigh(covariance)[1][:, :, 0]
        return normals, -np.einsum("ni,ni->n", mean, normals)


PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
