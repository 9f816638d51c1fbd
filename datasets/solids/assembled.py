"""Assemblies: bodies that fit into each other with one clearance. Each function draws first and builds on demand.

Lengths are chosen so that an assembly is about 2 across. Wherever two bodies face each other they are ``gap`` apart, in
threads along the normal of the flanks; round bodies have their facets at the same angles as the holes around them.
"""

from __future__ import annotations

from collections.abc import Callable
from math import cos, pi, radians, sin, sqrt, tan
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .fillets import box, circle, extruded, lobes, polygon, section
from .threads import DEPTH, thread

if TYPE_CHECKING:
    from manifold3d import CrossSection, Manifold

SEGMENTS = 64  # of a full circle
FINE = 144  # of a ring of a bearing
OVER = 0.05  # how far a tool goes beyond the faces
COARSEST = 5.0  # least pitch of a thread, in gaps, at which nut and bolt overlap


class Assembly(NamedTuple):
    """An assembly that is not built yet."""

    build: Callable[[], list[Manifold]]
    components: int
    genus: int  # of all bodies together
    size: float  # the approximate diagonal of the bounding box
    threads: int


def bolted(rng: np.random.Generator, gap: float) -> Assembly:
    """Two plates held by bolts, each with its washer and its nut."""
    count = int(rng.integers(1, 5))
    columns, rows = (count, 1) if count < 4 else (2, 2)
    radius = rng.uniform(0.85, 1.1) * (0.2, 0.16, 0.14, 0.13)[count - 1]
    pitch = max(rng.uniform(0.3, 0.4) * radius, COARSEST * gap)
    width, depth = ((1.1, 1.0), (1.6, 0.8), (2.0, 0.7), (1.5, 1.3))[count - 1]
    upper, lower = rng.uniform(0.14, 0.3), rng.uniform(0.14, 0.3)
    washer, head, nut = 0.25 * radius, 1.3 * radius, 1.6 * radius
    tip = rng.uniform(2.0, 6.0) * pitch  # of the bolt beyond the nut
    shift = rng.uniform(-0.15, 0.15)

    def build() -> list[Manifold]:
        holes = [
            (width * ((i + 0.5) / columns - 0.5), depth * ((j + 0.5) / rows - 0.5))
            for i in range(columns)
            for j in range(rows)
        ]
        plates = [(upper, 0.0, 0.0), (lower, -gap - lower, shift)]
        bodies = []
        for thick, z, aside in plates:
            plate = extruded([box(width, depth, 0.1)], thick, top=0.02, bottom=0.02).translate((aside, 0, z))
            for x, y in holes:
                plate -= _hole(radius, gap, thick).translate((x, y, z))
            bodies.append(plate)
        low = -gap - lower - gap - nut  # the lower face of the nut
        wide, under = 1.75 * radius, upper + gap + washer + gap  # of a hexagon; the lower face of the head
        rod = thread(radius, pitch, nut + tip + 2 * pitch, SEGMENTS).translate((0, 0, low - tip))
        shank = _cylinder(radius, under - (low + nut + pitch) + 0.01).translate((0, 0, low + nut + pitch))
        bolt = shank + rod + _hexagon(wide, head).translate((0, 0, under))
        ring = _cylinder(2.1 * radius, washer) - _hole(radius, gap, washer)
        wider = gap * _radial(radius, pitch)
        inside = thread(radius + wider, pitch, nut + tip + 2 * pitch, SEGMENTS).translate((0, 0, low - tip))
        inner = _hexagon(wide, nut).rotate((180, 0, 0)).translate((0, 0, low + nut)) - inside
        for x, y in holes:
            at = (x, y, 0)
            bodies += [bolt.translate(at), ring.translate((x, y, upper + gap)), inner.translate(at)]
        return bodies

    height = tip + nut + lower + upper + washer + head + 4 * gap
    size = sqrt((width + abs(shift)) ** 2 + depth**2 + height**2)
    return Assembly(build, 2 + 3 * count, 4 * count, size, 2 * count)


