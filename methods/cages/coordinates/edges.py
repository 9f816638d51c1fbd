"""The edges of a cage's faces."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Edges(NamedTuple):
    """The edges of a mesh, each once, for any number of adjacent faces."""

    ends: np.ndarray
    """(e, 2) int64 array: vertices"""
    of_face: np.ndarray
    """(f, 3) int64 array: the edge opposite each corner"""
    sign: np.ndarray
    """(f, 3) float64 array: 1 if the face traverses the edge from its first end, -1 if from its second"""


def edges_of(faces: np.ndarray) -> Edges:
    """The edges of ``faces`` (f, 3)."""
    faces = np.asarray(faces, dtype=np.int64)
    start, stop = faces[:, [1, 2, 0]], faces[:, [2, 0, 1]]
    pairs = np.stack([np.minimum(start, stop), np.maximum(start, stop)], axis=-1)
    ends, number = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    return Edges(ends, number.reshape(faces.shape).astype(np.int64), np.where(start < stop, 1.0, -1.0))
