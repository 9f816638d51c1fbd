"""Digits and letters: strokes that vary as in handwriting, drawn by a round pen, and the outline of the ink.

The ink of a pen that moves along a stroke is a Gaussian around each point of it; the outline is the level set of their
sum, at the value half a line's width beside a long straight stroke. So strokes that meet merge smoothly, and loops
leave holes. The outline is traced on a grid, knots are put on it evenly, and the closed cubic spline through them is
the curve: the spline, not the ink, is the truth.
"""

from __future__ import annotations

import numpy as np

from .pieces import area, spline, turned

# On a field of -0.6..0.6 x -1..1. A stroke is a text of points: "~" is smooth through them, "o" smooth and closed,
# "-" straight from each to the next. The number before the strokes is that of the outline's closed curves.
GLYPHS = {
    "digit": {
        "0": (2, ["o .5,0 .38,.7 0,1 -.38,.7 -.5,0 -.38,-.7 0,-1 .38,-.7"]),
        "1": (1, ["- -.35,.6 .05,1 .05,-1"]),
        "2": (1, ["~ -.5,.55 -.3,.9 .1,1 .48,.75 .42,.3 0,-.35 -.55,-1", "- -.55,-1 .6,-1"]),
        "3": (1, ["~ -.5,.75 -.1,1 .4,.8 .35,.35 -.1,.08", "~ -.1,.08 .4,-.1 .5,-.6 .1,-1 -.35,-.95 -.55,-.7"]),
        "4": (2, ["- .25,1 -.6,-.3 .6,-.3", "- .25,1 .25,-1"]),
        "5": (1, ["- .5,1 -.35,1 -.45,.15", "~ -.45,.15 -.05,.35 .45,.1 .5,-.5 .1,-.97 -.3,-.95 -.55,-.7"]),
        "6": (2, ["~ .4,.95 -.1,.7 -.45,.05 -.5,-.5 -.1,-.98 .4,-.75 .45,-.3 .1,.05 -.3,-.1 -.5,-.5"]),
        "7": (1, ["- -.55,1 .55,1", "~ .55,1 .2,.3 -.05,-.3 -.2,-1"]),
        "8": (3, ["o 0,.05 .42,.42 .36,.82 0,1 -.36,.82 -.42,.42 0,.05 .5,-.38 .45,-.8 0,-1 -.45,-.8 -.5,-.38"]),
        "9": (2, ["~ -.4,-.95 .1,-.7 .45,-.05 .5,.5 .1,.98 -.4,.75 -.45,.3 -.1,-.05 .3,.1 .5,.5"]),
    },
    "letter": {
        "A": (2, ["- -.6,-1 0,1 .6,-1", "- -.38,-.3 .38,-.3"]),
        "B": (3, ["- -.5,-1 -.5,1", "~ -.5,1 .1,.98 .45,.7 .38,.25 -.1,.04 -.5,.04",
                  "~ -.5,.04 .1,.02 .52,-.25 .5,-.75 .1,-.98 -.5,-1"]),
        "C": (1, ["~ .5,.6 .2,.95 -.25,.85 -.5,.3 -.5,-.3 -.25,-.85 .2,-.95 .5,-.6"]),
        "D": (2, ["- -.5,-1 -.5,1", "~ -.5,1 .1,.9 .5,.4 .5,-.4 .1,-.9 -.5,-1"]),
        "E": (1, ["- .5,1 -.45,1 -.45,-1 .5,-1", "- -.45,.05 .35,.05"]),
        "H": (1, ["- -.5,1 -.5,-1", "- .5,1 .5,-1", "- -.5,0 .5,0"]),
        "K": (1, ["- -.5,1 -.5,-1", "- .5,1 -.5,0 .55,-1"]),
        "M": (1, ["- -.6,-1 -.5,1 0,-.2 .5,1 .6,-1"]),
        "P": (2, ["- -.45,-1 -.45,1", "~ -.45,1 .15,.95 .48,.6 .4,.15 .05,-.1 -.45,-.1"]),
        "R": (2, ["- -.45,-1 -.45,1", "~ -.45,1 .15,.95 .48,.65 .4,.2 .05,0 -.45,0", "- 0,0 .55,-1"]),
        "S": (1, ["~ .45,.7 .15,.98 -.35,.85 -.4,.4 0,.05 .4,-.35 .4,-.8 0,-1 -.5,-.75"]),
        "X": (1, ["- -.5,1 .5,-1", "- .5,1 -.5,-1"]),
    },
}  # fmt: skip

GRID = 0.02  # cells of the grid on which the outline is traced
INK = 0.02  # distance between the sample points of a stroke
KNOTS = 0.045  # distance between the knots of the spline; the ends of strokes have radii from about 0.08 on
SPREAD = 0.8  # of the Gaussian, in halves of a line's width
TRIES = 5  # each with a steadier hand and a thinner pen, until the outline has its holes


