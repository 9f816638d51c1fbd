"""Triangle strips as triangles."""

from __future__ import annotations

import numpy as np

from ...errors import BadInput

RESTART = -1


def triangles_of_strips(sizes: np.ndarray, corners: np.ndarray, vertices: int, name: str) -> np.ndarray:
    """The triangles (f, 3) int64 of strips, all wound alike; those that name a corner twice are bridges, left out.

    Parameters
    ----------
    sizes : (s,) int array, corners of each strip
    corners : (sum of sizes,) int array, vertex indices; -1 begins another strip
    vertices : how many there are
    name : str, of the file, for messages

    Raises
    ------
    BadInput
        If an index names no vertex.
    """
    bad = np.flatnonzero((corners < RESTART) | (corners >= vertices))
    if len(bad):
        raise BadInput(
            f"{name}: {len(bad)} corners of triangle strips name vertices that do not exist (the first is "
            f"{corners[bad[0]]}, of {vertices} vertices counted from 0); the file is damaged, export it again"
        )
    ends = np.cumsum(sizes)
    corners = np.insert(corners, ends[:-1] if len(ends) else [], RESTART).astype(np.int64)
    faces = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1) if len(corners) > 2 else np.empty((0, 3), int)
    place = np.arange(len(corners))
    begins = np.maximum.accumulate(np.where(corners == RESTART, place + 1, 0))
    odd = (place - begins)[: len(faces)] % 2 == 1  # every second triangle of a strip is wound the other way round
    faces[odd] = faces[odd][:, [1, 0, 2]]
    a, b, c = faces.T
    return faces[(faces != RESTART).all(axis=1) & (a != b) & (b != c) & (c != a)].astype(np.int64)
