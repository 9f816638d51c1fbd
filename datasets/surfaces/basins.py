"""Other candidates for the nearest point: vertices of a mesh that are nearer to a point than all their neighbours.

Newton's method ends in the basin that it starts in. Near a surface, the basin of the mesh's closest point is the right
one; far from a bumpy surface, the distances of several bumps may differ by less than the error of the mesh.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

NEAREST = 64  # number of nearest vertices that are searched for basins
FAR = 3.0  # mean edges from the mesh: nearer points have one basin
ROWS = 4096  # points at a time


class Basins:
    """The vertices of a mesh that lie on a surface, and which of them are local minima of a distance.

    Parameters
    ----------
    vertices : (v, 3) array
    faces : (f, 3) int array
    tree : cKDTree of the vertices, optional
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, tree: cKDTree | None = None):
        from scipy.spatial import cKDTree

        self.vertices = np.asarray(vertices, dtype=np.float64)
        self._tree = cKDTree(self.vertices) if tree is None else tree
        ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        self._edge = float(np.linalg.norm(np.diff(self.vertices[ends[: len(faces)]], axis=1), axis=-1).mean())
        ends = ends[np.argsort(ends[:, 0], kind="stable")]
        counts = np.bincount(ends[:, 0], minlength=len(self.vertices))
        place = np.arange(len(ends)) - np.repeat(np.cumsum(counts) - counts, counts)
        # One row per vertex with its neighbours, padded with itself; only poles with hundreds are cut off.
        width = min(int(counts.max()), 32)
        self._around = np.repeat(np.arange(len(self.vertices))[:, None], width, axis=1)
        kept = place < width
        self._around[ends[kept, 0], place[kept]] = ends[kept, 1]

    def starts(self, points: np.ndarray, distances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Starting points for points with several basins: the points (s,) and vertices (s,), as indices.

        Parameters
        ----------
        points : (n, 3) array
        distances : (n,) array, from the mesh, approximately
        """
        rows, starts = [np.empty(0, dtype=np.int64)], [np.empty(0, dtype=np.int64)]
        far = np.flatnonzero(distances > FAR * self._edge)
        for part in np.split(far, range(ROWS, len(far), ROWS)):
            away, nearest = self._tree.query(points[part], k=min(NEAREST, len(self.vertices)))
            # Whether any neighbour is nearer, one column at a time; the first column rules out most vertices.
            lowest = np.ones(nearest.shape, dtype=bool)
            for k in range(self._around.shape[1]):
                at = np.nonzero(lowest)
                other = self.vertices[self._around[nearest[at], k]]
                lowest[at] = ((points[part[at[0]]] - other) ** 2).sum(axis=1) >= away[at] ** 2 * (1 - 1e-12)
            lowest &= (lowest.sum(axis=1) > 1)[:, None]
            at = np.nonzero(lowest)
            rows.append(part[at[0]])
            starts.append(nearest[at])
        return np.concatenate(rows), np.concatenate(starts)


def best_of(rows: np.ndarray, squares: np.ndarray) -> np.ndarray:
    """For each row that occurs in ``rows`` (s,), the index of its trial with the least of ``squares`` (s,)."""
    order = np.lexsort((squares, rows))
    return order[np.unique(rows[order], return_index=True)[1]]
