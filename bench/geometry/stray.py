"""The frame of a cloud, whatever a few stray points do."""

from __future__ import annotations

import numpy as np

from .cloud import Frame

SHARE = 0.005  # of the points at each end of an axis that do not count for the size of the bulk
FAR = 20.0  # radii of the bulk; a farther point would make the bulk a dot in the frame of all
REACH = 3.0  # radii of the bulk within which points set the frame
MOST = 0.01  # share of the points that may be strays; more are a part of the scene


def frame_of_bulk(points: np.ndarray) -> Frame:
    """The frame in which points (n, 3), or all but a few that are very far from them, have radius 1.

    The reader of a file gives a notice of such points (:mod:`bench.geometry.suspicions`).
    """
    frame = Frame.of(points)
    low, high = np.quantile(points, [SHARE, 1 - SHARE], axis=0)
    radius = float(np.linalg.norm(high - low)) / 2
    if not 0 < FAR * radius < frame.radius:
        return frame
    inside = np.linalg.norm(points - (low + high) / 2, axis=1) <= REACH * radius
    outside = len(points) - int(inside.sum())
    return Frame.of(points[inside]) if 0 < outside <= MOST * len(points) else frame
