"""Distances of pixels to the faces near them, depths there, and gradients to the vertices."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .hard import span
from .scene import NEAR


@njit(cache=True, error_model="numpy")
def _corners(screen, faces, f):
    """x, y and inverse depth of three corners: a (3, 3) array; and twice the area on the screen."""
    corners = np.empty((3, 3))
    for k in range(3):
        vertex = screen[faces[f, k]]
        corners[k, 0], corners[k, 1], corners[k, 2] = vertex[0], vertex[1], 1 / vertex[2]
    a, b, c = corners
    return corners, (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


@njit(cache=True, error_model="numpy")
def _edges(corners):
    """The three edges: their x and y, and one over the squared length (0 for none)."""
    edges = np.empty((3, 3))
    for k in range(3):
        ex, ey = corners[(k + 1) % 3, 0] - corners[k, 0], corners[(k + 1) % 3, 1] - corners[k, 1]
        length = ex * ex + ey * ey
        edges[k, 0], edges[k, 1], edges[k, 2] = ex, ey, 1 / length if length > 0 else 0.0
    return edges


@njit(cache=True, error_model="numpy")
def _nearest_edge(corners, edges, x, y):
    """The edge nearest to a point, the place on it (0 to 1), and the squared distance."""
    edge, place, least = 0, 0.0, np.inf
    for k in range(3):
        px, py, ex, ey = x - corners[k, 0], y - corners[k, 1], edges[k, 0], edges[k, 1]
        t = min(max((px * ex + py * ey) * edges[k, 2], 0.0), 1.0)
        dx, dy = px - t * ex, py - t * ey
        squared = dx * dx + dy * dy
        if squared < least:
            edge, place, least = k, t, squared
    return edge, place, least


@njit(cache=True, error_model="numpy")
def _weight(corners, area, k, x, y):
    """The barycentric coordinate of a point for corner k."""
    b, c = corners[(k + 1) % 3], corners[(k + 2) % 3]
    return ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) / area


@njit(cache=True, error_model="numpy")
def _box(corners, reach, width, height):
    """The pixels within reach of a face's box: left, right, top, bottom."""
    x, y = corners[:, 0], corners[:, 1]
    left, right = span(x.min() - reach, x.max() + reach, width)
    top, bottom = span(y.min() - reach, y.max() + reach, height)
    return left, right, top, bottom


@njit(cache=True, error_model="numpy")
def near_pairs(screen, faces, width, height, sigma, least):
    """The fields of :class:`.soft.Pairs`: all pairs of faces and pixels with a score above ``-least``."""
    reach, most = math.sqrt(sigma * least), 0
    drawn = np.zeros(len(faces), np.bool_)
    for f in range(len(faces)):
        if min(screen[faces[f, 0], 2], screen[faces[f, 1], 2], screen[faces[f, 2], 2]) < NEAR:
            continue
        left, right, top, bottom = _box(_corners(screen, faces, f)[0], reach, width, height)
        if right >= left and bottom >= top:
            drawn[f] = True
            most += (right - left + 1) * (bottom - top + 1)
    face, pixel, edge = np.empty(most, np.int32), np.empty(most, np.int32), np.empty(most, np.int8)
    place, score, depth = np.empty(most), np.empty(most), np.empty(most)
    count = 0
    for f in range(len(faces)):
        if not drawn[f]:
            continue
        corners, area = _corners(screen, faces, f)
        edges = _edges(corners)
        left, right, top, bottom = _box(corners, reach, width, height)
        for i in range(top, bottom + 1):
            for j in range(left, right + 1):
                x, y = j + 0.5, i + 0.5
                u, v = _weight(corners, area, 0, x, y), _weight(corners, area, 1, x, y)
                inside = area != 0 and u >= 0 and v >= 0 and u + v <= 1
                k, t, squared = _nearest_edge(corners, edges, x, y)
                if not inside and squared >= sigma * least:
                    continue
                if inside:
                    inverse = u * corners[0, 2] + v * corners[1, 2] + (1 - u - v) * corners[2, 2]
                else:
                    inverse = (1 - t) * corners[k, 2] + t * corners[(k + 1) % 3, 2]
                face[count], pixel[count], edge[count], place[count] = f, i * width + j, k, t
                score[count], depth[count] = (squared if inside else -squared) / sigma, 1 / inverse
                count += 1
    return face[:count], pixel[:count], edge[:count], place[:count], score[:count], depth[:count]


@njit(cache=True, error_model="numpy")
def pairs_back(screen, faces, width, sigma, face, pixel, edge, place, score, depth, of_score, of_depth):
    """The derivative (v, 3) by columns, rows and depths of the vertices, from those by scores and depths of pairs."""
    gradient = np.zeros_like(screen)
    last = -1
    corners, area = np.zeros((3, 3)), 0.0
    for p in range(len(face)):
        f = np.int64(face[p])  # the type of near_pairs, so that the called functions are compiled once
        if f != last:
            last = f
            corners, area = _corners(screen, faces, f)
        x, y = pixel[p] % width + 0.5, pixel[p] // width + 0.5
        k, t = edge[p], place[p]
        m = (k + 1) % 3
        a, b = faces[f, k], faces[f, m]
        ex, ey = corners[m, 0] - corners[k, 0], corners[m, 1] - corners[k, 1]
        px, py = x - corners[k, 0], y - corners[k, 1]
        inside = score[p] >= 0
        # The nearest point moves with the ends of its edge; sliding along it does not change the distance.
        pull = (-2.0 if inside else 2.0) * of_score[p] / sigma
        gradient[a, 0] += pull * (1 - t) * (px - t * ex)
        gradient[a, 1] += pull * (1 - t) * (py - t * ey)
        gradient[b, 0] += pull * t * (px - t * ex)
        gradient[b, 1] += pull * t * (py - t * ey)
        of_inverse = -of_depth[p] * depth[p] * depth[p]
        if of_inverse == 0:
            continue
        if inside and area != 0:
            _plane_back(corners, area, faces[f], x, y, of_inverse, gradient)
            continue
        qa, qb = corners[k, 2], corners[m, 2]
        gradient[a, 2] -= of_inverse * (1 - t) * qa * qa
        gradient[b, 2] -= of_inverse * t * qb * qb
        if 0 < t < 1:
            slide = of_inverse * (qb - qa) / (ex * ex + ey * ey)
            gradient[a, 0] += slide * (2 * t * ex - ex - px)
            gradient[a, 1] += slide * (2 * t * ey - ey - py)
            gradient[b, 0] += slide * (px - 2 * t * ex)
            gradient[b, 1] += slide * (py - 2 * t * ey)
    return gradient


@njit(cache=True, error_model="numpy")
def _plane_back(corners, area, face, x, y, of_inverse, gradient):
    """Add the derivative of the inverse depth of a face's plane at a point, times ``of_inverse``."""
    tilt_x, tilt_y = 0.0, 0.0  # of the inverse depth on the screen
    for k in range(3):
        b, c = corners[(k + 1) % 3], corners[(k + 2) % 3]
        tilt_x += corners[k, 2] * (b[1] - c[1]) / area
        tilt_y += corners[k, 2] * (c[0] - b[0]) / area
    for k in range(3):
        share = of_inverse * _weight(corners, area, k, x, y)
        gradient[face[k], 0] -= share * tilt_x
        gradient[face[k], 1] -= share * tilt_y
        gradient[face[k], 2] -= share * corners[k, 2] * corners[k, 2]
