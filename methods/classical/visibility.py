"""The side that a point faces, from the empty space around it: the signs of the initial normals of `ipsr`.

The points are thickened into a wall, the thinnest that is tight. The remaining empty space has several regions: the
outside, solids behind its walls, cavities behind theirs, and so on alternately. A normal points into the outside, or
into a cavity. Hou et al. 2022 use visibility from outside, in an octree, for the same purpose.
"""

from __future__ import annotations

import numpy as np

WALLS = (2, 3, 4, 6)  # halves of the wall thicknesses to try, in mean spacings
LEAKY = 0.1  # the largest share of points with the same region on both sides, equally near, at which a wall is tight
OPEN = 0.5  # the share at which the points enclose nothing
CELLS = 160  # of the grid along the longest side of the box, at most
FAR = 5  # cells beyond the wall in which a region is searched
NEAR = 2  # cells within which it must begin on one side: a region that begins beyond lies behind another wall
LEAST = 3  # least number of points between two neighbouring regions


def facing(points: np.ndarray, normals: np.ndarray) -> np.ndarray | None:
    """The sign of each normal that makes it point out of the solid, 0 if it is unknown.

    Parameters
    ----------
    points : (n, 3) array, all different
    normals : (n, 3) array of unit length, of either sign

    Returns
    -------
    (n,) float array of -1, 0 and 1, or None if the points enclose nothing
    """
    from bench.geometry.spacing import mean_spacing

    spacing = mean_spacing(points)
    best, least = None, OPEN
    # Walls thinner than the smallest cells are all equal.
    for cell, wall in dict.fromkeys(_cell_and_wall(points, wall * spacing) for wall in WALLS):
        signs, leak = _signs(points, normals, cell, wall)
        if leak < least and signs.any():
            best, least = signs, leak
        if leak < LEAKY:
            break
    return best


def _cell_and_wall(points: np.ndarray, wall: float) -> tuple[float, float]:
    """The side of the cells of a grid for a wall, and the wall, made at least as thick as these resolve."""
    cell = max(wall / 3, float(np.ptp(points, axis=0).max()) / CELLS)
    return cell, max(wall, 1.5 * cell)


def _signs(points: np.ndarray, normals: np.ndarray, cell: float, wall: float) -> tuple[np.ndarray, float]:
    """The signs with one thickness of the wall, and the share of the points through which it leaks."""
    regions, origin = _regions(points, cell, wall)
    beyond = wall + cell * np.arange(0.5, FAR)
    (front, near_front), (back, near_back) = (
        _first_region(regions, (points + side * beyond[:, None, None] * normals - origin) / cell) for side in (1, -1)
    )
    nearer = np.where(np.abs(near_front - near_back) <= 1, 0, np.sign(near_back - near_front))
    leak = float(((front > 0) & (front == back) & (nearer == 0)).mean())
    outward = _outward(regions.max(), regions[0, 0, 0], front, back)
    at_front, at_back = outward[front], outward[back]
    # Between a solid and empty space the side is clear; between two of a kind, across a thin sheet, the nearer counts.
    signs = np.where(at_front != at_back, np.sign(at_front - at_back), nearer * at_front)
    return np.where(np.minimum(near_front, near_back) <= NEAR, signs, 0), leak


def _regions(points: np.ndarray, cell: float, wall: float) -> tuple[np.ndarray, np.ndarray]:
    """Regions of empty space numbered from 1 on a grid, 0 for the wall; and its origin."""
    from scipy import ndimage

    extent = np.ptp(points, axis=0)
    margin = wall + (FAR + 1) * cell
    origin = points.min(axis=0) - margin
    empty = np.ones(np.ceil((extent + 2 * margin) / cell).astype(int) + 1, dtype=bool)
    empty[tuple(((points - origin) / cell).astype(int).T)] = False
    return ndimage.label(ndimage.distance_transform_edt(empty, sampling=cell) > wall)[0], origin


def _first_region(regions: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first region on the path of each point, 0 if there is none; and the number of steps to it.

    Parameters
    ----------
    regions : 3-d int array
    places : (steps, n, 3) array
        In cells of the grid.
    """
    met = regions[tuple(np.moveaxis(places.astype(int), -1, 0))]
    steps = np.where(met.any(axis=0), (met > 0).argmax(axis=0), 2 * len(met))
    return met[np.minimum(steps, len(met) - 1), np.arange(met.shape[1])], steps


def _outward(count: int, around: int, front: np.ndarray, back: np.ndarray) -> np.ndarray:
    """For each region: 1 if normals point into it, -1 if it is solid, 0 if unknown; a (count + 1,) array.

    Regions that the wall separates at enough points alternate.
    """
    between = (front > 0) & (back > 0) & (front != back)
    links = np.sort(np.stack([front[between], back[between]], axis=1), axis=1)
    pairs, seen = np.unique(links, axis=0, return_counts=True)
    pairs = pairs[seen >= LEAST]
    outward = np.zeros(count + 1)
    outward[around] = 1
    for _ in range(count):
        known = outward[pairs]
        new = (known != 0).sum(axis=1) == 1
        if not new.any():
            break
        one, other = pairs[new].T
        turned = np.where(outward[one] == 0, one, other), np.where(outward[one] == 0, other, one)
        outward[turned[0]] = -outward[turned[1]]
    return outward
