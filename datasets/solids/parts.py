"""Machine parts by solid booleans. Each function draws its measures first and builds only on demand.

Lengths are chosen so that a part is about 2 across. Solids overlap where they are joined, and drills go right through,
so that no boolean gets two coplanar faces by accident, and every part is one closed manifold.
"""

from __future__ import annotations

from collections.abc import Callable
from math import cos, hypot, pi, sin
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from manifold3d import CrossSection, Manifold

SEGMENTS = 64  # of a full circle: neighbouring facets meet at 5.6 degrees, far from a sharp edge
OVER = 0.05  # how far a drill goes beyond the faces


class Part(NamedTuple):
    """A part that is not built yet."""

    build: Callable[[], Manifold]
    genus: int
    thinnest: float  # the thinnest wall
    size: float  # the diagonal of the bounding box


def plate(rng: np.random.Generator) -> Part:
    """A plate with round corners and a grid of counterbored holes."""
    width, depth, height = 2.0, rng.uniform(1.1, 1.7), rng.uniform(0.12, 0.3)
    columns, rows = (int(n) for n in rng.integers([2, 1], [5, 4]))
    cell = min(width / columns, depth / rows)
    radius, bore = rng.uniform(0.14, 0.2) * cell, rng.uniform(0.25, 0.32) * cell
    step = height * rng.uniform(0.35, 0.65)

    def build() -> Manifold:
        solid = _extrude(_rounded(width, depth, 0.12), height)
        for x, y in _grid(columns, rows, width, depth):
            solid -= _drill(radius, height).translate((x, y, 0))
            solid -= _cylinder(bore, height).translate((x, y, step))
        return solid

    return Part(build, columns * rows, min(step, height - step), hypot(width, depth, height))


def bracket(rng: np.random.Generator) -> Part:
    """An angle bracket with ribs, and a hole in each bay of both legs."""
    width, depth, height = rng.uniform(1.2, 1.8), rng.uniform(0.9, 1.3), rng.uniform(0.8, 1.3)
    wall = rng.uniform(0.1, 0.18)
    ribs = int(rng.integers(1, 4))
    bay = width / (ribs + 1)
    rib, radius = wall * rng.uniform(0.5, 0.8), rng.uniform(0.16, 0.24) * min(bay, height, depth)
    reach = rng.uniform(0.6, 0.85)

    def build() -> Manifold:
        solid = _box(width, depth, wall) + _box(width, wall, height)
        profile = _polygon(
            [
                (wall / 2, wall / 2),
                (wall + reach * (depth - wall), wall / 2),
                (wall / 2, wall + reach * (height - wall)),
            ]
        )
        for i in range(1, ribs + 1):  # drawn in (y, z), stood up along x
            prism = _extrude(profile, rib).rotate((90, 0, 90))
            solid += prism.translate((i * bay - rib / 2, 0, 0))
        for i in range(ribs + 1):
            x = (i + 0.5) * bay
            solid -= _drill(radius, wall).translate((x, 0.6 * depth, 0))
            solid -= _drill(radius, wall).rotate((-90, 0, 0)).translate((x, 0, 0.6 * height))
        return solid

    return Part(build, 2 * (ribs + 1), min(wall, rib), hypot(width, depth, height))


