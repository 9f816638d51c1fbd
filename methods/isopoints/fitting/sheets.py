"""Which sheets of a level the cloud confirms, and how far the others must go."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ..sampling.extraction import IsoPoints
from ..sampling.neighbours import nearest
from ..sampling.sheets import sheets_of

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
    sheet = sheets_of(iso.points)
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
