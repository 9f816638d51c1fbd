"""Tessellations of surfaces of patches: grids over (u, v), welded along seams and at poles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

WELD = 1e-9  # grid points on borders that are closer than this, relative to the size, become one vertex


class PatchGrid(NamedTuple):
    """Grid points of one patch, row by row, and the faces between them, wound from u to v."""

    u: np.ndarray
    v: np.ndarray
    faces: np.ndarray  # (f, 3): triangles between rows of different numbers of columns
    border: np.ndarray  # the grid points on the border
    quads: np.ndarray  # (q, 4): the quads between the other rows, corners in order, not yet split


class WeldedMesh(NamedTuple):
    """A mesh with the grid points of its corners, which have parameters."""

    vertices: np.ndarray  # (v, 3)
    faces: np.ndarray  # (f, 3)
    corners: np.ndarray  # (f, 3): the grid point of each corner of a face
    representative: np.ndarray  # (v,): one grid point of each vertex
    vertex: np.ndarray  # (n,): the vertex of each grid point; -1 if no face uses it


def patch_grid(u: np.ndarray, v: np.ndarray, levels: np.ndarray | None) -> PatchGrid:
    """The grid over the lines u (rows) and v (columns).

    Parameters
    ----------
    u, v : ascending grid lines
    levels : (len(u),) int array, optional
        Row i keeps only every 2^levels[i]-th column; neighbouring rows differ by at most one level. This gives fewer
        columns towards a pole.
    """
    columns = [np.arange(0, len(v), 1 << int(level)) for level in (np.zeros(len(u)) if levels is None else levels)]
    starts = np.concatenate([[0], np.cumsum([len(c) for c in columns])])
    rows = [start + np.arange(len(c)) for start, c in zip(starts, columns, strict=False)]
    quads, triangles = [], []
    for low, high in zip(rows[:-1], rows[1:], strict=True):
        if len(low) == len(high):
            quads.append(np.stack([low[:-1], high[:-1], high[1:], low[1:]], axis=1))
        else:
            triangles.append(_zip(low, high) if len(low) > len(high) else _zip(high, low)[:, ::-1])
    border = np.unique(np.concatenate([rows[0], rows[-1], *([row[[0, -1]] for row in rows])]))
    quads = np.concatenate(quads) if quads else np.empty((0, 4), dtype=np.int64)
    triangles = np.concatenate(triangles) if triangles else np.empty((0, 3), dtype=np.int64)
    return PatchGrid(np.repeat(u, [len(c) for c in columns]), v[np.concatenate(columns)], triangles, border, quads)


def _zip(fine: np.ndarray, coarse: np.ndarray) -> np.ndarray:
    """Triangles between a row and the next one, which has half as many cells."""
    f0, f1, f2, c0, c1 = fine[:-2:2], fine[1:-1:2], fine[2::2], coarse[:-1], coarse[1:]
    return np.concatenate([np.stack(corners, axis=1) for corners in ((f0, c0, f1), (f1, c0, c1), (f1, c1, f2))])


def weld(points: np.ndarray, grids: list[PatchGrid], flips: list[bool], fixed: list[bool]) -> WeldedMesh:
    """One mesh of all grids.

    Parameters
    ----------
    points : (n, 3) array of all grid points, one grid after the other
    grids : one for each patch
    flips : for each, whether the outward normal is ``x_v`` cross ``x_u``
    fixed : for each, whether its quads are split along their first diagonals, independent of its points
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    starts = np.cumsum([0] + [len(grid.u) for grid in grids])
    corners = []
    for start, grid, flip, first in zip(starts, grids, flips, fixed, strict=False):
        faces = start + np.concatenate([grid.faces, _split(points[start:], grid.quads, first)])
        corners.append(faces[:, ::-1] if flip else faces)
    corners = np.concatenate(corners)
    border = np.concatenate([start + grid.border for start, grid in zip(starts, grids, strict=False)])
    size = np.linalg.norm(np.ptp(points, axis=0))
    pairs = cKDTree(points[border]).query_pairs(WELD * size, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), (border[pairs[:, 0]], border[pairs[:, 1]])), shape=(len(points),) * 2)
    labels = connected_components(graph, directed=False)[1]
    faces = labels[corners]
    proper = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    faces, corners = faces[proper], corners[proper]
    used, faces = np.unique(faces, return_inverse=True)  # rows of cells that collapse at a pole have no faces
    representative = np.full(labels.max() + 1, -1)
    representative[labels[::-1]] = np.arange(len(points))[::-1]
    representative = representative[used]
    numbers = np.full(labels.max() + 1, -1)
    numbers[used] = np.arange(len(used))
    return WeldedMesh(points[representative], faces.reshape(-1, 3), corners, representative, numbers[labels])


def _split(points: np.ndarray, quads: np.ndarray, first: bool) -> np.ndarray:
    """Two triangles for each quad, along its shorter diagonal or always along its first one."""
    a, b, c, d = quads.T
    across = ((points[a] - points[c]) ** 2).sum(axis=1) <= 1.000001 * ((points[b] - points[d]) ** 2).sum(axis=1)
    across |= first
    one = np.where(across[:, None], np.stack([a, b, c], axis=1), np.stack([a, b, d], axis=1))
    other = np.where(across[:, None], np.stack([a, c, d], axis=1), np.stack([b, c, d], axis=1))
    return np.concatenate([one, other])


def pole_levels(ring: np.ndarray, spacing: np.ndarray, columns: int) -> np.ndarray:
    """How often to halve the columns of each row so that its cells are about as wide as high.

    Parameters
    ----------
    ring : (rows,) array, the width of a cell in each row before halving
    spacing : (rows,) array, the height of the cells there
    columns : int
        Number of cells across the narrowest patch: no row is halved beyond a whole number of cells.
    """
    deepest = (columns & -columns).bit_length() - 1
    wanted = np.floor(np.log2(np.maximum(spacing, 1e-300) / np.maximum(ring, 1e-12 * spacing.max())) + 0.5)
    levels = np.clip(wanted, 0, deepest).astype(int)
    for _ in range(deepest):  # neighbouring rows differ by one level at most
        levels[1:] = np.minimum(levels[1:], levels[:-1] + 1)
        levels[:-1] = np.minimum(levels[:-1], levels[1:] + 1)
    for i in range(1, len(levels)):
        levels[i] = min(levels[i], levels[i - 1] + 1)
    for i in range(len(levels) - 2, -1, -1):
        levels[i] = min(levels[i], levels[i + 1] + 1)
    return levels


def graded_lines(points: np.ndarray, parameters: np.ndarray, cells: int, turning: float = 0.5) -> np.ndarray:
    """Parameters of ``cells + 1`` grid lines along a curve, closer where it turns fast.

    Parameters
    ----------
    points : (n, d) array, the curve, densely
    parameters : (n,) array, ascending
    turning : float
        Share of the lines that follow the turning angle; the rest follow the length.
    """
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    units = steps / np.maximum(lengths, 1e-300)[:, None]
    angles = np.zeros(len(points))
    angles[1:-1] = 2 * np.arcsin(np.clip(np.linalg.norm(np.diff(units, axis=0), axis=1) / 2, 0, 1))
    angles = (angles[1:] + angles[:-1]) / 2
    weights = (1 - turning) * lengths / lengths.sum() + turning * angles / max(angles.sum(), np.pi / 4)
    cumulative = np.concatenate([[0], np.cumsum(weights)])
    lines = np.interp(np.linspace(0, cumulative[-1], cells + 1), cumulative, parameters)
    lines[[0, -1]] = parameters[[0, -1]]
    return lines