def gear(rng: np.random.Generator) -> Part:
    """A spur gear with a hub, a bore with a keyway, and round windows in its web."""
    teeth, windows = int(rng.integers(12, 25)), int(rng.choice([0, 4, 5, 6]))
    height, hub = rng.uniform(0.2, 0.4), rng.uniform(0.3, 0.36)
    root = 1 - 4.5 / (teeth + 2)  # 2.25 modules deep, as the standard tooth
    bore, rise = rng.uniform(0.45, 0.6) * hub, rng.uniform(0.1, 0.25)
    window = min(0.34 * (root - hub), 0.56 * (root + hub) / max(windows, 1))
    angles = np.arange(teeth)[:, None] * 2 * pi / teeth + np.array([-0.30, -0.13, 0.13, 0.30]) * 2 * pi / teeth
    radii = np.tile([root, 1.0, 1.0, root], teeth)

    def build() -> Manifold:
        outline = np.column_stack([radii * np.cos(angles.ravel()), radii * np.sin(angles.ravel())])
        solid = _extrude(_polygon(outline), height)
        solid += _cylinder(hub, height + 2 * rise).translate((0, 0, -rise))
        solid -= _drill(bore, height + 2 * rise).translate((0, 0, -rise))
        key = _box(0.35 * bore, 1.25 * bore, height + 2 * (rise + OVER))
        solid -= key.translate((-0.175 * bore, 0, -rise - OVER))
        for i in range(windows):
            a = 2 * pi * (i + 0.5) / windows
            solid -= _drill(window, height).translate(((root + hub) / 2 * cos(a), (root + hub) / 2 * sin(a), 0))
        return solid

    thinnest = min(hub - 1.25 * bore, 0.26 * 2 * pi / teeth, (root - hub) / 2 - window)  # hub, tip of a tooth, web
    return Part(build, 1 + windows, thinnest, hypot(2, 2, height + 2 * rise))


def pipe_tee(rng: np.random.Generator) -> Part:
    """A tee of three pipes, each with a flange and its ring of bolt holes."""
    outer = rng.uniform(0.26, 0.34)
    wall = rng.uniform(0.18, 0.3) * outer
    flange, thick = rng.uniform(1.75, 1.95) * outer, rng.uniform(0.1, 0.16)
    bolts, length = int(rng.integers(4, 9)), 1.0
    bolt, circle = 0.13 * outer, (outer + flange) / 2

    def build() -> Manifold:
        ways = [(0, 90, 0), (0, -90, 0), (0, 0, 0)]
        solid, inside = None, None
        for way in ways:
            arm = _cylinder(outer, length) + _cylinder(flange, thick).translate((0, 0, length - thick))
            for i in range(bolts):
                a = 2 * pi * (i + 0.5) / bolts
                at = (circle * cos(a), circle * sin(a), length - thick)
                arm -= _drill(bolt, thick).translate(at)
            hole = _cylinder(outer - wall, length + OVER)
            solid = arm.rotate(way) if solid is None else solid + arm.rotate(way)
            inside = hole.rotate(way) if inside is None else inside + hole.rotate(way)
        # Ball joints close the corner where the arms meet.
        return solid + _ball(outer) - (inside + _ball(outer - wall))

    return Part(build, 2 + 3 * bolts, wall, hypot(2 * length, 2 * flange, length + flange))


def heat_sink(rng: np.random.Generator) -> Part:
    """A heat sink: thin parallel fins on a base with a screw hole in each corner."""
    width, depth = 2.0, rng.uniform(1.2, 1.7)
    base, height = rng.uniform(0.12, 0.2), rng.uniform(0.5, 0.9)
    fins, lip = int(rng.integers(6, 13)), 0.3
    pitch = (width - 2 * lip) / (fins - 1 + 0.4)
    fin = 0.4 * pitch

    def build() -> Manifold:
        solid = _box(width, depth, base)
        for i in range(fins):
            solid += _box(fin, depth - 0.1, height).translate((lip + i * pitch, 0.05, base / 2))
        for x in (lip / 2, width - lip / 2):
            for y in (lip / 2, depth - lip / 2):
                solid -= _drill(0.075, base).translate((x, y, 0))
        return solid

    return Part(build, 4, min(fin, base), hypot(width, depth, base / 2 + height))


