"""Colours of faces under known lights, and gradients from colours to vertices."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Normals(NamedTuple):
    """The face normals of a mesh."""

    unit: np.ndarray
    """(f, 3) array; zero for faces without an area"""
    length: np.ndarray
    """(f,) array: twice the area of each face"""


def normals_of(vertices: np.ndarray, faces: np.ndarray) -> Normals:
    """By the right-hand rule."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    length = np.linalg.norm(cross, axis=1)
    return Normals(np.divide(cross, length[:, None], out=np.zeros_like(cross), where=length[:, None] > 0), length)


def normals_back(of_normals: np.ndarray, normals: Normals, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The gradient (v, 3) by vertices, from the gradient (f, 3) by unit face normals."""
    along = np.einsum("fi,fi->f", of_normals, normals.unit)[:, None]
    length = normals.length[:, None]
    of_cross = np.divide(of_normals - along * normals.unit, length, out=np.zeros_like(of_normals), where=length > 1e-14)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    # Twice the area vector is a x b + b x c + c x a.
    by_corner = [np.cross(b - c, of_cross), np.cross(c - a, of_cross), np.cross(a - b, of_cross)]
    gradient = np.zeros_like(vertices)
    corners = faces.T.reshape(-1)
    values = np.concatenate(by_corner)
    for axis in range(3):
        gradient[:, axis] = np.bincount(corners, values[:, axis], len(vertices))
    return gradient


class Lights(NamedTuple):
    """The k lights of one view, infinitely far."""

    directions: np.ndarray
    """(k, 3) array of unit length, towards the lights"""
    colors: np.ndarray
    """(k, 3) array"""
    ambient: np.ndarray
    """(3,) array: ambient light"""

    def shade(self, normals: np.ndarray) -> np.ndarray:
        """The colours (f, 3) of white diffuse faces: ambient + sum over lights of max(n.l, 0) colour."""
        return self.ambient + np.maximum(normals @ self.directions.T, 0) @ self.colors

    def shade_back(self, of_colors: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """The gradient (f, 3) by normals, from that by colours."""
        lit = normals @ self.directions.T > 0
        return (of_colors @ self.colors.T * lit) @ self.directions