def glyph(kind: str, name: str, rng: np.random.Generator) -> list[np.ndarray]:
    """The outline of a glyph: its closed curves, (m, 4, 2) control points each, with the ink on their left.

    Slant, proportions, width of the pen and the positions of the points vary with ``rng``.
    """
    count, strokes = GLYPHS[kind][name]
    pen = rng.uniform(0.1, 0.17)
    shear, turn = rng.normal(scale=0.15), rng.normal(scale=0.08)
    frame = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ [[1, shear], [0, 1]]
    frame = frame @ np.diag([rng.uniform(0.85, 1.25), 1.0])
    waves = rng.uniform(1.0, 2.5, size=(2, 2)), rng.uniform(0, 2 * np.pi, size=2), rng.normal(scale=0.05, size=2)
    shifts = [rng.normal(scale=0.035, size=(len(stroke.split()) - 1, 2)) for stroke in strokes]
    curves: list[np.ndarray] = []
    for hand in np.linspace(1, 0, TRIES):
        places = _places(strokes, [hand * shift for shift in shifts])
        drawn = [(p + hand * waves[2] * np.sin(p @ waves[0] + waves[1])) @ frame.T for p in places]
        curves = _outline(drawn, pen * (0.7 + 0.3 * hand))
        if len(curves) == count:
            break
    return curves


def _places(strokes: list[str], shifts: list[np.ndarray]) -> list[np.ndarray]:
    """Sample points (n, 2) along each stroke, whose points are moved by ``shifts``; shared ends stay together."""
    from scipy.interpolate import CubicSpline

    moved: dict[tuple[float, ...], np.ndarray] = {}
    places = []
    for stroke, shift in zip(strokes, shifts, strict=True):
        how, *words = stroke.split()
        points = [tuple(map(float, word.split(","))) for word in words]
        line = np.array([moved.setdefault(p, np.array(p) + s) for p, s in zip(points, shift, strict=True)])
        if how == "o":
            line = np.concatenate([line, line[:1]])
        knots = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        t = np.linspace(0, knots[-1], int(knots[-1] / INK) + 2)
        if how == "-":
            places.append(np.stack([np.interp(t, knots, x) for x in line.T], axis=1))
        else:
            places.append(CubicSpline(knots, line, bc_type="periodic" if how == "o" else "natural")(t))
    return places


def _outline(strokes: list[np.ndarray], pen: float) -> list[np.ndarray]:
    """The curves around the ink of strokes, given by points (n, 2) along each; ``pen`` is half the width of a line."""
    from skimage.measure import find_contours

    places = np.concatenate(strokes)
    gaps = [np.linalg.norm(np.diff(stroke, axis=0), axis=1) for stroke in strokes]
    weights = np.concatenate([(np.pad(g, (0, 1)) + np.pad(g, (1, 0))) / 2 for g in gaps])  # the trapezoidal rule
    ink = _Ink(places, weights, SPREAD * pen, pen)
    low, high = places.min(axis=0) - 3 * pen, places.max(axis=0) + 3 * pen
    x, y = (np.arange(a, b, GRID) for a, b in zip(low, high, strict=True))
    found = [low + GRID * line[:-1] for line in find_contours(ink.grid(x, y), 0.0)]
    curves = [spline(ink.nearest(_evenly(line, KNOTS))) for line in found if len(line) > 8]
    # The largest is the outline, the others are holes in it: glyphs have one piece.
    largest = max(range(len(curves)), key=lambda k: abs(area(curves[k])))
    return [c if (area(c) > 0) == (k == largest) else turned(c) for k, c in enumerate(curves)]


class _Ink:
    """The log density of the ink: ln of the sum of Gaussians at points (n, 2), divided by its value on the outline."""

    def __init__(self, places: np.ndarray, weights: np.ndarray, sigma: float, pen: float):
        self._places, self._weights, self._sigma = places, weights, sigma
        self._edge = np.sqrt(2 * np.pi) * sigma * np.exp(-((pen / sigma) ** 2) / 2)  # beside a straight line

    def grid(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """(len(x), len(y)) values; a Gaussian of two coordinates is a product."""
        along = [
            np.exp(-(((a[:, None] - p) / self._sigma) ** 2) / 2) for a, p in zip((x, y), self._places.T, strict=True)
        ]
        return np.log(np.maximum(along[0] * self._weights @ along[1].T, 1e-30) / self._edge)

    def nearest(self, points: np.ndarray) -> np.ndarray:
        """The points (k, 2) near the outline, moved onto it."""
        for _ in range(4):
            away = points[:, None] - self._places
            share = self._weights * np.exp(-((away / self._sigma) ** 2).sum(axis=2) / 2)
            total = share.sum(axis=1)
            slope = -np.einsum("kp,kpi->ki", share, away) / (self._sigma**2 * total[:, None])
            value = np.log(total / self._edge)
            points = points - (value / (slope**2).sum(axis=1))[:, None] * slope
        return points


def _evenly(line: np.ndarray, spacing: float) -> np.ndarray:
    """Points (n, 2) on a closed polyline at equal distances."""
    closed = np.concatenate([line, line[:1]])
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    t = np.arange(n := max(round(at[-1] / spacing), 8)) / n * at[-1]
    return np.stack([np.interp(t, at, x) for x in closed.T], axis=1)