def block(rng: np.random.Generator) -> Part:
    """A block with rounded pockets; one row of them is drilled through from side to side."""
    width, depth, height = 2.0, rng.uniform(1.1, 1.6), rng.uniform(0.5, 0.9)
    columns, rows = (int(n) for n in rng.integers([2, 1], [4, 3]))
    wall = rng.uniform(0.08, 0.14)
    cell_x, cell_y = (width - wall) / columns, (depth - wall) / rows
    floor = rng.uniform(0.2, 0.3) * height
    radius = rng.uniform(0.25, 0.4) * (height - floor) / 2
    row = int(rng.integers(rows))

    def build() -> Manifold:
        solid = _box(width, depth, height)
        pocket = _extrude(_rounded(cell_x - wall, cell_y - wall, 0.08), height)
        for i in range(columns):
            for j in range(rows):
                solid -= pocket.translate((wall / 2 + (i + 0.5) * cell_x, wall / 2 + (j + 0.5) * cell_y, floor))
        drill = _drill(radius, width).rotate((0, 90, 0))
        return solid - drill.translate((0, wall / 2 + (row + 0.5) * cell_y, (floor + height) / 2))

    return Part(build, columns + 1, min(wall, floor), hypot(width, depth, height))


def lattice(rng: np.random.Generator) -> Part:
    """A cubic lattice of square beams."""
    cells = int(rng.integers(1, 4))
    beam = rng.uniform(0.18, 0.32) / cells
    size = 1.5
    pitch = (size - beam) / cells

    def build() -> Manifold:
        # Channels along each axis with the same coordinates: rotated ones would differ in the last digit, so that
        # vertices coincide on one processor and not on another.
        solid = _box(size, size, size)
        for i in range(cells):
            for j in range(cells):
                for axis in range(3):
                    sides, corner = [pitch - beam] * 2, [beam + i * pitch, beam + j * pitch]
                    sides.insert(axis, size + 2 * OVER)
                    corner.insert(axis, -OVER)
                    solid -= _box(*sides).translate(corner)
        return solid

    # A graph of beams: genus = edges - nodes + 1.
    n = cells + 1
    return Part(build, 3 * cells * n**2 - n**3 + 1, beam, size * 3**0.5)


KINDS = {part.__name__: part for part in (plate, bracket, gear, pipe_tee, heat_sink, block, lattice)}


# -- solids ------------------------------------------------------------------------------------------------------------


def _box(x: float, y: float, z: float) -> Manifold:
    from manifold3d import Manifold

    return Manifold.cube((x, y, z))


def _cylinder(radius: float, height: float) -> Manifold:
    from manifold3d import Manifold

    return Manifold.cylinder(height, radius, radius, SEGMENTS)


def _drill(radius: float, height: float) -> Manifold:
    """A cylinder from below z = 0 to above z = height."""
    return _cylinder(radius, height + 2 * OVER).translate((0, 0, -OVER))


def _ball(radius: float) -> Manifold:
    from manifold3d import Manifold

    return Manifold.sphere(radius, SEGMENTS)


def _polygon(points: object) -> CrossSection:
    from manifold3d import CrossSection

    return CrossSection([np.asarray(points, dtype=np.float64)])


def _rounded(x: float, y: float, radius: float) -> CrossSection:
    """A rectangle with round corners, centred at the origin."""
    quarter = np.linspace(0, pi / 2, SEGMENTS // 4 + 1)
    corners = [(x / 2 - radius, y / 2 - radius), (radius - x / 2, y / 2 - radius)]
    corners += [(-cx, -cy) for cx, cy in corners]
    arcs = [
        np.column_stack([cx + radius * np.cos(quarter + k * pi / 2), cy + radius * np.sin(quarter + k * pi / 2)])
        for k, (cx, cy) in enumerate(corners)
    ]
    return _polygon(np.concatenate(arcs))


def _extrude(section: CrossSection, height: float) -> Manifold:
    return section.extrude(height)


def _grid(columns: int, rows: int, width: float, depth: float) -> list[tuple[float, float]]:
    """The centres of the cells of a rectangle centred at the origin."""
    return [
        (width * ((i + 0.5) / columns - 0.5), depth * ((j + 0.5) / rows - 0.5))
        for i in range(columns)
        for j in range(rows)
    ]
