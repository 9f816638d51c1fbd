"""Objects of thin wire: the centre lines of each, and the solid of a round wire along them.

Each function draws the measures and returns centre lines in any unit; :func:`solid` scales them.
"""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from manifold3d import Manifold

SIDES = 8  # facets around a wire
JOINT = 1.3  # radius of the ball where wires are joined, in radii of the wire


class Wirework(NamedTuple):
    """Centre lines; if they are ``joined``, they become one body."""

    lines: list[np.ndarray]  # (n, 3) each, open
    rings: list[np.ndarray]  # (n, 3) each, closed; the first point is not repeated
    joints: np.ndarray  # (j, 3): where a ball covers the ends of wires
    joined: bool
    genus: int
    components: int
    large: float = JOINT  # radius of the balls, in radii of the wire


def lattice(rng: np.random.Generator, thickness: float) -> Wirework:
    """A block of cells of a strut lattice: cubic, body-centred or octet."""
    kind = ("cubic", "centred", "octet")[int(rng.integers(3))]
    cells = rng.integers(3, 6, 3) if kind == "cubic" else rng.integers(2, 4, 3)
    corner = np.stack(np.meshgrid(*(np.arange(n + 1) for n in cells), indexing="ij"), axis=-1).reshape(-1, 3)
    cube = np.stack(np.meshgrid(*(np.arange(n) for n in cells), indexing="ij"), axis=-1).reshape(-1, 3)
    edges = [np.stack([corner, corner + step], axis=1) for step in np.eye(3)]
    if kind == "centred":
        middle = cube + 0.5
        diagonals = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2
        edges += [np.stack([middle, middle + d], axis=1) for d in diagonals]
    if kind == "octet":  # corners and middles of faces, each of these tied to its corners and to its neighbours
        edges = []
        for axis in range(3):
            u, v = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
            face = np.concatenate([cube, cube[cube[:, axis] == cells[axis] - 1] + np.eye(3)[axis]]) + (u + v) / 2
            edges += [np.stack([face, face + a * u + b * v], axis=1) for a in (-0.5, 0.5) for b in (-0.5, 0.5)]
            middle = cube + (u + v) / 2  # from the face below to the faces at its sides, and from the one above
            w = np.eye(3)[axis] / 2
            for start, up in ((middle, w), (middle + 2 * w, -w)):
                edges += [np.stack([start, start + up + s * d / 2], axis=1) for d in (u, v) for s in (-1, 1)]
    edges = np.concatenate(edges)
    inside = ((edges >= 0) & (edges <= cells)).all(axis=(1, 2))
    sides = rng.uniform(0.8, 1.2, 3)
    return _tied(edges[inside], sides)


def pylon(rng: np.random.Generator, thickness: float) -> Wirework:
    """A lattice mast that tapers: four legs, rings, and crossed braces on each side of each bay."""
    bays, foot, top = int(rng.integers(7, 15)), rng.uniform(0.25, 0.4), rng.uniform(0.04, 0.12)
    z = 2 * (1 - (1 - np.linspace(0, 1, bays + 1)) ** rng.uniform(1.1, 1.5))
    half = foot + (top - foot) * (z / 2) ** rng.uniform(0.5, 1.0)
    square = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    legs = np.concatenate([half[:, None, None] * square, np.broadcast_to(z[:, None, None], (bays + 1, 4, 1))], axis=2)
    edges = [(legs[k, i], legs[k + 1, i]) for k in range(bays) for i in range(4)]
    edges += [(legs[k, i], legs[k, (i + 1) % 4]) for k in range(1, bays + 1) for i in range(4)]
    for k in range(bays):
        for i in range(4):
            a, b, c, d = legs[k, i], legs[k, (i + 1) % 4], legs[k + 1, (i + 1) % 4], legs[k + 1, i]
            share = half[k] / (half[k] + half[k + 1])  # where the diagonals of a trapezium cross
            cross = a + share * (c - a)
            edges += [(end, cross) for end in (a, b, c, d)]
    return _tied(np.array(edges), np.ones(3))