def bearing(rng: np.random.Generator, gap: float) -> Assembly:
    """A deep-groove ball bearing on a shaft: two rings and the balls between them."""
    ball, middle, width = rng.uniform(0.13, 0.17), rng.uniform(0.6, 0.68), rng.uniform(0.42, 0.5)
    count = int(rng.integers(7, int(pi / np.arcsin((ball + gap) / middle)) + 1))
    bore, outside = middle - rng.uniform(1.5, 1.7) * ball, 0.98
    shoulder = rng.uniform(0.35, 0.5) * ball  # of the rings, from the circle of the balls
    shaft, long = bore - gap / cos(pi / FINE), rng.uniform(0.8, 1.4)

    def build() -> list[Manifold]:
        race = section(circle((ball + gap) / cos(pi / SEGMENTS), SEGMENTS).at(middle, 0))
        bodies = []
        for low, high in ((bore, middle - shoulder), (middle + shoulder, outside)):
            ring = _bevelled(low, high, width, 0.03) - race
            bodies.append(ring.revolve(FINE))
        for k in range(count):
            a = 2 * pi * k / count
            bodies.append(_ball(ball).translate((middle * cos(a), middle * sin(a), 0)))
        rod = extruded([circle(shaft, FINE)], long, top=0.04, bottom=0.04)
        return [*bodies, rod.translate((0, 0, -0.4 * long))]

    return Assembly(build, 3 + count, 2, sqrt(8 * outside**2 + long**2), 0)


def hinge(rng: np.random.Generator, gap: float) -> Assembly:
    """A butt hinge, more or less open: two leaves with interleaved knuckles and countersunk holes, and the pin."""
    length, reach = 2.0, rng.uniform(0.6, 0.9)
    outer = rng.uniform(0.1, 0.14)
    pin, thick = rng.uniform(0.5, 0.6) * outer, rng.uniform(0.045, 0.07)
    knuckles, screws = int(rng.choice([3, 5, 7])), int(rng.integers(2, 5))
    angle = float(rng.uniform(-60, 80))
    wide = (length - (knuckles - 1) * gap) / knuckles

    def leaf(own: int) -> Manifold:
        start = outer + gap
        plate = extruded([polygon([(0, start), (length, start), (length, reach), (0, reach)], 0.03)], thick, top=0.01)
        solid = plate.translate((0, 0, outer - thick))
        bore = _hole(pin, gap, length).rotate((0, 90, 0))
        for k in range(own, knuckles, 2):
            x = k * (wide + gap)
            solid += _cylinder(outer, wide).rotate((0, 90, 0)).translate((x, 0, 0))
            solid += _box(wide, start + 0.05, thick).translate((x, 0, outer - thick))
        solid -= bore
        for k in range(screws):
            # The countersink is as deep as the leaf is thick: the holes have no straight part.
            screw = _cone(1.6 * thick, 0.8 * thick, thick)
            solid -= screw.translate(
                ((k + 0.5) * length / screws, (start + reach) / 2 + 0.1 * (-1) ** k, outer - thick)
            )
        return solid

    def build() -> list[Manifold]:
        one = leaf(0).rotate((angle, 0, 0))
        other = leaf(1).mirror((0, 1, 0))
        rod = _cylinder(pin, length + 0.04 + gap).rotate((0, 90, 0)).translate((-gap - 0.01, 0, 0))
        head = _ball(1.5 * pin).trim_by_plane((-1, 0, 0), 0).translate((-gap, 0, 0))
        return [one, other, rod + head]

    # The rotated leaf, and the other one; of both, the far edge and the knuckles.
    c, s = cos(radians(angle)), sin(radians(angle))
    edges = [(reach * c - z * s, reach * s + z * c) for z in (outer, outer - thick)]
    edges += [(-reach, outer), (-reach, outer - thick), (outer, outer), (-outer, -outer)]
    size = sqrt((length + 1.5 * pin + 0.03) ** 2 + (np.ptp(edges, axis=0) ** 2).sum())
    return Assembly(build, 3, knuckles + 2 * screws, size, 0)


