"""Depths of the visual hull: the largest shape that has the given masks."""

from __future__ import annotations

import numpy as np

from bench import Views


def carved(views: Views, cells: int) -> np.ndarray:
    """Which cells of the cube [-1, 1]^3 lie in all masks, by their middles: (cells, cells, cells) bool array.

    Cells outside of an image count as outside the mask.
    """
    middles = (np.arange(cells) + 0.5) * 2 / cells - 1
    inside = np.ones((cells, cells, cells), dtype=bool)
    for first, x in enumerate(middles):  # slice by slice, to save memory
        grid = np.stack(np.meshgrid([x], middles, middles, indexing="ij"), axis=-1).reshape(-1, 3)
        rows, columns, shown = views.pixels_at(grid)
        kept = shown & views.masks[np.arange(len(views))[:, None], rows, columns]
        inside[first] = kept.all(axis=0).reshape(cells, cells)
    return inside


def hull_depths(views: Views, cells: int) -> np.ndarray:
    """The depth along the optical axis at which the ray of each pixel enters the visual hull.

    Parameters
    ----------
    views : Views
    cells : int
        Of the grid along each axis; rays are sampled at half a cell.

    Returns
    -------
    (v, h, w) float64 array
        Infinite where the ray misses the hull.
    """
    inside = carved(views, cells)
    depths = np.full(views.masks.shape, np.inf)
    for view in range(len(views)):
        _, directions = views.rays(view)
        rays = directions[views.masks[view]]
        axial = rays @ views.extrinsics[view, 2, :3]
        middle = float(np.linalg.norm(views.centers[view]))
        found = np.full(len(rays), np.inf)
        for along in np.arange(middle - np.sqrt(3), middle + np.sqrt(3), 1 / cells):
            free = np.flatnonzero(~np.isfinite(found))
            place = views.centers[view] + along * rays[free]
            cell = np.floor((place + 1) * cells / 2).astype(np.int64)
            known = ((cell >= 0) & (cell < cells)).all(axis=1) & (along > 0)
            hit = free[known][inside[tuple(cell[known].T)]]
            found[hit] = along * axial[hit]
        depths[view][views.masks[view]] = found
    return depths
