"""Sums of real spherical harmonics, with exact first and second derivatives.

Written in Cartesian form, ``Y_lm(x, y, z) = q_l^m(z) * Re or Im of (x + iy)^m`` with polynomials ``q_l^m``, so that
the poles are not singular and every derivative is again a polynomial.
"""

from __future__ import annotations

from functools import lru_cache
from math import isqrt, pi, sqrt

import numpy as np

CHUNK = 512  # directions at a time, so that the table of polynomials stays in the cache


class HarmonicSum:
    """The function ``f(u) = sum of a_lm Y_lm(u)`` on the unit sphere.

    The basis is real and orthonormal: the integral of ``f^2`` over the sphere is the sum of the ``a_lm^2``. For m > 0
    ``Y_lm`` is ``sqrt(2) N_lm P_l^m(cos theta) cos(m phi)``, for m < 0 the same of ``|m|`` with ``sin(|m| phi)``, both
    without the Condon-Shortley sign.

    Parameters
    ----------
    coefficients : ((L + 1)^2,) array
        ``a_lm`` at the index ``l^2 + l + m``.
    """

    def __init__(self, coefficients: np.ndarray):
        self.coefficients = np.asarray(coefficients, dtype=np.float64)
        self.degree = isqrt(len(self.coefficients)) - 1
        if self.degree < 0 or (self.degree + 1) ** 2 != len(self.coefficients):
            raise ValueError(f"coefficients: expected (L + 1)^2 of them, got {len(self.coefficients)}")
        self._factors = _factors(self.coefficients, self.degree)

    def value(self, directions: np.ndarray) -> np.ndarray:
        """``f`` at unit vectors (n, 3): an (n,) array."""
        return self._derivatives(directions, 0)[0]

    def gradient(self, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``f`` and its gradient along the sphere, a tangent vector: (n,) and (n, 3) arrays."""
        value, gradient = self._derivatives(directions, 1)
        return value, gradient - np.einsum("ni,ni->n", gradient, directions)[:, None] * directions

    def hessian(self, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """``f``, and the gradient g and Hessian H of its polynomial in space: (n,), (n, 3) and (n, 3, 3) arrays.

        Along the great circle through u in the tangent direction t, ``f'' = t . H t - g . u``.
        """
        value, gradient, hessian = self._derivatives(directions, 2)
        return value, gradient, hessian

    def _derivatives(self, directions: np.ndarray, order: int) -> list[np.ndarray]:
        directions = np.asarray(directions, dtype=np.float64)
        results = [np.empty((len(directions), *(3,) * k)) for k in range(order + 1)]
        for start in range(0, len(directions), CHUNK):
            part = slice(start, start + CHUNK)
            x, y, z = directions[part].T
            for result, values in zip(results, self._of_chunk(x, y, z, order), strict=True):
                result[part] = values
        return results

    def _of_chunk(self, x: np.ndarray, y: np.ndarray, z: np.ndarray, order: int) -> list[np.ndarray]:
        table = _polynomials(z, self.degree)
        # w[k][m]: the k-th derivative in z of sum_l (a_lm - i a_l,-m) q_l^m(z), so that f = Re sum_m w[0] (x + iy)^m
        factors = self._factors[: order + 1]
        w = [(cosine @ table[k:])[:, 0] - 1j * (sine @ table[k:])[:, 0] for k, (cosine, sine) in enumerate(factors)]
        power = np.ones((self.degree + 1, len(z)), dtype=complex)
        for m in range(self.degree):
            np.multiply(power[m], x + 1j * y, out=power[m + 1])
        m = np.arange(self.degree + 1)[:, None]

        def total(factors: np.ndarray, lowered: int = 0) -> np.ndarray:
            """Sum over m of factors_m (x + iy)^(m - lowered)."""
            factors = factors[lowered:]
            return np.einsum("mn,mn->n", factors, power[: len(factors)])

        results = [total(w[0]).real]
        if order >= 1:
            # d/dx of Re w (x + iy)^m is Re of m w (x + iy)^(m - 1); d/dy is minus the imaginary part of the same.
            d = total(m * w[0], 1)
            results.append(np.stack([d.real, -d.imag, total(w[1]).real], axis=1))
        if order >= 2:
            dd, dz = total(m * (m - 1) * w[0], 2), total(m[:-1] * w[1], 1)
            xx, xy, xz, yz, zz = dd.real, -dd.imag, dz.real, -dz.imag, total(w[2]).real
            results.append(np.stack([xx, xy, xz, xy, -xx, yz, xz, yz, zz], axis=1).reshape(-1, 3, 3))
        return results


def _polynomials(z: np.ndarray, degree: int) -> np.ndarray:
    """The table of ``q_l^m(z)``: (m, l, n), zero where l < m."""
    diagonal, alpha, beta = _recurrence(degree)
    table = np.zeros((degree + 1, degree + 1, len(z)))  # (l, m, n): one step of the recurrence is one block of memory
    table[0, 0] = diagonal[0]
    for l in range(1, degree + 1):  # noqa: E741
        table[l, l] = diagonal[l]
        # q_l = alpha z q_(l-1) - beta q_(l-2), stable for growing l
        np.multiply(alpha[l, :l, None], z, out=table[l, :l])
        table[l, :l] *= table[l - 1, :l]
        if l > 1:
            table[l, : l - 1] -= beta[l, : l - 1, None] * table[l - 2, : l - 1]
    return table.transpose(1, 0, 2)


@lru_cache(maxsize=8)
def _recurrence(degree: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    l, m = np.ogrid[: degree + 1.0, : degree + 1.0]  # noqa: E741
    with np.errstate(divide="ignore", invalid="ignore"):
        alpha = np.sqrt((4 * l**2 - 1) / (l**2 - m**2))
        beta = alpha * np.sqrt(((l - 1) ** 2 - m**2) / (4 * (l - 1) ** 2 - 1))
    # q_m^m is the constant sqrt(2) N_mm (2m - 1)!!, for m = 0 without the sqrt(2).
    k = np.arange(1.0, degree + 1)
    ratios = np.sqrt((2 * k + 1) / (2 * k)) * np.where(k == 1, sqrt(2), 1)
    diagonal = sqrt(1 / (4 * pi)) * np.cumprod(np.concatenate([[1.0], ratios]))
    return diagonal, alpha, beta  # read where m < l, and m < l - 1


def _factors(coefficients: np.ndarray, degree: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """The factors of ``q_l^(m+k)`` in the k-th derivative in z, for k = 0, 1, 2: (m, 1, l) arrays, cosine and sine.

    One table of polynomials is enough for all derivatives, since the derivative of one is a multiple of the next:
    ``d q_l^m / dz = sqrt((l - m) (l + m + 1)) q_l^(m+1)``, with another ``1/sqrt(2)`` for m = 0.
    """
    cosine, sine = np.zeros((2, degree + 1, 1, degree + 1))
    for l in range(degree + 1):  # noqa: E741
        cosine[: l + 1, 0, l] = coefficients[l * l + l : (l + 1) ** 2]
        sine[1 : l + 1, 0, l] = coefficients[l * l : l * l + l][::-1]
    m, l = np.ogrid[: degree + 1, : degree + 1]  # noqa: E741
    step = (np.sqrt(np.maximum((l - m) * (l + m + 1), 0)) * np.where(m == 0, sqrt(0.5), 1.0))[:, None]
    factors = [(cosine, sine)]
    for k in (1, 2):  # rows and columns move on by k: the factor of q_l^(m+k) stands in row m
        cosine, sine = cosine[:-1] * step[k - 1 : degree], sine[:-1] * step[k - 1 : degree]
        factors.append((cosine, sine))
    return factors
