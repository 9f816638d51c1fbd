"""Other sizes of images: every new pixel is the mean over its area, and intrinsics follow."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from scipy.sparse import csr_array


def area_resized(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """An image at another size, by area averaging.

    Parameters
    ----------
    image : (h, w, 3) uint8 or (h, w) bool array
        A pixel of the new mask is set if more than half of it lies in the old mask.
    size : (int, int)
        Width and height.

    Returns
    -------
    (height, width, 3) uint8 or (height, width) bool array
    """
    width, height = size
    if image.shape[:2] == (height, width):
        return image
    values = image.reshape(*image.shape[:2], -1).astype(np.float64)
    old_height, old_width, channels = values.shape
    values = (_overlaps(old_height, height) @ values.reshape(old_height, -1)).reshape(height, old_width, channels)
    values = values.transpose(1, 0, 2).reshape(old_width, -1)
    values = (_overlaps(old_width, width) @ values).reshape(width, height, channels).transpose(1, 0, 2)
    if image.dtype == np.bool_:
        return values[..., 0] > 0.5
    return np.rint(values).astype(np.uint8)


def _overlaps(old: int, new: int) -> csr_array:
    """Which share of each of ``new`` equal intervals each of ``old`` ones makes up: a sparse (new, old) array."""
    from scipy.sparse import csr_array

    ends = np.union1d(np.arange(old + 1) * new, np.arange(new + 1) * old)  # both partitions, in units of 1 / (old new)
    starts, lengths = ends[:-1], np.diff(ends)
    return csr_array((lengths / old, (starts // old, starts // new)), shape=(new, old))


def scaled_intrinsics(intrinsics: np.ndarray, size: tuple[int, int], new: tuple[int, int]) -> np.ndarray:
    """The intrinsics (3, 3) of the same camera with an image of ``new`` instead of ``size`` (width, height)."""
    return np.diag([new[0] / size[0], new[1] / size[1], 1.0]) @ intrinsics
