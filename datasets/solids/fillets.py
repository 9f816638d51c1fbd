"""Solids with rounded edges: an outline of lines and arcs is extruded, and its top and bottom edges are rounded over.

The outline moves along its own normals while it rises, by a quarter of a circle. So an edge is a true fillet along
straight sides, round corners and holes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from manifold3d import CrossSection, Manifold

STEPS = 14  # facets of a fillet of 90 degrees
ARC = np.radians(4.5)  # of an arc of an outline, a facet


class Loop(NamedTuple):
    """A closed smooth curve, with the solid on its left: counter-clockwise around a body, clockwise around a hole."""

    points: np.ndarray  # (n, 2)
    normals: np.ndarray  # (n, 2), unit, out of the solid

    def inset(self, by: float) -> np.ndarray:
        """The points (n, 2), moved into the solid."""
        return self.points - by * self.normals

    @property
    def hole(self) -> Loop:
        """The same curve around a hole."""
        return Loop(self.points[::-1], -self.normals[::-1])

    def at(self, x: float, y: float) -> Loop:
        """The curve, moved."""
        return Loop(self.points + [x, y], self.normals)


def polygon(corners: Sequence[tuple[float, float]], radii: Sequence[float] | float) -> Loop:
    """A counter-clockwise polygon with an arc at each corner, convex or not.

    Parameters
    ----------
    corners : (n, 2) array
    radii : of the arcs, one for each corner or one for all; the arcs must fit the sides
        A radius of 0 gives a sharp corner; use it only in outlines whose edges stay sharp, too.
    """
    corner = np.asarray(corners, dtype=np.float64)
    ahead = np.roll(corner, -1, axis=0) - corner
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    before = np.roll(ahead, 1, axis=0)
    turn = np.arctan2(before[:, 0] * ahead[:, 1] - before[:, 1] * ahead[:, 0], (before * ahead).sum(axis=1))
    points, normals = [], []
    for k, radius in enumerate(np.broadcast_to(radii, len(corner))):
        if not radius:
            points.append(corner[k : k + 1])
            normals.append(_right(before[k] + ahead[k])[None])
            continue
        sign = np.sign(turn[k])
        out = sign * _right(before[k])
        centre = corner[k] - before[k] * radius * np.tan(abs(turn[k]) / 2) - radius * out
        start = np.arctan2(*out[::-1])
        angles = start + np.linspace(0, turn[k], max(2, round(abs(turn[k]) / ARC)) + 1)
        out = np.column_stack([np.cos(angles), np.sin(angles)])
        points.append(centre + radius * out)
        normals.append(sign * out)
    return Loop(np.concatenate(points), np.concatenate(normals))


def _right(direction: np.ndarray) -> np.ndarray:
    """The unit vector to the right of a direction (2,)."""
    return np.array([direction[1], -direction[0]]) / np.linalg.norm(direction)


def box(width: float, depth: float, radius: float) -> Loop:
    """A rectangle with round corners, centred at the origin."""
    x, y = width / 2, depth / 2
    return polygon([(-x, -y), (x, -y), (x, y), (-x, y)], radius)


def circle(radius: float, segments: int = 64) -> Loop:
    """A circle about the origin."""
    angles = 2 * np.pi * np.arange(segments) / segments
    out = np.column_stack([np.cos(angles), np.sin(angles)])
    return Loop(radius * out, out)


def lobes(radius: float, height: float, number: int, segments: int = 360) -> Loop:
    """The curve ``r = radius + height cos(number angle)``; smooth, and its normals are exact."""
    a = 2 * np.pi * np.arange(segments) / segments
    r, slope = radius + height * np.cos(number * a), -height * number * np.sin(number * a)
    out, along = np.column_stack([np.cos(a), np.sin(a)]), np.column_stack([-np.sin(a), np.cos(a)])
    normals = r[:, None] * out - slope[:, None] * along
    return Loop(r[:, None] * out, normals / np.linalg.norm(normals, axis=1, keepdims=True))


def extruded(loops: Sequence[Loop], height: float, top: float = 0.0, bottom: float = 0.0) -> Manifold:
    """The solid between z = 0 and z = ``height`` within an outline, its edges rounded.

    Parameters
    ----------
    loops : the outline and its holes
    height : float
        More than ``top + bottom``.
    top, bottom : float
        Radii of the fillets; 0 leaves an edge sharp. Convex arcs of the outline need a larger radius.
    """
    from manifold3d import Manifold, Mesh64, triangulate

    insets, levels = _quarter(bottom), _quarter(top)
    layers = [(inset, z) for inset, z in zip(insets[0], insets[1], strict=True)]
    layers += [(inset, height - z) for inset, z in zip(levels[0][::-1], levels[1][::-1], strict=True)]
    rings = [[loop.inset(inset) for loop in loops] for inset, _ in layers]
    size = sum(len(loop.points) for loop in loops)
    vertices = np.concatenate(
        [np.column_stack([np.concatenate(ring), np.full(size, z)]) for ring, (_, z) in zip(rings, layers, strict=True)]
    )
    ahead = np.concatenate([start + np.roll(np.arange(n), -1) for start, n in _spans(loops)])
    here = np.arange(size)
    low = size * np.arange(len(layers) - 1)[:, None]
    a, b, c, d = low + here, low + ahead, low + size + ahead, low + size + here
    sides = np.stack([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)]).reshape(-1, 3)
    last = size * (len(layers) - 1)
    caps = [np.asarray(triangulate(rings[0]))[:, ::-1], last + np.asarray(triangulate(rings[-1]))]
    faces = np.concatenate([sides, *caps]).astype(np.uint64)
    solid = Manifold(Mesh64(np.ascontiguousarray(vertices), np.ascontiguousarray(faces)))
    if solid.is_empty():
        raise ValueError(f"the outline gives no solid: {solid.status()}; are its arcs wider than the fillets?")
    return solid


def _quarter(radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Insets and heights along a fillet, from the face to the side."""
    angles = np.linspace(0, np.pi / 2, STEPS + 1 if radius else 1)
    return radius * (1 - np.sin(angles)) if radius else np.zeros(1), radius * (1 - np.cos(angles))


def _spans(loops: Sequence[Loop]) -> list[tuple[int, int]]:
    counts = [len(loop.points) for loop in loops]
    return list(zip(np.cumsum([0, *counts[:-1]]), counts, strict=True))


def section(*loops: Loop) -> CrossSection:
    """The area inside an outline and outside its holes."""
    from manifold3d import CrossSection

    return CrossSection([np.ascontiguousarray(loop.points) for loop in loops])
