"""Screw threads as solids: a profile that rises by one pitch while it goes once round."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from manifold3d import Manifold

DEPTH = 5 / 8 * np.sqrt(3) / 2  # of the metric thread, from crest to root, in pitches
# Where the metric profile has its corners, in pitches: a crest of 1/8, a flank, a root of 1/4, and the other flank. The
# flanks are 60 degrees apart.
CORNERS = np.array([0, 1 / 8, 7 / 16, 11 / 16])


def thread(radius: float, pitch: float, length: float, segments: int = 64) -> Manifold:
    """A threaded rod between z = 0 and z = ``length``, with the metric profile.

    The edges of crest and root are edges of the mesh all the way round; rods of all radii have the same phase, with
    their crests at the same places, so a slightly larger rod is the hole for another.

    Parameters
    ----------
    radius : float
        The radius of the crests.
    pitch : float
        Rise of one turn, to the right.
    length : float
    segments : int
        Number of facets of a turn.
    """
    from manifold3d import Manifold, Mesh64

    turns, m = int(np.ceil(length / pitch)) + 3, len(CORNERS)
    rows = m * turns + 1
    a = 2 * np.pi * np.arange(segments) / segments
    j = np.arange(rows)
    z = pitch * (CORNERS[j % m] + j // m - 1.5 + np.arange(segments)[:, None] / segments)  # (segments, rows)
    r = np.broadcast_to((radius - DEPTH * pitch * np.array([0, 0, 1, 1]))[j % m], z.shape)
    sides = np.stack([r * np.cos(a)[:, None], r * np.sin(a)[:, None], z], axis=-1).reshape(-1, 3)
    number = np.arange(len(sides)).reshape(segments, rows)
    here = number[:, : rows - m]
    ahead = np.concatenate([number[1:, : rows - m], number[:1, m:]])  # after the last segment the first, a pitch higher
    p, q, s, t = here[:, :-1], ahead[:, :-1], ahead[:, 1:], here[:, 1:]
    # Each end is a fan about the axis; its rim goes round once and then down the seam by a pitch.
    low = np.append(number[:, 0], number[0, m:0:-1])
    high = np.append(number[:, rows - m - 1], number[0, rows - 1 : rows - m - 1 : -1])
    ends = len(sides) + np.arange(2)
    faces = [np.stack(corners, axis=-1).reshape(-1, 3) for corners in ((p, q, s), (p, s, t))]
    faces.append(np.column_stack([np.roll(low, -1), low, np.full(len(low), ends[0])]))
    faces.append(np.column_stack([high, np.roll(high, -1), np.full(len(high), ends[1])]))
    axis = [[0, 0, z[:, 0].mean()], [0, 0, z[:, rows - m - 1].mean()]]
    used, faces = np.unique(np.concatenate(faces), return_inverse=True)
    vertices = np.concatenate([sides, axis])[used]
    solid = Manifold(Mesh64(np.ascontiguousarray(vertices), faces.reshape(-1, 3).astype(np.uint64)))
    return solid.trim_by_plane((0, 0, 1), 0).trim_by_plane((0, 0, -1), -length)
