"""Checks that geometry is usable; the messages name it and state what was expected."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..errors import BadInput
from .used import used_vertices

if TYPE_CHECKING:
    from trimesh import Trimesh

FARTHEST = 1e60  # of a coordinate: squares of areas, and sums of them, are finite; and above 0 for its inverse


def check_mesh(mesh: Trimesh, name: str) -> None:
    """Raise :class:`BadInput` unless ``mesh`` has faces, finite vertices and an area."""
    if not len(mesh.faces):
        raise BadInput(f"{name}: has {len(mesh.vertices)} vertices but no faces; expected a triangle mesh")
    check_points(mesh.vertices, name, what="vertices")
    if mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices):
        raise BadInput(f"{name}: faces name vertices that do not exist; the file is damaged")
    extent = float(np.ptp(used_vertices(mesh), axis=0).max())
    if not mesh.area > 1e-14 * extent**2:
        raise BadInput(f"{name}: all {len(mesh.faces)} faces are degenerate (no area); expected a surface")


def check_points(points: np.ndarray, name: str, *, what: str = "points", at_least: int = 1) -> None:
    """Raise :class:`BadInput` unless ``points`` (n, 3) are finite, numerous enough, not all equal, and not too far."""
    if len(points) < at_least:
        raise BadInput(f"{name}: has {len(points)} {what}; expected at least {at_least}")
    bad = int((~np.isfinite(points)).any(axis=1).sum())
    if bad:
        raise BadInput(f"{name}: {bad} of {len(points)} {what} are NaN or infinite; remove them first")
    farthest = float(np.abs(points).max(initial=0))
    if farthest > FARTHEST:
        raise BadInput(
            f"{name}: has coordinates up to {farthest:.3g}; expected at most {FARTHEST:g}, so that areas and "
            "their squares are finite. The file is damaged, or has to be scaled"
        )
    if not np.ptp(points, axis=0).max() > 1 / FARTHEST:
        raise BadInput(f"{name}: all {len(points)} {what} coincide; there is no surface in them")
