"""The field of least norm for points and normals, in the span of the functions of some of the points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...learned.compiled.pool import in_parts
from . import arc_cosine

if TYPE_CHECKING:
    from bench import Run

BLOCK = 256  # points whose rows are in memory at a time
JITTER = 1e-13  # of the largest diagonal entry, which a rounded Gram matrix may need to be positive


@dataclass(frozen=True, eq=False)
class KernelField:
    """f(x) = sum_j alpha_j K(x, z_j) + beta_j n_j . dK/dz(x, z_j), negative inside."""

    centers: np.ndarray  # (3, m)
    directions: np.ndarray  # (3, m)
    alpha: np.ndarray  # (m,)
    beta: np.ndarray  # (m,)
    threads: int = 1

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """The values (n,) at points (n, 3)."""
        points = np.ascontiguousarray(points, dtype=np.float64)
        out = np.empty(len(points))
        arguments = (self.centers, self.directions, self.alpha, self.beta, out)
        in_parts(arc_cosine.values, len(points), self.threads, points, *arguments)
        return out


def fitted(
    points: np.ndarray,
    normals: np.ndarray,
    chosen: np.ndarray,
    regularisation: float,
    reach: float,
    method: str,
    run: Run,
) -> KernelField:
    """The field f that minimises, over the span of the functions of the chosen points,

        mean_i f(x_i)^2 + reach^2 |grad f(x_i) - n_i|^2  +  regularisation |f|^2

    with the norm of the kernel's space. The functions are made orthonormal by a Cholesky factor of their Gram matrix,
    so that the regularisation bounds the condition of the normal equations.

    Parameters
    ----------
    points, normals : (n, 3) float64 arrays
    chosen : (m,) int array
    regularisation, reach : float
        ``reach`` is the length that converts a gradient to a value.
    method : str
        Named in the note.
    run : Run
        Receives the progress. When more than half of its time is used, the remaining points are left out, with a
        note: pass the points in random order.
    """
    from scipy.linalg import cho_solve, cholesky, solve_triangular
    from scipy.linalg.blas import dsyrk

    centers, directions = (np.ascontiguousarray(array[chosen].T) for array in (points, normals))
    count = 2 * len(chosen)
    factor = cholesky(_gram(centers, directions), lower=True, overwrite_a=True, check_finite=False)
    system = np.zeros((count, count), order="F")
    right = np.zeros(count)
    used, reserve = 0, run.seconds_left() / 2 if np.isfinite(run.seconds_left()) else 0.0
    for first in range(0, len(points), BLOCK):
        if first and (run.seconds_left() < reserve or not run.time_for_more()):
            run.note(f"{method}: only {used:,} of {len(points):,} points were fitted in half of the time limit")
            break
        part = slice(first, first + BLOCK)
        rows = np.empty((4, len(points[part]), count))
        arc_cosine.rows(points[part], centers, directions, rows)
        rows[1:] *= reach
        flat = rows.reshape(-1, count)
        wanted = np.concatenate([np.zeros(len(points[part])), reach * normals[part].T.ravel()])
        white = solve_triangular(factor, flat.T, lower=True, check_finite=False)
        system = dsyrk(1.0, white, beta=1.0, c=system, lower=1, overwrite_c=1)
        right += white @ wanted
        used += len(points[part])
        run.progress(used, len(points))
    system[np.diag_indices(count)] += regularisation * used
    solved = cho_solve((cholesky(system, lower=True, overwrite_a=True, check_finite=False), True), right)
    weights = solve_triangular(factor, solved, lower=True, trans="T", check_finite=False)
    return KernelField(centers, directions, weights[: count // 2], weights[count // 2 :], run.threads)


def _gram(centers: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """The products (2 m, 2 m) of all functions of the centres."""
    count = centers.shape[1]
    gram = np.empty((2 * count, 2 * count))
    for first in range(0, count, BLOCK):
        part = slice(first, min(first + BLOCK, count))
        rows = np.empty((4, part.stop - first, 2 * count))
        arc_cosine.rows(np.ascontiguousarray(centers[:, part].T), centers, directions, rows)
        gram[part] = rows[0]
        gram[count + first : count + part.stop] = np.einsum("anm,an->nm", rows[1:], directions[:, part])
    gram[np.diag_indices(2 * count)] += JITTER * gram.diagonal().max()
    return gram


def load_compiled() -> None:
    """Load the compiled loops, or compile them, so that no measured call has to."""
    arc_cosine.rows(np.eye(3), np.eye(3), np.eye(3), np.empty((4, 3, 6)))
    KernelField(np.eye(3), np.eye(3), np.ones(3), np.ones(3))(np.eye(3))
