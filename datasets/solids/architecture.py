"""Buildings: flat walls with rows of equal openings, long thin elements, and ornament. Draws first, builds on demand.

z is up, the front is at the lowest y. Parts overlap where they are joined, so that no boolean gets two coplanar faces.
The longest side of a building is about 2.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .fillets import circle, lobes, polygon, section

if TYPE_CHECKING:
    from manifold3d import CrossSection, Manifold

SINK = 0.004  # how far a part sinks into the part below it
SEGMENTS = 32


class Building(NamedTuple):
    """A building that is not built yet."""

    build: Callable[[], Manifold]
    genus: int
    openings: int  # number of equal ones: windows, arches, spaces between columns
    thinnest: float  # diameter of the thinnest bar, post or mast


def tower(rng: np.random.Generator) -> Building:
    """An office tower: a grid of windows, fins and ledges, balconies with railings on one side, and a mast."""
    width, depth, height = rng.uniform(0.5, 0.75), rng.uniform(0.45, 0.7), 1.6
    floors, bays, sides = int(rng.integers(9, 17)), int(rng.integers(5, 10)), int(rng.integers(4, 8))
    posts, bar = int(rng.integers(5, 10)), rng.uniform(0.006, 0.01)
    storey, recess = height / (floors + 1.5), rng.uniform(0.012, 0.025)
    fins, fin = rng.random() < 0.6, rng.uniform(0.008, 0.014)
    mast, step = rng.uniform(0.25, 0.45), rng.uniform(0.1, 0.16)

    def build() -> Manifold:
        walls, cuts, bars = [_box((-width / 2, width / 2), (-depth / 2, depth / 2), (0, height))], [], []
        front, flank = width - 3 * recess, depth - 3 * recess  # recesses of two sides do not meet at a corner
        for floor in range(floors):
            z = (floor + 1.1) * storey
            for turn in (0, 180):
                for i in range(bays):
                    at = front * ((i + 0.5) / bays - 0.5)
                    glass = _box(_about(at, 0.72 * front / bays), (-depth, recess - depth / 2), (z, z + 0.6 * storey))
                    cuts.append(glass.rotate((0, 0, turn)))
            for i in range(sides):  # on the left; balconies are on the right
                at = flank * ((i + 0.5) / sides - 0.5)
                cuts.append(_box((-width, recess - width / 2), _about(at, 0.6 * flank / sides), (z, z + 0.55 * storey)))
            walls.append(_ledge(width, depth, 0.35 * recess, z + 0.72 * storey, 0.12 * storey))
            bars += _balcony(width, depth, step, z - 0.1 * storey, 0.5 * storey, posts, bar)
        if fins:
            for i in range(bays + 1):
                at = _about(0.985 * front * (i / bays - 0.5), fin)
                walls.append(_box(at, _about(0, depth + 2.6 * recess), (0.9 * storey, height + 0.03)))
        walls.append(_box(_about(0, 0.4 * width), _about(0, 0.4 * depth), (height - SINK, height + 0.1)))
        walls.append(_cone(0.012, 0.006, mast).translate((0.1 * width, 0, height + 0.1 - SINK)))
        walls.append(_box(_about(0, 1.3 * width), _about(0, 1.25 * depth), (-0.05, SINK)))
        return _made(walls, cuts, bars)

    # A railing is held by the wall at both ends and by its posts.
    return Building(build, floors * (posts + 1), floors * (2 * bays + sides), min(bar, 0.012))


def house(rng: np.random.Generator) -> Building:
    """A house with a gabled roof, windows with glazing bars, a chimney, and a porch on posts."""
    width, depth, height = 1.3, rng.uniform(0.8, 1.0), rng.uniform(0.55, 0.7)
    rise, eaves, thick = rng.uniform(0.3, 0.5), rng.uniform(0.05, 0.1), 0.045
    columns, storeys = int(rng.integers(4, 7)), 2
    panes, bar = rng.integers(2, 4, 2), rng.uniform(0.008, 0.012)
    posts, recess = int(rng.integers(4, 7)), rng.uniform(0.035, 0.05)
    pickets, seams = int(rng.integers(36, 57)), int(rng.integers(16, 29))
    chimney = rng.uniform(-0.35, 0.35) * width

    def build() -> Manifold:
        y = depth / 2
        walls = [_box(_about(0, width), _about(0, depth), (0, height)), _prism(width, depth - 0.02, height, rise)]
        roof = _prism(width + 2 * eaves, depth + 2 * eaves, height + thick - 2 * rise * eaves / depth, rise + thick)
        under = _prism(3.0, depth + 2 * eaves, height - 2 * rise * eaves / depth, rise + thick).translate(
            (0, 0, -thick)
        )
        walls.append(roof - under)
        walls.append(_box(_about(chimney, 0.12), (0.1, 0.22), (height, height + rise + 0.14)))
        walls.append(_box(_about(chimney, 0.15), (0.085, 0.235), (height + rise + 0.1, height + rise + 0.125)))
        cuts, bars = [], []
        for turn in (0, 180):
            for i in range(columns):
                for j in range(storeys):
                    at = (width * ((i + 0.5) / columns - 0.5), (j + 0.55) * height / storeys)
                    if turn == 0 and j == 0:  # behind the porch: higher doors
                        size, count = (0.5 * width / columns, 0.6 * height / storeys), (2, 3)
                    else:
                        size, count = (0.45 * width / columns, 0.5 * height / storeys), tuple(panes)
                    cut, grille = _window(at, size, count, y, recess, bar)
                    cuts.append(cut.rotate((0, 0, turn)))
                    bars += [part.rotate((0, 0, turn)) for part in grille]
        for k in range(seams):  # of the sheets of the roof
            at = (width + 2 * eaves - 0.02) * (k / (seams - 1) - 0.5)
            walls.append(_seam(depth + 2 * eaves, height + thick - 2 * rise * eaves / depth, rise + thick, at))
        deck, out = 0.05, 0.3
        walls.append(_box(_about(0, 1.7), (-y - out - 0.3, y + 0.15), (-0.08, SINK)))
        for k in range(pickets):
            at = 1.62 * (k / (pickets - 1) - 0.5)
            walls.append(_box(_about(at, 0.016), _about(-y - out - 0.25, 0.012), (0, 0.15 + 0.015 * (k % 2))))
        for z in (0.04, 0.11):
            walls.append(_box(_about(0, 1.66), _about(-y - out - 0.25, 0.007), (z, z + 0.012)))
        walls.append(_box(_about(0, 0.9 * width), (-y - out, 0), (-0.04, deck - 0.01)))
        walls.append(_box(_about(0, 0.95 * width), (-y - out - 0.03, -y + SINK), (0.48 * height, 0.48 * height + 0.03)))
        for i in range(posts):
            at = 0.84 * width * (i / (posts - 1) - 0.5)
            post = _cone(0.014, 0.012, 0.48 * height - deck + 0.03)
            walls.append(post.translate((at, -y - out + 0.03, deck - 0.02)))
        return _made(walls, cuts, bars)

    # A grille of p panes before one recess: p - 1. Posts between deck and roof of the porch, which the wall joins too.
    windows = columns * storeys * 2
    # The pickets of the fence stand on the ground and cross two rails.
    genus = posts + 2 * (pickets - 1) + columns * 5 + (windows - columns) * (int(panes.prod()) - 1)
    return Building(build, genus, windows, 0.007)


def temple(rng: np.random.Generator) -> Building:
    """A temple: fluted columns all around on three steps, triglyphs, dentils, and a rosette in each gable."""
    front, flank = int(rng.choice([4, 6, 8])), int(rng.integers(7, 12))
    pitch = 1.9 / flank
    radius, height = rng.uniform(0.2, 0.24) * pitch, rng.uniform(2.2, 3.0) * pitch
    flutes, taper = int(rng.choice([12, 16, 20])), rng.uniform(0.78, 0.88)
    width, length = (front - 1) * pitch, (flank - 1) * pitch
    rise, petals = rng.uniform(0.22, 0.3) * (width + pitch) / 2, int(rng.integers(6, 13))
    places = [(i * pitch - width / 2, j * pitch - length / 2) for i in range(front) for j in range(flank)
              if i in (0, front - 1) or j in (0, flank - 1)]  # fmt: skip

    def build() -> Manifold:
        step, room = 0.18 * pitch, 0.55 * pitch  # of the beam beyond the middles of the columns
        parts = [
            _box(
                _about(0, width + 2 * (room + k * step)),
                _about(0, length + 2 * (room + k * step)),
                (z, z + step + SINK),
            )
            for k, z in enumerate((-step, -2 * step, -3 * step))
        ]
        column = _column(radius, height, flutes, taper, pitch)
        parts += [column.translate((x, y, SINK / 2)) for x, y in places]
        inner = (
            (width - 1.7 * pitch, length - 2.2 * pitch) if front > 4 else (width - 1.5 * pitch, length - 2.2 * pitch)
        )
        parts.append(_box(_about(0, inner[0]), _about(0, inner[1]), (0, height + SINK)))
        beam, z = 0.32 * pitch, height
        across, along = width + 1.6 * radius, length + 1.6 * radius
        parts.append(_box(_about(0, across), _about(0, along), (z, z + 2 * beam)))
        for x, y, turn in _around(across, along, pitch / 2):
            mark = _box(_about(0, 0.2 * pitch), (-0.025 * pitch, SINK), (z + beam, z + 2 * beam - SINK))
            parts.append(mark.rotate((0, 0, turn)).translate((x, y, 0)))
        for x, y, turn in _around(across, along, pitch / 7):
            tooth = _box(
                _about(0, 0.07 * pitch), (-0.09 * pitch, SINK), (z + 2 * beam - 0.09 * pitch, z + 2 * beam + SINK)
            )
            parts.append(tooth.rotate((0, 0, turn)).translate((x, y, 0)))
        z += 2 * beam
        parts.append(
            _box(_about(0, across + 0.45 * pitch), _about(0, along + 0.45 * pitch), (z - SINK, z + 0.1 * pitch))
        )
        z += 0.1 * pitch - SINK
        ends = along + 0.42 * pitch
        gable = _prism(ends, across + 0.42 * pitch, z, rise).rotate((0, 0, 90))
        field = _prism(0.14 * pitch, 0.8 * across, z + 0.14 * rise, 0.72 * rise).rotate((0, 0, 90))
        flower = section(lobes(0.2 * rise, 0.05 * rise, petals, 12 * petals)).extrude(0.07 * pitch).rotate((90, 0, 0))
        for side in (-1, 1):
            gable -= field.translate((0, side * ends / 2, 0))
            at = side * (ends / 2 - 0.07 * pitch) + 0.035 * pitch
            gable += flower.translate((0, at, z + 0.42 * rise))
        door = _box(_about(0, 0.45 * inner[0]), (-length, 0.2 * pitch - inner[1] / 2), (SINK, 0.75 * height))
        return _made(
            parts, [], [gable], late=[door ^ _box(_about(0, inner[0]), _about(0, inner[1] + 2 * SINK), (0, height))]
        )

    return Building(build, len(places), len(places), 2 * taper * radius)


def church(rng: np.random.Generator) -> Building:
    """A church: arched windows with mullions between buttresses, a rose window, and a belfry with a spire."""
    bays, pitch = int(rng.integers(4, 8)), rng.uniform(0.2, 0.26)
    width, height = rng.uniform(0.5, 0.62), rng.uniform(0.4, 0.52)
    rise, recess = rng.uniform(0.26, 0.36), 0.05
    bar, spokes = rng.uniform(0.012, 0.018), int(rng.integers(6, 13))
    side, spire = rng.uniform(0.3, 0.36), rng.uniform(0.5, 0.7)
    tall = (height + rise + rng.uniform(0.03, 0.1)) / 0.67  # the belfry is above the ridge
    length = bays * pitch

    def build() -> Manifold:
        walls = [_box(_about(0, width), (0, length), (0, height))]
        walls.append(
            _prism(length + 0.03, width + 0.06, height - SINK, rise).rotate((0, 0, 90)).translate((0, length / 2, 0))
        )
        walls.append(_box(_about(0, 1.25 * width), (-side - 0.05, length + 0.06), (-0.05, SINK)))
        cuts, bars, late = [], [], []
        for turn in (-1, 1):
            pier = _buttress(0.045, 0.1, 0.85 * height)
            pier = pier if turn > 0 else pier.mirror((1, 0, 0))
            for k in range(bays + 1):
                at = (turn * (width / 2 - SINK), 0.03 + k * (length - 0.06) / bays, 0)
                walls.append(pier.translate(at))
            for k in range(bays):
                y = (k + 0.5) * pitch
                opening = _arch(0.45 * pitch, 0.62 * height, 2 * recess).rotate((0, 0, 90))
                cuts.append(opening.translate((turn * width / 2, y, 0.2 * height)))
                mullion = _box(
                    _about(turn * (width / 2 - 0.5 * recess), bar), _about(y, bar), (0.18 * height, 0.84 * height)
                )
                bars.append(mullion)
        y = length  # the rose is in the wall at the end
        rose, depth = 0.26 * width, 2 * recess
        at = (0, y - recess, height)
        cuts.append(_disc(rose, depth).translate(at))
        walls.append((_disc(1.25 * rose, recess) - _disc(rose, 1.0)).translate((0, y - 0.4 * recess, height)))
        bars.append(_disc(0.3 * rose, bar).translate((0, y - 0.4 * recess, height)))
        for k in range(spokes):
            spoke = _box((0, 1.1 * rose), _about(0, bar), _about(0, bar)).rotate((0, -360 * (k + 0.3) / spokes, 0))
            bars.append(spoke.translate((0, y - 0.4 * recess + bar / 2, height)))
        walls.append(_box(_about(0, side), (-side, 0.04), (0, tall)))
        walls.append(_ledge(side, side, 0.015, 0.62 * tall, 0.02).translate((0, -side / 2, 0)))
        walls.append(_ledge(side, side, 0.02, tall - 0.02, 0.03).translate((0, -side / 2, 0)))
        cone = _cone(0.5 * side, 0.004, spire, 8).rotate((0, 0, 22.5))
        walls.append(cone.translate((0, -side / 2, tall)))
        walls.append(_cross(tall + spire - 0.04, -side / 2, bar))
        for turn in (0, 90):  # the belfry is open on four sides
            opening = _arch(0.4 * side, 0.28 * tall, 2 * side).rotate((0, 0, turn))
            late.append(opening.translate((0, -side / 2, 0.67 * tall)))
        cuts.append(_arch(0.34 * side, 0.25 * tall, 0.08).translate((0, -side, SINK)))
        return _made(walls, cuts, bars, late=late)

    # A mullion divides a recess in two, spokes divide the rose; the belfry has four openings.
    return Building(build, 2 * bays + spokes - 1 + 3, 2 * bays, bar)


def arcade(rng: np.random.Generator) -> Building:
    """A viaduct of two tiers of arches, its deck between two balustrades."""
    large, each = int(rng.integers(4, 7)), int(rng.integers(2, 4))
    small = large * each
    pitch, thick = 2.0 / large, rng.uniform(0.2, 0.28)
    lower, upper = rng.uniform(0.9, 1.3) * pitch, rng.uniform(1.2, 1.5) * pitch / each
    posts, rail = 12 * large, rng.uniform(0.016, 0.022)
    tall = rng.uniform(0.09, 0.12)

    def build() -> Manifold:
        walls = [
            _box((0, 2), _about(0, thick), (0, lower)),
            _box((-0.04, 2.04), _about(0, thick + 0.12), (-0.06, SINK)),
        ]
        walls.append(_box((0, 2), _about(0, 0.8 * thick), (lower - SINK, lower + upper)))
        cuts, posts_of = [], _baluster(tall, 0.3 * rail)
        for k in range(large):
            cuts.append(_arch(0.78 * pitch, 0.88 * lower, 1.0).translate(((k + 0.5) * pitch, 0, 2 * SINK)))
        for k in range(small):
            opening = _arch(0.66 * pitch / each, 0.8 * upper, 1.0)
            cuts.append(opening.translate(((k + 0.5) * pitch / each, 0, lower + 0.06 * upper)))
        for z, wide in ((lower - 0.02, thick + 0.03), (lower + upper - 0.02, 0.8 * thick + 0.08)):
            walls.append(_box((-0.015, 2.015), _about(0, wide), (z, z + 0.035)))
        deck = lower + upper + 0.015
        for side in (-1, 1):
            y = side * (0.4 * thick + 0.04 - rail)
            walls.append(_box((0, 2), _about(y, rail), (deck + tall - SINK, deck + tall + 0.6 * rail)))
            walls += [posts_of.translate(((k + 0.5) * 2 / posts, y, deck - SINK / 2)) for k in range(posts)]
        for k in range(2 * small + 1):  # consoles under the deck
            x = 0.02 + k * 1.96 / (2 * small)
            walls.append(_box(_about(x, 0.02), _about(0, 0.8 * thick + 0.05), (lower + upper - 0.045, lower + upper)))
        return _made(walls, cuts, [])

    return Building(build, large + small + 2 * (posts - 1), large + small, 0.6 * rail)


KINDS = {kind.__name__: kind for kind in (tower, house, temple, church, arcade)}


# -- parts -------------------------------------------------------------------------------------------------------------


def _made(walls: list, cuts: list, bars: list, late: list | None = None) -> Manifold:
    """The walls minus the cuts, plus the bars in front of the openings, minus the ``late`` cuts."""
    from manifold3d import Manifold, OpType

    solid = Manifold.batch_boolean(walls, OpType.Add)
    for parts, how in ((cuts, OpType.Subtract), (bars, OpType.Add), (late or [], OpType.Subtract)):
        if parts:
            solid = Manifold.batch_boolean([solid, *parts], how)
    return solid


def _about(middle: float, size: float) -> tuple[float, float]:
    return middle - size / 2, middle + size / 2


def _box(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> Manifold:
    """The box between two limits on each axis."""
    from manifold3d import Manifold

    low, high = np.array([x, y, z]).T
    return Manifold.cube(tuple(high - low)).translate(tuple(low))


def _cone(foot: float, top: float, height: float, segments: int = SEGMENTS) -> Manifold:
    from manifold3d import Manifold

    return Manifold.cylinder(height, foot, top, segments)


def _disc(radius: float, thick: float) -> Manifold:
    """A cylinder along y from 0 to ``thick``, about the origin."""
    return section(circle(radius, 48)).extrude(thick).rotate((-90, 0, 0))


def _prism(length: float, width: float, z: float, rise: float) -> Manifold:
    """A gable along x, its foot at z."""
    return _profile([(-width / 2, 0), (width / 2, 0), (0, rise)], length).translate((-length / 2, 0, z))


def _seam(width: float, z: float, rise: float, x: float) -> Manifold:
    """A rib over both slopes of a gable as :func:`_prism` makes it."""
    y, up = width / 2 - SINK, 0.008
    corners = [(-y, 0), (y, 0), (y, 2 * up), (0, rise + 2 * up), (-y, 2 * up)]
    return _profile(corners, 0.008).translate((x - 0.004, 0, z - up))


def _profile(corners: list[tuple[float, float]], length: float) -> Manifold:
    """A polygon in (y, z), extruded from x = 0 to x = ``length``."""
    return section(polygon(corners, 0.0)).extrude(length).rotate((90, 0, 90))


def _arch(width: float, height: float, depth: float) -> Manifold:
    """An opening with a round head, its sill at z = 0, from y = -depth / 2 to depth / 2."""
    a = np.linspace(0, pi, SEGMENTS // 2 + 1)
    head = np.column_stack([width / 2 * np.cos(a), height - width / 2 + width / 2 * np.sin(a)])
    outline = np.concatenate([[(-width / 2, 0), (width / 2, 0)], head])
    return _drawn(outline).extrude(depth).rotate((90, 0, 0)).translate((0, depth / 2, 0))


def _drawn(outline: np.ndarray) -> CrossSection:
    from manifold3d import CrossSection

    return CrossSection([np.ascontiguousarray(outline)])


def _ledge(width: float, depth: float, out: float, z: float, height: float) -> Manifold:
    """A band around a block."""
    return _box(_about(0, width + 2 * out), _about(0, depth + 2 * out), (z, z + height))


def _balcony(width: float, depth: float, out: float, z: float, high: float, posts: int, bar: float) -> list[Manifold]:
    """A slab on the right side of a tower, and a rail on posts whose ends are in the wall."""
    wall, long = width / 2 - SINK, 0.42 * depth
    parts = [_box((wall, width / 2 + out), _about(0, 2 * long), (z, z + 0.015))]
    top = (z + high - bar, z + high)
    parts += [_box((wall, width / 2 + out - 0.01), _about(side * (long - 0.02), bar), top) for side in (-1, 1)]
    x = width / 2 + out - 0.02
    parts.append(_box(_about(x, bar), _about(0, 2 * (long - 0.02)), top))
    for k in range(posts):
        at = (long - 0.03) * (2 * k / (posts - 1) - 1)
        parts.append(_box(_about(x, 0.8 * bar), _about(at, 0.8 * bar), (z + 0.01, z + high - bar / 2)))
    return parts


def _window(
    at: tuple[float, float], size: tuple[float, float], panes: tuple[int, int], wall: float, recess: float, bar: float
) -> tuple[Manifold, list[Manifold]]:
    """A recess in the front wall y = -``wall``, and the bars in front of it that divide it into panes."""
    x, z = (_about(middle, length) for middle, length in zip(at, size, strict=True))
    cut = _box(x, (-wall - 0.02, recess - wall), z)
    front = _about(0.4 * recess - wall, bar)
    bars = [
        _box(_about(x[0] + size[0] * k / panes[0], bar), front, (z[0] - SINK, z[1] + SINK)) for k in range(1, panes[0])
    ]
    bars += [
        _box((x[0] - SINK, x[1] + SINK), front, _about(z[0] + size[1] * k / panes[1], 0.9 * bar))
        for k in range(1, panes[1])
    ]
    return cut, bars


def _column(radius: float, height: float, flutes: int, taper: float, pitch: float) -> Manifold:
    """A fluted shaft that tapers, with a round cushion and a square slab on top."""
    a = 2 * pi * np.arange(8 * flutes) / (8 * flutes)
    r = radius * (1 - 0.09 * np.abs(np.sin(flutes * a / 2)))
    shaft = _drawn(r[:, None] * np.column_stack([np.cos(a), np.sin(a)])).extrude(0.93 * height, 4, 0, (taper, taper))
    cushion = _cone(0.9 * taper * radius, 1.35 * radius, 0.06 * height, 2 * SEGMENTS).rotate(
        (0, 0, 1.7)
    )  # its facets and those of the shaft do not meet in edges
    cushion = cushion.translate((0, 0, 0.9 * height))
    slab = _box(_about(0, 2.7 * radius), _about(0, 2.7 * radius), (0.955 * height, height + SINK))
    return shaft + cushion + slab


def _baluster(height: float, radius: float) -> Manifold:
    """A turned post, from z = 0 to ``height``."""
    z = np.linspace(0, 1, 13)
    r = radius * (1.0 + 0.8 * np.exp(-(((z - 0.35) / 0.18) ** 2)) + 0.5 * (np.abs(z - 0.5) > 0.44))
    outline = np.concatenate([[(0, 0)], np.column_stack([r, z * height]), [(0, height)]])
    return _drawn(outline).revolve(12)


def _buttress(wide: float, out: float, height: float) -> Manifold:
    """A pier in front of a wall at x = 0, with a sloping head, centred at y = 0."""
    corners = [
        (0, 0),
        (out, 0),
        (out, 0.6 * height),
        (0.6 * out, 0.72 * height),
        (0.6 * out, 0.9 * height),
        (0, height),
    ]
    return section(polygon(corners, 0.0)).extrude(wide).rotate((90, 0, 0)).translate((0, wide / 2, 0))


def _cross(z: float, y: float, bar: float) -> Manifold:
    """A thin cross on a spire."""
    upright = _box(_about(0, 0.6 * bar), _about(y, 0.6 * bar), (z, z + 0.16))
    return upright + _box(_about(0, 0.08), _about(y, 0.55 * bar), (z + 0.1, z + 0.1 + 0.6 * bar))


def _around(width: float, length: float, pitch: float) -> list[tuple[float, float, float]]:
    """Positions along the four sides of a block, about a pitch apart, and the angle there of a part that faces -y."""
    found: list[tuple[float, float, float]] = []
    for turn, long, away in ((0, width, length), (90, length, width), (180, width, length), (270, length, width)):
        count = max(2, round(long / pitch))
        c, s = round(np.cos(np.radians(turn))), round(np.sin(np.radians(turn)))
        for k in range(count):
            x, y = long * ((k + 0.5) / count - 0.5), -away / 2
            found.append((c * x - s * y, s * x + c * y, turn))
    return found
