"""Sheets of a level that the cloud confirms, lobes attached to them, and bounds for all others."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ..sampling.extraction import IsoPoints
from ..sampling.neighbours import nearest
from ..sampling.sheets import connected, sheets_of

LEAST = 0.02  # of the cloud's points: a sheet that is nearest to fewer is not part of the surface
PART = 0.5  # of the distance to the surface: the bound
AROUND = 8  # neighbours of an iso-point whose points of the cloud support it, too
HELD = 0.2  # of the median number of cloud points around supported iso-points: with fewer an iso-point is bare
SHUT = 0.5  # of the area of a bare patch: with less vector area it is a lobe
SMALLEST = 8  # iso-points of a patch that is tested
FEWEST = 4  # iso-points of a rim
MARGIN = 2.0  # spacings beyond the hull of the rims
TUBE = 0.1  # of a patch with several rims: with more beyond their hull it is a lobe


class Sheets(NamedTuple):
    """Iso-points of false sheets."""

    points: Tensor  # (m, 3)
    bounds: Tensor  # (m,) half the distance to the confirmed parts, negative where the field should be negative


def split(iso: IsoPoints, cloud: Tensor, *, with_lobes: bool = False) -> tuple[IsoPoints, Sheets]:
    """Iso-points of the sheets to which enough points (n, 3) of a cloud are nearest, and the others.

    A network fitted to points also vanishes elsewhere: at clumps of outliers, and far from all points, where few terms
    prevent it. Iso-points would fix such sheets. A hole does not disconnect a sheet. With lobes,
    the bags attached to a sheet are among the others (:func:`lobes`).
    """
    sheet = sheets_of(iso.points)
    voted = nearest(cloud, 1, iso.points).rows[:, 0]
    votes = torch.bincount(sheet[voted], minlength=int(sheet.max()) + 1)
    true = (votes >= min(LEAST * len(cloud), int(votes.max())))[sheet]
    inside_is = lobes(iso, voted) if with_lobes else torch.zeros_like(iso.points[:, 0])
    true &= inside_is == 0
    kept = IsoPoints(iso.points[true], iso.normals[true], iso.evaluations)
    false = iso.points[~true]
    if not len(false) or not len(kept.points):
        return (kept if len(kept.points) else iso), Sheets(false[:0], false.new_zeros(0))
    at = nearest(false, 1, kept.points)
    rows = at.rows[:, 0]
    outside = ((false - kept.points[rows]) * kept.normals[rows]).sum(1) >= 0
    side = torch.where(outside, 1.0, -1.0)
    side = torch.where(inside_is[~true] == 0, side, inside_is[~true])
    return kept, Sheets(false, PART * side * at.distances[:, 0])


def lobes(iso: IsoPoints, voted: Tensor) -> Tensor:
    """The lobes among iso-points: 1 where one encloses the inside, -1 where it encloses the outside, else 0; (n,).

    A patch of the surface without points of the cloud either spans a hole or is a bag attached to its rim, for example
    around a clump of outliers. Its vector area, the sum of its normals, depends only on the rim: it is nearly the area
    if the patch spans the rim, and a small part of it for a bag with a narrow neck. A tube between two parts with
    points has no vector area either, but two rims, and it lies within their convex hull. If normals point
    away from the middle, the bag encloses the inside, and the field there should be positive.

    Parameters
    ----------
    iso : IsoPoints
        Evenly spaced, so that their number measures the area.
    voted : (m,) tensor
        For each point of the cloud, the iso-point nearest to it.
    """
    near = nearest(iso.points, AROUND).rows
    votes = torch.bincount(voted, minlength=len(iso.points))
    around = votes + votes[near].sum(1)
    bare = around < HELD * around[voted].double().median()
    patch = connected(near, bare[:, None] & bare[near])
    count = torch.bincount(patch)
    zeros = iso.points.new_zeros(len(count), 3)
    vector = zeros.index_add(0, patch, iso.normals)
    middle = zeros.index_add(0, patch, iso.points) / count[:, None]
    shut = (torch.linalg.vector_norm(vector, dim=1) < SHUT * count) & (count >= SMALLEST)
    away = zeros[:, 0].index_add(0, patch, ((iso.points - middle[patch]) * iso.normals).sum(1))
    held = connected(near, ~bare[:, None] & ~bare[near])
    enough = torch.bincount(held[voted], minlength=int(held.max()) + 1) >= LEAST * len(voted)
    side = torch.zeros_like(iso.points[:, 0])
    for one in torch.nonzero(shut)[:, 0]:
        own = patch == one
        if bare[own].all():
            rim, parts = rims(own, ~bare & enough[held], near)
            if parts < 2 or beyond(iso.points[own], iso.points[rim]).double().mean() > TUBE:
                side[own] = away[one].sign()
    return side


def rims(patch: Tensor, around: Tensor, near: Tensor) -> tuple[Tensor, int]:
    """The rim (n,) bool of a patch of points (n,) bool among others (n,) bool, and the number of its components."""
    rim = patch
    for _ in range(2):  # two points wide: a ring of single points may have gaps
        reached = rim[near].any(1)
        reached[near[rim].flatten()] = True
        rim = rim | (reached & around)
    rim = rim & ~patch
    parts = connected(near, rim[:, None] & rim[near])[rim]
    return rim, int((torch.bincount(parts) >= FEWEST).sum()) if len(parts) else 0


def beyond(points: Tensor, rim: Tensor) -> Tensor:
    """Which points (n, 3) are outside the convex hull of a rim (m, 3) by more than the rim's spacing: (n,) bool."""
    from scipy.spatial import ConvexHull

    spacing = float(nearest(rim, 1).distances.median())
    facets = torch.from_numpy(ConvexHull(rim.double().cpu().numpy(), qhull_options="QJ").equations).to(points)
    return (points @ facets[:, :3].T + facets[:, 3]).amax(1) > MARGIN * spacing