def cage(rng: np.random.Generator, thickness: float) -> Wirework:
    """A ball of wire: meridians from pole to pole, and rings around."""
    meridians, rings = int(rng.integers(12, 29)), int(rng.integers(3, 9))
    tall, waist = rng.uniform(0.9, 1.4), rng.uniform(-0.25, 0.1)

    def at(t: np.ndarray, angle: np.ndarray | float) -> np.ndarray:
        r = np.sin(t) * (1 + waist * np.cos(2 * t))
        return np.stack(np.broadcast_arrays(r * np.cos(angle), r * np.sin(angle), tall * np.cos(t)), axis=-1)

    t = np.linspace(0, pi, round(32 / (rings + 1)) * (rings + 1) + 1)  # rings cross meridians at vertices
    turn = 2 * pi * np.arange(meridians) / meridians
    around = np.linspace(0, 2 * pi, 4 * meridians, endpoint=False)
    lines = [at(t, a) for a in turn]
    hoops = [at(np.array(pi * (k + 1) / (rings + 1)), around) for k in range(rings)]
    poles = np.array([at(np.array(end), 0.0) for end in (0.0, pi)])
    # The balls at the poles are large enough for the wires to be separate where they leave them.
    return Wirework(lines, hoops, poles, True, meridians * rings + meridians - 1, 1, 1.5 * meridians / pi + 1)


def woven(rng: np.random.Generator, thickness: float) -> Wirework:
    """A wire cloth of two sets of wires that pass over and under each other without contact, flat or domed."""
    counts = rng.integers(14, 25, 2)
    pitch, dome = 1.3 / counts.max(), rng.uniform(0, 0.5) * (rng.random() < 0.7)
    swing = 0.8 * thickness  # of the middle of a wire: at a crossing the two are 1.6 diameters apart
    lines = []
    for axis in (0, 1):
        along = np.linspace(-0.5, counts[axis] - 0.5, 4 * counts[axis] + 1)
        for k in range(counts[1 - axis]):
            height = (1 - 2 * axis) * swing * np.cos(pi * (along + k))
            at = np.stack([along, np.full_like(along, k), height / pitch], axis=1)
            lines.append((at if axis == 0 else at[:, [1, 0, 2]]) * pitch)
    middle = pitch * (np.append(counts, 1) - 1) / 2
    for line in lines:
        line -= middle
        line[:, 2] += dome * (1 - (line[:, :2] ** 2).sum(axis=1))
    return Wirework(lines, [], np.empty((0, 3)), False, 0, len(lines))


def spring(rng: np.random.Generator, thickness: float) -> Wirework:
    """A coil, straight, conical or waisted, with a hook at each end; some have another coil inside."""
    coils, lines = 1 + int(rng.random() < 0.4), []
    length, radius = rng.uniform(1.2, 2.0), rng.uniform(0.3, 0.5)
    cone, waist = rng.uniform(-0.25, 0.25), rng.uniform(-0.3, 0.3)
    for k in range(coils):
        turns = int(rng.integers(14, 31))
        t = np.linspace(0, 1, 40 * turns + 1)
        r = 0.6**k * radius * (1 + cone * (2 * t - 1) + waist * (2 * t - 1) ** 2)
        a = 2 * pi * turns * t * (-1) ** k  # the inner coil is wound the other way, and a little shorter
        coil = np.column_stack([r * np.cos(a), r * np.sin(a), (1 - 0.1 * k) * length * (t - 0.5)])
        lines.append(coil if k else np.concatenate([_hook(coil[0], -1)[::-1], coil, _hook(coil[-1], 1)]))
    return Wirework(lines, [], np.empty((0, 3)), False, 0, coils)


def _hook(end: np.ndarray, up: int) -> np.ndarray:
    """Nearly half a circle (n, 3) over the end of a coil, which ends at the axis."""
    s, radius = np.linspace(0, 0.95 * pi, 25)[1:, None], np.hypot(*end[:2]) / 2
    flat = (1 + np.cos(s)) / 2 * end[:2]
    return np.hstack([flat, end[2] + up * radius * np.sin(s)])


