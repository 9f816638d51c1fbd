"""Mean value coordinates and their derivatives, compiled: one query at a time, edges before faces.

With e_j = v_j - x for the vertices of a face in order, c_i = e_{i+1} x e_{i-1}, and theta_i the angle between e_{i+1}
and e_{i-1}, the mean vector of the spherical triangle is m = 1/2 sum_i theta_i c_i / |c_i|, and the face's weights are
those that make sum_i w_i e_i = m: w_i = (c_i . m) / D with D = e_0 . (e_1 x e_2) (Ju, Schaefer and Warren 2005, in
vectors rather than in angles). Angle and cross product belong to an edge, so two faces share them, and their rounding
errors cancel. For a query on a face D vanishes; D is the same for the three corners, so the face's own weights,
without it, are the coordinates.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

AT_VERTEX = 1e-13  # of the largest distance to a vertex
ON_EDGE = 1e-9  # sine of the angle under which an edge is seen from a query on it, at most
ON_PLANE = 1e-9  # volume of three unit vectors
NEAR_EDGE = 1e-3  # angle between the plane of a face and that through one of its edges, about
BLOCK = 32  # queries whose derivatives with respect to the cage are summed together

INSIDE, VERTEX, EDGE, FACE = 0, 1, 2, 3


@njit(cache=True, error_model="numpy")
def _look(x, v, ends, e, d, c, s, p, theta):
    """Directions, cross products and angles as seen from a query; its location: a kind, and the vertex or edge."""
    farthest = 0.0
    for j in range(v.shape[0]):
        e0, e1, e2 = v[j, 0] - x[0], v[j, 1] - x[1], v[j, 2] - x[2]
        e[j, 0], e[j, 1], e[j, 2] = e0, e1, e2
        d[j] = math.sqrt(e0 * e0 + e1 * e1 + e2 * e2)
        farthest = max(farthest, d[j])
    for j in range(v.shape[0]):
        if d[j] <= AT_VERTEX * farthest:
            return VERTEX, j
    for k in range(ends.shape[0]):
        i, j = ends[k, 0], ends[k, 1]
        a0, a1, a2, b0, b1, b2 = e[i, 0], e[i, 1], e[i, 2], e[j, 0], e[j, 1], e[j, 2]
        c0, c1, c2 = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
        c[k, 0], c[k, 1], c[k, 2] = c0, c1, c2
        s[k] = math.sqrt(c0 * c0 + c1 * c1 + c2 * c2)
        p[k] = a0 * b0 + a1 * b1 + a2 * b2
        if s[k] <= ON_EDGE * d[i] * d[j]:
            if p[k] < 0:
                return EDGE, k
            theta[k] = 0.0
        else:
            theta[k] = math.atan2(s[k], p[k])
    return INSIDE, 0


@njit(cache=True, error_model="numpy")
def _face(f, faces, of_face, sign, e, d, c, s, theta):
    """The mean vector of a face, its volume D, whether the query lies on it, and whether it is seen at all."""
    m0, m1, m2 = 0.0, 0.0, 0.0
    for k in range(3):
        edge = of_face[f, k]
        angle = theta[edge]
        if angle > 0:
            factor = 0.5 * sign[f, k] * angle / s[edge]
            m0 += factor * c[edge, 0]
            m1 += factor * c[edge, 1]
            m2 += factor * c[edge, 2]
    i, edge = faces[f, 0], of_face[f, 0]
    volume = sign[f, 0] * (e[i, 0] * c[edge, 0] + e[i, 1] * c[edge, 1] + e[i, 2] * c[edge, 2])
    flat = abs(volume) <= ON_PLANE * d[i] * d[faces[f, 1]] * d[faces[f, 2]]
    # In the plane of a face, the mean vector has length pi inside of it, that of a hemisphere, and 0 elsewhere. A
    # length between means that an edge is nearer than the plane: then the face is treated like any other.
    length = math.sqrt(m0 * m0 + m1 * m1 + m2 * m2)
    flat = flat and min(length, math.pi - length) <= NEAR_EDGE
    return m0, m1, m2, volume, flat and length > 1, not flat


@njit(cache=True, error_model="numpy")
def _weights(faces, of_face, sign, e, d, c, s, theta, w):
    """The weights of all vertices, not normalised, into ``w``; the face on which the query lies, or -1."""
    w[:] = 0.0
    for f in range(faces.shape[0]):
        m0, m1, m2, volume, on, seen = _face(f, faces, of_face, sign, e, d, c, s, theta)
        if on:
            w[:] = 0.0
        if on or seen:
            scale = 1.0 if on else 1 / volume
            for k in range(3):
                edge = of_face[f, k]
                along = c[edge, 0] * m0 + c[edge, 1] * m1 + c[edge, 2] * m2
                w[faces[f, k]] += sign[f, k] * along * scale
        if on:
            return f
    return -1


@njit(nogil=True, cache=True, error_model="numpy")
def coordinates(first_job, last_job, x, v, faces, ends, of_face, sign, out):
    """The coordinates of queries ``x`` (b, p, 3) in cages ``v`` (b, n, 3) into ``out`` (b, p, n), for some of the jobs.

    A job is a block of queries of one cage: number ``cage * blocks + block``.
    """
    queries = x.shape[1]
    n, edges = v.shape[1], ends.shape[0]
    blocks = (queries + BLOCK - 1) // BLOCK
    e, d, w = np.empty((n, 3)), np.empty(n), np.empty(n)
    c, s, p, theta = np.empty((edges, 3)), np.empty(edges), np.empty(edges), np.empty(edges)
    for job in range(first_job, last_job):
        b, first = job // blocks, job % blocks * BLOCK
        for q in range(first, min(first + BLOCK, queries)):
            kind, which = _look(x[b, q], v[b], ends, e, d, c, s, p, theta)
            if kind == INSIDE:
                _weights(faces, of_face, sign, e, d, c, s, theta, w)
                total = w.sum()
                for j in range(n):
                    out[b, q, j] = w[j] / total if total != 0 else w[j]
            else:
                out[b, q, :] = 0
                if kind == VERTEX:
                    out[b, q, which] = 1
                else:
                    i, j = ends[which, 0], ends[which, 1]
                    out[b, q, i], out[b, q, j] = d[j] / (d[i] + d[j]), d[i] / (d[i] + d[j])


@njit(cache=True, error_model="numpy")
def _faces_back(on, faces, of_face, sign, e, d, c, s, theta, g, to_e, to_c, to_theta):
    """Derivatives ``g`` (n,) by the weights of all vertices to those by directions, cross products and angles."""
    for f in range(faces.shape[0]):
        if on >= 0 and f != on:
            continue
        m0, m1, m2, volume, _, seen = _face(f, faces, of_face, sign, e, d, c, s, theta)
        if on < 0 and not seen:
            continue
        scale = 1.0 if on >= 0 else 1 / volume
        to_volume, r0, r1, r2 = 0.0, 0.0, 0.0, 0.0  # r: by the mean vector
        for k in range(3):
            edge = of_face[f, k]
            part = g[faces[f, k]] * scale * sign[f, k]
            to_volume -= part * scale * (c[edge, 0] * m0 + c[edge, 1] * m1 + c[edge, 2] * m2)
            r0 += part * c[edge, 0]
            r1 += part * c[edge, 1]
            r2 += part * c[edge, 2]
            to_c[edge, 0] += part * m0
            to_c[edge, 1] += part * m1
            to_c[edge, 2] += part * m2
        if on < 0:
            i, edge, part = faces[f, 0], of_face[f, 0], to_volume * sign[f, 0]
            for a in range(3):
                to_e[i, a] += part * c[edge, a]
                to_c[edge, a] += part * e[i, a]
        for k in range(3):
            edge = of_face[f, k]
            if theta[edge] > 0:
                # Of theta c / |c|: along c the length stays 1.
                one = 1 / s[edge]
                along = (r0 * c[edge, 0] + r1 * c[edge, 1] + r2 * c[edge, 2]) * one
                to_theta[edge] += 0.5 * sign[f, k] * along
                factor, along = 0.5 * sign[f, k] * theta[edge] * one, along * one
                to_c[edge, 0] += factor * (r0 - along * c[edge, 0])
                to_c[edge, 1] += factor * (r1 - along * c[edge, 1])
                to_c[edge, 2] += factor * (r2 - along * c[edge, 2])


@njit(cache=True, error_model="numpy")
def _edges_back(ends, e, d, c, s, p, theta, to_e, to_c, to_theta):
    """Continue to the derivatives by directions only, in ``to_e`` (n, 3)."""
    for k in range(ends.shape[0]):
        i, j = ends[k, 0], ends[k, 1]
        a0, a1, a2, b0, b1, b2 = e[i, 0], e[i, 1], e[i, 2], e[j, 0], e[j, 1], e[j, 2]
        t0, t1, t2, by_p = to_c[k, 0], to_c[k, 1], to_c[k, 2], 0.0
        if theta[k] > 0:
            turn = to_theta[k] / (d[i] * d[j]) ** 2
            by_s, by_p = turn * p[k] / s[k], -turn * s[k]
            t0 += by_s * c[k, 0]
            t1 += by_s * c[k, 1]
            t2 += by_s * c[k, 2]
        to_e[i, 0] += by_p * b0 + b1 * t2 - b2 * t1
        to_e[i, 1] += by_p * b1 + b2 * t0 - b0 * t2
        to_e[i, 2] += by_p * b2 + b0 * t1 - b1 * t0
        to_e[j, 0] += by_p * a0 + t1 * a2 - t2 * a1
        to_e[j, 1] += by_p * a1 + t2 * a0 - t0 * a2
        to_e[j, 2] += by_p * a2 + t0 * a1 - t1 * a0


@njit(cache=True, error_model="numpy")
def _slope_of_weights(w, slope, g):
    """Derivatives by coordinates, w / sum w, to those by weights, into ``g``."""
    total, mean = 0.0, 0.0
    for j in range(len(w)):
        total += w[j]
        mean += w[j] * slope[j]
    if total == 0:
        g[:] = 0.0
        return
    for j in range(len(w)):
        g[j] = (slope[j] - mean / total) / total


@njit(nogil=True, cache=True, error_model="numpy")
def derivatives(first_job, last_job, x, v, faces, ends, of_face, sign, slope, by_x, by_v):
    """The derivatives of a loss, given its ``slope`` (b, p, n), by queries, into ``by_x`` (b, p, 3), and by cages.

    For some jobs, as above. The latter are summed over blocks of queries: ``by_v`` is (b, blocks, n, 3), and does not
    depend on threads.
    """
    queries = x.shape[1]
    n, edges = v.shape[1], ends.shape[0]
    blocks = (queries + BLOCK - 1) // BLOCK
    e, d, w = np.empty((n, 3)), np.empty(n), np.empty(n)
    c, s, p, theta = np.empty((edges, 3)), np.empty(edges), np.empty(edges), np.empty(edges)
    to_c, to_e, to_theta, g = np.empty((edges, 3)), np.empty((n, 3)), np.empty(edges), np.empty(n)
    for job in range(first_job, last_job):
        b, first = job // blocks, job % blocks * BLOCK
        by_v[b, job % blocks] = 0.0
        for q in range(first, min(first + BLOCK, queries)):
            by_x[b, q, :] = 0.0
            kind, which = _look(x[b, q], v[b], ends, e, d, c, s, p, theta)
            if kind == VERTEX:
                continue
            to_e[:] = 0.0
            if kind == EDGE:
                i, j = ends[which, 0], ends[which, 1]
                lean = (slope[b, q, j] - slope[b, q, i]) / (d[i] + d[j]) ** 2
                for a in range(3):
                    to_e[i, a] = lean * d[j] / d[i] * e[i, a]
                    to_e[j, a] = -lean * d[i] / d[j] * e[j, a]
            else:
                on = _weights(faces, of_face, sign, e, d, c, s, theta, w)
                _slope_of_weights(w, slope[b, q], g)
                to_c[:] = 0.0
                to_theta[:] = 0.0
                _faces_back(on, faces, of_face, sign, e, d, c, s, theta, g, to_e, to_c, to_theta)
                _edges_back(ends, e, d, c, s, p, theta, to_e, to_c, to_theta)
            for j in range(n):
                for a in range(3):
                    by_v[b, job % blocks, j, a] += to_e[j, a]
                    by_x[b, q, a] -= to_e[j, a]
