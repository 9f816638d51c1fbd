"""Height fields over (u, v) for reliefs: knurls, hexagons, weaves and engraved letters; C1 everywhere, 0..1."""

from __future__ import annotations

from collections.abc import Callable
from math import pi

import numpy as np

from ..surfaces.jets import Jet, cos, sin, smooth_step

Pattern = Callable[[Jet, Jet], Jet]

# A stroke font on a field of 2 x 4: each letter a polyline or several, point by point.
_LETTERS = {
    "A": ["00 14 20", "0.51.5 1.51.5"],
    "B": ["00 04 1.53.5 1.52.5 02", "1.52.5 21 1.50 00"],
    "D": ["00 04 13.7 22 10.3 00"],
    "E": ["20 00 04 24", "02 1.52"],
    "G": ["23 14 02 10 21 1.32"],
    "H": ["00 04", "20 24", "02 22"],
    "K": ["00 04", "24 02 20"],
    "L": ["04 00 20"],
    "M": ["00 04 12 24 20"],
    "N": ["00 04 20 24"],
    "O": ["10 01 03 14 23 21 10"],
    "R": ["00 04 1.54 1.52 02", "0.82 20"],
    "S": ["01 10 21 12 03 14 23"],
    "T": ["04 24", "14 10"],
    "V": ["04 10 24"],
    "X": ["00 24", "04 20"],
    "Z": ["04 24 00 20"],
}


def _point(text: str) -> tuple[float, float]:
    """Two coordinates, each a digit with an optional tenth: "0.51.5" is (0.5, 1.5)."""
    first = 3 if text[1:2] == "." else 1
    return float(text[:first]), float(text[first:])


def _segments() -> np.ndarray:
    """(letters, most segments, 4) ends of the strokes in the unit cell about 0; short letters repeat their last one."""
    letters = []
    for strokes in _LETTERS.values():
        lines = [[_point(word) for word in stroke.split()] for stroke in strokes]
        letters.append([(*a, *b) for line in lines for a, b in zip(line[:-1], line[1:], strict=True)])
    most = max(len(letter) for letter in letters)
    table = np.array([letter + letter[-1:] * (most - len(letter)) for letter in letters])
    return (table - [1, 2, 1, 2]) * [0.28, 0.16, 0.28, 0.16]  # with a stroke around, within the cell


SEGMENTS = _segments()
STROKE = 0.17  # half the width of a stroke where it meets the ground, in cells


def knurl(across: int, around: int, steepness: float = 2.2) -> Pattern:
    """Diamonds between two families of crossing grooves.

    Parameters
    ----------
    across, around : int
        Numbers of periods over 2 pi of u and of v.
    steepness : float
        1 for grooves as wide as the diamonds, more for narrower ones.
    """

    def groove(phase: Jet) -> Jet:
        s = sin(phase * 0.5)
        return smooth_step(1.02 - s * s * steepness)

    return lambda u, v: (1 - groove(v * around + u * across)) * (1 - groove(v * around - u * across))


def hexagons(across: int, around: int, steepness: float = 0.55) -> Pattern:
    """Round studs in a honeycomb, with flanks of the given steepness."""

    def height(u: Jet, v: Jet) -> Jet:
        V, U = v * around, u * across
        return smooth_step((cos(2 * V) + 2 * cos(V) * cos(U) + 1.2) * steepness)

    return height


def weave(across: int, around: int) -> Pattern:
    """Strands over and under each other, ``across`` and ``around`` of each; both even."""

    def signed_square(x: Jet) -> Jet:
        return x * x * np.where(x.value < 0, -1.0, 1.0)

    def height(u: Jet, v: Jet) -> Jet:
        a, b = sin(v * (around / 2)), cos(u * (across / 2))
        warp, weft = (a * a + signed_square(a) * b) * 0.5, (b * b - signed_square(b) * a) * 0.5
        return 1 - (1 - warp) * (1 - weft)

    return height


def letters(rows: int, columns: int, rng: np.random.Generator) -> Pattern:
    """Rows of random letters; ``rows`` and ``columns`` of them over 2 pi of u and of v."""
    text = rng.integers(len(SEGMENTS), size=(rows, columns))

    def height(u: Jet, v: Jet) -> Jet:
        x, y = v * (columns / (2 * pi)), u * (rows / (2 * pi))
        column, row = np.floor(x.value), np.floor(y.value)
        strokes = SEGMENTS[text[row.astype(int) % rows, column.astype(int) % columns]]
        x, y = x - (column + 0.5), y - (row + 0.5)
        outside = 1.0 + 0.0 * x
        for ax, ay, bx, by in np.moveaxis(strokes, 0, 2):
            dx, dy = bx - ax, by - ay
            along = (x - ax) * (dx / (dx**2 + dy**2)) + (y - ay) * (dy / (dx**2 + dy**2))
            within = (along.value > 0) & (along.value < 1)
            t = Jet(along.c * within)
            t.c[0] = np.clip(along.value, 0, 1)
            p, q = x - ax - t * dx, y - ay - t * dy
            outside = outside * (1 - smooth_step(1.1 - (p * p + q * q) * (1.1 / STROKE**2)))
        return 1 - outside

    return height
