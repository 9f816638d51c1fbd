"""A function on a grid, evaluated only where its surface may be, without missing any part of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .field import Field

COARSE, FINE = 16, 4  # grid points along the sides of the two kinds of blocks
BATCH = 64  # fine blocks at a time: 4,096 points


def sample_near_zero(field: Field, origin: np.ndarray, shape: np.ndarray, step: float) -> np.ndarray:
    """The values of ``field`` at ``origin + step * (i, j, k)``: exact near its zeros, elsewhere only their sign.

    A block of grid points is skipped if the bounds of the function in the ball about it have the same sign. So every
    sign change between neighbours on the full grid is found.

    Parameters
    ----------
    field : Field
    origin : (3,) array
    shape : (3,) int array
        At least this many points along each axis; it is rounded up to whole blocks.
    step : float

    Returns
    -------
    volume : (a, b, c) float32 array
    """
    blocks = -(-np.asarray(shape) // COARSE)
    volume = np.empty(blocks * COARSE, dtype=np.float32)
    coarse = np.stack(np.meshgrid(*(np.arange(n) for n in blocks), indexing="ij"), axis=-1).reshape(-1, 3)
    coarse = _fill_one_sided(field, volume, coarse, COARSE, origin, step)
    ratio = COARSE // FINE
    within = np.stack(np.meshgrid(*(np.arange(ratio),) * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    fine = (coarse[:, None] * ratio + within).reshape(-1, 3)
    fine = _fill_one_sided(field, volume, fine, FINE, origin, step)
    inner = np.stack(np.meshgrid(*(np.arange(FINE),) * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    target = _as_blocks(volume, FINE)
    for start in range(0, len(fine), BATCH):
        batch = fine[start : start + BATCH]
        points = origin + step * (batch[:, None] * FINE + inner).reshape(-1, 3)
        target[tuple(batch.T)] = field.value(points).reshape(-1, FINE, FINE, FINE)
    return volume


def _as_blocks(volume: np.ndarray, size: int) -> np.ndarray:
    """The volume as a view (i, j, k, within i, within j, within k)."""
    a, b, c = (n // size for n in volume.shape)
    return volume.reshape(a, size, b, size, c, size).transpose(0, 2, 4, 1, 3, 5)


def _fill_one_sided(
    field: Field, volume: np.ndarray, blocks: np.ndarray, size: int, origin: np.ndarray, step: float
) -> np.ndarray:
    """Write the sign of the blocks (n, 3) without a zero into the volume, and return the other blocks (m, 3)."""
    radius = step * (size - 1) / 2 * 3**0.5
    low, high = np.empty(len(blocks)), np.empty(len(blocks))
    for start in range(0, len(blocks), 4096):
        part = slice(start, start + 4096)
        low[part], high[part] = field.range(origin + step * (blocks[part] * size + (size - 1) / 2), radius)
    crossing = (low <= 0) & (high >= 0)
    sign = np.where(low > 0, 1.0, -1.0)[~crossing]
    _as_blocks(volume, size)[tuple(blocks[~crossing].T)] = sign[:, None, None, None]
    return blocks[crossing]
