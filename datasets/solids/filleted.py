"""Machine parts as if milled or cast: true fillets on edges and in corners, and legible numbers.

Each function draws its measures first and builds only on demand. Lengths are chosen so that a part is about 2 across.
"""

from __future__ import annotations

from collections.abc import Callable
from math import cos, hypot, pi, sin
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..outlines.lettering import LETTERS, around, ink, lines, width
from .fillets import box, circle, extruded, lobes, polygon, section

if TYPE_CHECKING:
    from manifold3d import Manifold

OVER = 0.05  # how far a tool goes beyond the faces
SEGMENTS = 128  # of a full circle
PEN = 0.16  # width of a stroke, in heights of a letter


class FilletedPart(NamedTuple):
    """A part that is not built yet."""

    build: Callable[[], Manifold]
    genus: int
    size: float  # the diagonal of the bounding box
    text: str  # the lettering
    height: float  # of a letter
    depth: float  # of the lettering: below the face where it is positive, above it where it is negative
    fillet: float  # the smallest radius of a fillet

    @property
    def stroke(self) -> float:
        """The width of a stroke of the lettering."""
        return PEN * self.height


def plate(rng: np.random.Generator) -> FilletedPart:
    """A cover plate: a raised rim, a pocket with a round floor, countersunk holes, and its number in the pocket."""
    x, y, z = 2.0, rng.uniform(1.1, 1.5), rng.uniform(0.2, 0.34)
    corner, fillet = rng.uniform(0.16, 0.28), rng.uniform(0.035, 0.06)
    margin, floor = rng.uniform(0.26, 0.32), rng.uniform(0.4, 0.6) * z
    bore, holes = rng.uniform(0.045, 0.065), int(rng.choice([4, 6]))
    text, sign = _number(rng), rng.choice([-1, 1])
    height = min(0.3 * (y - 2 * margin), 0.75 * (x - 2 * margin) / width(text))
    depth = sign * rng.uniform(0.12, 0.2) * height

    def build() -> Manifold:
        solid = extruded([box(x, y, corner)], z, top=fillet, bottom=0.5 * fillet)
        pocket = extruded([box(x - 2 * margin, y - 2 * margin, 2 * fillet)], z, bottom=fillet)
        solid -= pocket.translate((0, 0, floor))
        for i in np.linspace(-1, 1, holes // 2):
            for j in (-1, 1):
                at = (i * (x - margin) / 2, j * (y - margin) / 2, 0)
                solid -= _countersunk(bore, z).translate(at)
        return _written(solid, lines(text, height), height, floor, depth)

    return FilletedPart(build, holes, hypot(x, y, z), text, height, depth, 0.5 * fillet)


def bracket(rng: np.random.Generator) -> FilletedPart:
    """An angle bracket with a round inner corner, round edges and slots, and its number on the upright leg."""
    x, y, z = rng.uniform(1.2, 1.7), rng.uniform(0.9, 1.2), rng.uniform(0.9, 1.2)
    wall, inner = rng.uniform(0.13, 0.18), rng.uniform(0.12, 0.3)
    fillet = rng.uniform(0.3, 0.42) * wall
    slots = int(rng.integers(2, 5))
    bay = x / slots
    across, long = rng.uniform(0.2, 0.28) * bay, rng.uniform(0.5, 0.65) * (y - wall - inner)
    text, sign = _number(rng), rng.choice([-1, 1])
    height = min(0.22 * z, 0.8 * x / width(text))
    depth = sign * min(rng.uniform(0.1, 0.18) * height, 0.3 * wall)

    def build() -> Manifold:
        corners = [(0, 0), (y, 0), (y, wall), (wall, wall), (wall, z), (0, z)]
        profile = polygon(corners, [1.3 * fillet] * 3 + [inner] + [1.3 * fillet] * 2)
        # Drawn in (y, z) and stood up along x.
        solid = extruded([profile], x, top=fillet, bottom=fillet).rotate((90, 0, 90))
        slot = section(box(across, long, 0.499 * min(across, long))).extrude(wall + 2 * OVER).translate((0, 0, -OVER))
        for i in range(slots):
            solid -= slot.translate(((i + 0.5) * bay, (wall + inner + y) / 2, 0))
        for i in range(2):
            hole = _countersunk(0.3 * across, wall).rotate((-90, 0, 0))
            solid -= hole.translate(((0.2 + 0.6 * i) * x, 0, wall + inner + 0.75 * (z - wall - inner)))
        upright = solid.translate((-x / 2, 0, -0.45 * z)).rotate((-90, 0, 0))  # the back is on top, letters upright
        return _written(upright.rotate((0, 0, 180)), lines(text, height), height, 0.0, depth)

    return FilletedPart(build, slots + 2, hypot(x, y, z), text, height, depth, fillet)


def flange(rng: np.random.Generator) -> FilletedPart:
    """A flange with a neck that joins it in a fillet, bolt holes, and its number around the neck."""
    radius, thick = 1.0, rng.uniform(0.16, 0.24)
    neck, tall = rng.uniform(0.34, 0.42), rng.uniform(0.5, 0.9)
    bore, fillet = rng.uniform(0.7, 0.8) * neck, rng.uniform(0.08, 0.14)
    edge = 0.25 * thick
    bolts, circle_of_bolts = int(rng.integers(4, 9)), 0.84
    bolt = rng.uniform(0.055, 0.075)
    height = 0.5 * (circle_of_bolts - bolt - neck - fillet)
    place = (neck + fillet + circle_of_bolts - bolt) / 2
    text, sign = _number(rng), rng.choice([-1, 1])
    depth = sign * rng.uniform(0.12, 0.2) * height

    def build() -> Manifold:
        corners = [(bore, 0), (radius, 0), (radius, thick), (neck, thick), (neck, tall), (bore, tall)]
        top = 0.35 * (neck - bore)
        solid = section(polygon(corners, [top, edge, edge, fillet, top, top])).revolve(SEGMENTS)
        for i in range(bolts):
            a = 2 * pi * (i + 0.5) / bolts
            at = (circle_of_bolts * cos(a), circle_of_bolts * sin(a), 0)
            solid -= _drill(bolt, thick).translate(at)
        return _written(solid, around(lines(text, height), place, pi / 2), height, thick, depth)

    return FilletedPart(build, 1 + bolts, hypot(2, 2, tall), text, height, depth, min(edge, 0.35 * (neck - bore)))


def housing(rng: np.random.Generator) -> FilletedPart:
    """A hollow cover, open below, with round edges, feet to screw down, a row of vents and its number on top."""
    x, y, z = 1.6, rng.uniform(0.9, 1.2), rng.uniform(0.45, 0.7)
    wall, fillet = rng.uniform(0.06, 0.09), rng.uniform(0.1, 0.16)
    vents = int(rng.integers(5, 11))
    foot, thick = rng.uniform(0.13, 0.16), 0.1
    text, sign = _number(rng), rng.choice([-1, 1])
    height = min(0.28 * y, 0.75 * x / width(text))
    depth = sign * min(rng.uniform(0.12, 0.2) * height, 0.5 * wall)
    pitch = 0.8 * x / vents

    def build() -> Manifold:
        corner, inner = 1.5 * fillet, 1.5 * fillet - wall
        solid = extruded([box(x, y, corner)], z, top=fillet)
        for side in (-1, 1):
            for at in (-0.3 * y, 0.3 * y):
                ear = extruded([circle(foot, SEGMENTS)], thick, top=0.3 * thick)
                solid += ear.translate((side * (x / 2 + 0.4 * foot), at, 0))
        cavity = extruded([box(x - 2 * wall, y - 2 * wall, inner)], z - wall + OVER, top=0.8 * inner)
        solid -= cavity.translate((0, 0, -OVER))
        slot = section(box(0.45 * pitch, 0.24 * y, 0.22 * pitch)).extrude(z)
        for i in range(vents):
            solid -= slot.translate(((i + 0.5) * pitch - 0.4 * x, -0.22 * y, z / 2))
        for side in (-1, 1):
            for at in (-0.3 * y, 0.3 * y):
                solid -= _drill(0.35 * foot, thick).translate((side * (x / 2 + 0.55 * foot), at, 0))
        letters = [line + [0, 0.18 * y] for line in lines(text, height)]
        return _written(solid, letters, height, z, depth)

    return FilletedPart(build, vents + 4, hypot(x + 2.8 * foot, y, z), text, height, depth, 0.3 * thick)


def dial(rng: np.random.Generator) -> FilletedPart:
    """A hand wheel with round lobes on a collar with a scale of ticks and digits, and a bore with a flat."""
    radius, thick = 1.0, rng.uniform(0.14, 0.22)
    grip, tall = rng.uniform(0.5, 0.58), rng.uniform(0.35, 0.55)
    number, fillet = int(rng.integers(5, 10)), rng.uniform(0.04, 0.07)
    wave = 0.5 * grip / number  # no lobe is narrower than its fillet
    digits, sign = int(rng.integers(6, 11)), rng.choice([-1, 1])
    bore, height = rng.uniform(0.14, 0.2), 0.13
    text, turn = "0123456789"[:digits], rng.uniform(0, 2 * pi)
    depth = sign * rng.uniform(0.02, 0.035)

    def build() -> Manifold:
        solid = extruded([circle(radius, 2 * SEGMENTS)], thick, top=0.3 * thick, bottom=0.3 * thick)
        handle = extruded([lobes(grip, wave, number)], thick / 2 + tall, top=fillet)
        solid += handle.translate((0, 0, thick / 2))
        strokes = []
        for k, digit in enumerate(text):
            strokes += around(lines(digit, height), 0.76, turn - 2 * pi * k / digits)
        for k in range(5 * digits):
            a, long = turn - 2 * pi * k / (5 * digits), 0.05 if k % 5 else 0.09
            strokes.append(np.outer([0.96 - 0.3 * thick - long, 0.96 - 0.3 * thick], [cos(a), sin(a)]))
        solid = _written(solid, strokes, height, thick, depth)
        hole = section(circle(bore, SEGMENTS)).extrude(thick + tall + 2 * OVER)
        flat = hole.trim_by_plane((-1, 0, 0), -0.75 * bore)
        return solid - flat.translate((0, 0, -OVER))

    return FilletedPart(build, 1, hypot(2, 2, thick + tall), text, height, depth, min(fillet, 0.3 * thick))


KINDS = {part.__name__: part for part in (plate, bracket, flange, housing, dial)}


# -- tools -------------------------------------------------------------------------------------------------------------


def _number(rng: np.random.Generator) -> str:
    """The number of a part, such as ``KD-4172``."""
    letters = "".join(rng.choice(list(LETTERS), int(rng.integers(1, 4))))
    return f"{letters}-{''.join(str(d) for d in rng.integers(0, 10, int(rng.integers(2, 5))))}"


def _written(solid: Manifold, strokes: list[np.ndarray], height: float, level: float, depth: float) -> Manifold:
    """The solid with lettering in (``depth`` above 0), or on, its face at z = ``level``."""
    letters = ink(strokes, PEN * height)
    if depth > 0:
        return solid - letters.extrude(depth + OVER).translate((0, 0, level - depth))
    return solid + letters.extrude(2 * -depth).translate((0, 0, level + depth))


def _drill(radius: float, height: float) -> Manifold:
    """A cylinder from below z = 0 to above z = height."""
    from manifold3d import Manifold

    return Manifold.cylinder(height + 2 * OVER, radius, radius, SEGMENTS).translate((0, 0, -OVER))


def _countersunk(radius: float, height: float) -> Manifold:
    """A drill with a cone of 90 degrees for the head of a screw, its wide end above z = height."""
    from manifold3d import Manifold

    wide = 1.8 * radius
    cone = Manifold.cylinder(wide + OVER, 0.01 * radius, wide + OVER, SEGMENTS)
    return _drill(radius, height) + cone.translate((0, 0, height - wide))