KINDS = {kind.__name__: kind for kind in (lattice, woven, spring, cage, pylon)}


def solid(work: Wirework, thickness: float) -> Manifold:
    """The wires as one solid, scaled so that the farthest centre line is at distance 1 from the middle of their box.

    Parameters
    ----------
    thickness : float
        Diameter of the wire.
    """
    from manifold3d import Manifold, OpType

    every = np.concatenate([*work.lines, *work.rings])
    middle = (every.min(axis=0) + every.max(axis=0)) / 2
    scale = 1 / np.linalg.norm(every - middle, axis=1).max()
    bodies = [_tube((line - middle) * scale, thickness / 2, closed=False) for line in work.lines]
    bodies += [_tube((ring - middle) * scale, thickness / 2, closed=True) for ring in work.rings]
    ball = Manifold.sphere(work.large * thickness / 2, 2 * SIDES)
    bodies += [ball.translate(tuple(at)) for at in (work.joints - middle) * scale]
    return Manifold.batch_boolean(bodies, OpType.Add) if work.joined else Manifold.compose(bodies)


def _tied(edges: np.ndarray, sides: np.ndarray) -> Wirework:
    """Struts (e, 2, 3) that are joined where their ends meet, without duplicates."""
    ends, number = np.unique(np.round(edges.reshape(-1, 3), 9), axis=0, return_inverse=True)
    pairs = np.unique(np.sort(number.reshape(-1, 2), axis=1), axis=0)
    genus = len(pairs) - len(ends) + 1  # of a connected graph
    return Wirework(list((ends * sides)[pairs]), [], ends * sides, True, genus, 1)


def _tube(line: np.ndarray, radius: float, *, closed: bool) -> Manifold:
    """A wire with ``SIDES`` facets along a polyline; it keeps its width in bends."""
    from manifold3d import Manifold, Mesh64

    steps = np.roll(line, -1, axis=0) - line if closed else np.diff(line, axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    along = (
        steps + np.roll(steps, 1, axis=0)
        if closed
        else np.concatenate([steps[:1], steps]) + np.concatenate([steps, steps[-1:]])
    )
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    a = 2 * pi * np.arange(SIDES) / SIDES
    rim = radius * np.stack([np.cos(a), np.sin(a)])
    side = np.eye(3)[np.abs(along[0]).argmin()]
    sides = np.empty_like(along)
    for k, direction in enumerate(along):  # the frame is transported without twist
        side = side - (side @ direction) * direction
        side /= np.linalg.norm(side)
        sides[k] = side
    if closed:
        sides = _untwist(along, sides)
    vertices = line[:, None] + rim[0][:, None] * sides[:, None] + rim[1][:, None] * np.cross(along, sides)[:, None]
    n, number = len(line), np.arange(len(line) * SIDES).reshape(-1, SIDES)
    here, ahead = (number, np.roll(number, -1, axis=0)) if closed else (number[:-1], number[1:])
    b, c = np.roll(here, -1, axis=1), np.roll(ahead, -1, axis=1)
    faces = [np.stack([here, b, c], axis=-1).reshape(-1, 3), np.stack([here, c, ahead], axis=-1).reshape(-1, 3)]
    if not closed:
        fan = np.column_stack([np.zeros(SIDES - 2, dtype=int), np.arange(1, SIDES - 1), np.arange(2, SIDES)])
        faces += [fan[:, ::-1], fan + (n - 1) * SIDES]
    mesh = Mesh64(np.ascontiguousarray(vertices.reshape(-1, 3)), np.concatenate(faces).astype(np.uint64))
    return Manifold(mesh)


def _untwist(along: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """The frames of a ring, rotated gradually along it so that the last matches the first."""
    last = sides[-1] - (sides[-1] @ along[0]) * along[0]
    miss = np.arctan2(np.cross(last, sides[0]) @ along[0], last @ sides[0])
    angle = (miss * np.arange(len(sides)) / len(sides))[:, None]
    return np.cos(angle) * sides + np.sin(angle) * np.cross(along, sides)
