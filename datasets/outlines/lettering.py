"""Engineering lettering: lines of upright text as centre lines of strokes, and the ink of a round pen along them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .glyphs import GLYPHS

if TYPE_CHECKING:
    from manifold3d import CrossSection

# Characters that GLYPHS lacks, in its notation: -0.6..0.6 x -1..1, "~" smooth, "o" smooth and closed, "-" straight.
_MORE = {
    "F": ["- .5,1 -.45,1 -.45,-1", "- -.45,.05 .3,.05"],
    "G": ["~ .5,.6 .2,.95 -.25,.85 -.5,.3 -.5,-.3 -.25,-.85 .2,-.97 .5,-.6", "- .05,-.1 .5,-.1 .5,-.6"],
    "I": ["- 0,1 0,-1"],
    "J": ["~ .35,1 .35,-.4 .2,-.9 -.15,-.95 -.4,-.6"],
    "L": ["- -.45,1 -.45,-1 .5,-1"],
    "N": ["- -.5,-1 -.5,1 .5,-1 .5,1"],
    "O": ["o .5,0 .38,.7 0,1 -.38,.7 -.5,0 -.38,-.7 0,-1 .38,-.7"],
    "T": ["- -.55,1 .55,1", "- 0,1 0,-1"],
    "U": ["- -.5,1 -.5,-.4", "~ -.5,-.4 -.35,-.88 0,-1 .35,-.88 .5,-.4", "- .5,-.4 .5,1"],
    "V": ["- -.55,1 0,-1 .55,1"],
    "Y": ["- -.55,1 0,.05 .55,1", "- 0,.05 0,-1"],
    "Z": ["- -.5,1 .5,1 -.5,-1 .5,-1"],
    "-": ["- -.35,0 .35,0"],
}
CHARACTERS: dict[str, list[str]] = {name: strokes for kind in GLYPHS.values() for name, (_, strokes) in kind.items()}
CHARACTERS |= _MORE
LETTERS = tuple(sorted(name for name in CHARACTERS if name.isalpha()))

ADVANCE = 0.8  # from one character to the next, in heights
BEND = 0.035  # distance between the points along a bend, in heights
ROUND = 12  # sides of the pen's circle


def width(text: str) -> float:
    """The width of a line of text, in heights, from the first stroke to the last."""
    return ADVANCE * (len(text) - 1) + 0.6


def lines(text: str, height: float) -> list[np.ndarray]:
    """The centre lines of the strokes of ``text``, (n, 2) each, centred at the origin.

    Parameters
    ----------
    text : str
        Capital letters, digits, hyphens and blanks.
    height : float
        Of a capital, between the centre lines.
    """
    found = []
    for k, character in enumerate(text):
        if character != " ":
            shift = [ADVANCE * (k - (len(text) - 1) / 2), 0]
            found += [height * (0.5 * _line(stroke) + shift) for stroke in CHARACTERS[character]]
    return found


def around(strokes: list[np.ndarray], radius: float, angle: float) -> list[np.ndarray]:
    """Strokes bent onto a circle about the origin, the tops of the letters outwards, their middle at ``angle``."""
    bent = []
    for stroke in strokes:
        r, a = radius + stroke[:, 1], angle - stroke[:, 0] / radius
        bent.append(np.column_stack([r * np.cos(a), r * np.sin(a)]))
    return bent


def ink(strokes: list[np.ndarray], pen: float) -> CrossSection:
    """The area that a round pen of diameter ``pen`` covers along polylines (n, 2)."""
    from manifold3d import CrossSection, OpType

    angles = 2 * np.pi * np.arange(ROUND) / ROUND
    circle = pen / 2 * np.column_stack([np.cos(angles), np.sin(angles)])
    marks = [
        CrossSection.hull_points(np.concatenate([a + circle, b + circle]))
        for stroke in strokes
        for a, b in zip(stroke[:-1], stroke[1:], strict=True)
    ]
    # Points nearer than a hundredth of the pen are merged: otherwise a letter has facets that no tool would cut.
    return CrossSection.batch_boolean(marks, OpType.Add).simplify(0.01 * pen)


def _line(stroke: str) -> np.ndarray:
    """Points along one stroke: the corners of a straight one, densely spaced along a smooth one."""
    from scipy.interpolate import CubicSpline

    how, *words = stroke.split()
    points = np.array([[float(x) for x in word.split(",")] for word in words])
    if how == "-":
        return points[np.append(True, np.diff(points, axis=0).any(axis=1))]
    if how == "o":
        points = np.concatenate([points, points[:1]])
    knots = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    t = np.linspace(0, knots[-1], int(knots[-1] / (2 * BEND)) + 2)
    return CubicSpline(knots, points, bc_type="periodic" if how == "o" else "natural")(t)
