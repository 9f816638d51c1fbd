"""The cerebral cortex of an average brain (fsaverage5): the same folds on two halves, with real bases.

FreeSurfer's template has, for each half, the inner and the outer surface of the grey matter (``white``, ``pial``), the
inner one inflated until its folds are gone, and a sphere to which all are mapped so that folds lie where they lie in
other brains (Fischl, Sereno, Tootell and Dale, "High-resolution intersubject averaging and a coordinate system for the
cortical surface", *Human Brain Mapping* 8, 1999). All surfaces of one half have one vertex order.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

KINDS = {"white": "white", "pial": "pial", "inflated": "infl"}  # names used here: names in the files
MIRROR = np.array([-1.0, 1.0, 1.0])  # x runs from left to right

Surface = tuple[np.ndarray, np.ndarray]  # vertices (v, 3), faces (f, 3)
Reader = Callable[[str], Surface]  # of a file's name


def file_of(kind: str, half: str) -> str:
    """``pial_left.gii.gz``"""
    return f"{KINDS.get(kind, kind)}_{half}.gii.gz"


def left(kind: str, read: Reader) -> Surface:
    """A surface of the left half, unchanged."""
    return read(file_of(kind, "left"))


def mirrored_right(kind: str, read: Reader) -> Surface:
    """A surface of the right half, mirrored to the left, with the faces and the vertex order of the left half.

    Vertex i lies at the point of the mirrored right half that corresponds to vertex i of the left half on the sphere:
    a point in a triangle of the right half, by linear interpolation.
    """
    from bench.geometry.closest import TriangleTree
    from bench.geometry.mesh_surface import barycentric

    (sphere, faces), (other, triangles) = read(file_of("sphere", "left")), read(file_of("sphere", "right"))
    at = TriangleTree(other, triangles).closest(sphere * MIRROR)
    corners = triangles[at.faces]
    values, _ = read(file_of(kind, "right"))
    weights = barycentric(at.points, other, corners)
    moved = sum(np.asarray(w)[:, None] * values[corners[:, k]] for k, w in enumerate(weights))
    return moved * MIRROR, faces
