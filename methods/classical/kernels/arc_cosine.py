"""The arc-cosine kernel of first order with its derivatives, compiled: the limit of infinitely many ReLU units.

With u = (x, 1) and v = (z, 1), theta the angle between them, C = u . v, S = |u| |v| sin(theta), and w normal in R^4,

    K = E[relu(w . u) relu(w . v)] = (S + (pi - theta) C) / (2 pi)            (Cho and Saul 2009)
    dK/du = ((pi - theta) v + S / |u|^2 u) / (2 pi),  and dK/dv by symmetry
    d2K/du dv = ((pi - theta) I + sin (b q' + q b') + cos (sin b b' - q q' / sin)) / (2 pi)

where b = v / |v|, q = u / |u| - cos b, and sin and cos are those of theta. S^2 = |x - z|^2 + |x x z|^2 loses no digits
where x and z are close. A centre z has two functions: K, and its derivative by z along a direction n.
"""

from __future__ import annotations

import math

from numba import njit

compiled = njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
TURN = 2 * math.pi


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy", inline="always")
def _parts(x0, x1, x2, z0, z1, z2, uu, vv):
    """C, S and theta of two points; uu and vv are |u|^2 and |v|^2."""
    c = x0 * z0 + x1 * z1 + x2 * z2 + 1.0
    d0, d1, d2 = x0 - z0, x1 - z1, x2 - z2
    e0, e1, e2 = x1 * z2 - x2 * z1, x2 * z0 - x0 * z2, x0 * z1 - x1 * z0
    s = math.sqrt(d0 * d0 + d1 * d1 + d2 * d2 + e0 * e0 + e1 * e1 + e2 * e2)
    # An arctangent without branches, so that several are computed at once: halve the angle twice more, then a series.
    t = s / (math.sqrt(uu * vv) + c)
    t = t / (1.0 + math.sqrt(1.0 + t * t))
    t = t / (1.0 + math.sqrt(1.0 + t * t))
    t = t / (1.0 + math.sqrt(1.0 + t * t))
    p = t * t
    series = 1.0 - p * (1 / 3 - p * (1 / 5 - p * (1 / 7 - p * (1 / 9 - p * (1 / 11 - p * (1 / 13 - p / 15))))))
    return c, s, 16.0 * t * series


@compiled
def values(first, last, points, centers, directions, alpha, beta, out):
    """The field sum_j alpha_j K(x, z_j) + beta_j n_j . dK/dz(x, z_j) at points first to last.

    Parameters
    ----------
    first, last : int
    points : (n, 3) float64 array
    centers, directions : (3, m) float64 arrays
    alpha, beta : (m,) float64 arrays
    out : (n,) float64 array, written to
    """
    for i in range(first, last):
        x0, x1, x2 = points[i, 0], points[i, 1], points[i, 2]
        uu = x0 * x0 + x1 * x1 + x2 * x2 + 1.0
        total = 0.0
        for j in range(centers.shape[1]):
            z0, z1, z2 = centers[0, j], centers[1, j], centers[2, j]
            n0, n1, n2 = directions[0, j], directions[1, j], directions[2, j]
            vv = z0 * z0 + z1 * z1 + z2 * z2 + 1.0
            c, s, theta = _parts(x0, x1, x2, z0, z1, z2, uu, vv)
            rest = math.pi - theta
            along = rest * (n0 * x0 + n1 * x1 + n2 * x2) + s / vv * (n0 * z0 + n1 * z1 + n2 * z2)
            total += alpha[j] * (s + rest * c) + beta[j] * along
        out[i] = total / TURN


@compiled
def rows(points, centers, directions, out):
    """Values and gradients at points of both functions of each centre.

    Parameters
    ----------
    points : (n, 3) float64 array
    centers, directions : (3, m) float64 arrays
    out : (4, n, 2 m) float64 array, written to
        The value and the three derivatives by x; of all K, then of all derivatives along the directions.
    """
    count = centers.shape[1]
    for i in range(points.shape[0]):
        x0, x1, x2 = points[i, 0], points[i, 1], points[i, 2]
        uu = x0 * x0 + x1 * x1 + x2 * x2 + 1.0
        for j in range(count):
            z0, z1, z2 = centers[0, j], centers[1, j], centers[2, j]
            n0, n1, n2 = directions[0, j], directions[1, j], directions[2, j]
            vv = z0 * z0 + z1 * z1 + z2 * z2 + 1.0
            c, s, theta = _parts(x0, x1, x2, z0, z1, z2, uu, vv)
            rest = math.pi - theta
            out[0, i, j] = (s + rest * c) / TURN
            out[1, i, j] = (rest * z0 + s / uu * x0) / TURN
            out[2, i, j] = (rest * z1 + s / uu * x1) / TURN
            out[3, i, j] = (rest * z2 + s / uu * x2) / TURN
            nz = n0 * z0 + n1 * z1 + n2 * z2
            out[0, i, count + j] = (rest * (n0 * x0 + n1 * x1 + n2 * x2) + s / vv * nz) / TURN
            u, v = math.sqrt(uu), math.sqrt(vv)
            sine, cosine = s / (u * v), c / (u * v)
            bn = nz / v
            qn = (n0 * x0 + n1 * x1 + n2 * x2) / u - cosine * bn
            of_b = sine * (qn + cosine * bn)
            of_q = sine * bn - cosine * qn / max(sine, 1e-150)
            b0, b1, b2 = z0 / v, z1 / v, z2 / v
            out[1, i, count + j] = (rest * n0 + of_b * b0 + of_q * (x0 / u - cosine * b0)) / TURN
            out[2, i, count + j] = (rest * n1 + of_b * b1 + of_q * (x1 / u - cosine * b1)) / TURN
            out[3, i, count + j] = (rest * n2 + of_b * b2 + of_q * (x2 / u - cosine * b2)) / TURN
