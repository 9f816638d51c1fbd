"""A mesh whose samples are pulled to a target: the quadratic energy of one round of matching."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, diags_array

from bench import PointCloud

from .nearest import Matching
from .samples import Samples
from .welded import Welded

ANCHOR = 1e-9  # of the mass: fixes vertices without any pull


class Pulled:
    """``E(x) = A sum_s w_s |(B x)_s - g_s|^2`` over samples s with goals g and weights w, A the area of the source.

    An integral over the surface, as are the energies of the links with cotangent weights: the ratio of the two is a
    length, for any resolution.
    """

    def __init__(self, welded: Welded, samples: Samples, cloud: PointCloud, matching: Matching):
        self.welded = welded
        self._samples, self._cloud, self._matching = samples, cloud, matching
        area = welded.areas.sum()
        # Vertices without area get some, so that the matrix is definite.
        self.masses = diags_array(np.maximum(welded.masses, 1e-3 * area / len(welded.vertices)))
        self._area = area
        points, normals = samples.matrix @ welded.vertices, samples.normals(welded.vertices)
        self._sign = matching.sign(points, normals, cloud)

    def round(self, moved: np.ndarray) -> tuple[csr_array, np.ndarray]:
        """Goals for the mesh at vertices (n, 3); H (n, n) and r (n, 3) of the energy ``x . H x / 2 - r . x + ...``.

        The common factor of two is omitted. H is positive definite, if barely: vertices without any pull do not move.
        """
        normals = self._sign * self._samples.normals(moved)
        goals, weights = self._matching.goals(self._samples.matrix @ moved, normals, self._cloud)
        pull = self._samples.matrix.T @ diags_array(self._area * weights)
        return (
            csr_array(pull @ self._samples.matrix + ANCHOR * self.masses),
            pull @ goals + ANCHOR * (self.masses @ moved),
        )
