"""Which sheets of a level the cloud confirms, and how far the others must go."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ..sampling.extraction import IsoPoints
from ..sampling.neighbours import nearest

NEIGHBOURS = 8  # of an iso-point, that may be of its sheet
GAP = 4.0  # neighbours farther than this many median spacings are not
LEAST = 0.02  # of the cloud's points: a sheet that is nearest to fewer is not of the surface
PART = 0.5  # of the distance to the surface: the bound


class Sheets(NamedTuple):
    """Iso-points where there should be none."""

    points: Tensor  # (m, 3)
    bounds: Tensor  # (m,) half the distance to the confirmed sheets, negative inside of them


def split(iso: IsoPoints, cloud: Tensor) -> tuple[IsoPoints, Sheets]:
    """Iso-points of the sheets to which enough points (n, 3) of a cloud are nearest, and the others.

    A network that is fitted to points also vanishes elsewhere: at clumps of outliers, and far from all points, where
    little says that it should not. Held there, such sheets would stay. A hole does not cut a sheet off.
    """
    sheet = torch.from_numpy(_sheets(iso.points)).to(cloud.device)
    votes = torch.bincount(sheet[nearest(cloud, 1, iso.points).rows[:, 0]], minlength=int(sheet.max()) + 1)
    true = (votes >= min(LEAST * len(cloud), int(votes.max())))[sheet]
    kept = IsoPoints(iso.points[true], iso.normals[true], iso.evaluations)
    false = iso.points[~true]
    if not len(false):
        return kept, Sheets(false, false.new_zeros(0))
    at = nearest(false, 1, kept.points)
    rows = at.rows[:, 0]
    outside = ((false - kept.points[rows]) * kept.normals[rows]).sum(1) >= 0
    return kept, Sheets(false, torch.where(outside, PART, -PART) * at.distances[:, 0])


def _sheets(points: Tensor) -> np.ndarray:
    """The sheet (n,) of each point, a number from 0: connected parts of the graph of near neighbours."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    near = nearest(points, NEIGHBOURS)
    distances = near.distances.cpu().numpy()
    linked = distances <= GAP * np.median(distances[:, 0])
    rows = np.broadcast_to(np.arange(len(points))[:, None], linked.shape)[linked]
    columns = near.rows.cpu().numpy()[linked]
    graph = coo_array((np.ones(len(rows), dtype=bool), (rows, columns)), shape=(len(points),) * 2)
    return connected_components(graph, directed=False)[1]