def jar(rng: np.random.Generator, gap: float) -> Assembly:
    """A jar with a thread on its neck, and the ribbed lid screwed onto it."""
    neck, body = rng.uniform(0.5, 0.62), rng.uniform(0.75, 0.9)
    tall, wall = rng.uniform(0.8, 1.4), rng.uniform(0.06, 0.09)
    pitch = max(rng.uniform(0.09, 0.13), COARSEST * gap)
    turns, ribs = rng.uniform(2.2, 3.2), int(rng.integers(18, 37))
    screw = turns * pitch
    thin = neck - DEPTH * pitch + 0.2 * gap  # a little above the roots: coincident faces would leave slivers

    def build() -> list[Manifold]:
        round_ = 0.25 * body
        outline = [(0, 0), (body, 0), (body, tall), (thin, tall + 0.3 * body), (thin, tall + 0.4 * body + screw)]
        hull = [*outline, (0, tall + 0.4 * body + screw)]
        inside = [(0, wall), (body - wall, wall), (body - wall, tall - 0.3 * wall)]
        inside += [(thin - wall, tall + 0.3 * body), (thin - wall, 4.0), (0, 4.0)]
        solid = _turned(hull, [0, 0.4 * round_, round_, 0.5 * wall, 0.3 * wall, 0])
        top = tall + 0.4 * body + screw
        solid += thread(neck, pitch, screw, 2 * SEGMENTS).translate((0, 0, top - 0.3 * wall - screw))
        solid -= _turned(inside, [0, 0.3 * round_, 0.8 * round_, 0.3 * wall, 0, 0])
        wider = gap * _radial(neck, pitch)
        cavity = thread(neck + wider, pitch, screw + pitch, 2 * SEGMENTS)
        cavity = cavity.translate((0, 0, top - 0.3 * wall - screw)).trim_by_plane((0, 0, -1), -(top + gap))
        low = top - 0.3 * wall - screw + 0.25 * pitch
        grip = lobes(neck + wider + wall, 0.25 * wall, ribs, 8 * ribs)
        lid = extruded([grip], top + gap + wall - low, top=0.5 * wall).translate((0, 0, low))
        return [solid, lid - cavity]

    size = sqrt(8 * body**2 + (tall + 0.4 * body + screw + wall) ** 2)
    return Assembly(build, 2, 0, size, 2)


KINDS = {kind.__name__: kind for kind in (bolted, bearing, hinge, jar)}


# -- bodies ------------------------------------------------------------------------------------------------------------


def _radial(radius: float, pitch: float) -> float:
    """The clearance of radii between a threaded hole and its rod, for flanks that are 1 apart.

    A flank is ``z = r tan 30 + pitch angle / 2 pi``; along its normal, a step in r counts by tan 30 over the length of
    its gradient.
    """
    slope = pitch / (2 * pi * (radius - DEPTH * pitch))
    return sqrt(1 + tan(pi / 6) ** 2 + slope**2) / tan(pi / 6)


def _box(x: float, y: float, z: float) -> Manifold:
    from manifold3d import Manifold

    return Manifold.cube((x, y, z))


def _cylinder(radius: float, height: float) -> Manifold:
    return _cone(radius, radius, height)


def _cone(top: float, foot: float, height: float) -> Manifold:
    from manifold3d import Manifold

    return Manifold.cylinder(height, foot, top, SEGMENTS)


def _ball(radius: float) -> Manifold:
    from manifold3d import Manifold

    return Manifold.sphere(radius, SEGMENTS)


def _hole(radius: float, gap: float, height: float) -> Manifold:
    """A drill for a round body of ``radius``, from below z = 0 to above z = height; facets are ``gap`` apart."""
    return _cylinder(radius + gap / cos(pi / SEGMENTS), height + 2 * OVER).translate((0, 0, -OVER))


def _hexagon(radius: float, height: float) -> Manifold:
    """The head of a bolt, its upper corners turned off."""
    from manifold3d import Manifold

    return Manifold.cylinder(height, radius, radius, 6) ^ Manifold.cylinder(
        height, 1.3 * radius, 0.92 * radius, SEGMENTS
    )


def _bevelled(low: float, high: float, width: float, edge: float) -> CrossSection:
    """The section of a ring between the radii ``low`` and ``high``, with bevelled edges."""
    y = width / 2
    corners = [(low + edge, -y), (high - edge, -y), (high, edge - y), (high, y - edge)]
    corners += [(low + high - a, -b) for a, b in corners]
    return section(polygon(corners, 0.0))


def _turned(corners: list[tuple[float, float]], radii: list[float]) -> Manifold:
    """A solid of revolution, the profile (radius, height) with round corners; sharp where a radius is 0."""
    return section(polygon(corners, radii)).revolve(2 * SEGMENTS)
