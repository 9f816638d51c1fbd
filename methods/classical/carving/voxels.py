"""The voxels that are carved: a grid over the box of the visual hull."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .silhouettes import Silhouettes, disagree

COARSE = 48  # cells along an axis for finding the hull's box
MARGIN = 4  # cells around the hull


@dataclass(frozen=True, eq=False)
class Voxels:
    """A grid of cubes.

    Parameters
    ----------
    low : (3,) array
        The corner of the first cube.
    cell : float
        The side of a cube.
    hull : (nx, ny, nz) float32 array
        The hull's field at the middles of the cubes, negative within.
    """

    low: np.ndarray
    cell: float
    hull: np.ndarray

    @classmethod
    def over(cls, silhouettes: Silhouettes, cells: int) -> Voxels:
        """Over the visual hull, with ``cells`` cubes along its longest side.

        Raises
        ------
        BadInput
            If no cube lies within the hull.
        """
        step = 2.2 / COARSE
        axis = -1.1 + step * (np.arange(COARSE) + 0.5)
        look = silhouettes.values(np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3))
        # A point of the hull is within half a diagonal of the middle of its cube, which bounds the field there.
        near = np.argwhere((look < 1.5 * step).reshape(COARSE, COARSE, COARSE))
        if not len(near):
            raise disagree()
        low, high = axis[near.min(axis=0)] - step / 2, axis[near.max(axis=0)] + step / 2
        cell = float((high - low).max() / cells)
        shape = np.ceil((high - low) / cell).astype(int) + 2 * MARGIN
        voxels = cls(low - MARGIN * cell, cell, np.empty(shape, dtype=np.float32))
        for first in range(shape[0]):  # slice by slice, to save memory
            slab = np.indices((1, *shape[1:])).reshape(3, -1).T + [first, 0, 0]
            voxels.hull[first] = silhouettes.values(voxels.middles(slab)).reshape(shape[1:])
        if not (voxels.hull < 0).any():
            raise disagree()
        return voxels

    def middles(self, index: np.ndarray) -> np.ndarray:
        """The middles (n, 3) of cubes by their indices (n, 3)."""
        return np.ascontiguousarray(self.low + self.cell * (index + 0.5))


def surface_of(filled: np.ndarray) -> np.ndarray:
    """The indices (n, 3) of filled cubes with a free side; the border of the grid is not filled."""
    inner = filled.copy()
    for axis in range(3):
        ahead, behind = np.moveaxis(inner, axis, 0), np.moveaxis(filled, axis, 0)
        ahead[1:] &= behind[:-1]
        ahead[:-1] &= behind[1:]
    return np.argwhere(filled & ~inner)
