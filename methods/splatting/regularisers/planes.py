"""Planes through weighted neighbours, compiled."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

SWEEPS = 12  # of Jacobi rotations; four suffice except for the worst matrices


@njit(cache=True)
def least_direction(matrix):
    """The eigenvector of the smallest eigenvalue of a symmetric matrix (3, 3): (3,), by Jacobi's rotations.

    The matrix is changed.
    """
    vectors = np.eye(3)
    for _ in range(SWEEPS):
        off = abs(matrix[0, 1]) + abs(matrix[0, 2]) + abs(matrix[1, 2])
        if off <= 1e-15 * (abs(matrix[0, 0]) + abs(matrix[1, 1]) + abs(matrix[2, 2])):
            break
        for p in range(2):
            for q in range(p + 1, 3):
                if matrix[p, q] == 0:
                    continue
                theta = (matrix[q, q] - matrix[p, p]) / (2 * matrix[p, q])
                t = 1 / (abs(theta) + math.sqrt(theta * theta + 1))
                if theta < 0:
                    t = -t
                c = 1 / math.sqrt(t * t + 1)
                s = t * c
                for k in range(3):
                    a, b = matrix[k, p], matrix[k, q]
                    matrix[k, p], matrix[k, q] = c * a - s * b, s * a + c * b
                for k in range(3):
                    a, b = matrix[p, k], matrix[q, k]
                    matrix[p, k], matrix[q, k] = c * a - s * b, s * a + c * b
                for k in range(3):
                    a, b = vectors[k, p], vectors[k, q]
                    vectors[k, p], vectors[k, q] = c * a - s * b, s * a + c * b
    least = 0
    for k in range(1, 3):
        if matrix[k, k] < matrix[least, least]:
            least = k
    return vectors[:, least].copy()
