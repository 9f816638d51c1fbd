"""Symmetric linear systems, factorised once and solved often."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu


class Factors:
    """The factors of a sparse symmetric positive definite (n, n) matrix."""

    def __init__(self, matrix: Any):
        # A symmetric ordering without pivots keeps the factors of such a matrix small.
        options = {"SymmetricMode": True}
        self._factors = splu(csc_array(matrix), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)

    def solve(self, right: np.ndarray) -> np.ndarray:
        """The solutions for right sides (n, k)."""
        return self._factors.solve(np.ascontiguousarray(right))
