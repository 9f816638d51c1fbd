"""Harmonic coordinates (Joshi et al. 2007): values on a cage's vertices, extended harmonically to its inside.

For each vertex of the cage they are the function that is 1 there, falls linearly to 0 on the faces around it, and has
the least Dirichlet energy inside. They follow distances inside the cage: parts that are near but across a gap do not
move.
"""

from __future__ import annotations

import numpy as np

from bench import BadInput

CELLS = 16  # of the grid of inner points, along the longest edge of the cage's box
JITTER = 0.2  # of a cell: points of a perfect grid have no unique tetrahedra
FLAT = 1e-6  # of a cell's volume: smaller tetrahedra are left out
NEAREST = 32  # tetrahedra among which the one that contains a point is searched


class HarmonicCoordinates:
    """The coordinates of one cage, for any points inside.

    The inside is filled with tetrahedra between points of the cage's faces and a grid; on those the functions are
    linear, so the identity ``coordinates @ vertices == points`` is exact.

    Parameters
    ----------
    vertices : (n, 3) array
        Of the cage, a closed mesh.
    faces : (f, 3) int array
    cells : int
        Of the grid, along the longest edge of the cage's box.

    Raises
    ------
    BadInput
        If the cage is not closed, or encloses no volume.
    """

    def __init__(
        self,
        vertices: np.ndarray,
        faces: np.ndarray,
        cells: int = CELLS,
    ):
        import igl
        from scipy.spatial import Delaunay, cKDTree
        from trimesh import Trimesh

        from bench.geometry.subdivision import divided
        from bench.geometry.winding import inside

        vertices = np.asarray(vertices, dtype=np.float64)
        if not Trimesh(vertices, faces, process=False).is_watertight:
            raise BadInput("harmonic coordinates: the cage has holes; expected a closed mesh")
        size = np.ptp(vertices, axis=0).max() / cells
        edges = vertices[faces] - vertices[np.roll(faces, 1, axis=1)]
        rounds = max(1, int(np.ceil(np.log2(np.linalg.norm(edges, axis=2).max() / size))))
        # Boundary values that are 1 at a vertex and linear over the faces are subdivided together with them.
        shell, shell_faces = divided(np.hstack([vertices, np.eye(len(vertices))]), faces, rounds)
        shell, values = shell[:, :3], shell[:, 3:]
        low = vertices.min(axis=0)
        grid = np.indices(np.ceil(np.ptp(vertices, axis=0) / size).astype(int) + 1).reshape(3, -1).T.astype(float)
        grid += np.random.default_rng(0).uniform(-JITTER, JITTER, grid.shape)  # always the same
        grid = low + size * grid
        grid = grid[inside(vertices, np.asarray(faces), grid) & (cKDTree(shell).query(grid)[0] > 0.5 * size)]
        places = np.concatenate([shell, grid])
        corners = Delaunay(places).simplices
        tetrahedra = places[corners]
        spans = tetrahedra[:, :3] - tetrahedra[:, 3:]
        whole = np.abs(np.linalg.det(spans)) > FLAT * size**3
        whole &= inside(vertices, np.asarray(faces), tetrahedra.mean(axis=1))
        if not whole.any():
            raise BadInput(
                "harmonic coordinates: the cage has no inside; expected a closed mesh that encloses a volume"
            )
        used, corners = np.unique(corners[whole], return_inverse=True)
        places, corners = places[used], corners.reshape(-1, 4)
        fixed = np.flatnonzero(used < len(shell))
        self._values = igl.harmonic(places, corners.astype(np.int64), fixed.astype(np.int64), values[used[fixed]], 1)
        self._corners, tetrahedra = corners, places[corners]
        self._last = tetrahedra[:, 3]
        self._inverse = np.linalg.inv((tetrahedra[:, :3] - tetrahedra[:, 3:]).transpose(0, 2, 1))
        self._centres = cKDTree(tetrahedra.mean(axis=1))

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """The coordinates (p, n) of points (p, 3); those of a point outside are those of the nearest tetrahedron."""
        points = np.asarray(points, dtype=np.float64)
        near = self._centres.query(points, k=np.arange(1, min(NEAREST, len(self._corners)) + 1))[1]
        shares = np.einsum("pkab,pkb->pka", self._inverse[near], points[:, None] - self._last[near])
        shares = np.concatenate([shares, 1 - shares.sum(axis=2, keepdims=True)], axis=2)
        row, best = np.arange(len(points)), shares.min(axis=2).argmax(axis=1)  # the one that contains it, or nearly
        return np.einsum("pk,pkn->pn", shares[row, best], self._values[self._corners[near[row, best]]])
