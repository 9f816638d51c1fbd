"""The identity of a shape: a digest over its mesh and its surface."""

from __future__ import annotations

import hashlib

import numpy as np

from .shape import Shape


def shape_digest(shape: Shape) -> str:
    """A digest over the identity of a shape: its mesh, bit for bit, and its exact surface.

    An id does not suffice: the shapes of the two splits, a shape and a pair, or the cases of two tasks may share one.
    """
    total = hashlib.blake2b(digest_size=16)
    surface = type(shape.surface)
    total.update(f"{surface.__module__}.{surface.__qualname__} {shape.exactness}".encode())
    for array in (np.asarray(shape.mesh.vertices, dtype=np.float64), np.asarray(shape.mesh.faces, dtype=np.int64)):
        total.update(repr(array.shape).encode() + np.ascontiguousarray(array).tobytes())
    if shape.cloud is not None and shape.cloud.normals is not None:
        total.update(shape.cloud.normals.tobytes())
    return total.hexdigest()
