"""Normals of a point cloud: estimated if there are none, completed if a few are missing, and turned outward."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..errors import BadInput
from ..notices import notice
from ..stages import stage
from .cloud import PointCloud
from .distinct import distinct_rows
from .neighbourhood_size import REGION, SIZES, choose_size
from .neighbours import curve_order
from .normal_signs import consistent_signs, orient_normals
from .planes import fit_planes

NEAR = 12  # neighbours of each point along which the orientation may travel
# Neighbours farther away along which it may travel too, by rank: the nearest of a dense scan line all lie on that line.
FAR = (16, 24, 32, 48, 64, 96, 128)
DENSE = 100_000  # points above which sizes are tried at some of the points only


class Estimate(NamedTuple):
    """Unoriented normals of n points, and what they were estimated from."""

    normals: np.ndarray
    """(n, 3) float64 array of unit length, of either sign"""
    flattened: np.ndarray
    """(n, 3) float64 array: the points, moved to the planes of their neighbourhoods, with most of their noise gone"""
    sizes: np.ndarray
    """(n,) int array: points of the neighbourhood, the point itself included"""
    neighbours: np.ndarray
    """(n, r) int array: points near each point, on the same neighbourhood; itself where there are fewer"""


def with_normals(cloud: PointCloud) -> PointCloud:
    """The cloud with a unit normal for every point.

    Normals of the cloud itself are used, scaled to unit length; those that are zero or not finite are taken from
    the nearest point that has one, with a notice, unless these are most of all. A cloud without any, or with hardly
    any, gets estimated, oriented normals.

    Raises
    ------
    BadInput
        If normals must be estimated and fewer than three points differ.
    """
    normals = None if cloud.normals is None else completed(cloud.points, cloud.normals, "the input")
    return PointCloud.of(cloud.arrays() | {"normals": oriented_normals(cloud.points) if normals is None else normals})


def completed(points: np.ndarray, normals: np.ndarray, name: str) -> np.ndarray | None:
    """Normals at unit length; the few that are zero or not finite are those of the nearest point that has one.

    Parameters
    ----------
    points, normals : (n, 3) arrays
    name : str
        For instance of the file, for the notice of how many were filled, or that all were left out.

    Returns
    -------
    (n, 3) float64 array, or None if more than half have no direction
    """
    # By the largest component first: squares of 1e-200 are zero, and those of 1e200 infinite.
    largest = np.abs(normals).max(axis=1, initial=0, keepdims=True)
    good = (np.isfinite(largest) & (largest > 0)).ravel()
    bad = len(good) - int(good.sum())
    if 2 * bad > len(good) or not len(good):
        notice(f"{name}: {bad:,} of {len(good):,} normals have no direction; all normals are left out")
        return None
    index = np.arange(len(good))
    if bad:
        from scipy.spatial import cKDTree

        candidates = np.flatnonzero(good)
        index[~good] = candidates[cKDTree(points[candidates]).query(points[~good])[1]]
        notice(
            f"{name}: {bad:,} of {len(good):,} normals have no direction; those of the nearest points are used instead"
        )
    scaled = normals[index] / largest[index]
    return scaled / np.linalg.norm(scaled, axis=1, keepdims=True)


def oriented_normals(points: np.ndarray, k: int = 0) -> np.ndarray:
    """Unit normals from the points alone, consistent over each connected piece, outward where a piece is closed.

    Parameters
    ----------
    points : (n, 3) array, finite; points that coincide get one normal
    k : int
        Points of a neighbourhood, the point itself included; 0 chooses the size point by point.

    Returns
    -------
    (n, 3) float64 array

    Raises
    ------
    BadInput
        If fewer than three points differ.
    """
    distinct, inverse = distinct_rows(points)
    if len(distinct) < 3:
        raise BadInput(f"{len(points)} points, of which {len(distinct)} differ: normals need at least 3")
    with stage("normals"):
        found = estimate_normals(distinct, k)
        return orient_normals(found.flattened, found.normals, found.neighbours)[inverse]


def estimate_normals(points: np.ndarray, k: int = 0) -> Estimate:
    """Unoriented normals by principal component analysis of the nearest neighbours (Hoppe et al. 1992).

    Parameters
    ----------
    points : (n, 3) array, finite
    k : int
        Points of every neighbourhood, the point itself included, at most n; 0 chooses between 12 and 256 for each
        point, see :mod:`bench.geometry.neighbourhood_size`. Where no size gives a plane, there is a notice.

    Returns
    -------
    Estimate
    """
    from scipy.spatial import cKDTree

    n, order = len(points), curve_order(points)
    along = np.ascontiguousarray(points[order], dtype=np.float64)
    back = np.empty_like(order)
    back[order] = np.arange(n)
    if not k and n > DENSE:
        return _estimate_dense(along, order, back)
    sizes = [min(k, n)] if k else [size for size in SIZES if size <= n] or [n]
    last = REGION if len(sizes) > 1 else NEAR + 1
    ranks = np.array([*range(min(last, n)), *(rank for rank in FAR if last <= rank < min(n, sizes[-1]))])
    planes = fit_planes(along, cKDTree(along), sizes, ranks)
    chosen, is_plane, noise = choose_size(planes, planes.neighbours[:, : min(last, n)])
    _notice_of_lines(is_plane)
    rows = np.arange(n)
    normals = planes.normals[rows, chosen].astype(np.float64)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    # Where two sheets are in one neighbourhood, the plane between them is no place for the points of either.
    flattened = along - (noise * planes.offsets[rows, chosen])[:, None] * normals
    used = np.isin(ranks, [*range(1, NEAR + 1), *FAR])
    near = ranks[used] < np.maximum(NEAR + 1, planes.sizes[chosen] // 2)[:, None]
    neighbours = order[np.where(near, planes.neighbours[:, used], rows[:, None])]
    return Estimate(normals[back], flattened[back], planes.sizes[chosen][back], neighbours[back])


def _estimate_dense(along: np.ndarray, order: np.ndarray, back: np.ndarray) -> Estimate:
    """The same for very many points, ``along`` a space-filling curve, in the order that they came in."""
    from .dense_normals import dense_planes

    planes = dense_planes(along, FAR)
    _notice_of_lines(planes.is_plane)
    flattened = along - planes.offsets[:, None] * planes.normals
    neighbours = order.astype(np.int32)[planes.neighbours[back]]
    return Estimate(planes.normals[back], flattened[back], planes.sizes[back], neighbours)


def disagreement(points: np.ndarray, normals: np.ndarray) -> float:
    """The share of normals whose sign contradicts those around them: 0 where all are oriented, up to 0.5.

    Signs are carried along the surface as :func:`orient_normals` does it; on each connected piece the smaller party
    contradicts. Where hardly any two neighbours contradict each other, nothing is carried, and the share is 0.

    Parameters
    ----------
    points, normals : (n, 3) arrays, finite, the normals of unit length
    """
    from scipy.spatial import cKDTree

    if len(points) < NEAR + 1:
        return 0.0
    order = curve_order(points)
    points, normals = points[order], normals[order]
    neighbours = cKDTree(points).query(points, NEAR + 1)[1]
    if _contradictions(points, normals, neighbours[:, 1:7]) < 0.002:
        return 0.0
    signs, piece = consistent_signs(points, normals, neighbours)
    turned, sizes = np.bincount(piece, signs < 0), np.bincount(piece)
    return float(np.minimum(turned, sizes - turned).sum() / len(points))


def _contradictions(points: np.ndarray, normals: np.ndarray, neighbours: np.ndarray) -> float:
    """The share of pairs of neighbours beside each other, not on two sides of a sheet, with opposite normals."""
    along = points[neighbours] - points[:, None]
    along /= np.maximum(np.linalg.norm(along, axis=2, keepdims=True), 1e-300)
    theirs = normals[neighbours]
    beside = np.abs(np.einsum("nki,ni->nk", along, normals)) < 0.5
    beside &= np.abs(np.einsum("nki,nki->nk", along, theirs)) < 0.5
    opposite = np.einsum("nki,ni->nk", theirs, normals) < -0.8
    return float((opposite & beside).sum() / max(int(beside.sum()), 1))


def _notice_of_lines(is_plane: np.ndarray) -> None:
    share = 1 - is_plane.mean()
    if share > 0.2:
        notice(
            f"normals: the neighbourhoods of {share:.0%} of the points are lines, not planes, up to {SIZES[-1]} "
            "points; thin the points along the scan lines, or give normals"
        )
