"""Chairs, tables and shelves as lists of bars: within a category the list is the same, only the measures change."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

ACROSS, ALONG = 4, 14  # subdivisions of a bar


class Bar(NamedTuple):
    """A straight piece from ``a`` to ``b`` with a cross-section that may shrink and may be round."""

    name: str
    a: np.ndarray
    b: np.ndarray
    start: tuple[float, float]  # half width and half depth at a
    end: tuple[float, float]  # at b
    roundness: float = 0.0  # 0: rectangle, 1: ellipse

    def vertices(self) -> np.ndarray:
        """(v, 3) array in the order of :func:`bar_grid`."""
        grid, _ = bar_grid()
        x, y, t = 2 * grid[:, 0] - 1, 2 * grid[:, 1] - 1, grid[:, 2]
        square = np.column_stack([x, y])
        disc = square * np.sqrt(1 - square[:, ::-1] ** 2 / 2)  # the square, mapped to the unit disc
        section = (1 - self.roundness) * square + self.roundness * disc
        section = section * (np.array(self.start) * (1 - t[:, None]) + np.array(self.end) * t[:, None])
        axis = self.b - self.a
        along = axis / np.linalg.norm(axis)
        # Width runs along x where the bar does not.
        hint = np.array([1.0, 0, 0]) if abs(along[0]) < 0.9 else np.array([0, 1.0, 0])
        width = hint - (hint @ along) * along
        width /= np.linalg.norm(width)
        depth = np.cross(along, width)
        return self.a + t[:, None] * axis + section[:, :1] * width + section[:, 1:] * depth


@cache
def bar_grid() -> tuple[np.ndarray, np.ndarray]:
    """The surface of the unit cube as a grid: vertices (v, 3) and faces (f, 3), outward."""
    counts = (ACROSS, ACROSS, ALONG)
    numbers = np.arange((ACROSS + 1) ** 2 * (ALONG + 1)).reshape([n + 1 for n in counts])
    quads = []
    for axis in range(3):
        for last in (False, True):
            sheet = np.moveaxis(numbers, axis, 0)[-1 if last else 0]
            if (axis == 1) != last:  # then the other two axes, in order, turn the wrong way
                sheet = sheet.T
            corners = (sheet[:-1, :-1], sheet[:-1, 1:], sheet[1:, 1:], sheet[1:, :-1])
            quads.append(np.column_stack([c.ravel() for c in corners]))
    quads = np.concatenate(quads)
    used, quads = np.unique(quads, return_inverse=True)
    quads = quads.reshape(-1, 4)
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, n + 1) for n in counts], indexing="ij"), axis=-1).reshape(-1, 3)
    return grid[used], np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


class Piece(NamedTuple):
    """One piece of furniture: its bars, the genus of their union, its landmarks and its measures."""

    bars: list[Bar]
    genus: int
    landmarks: dict[str, tuple[int, tuple[int, int, int]]]  # name: (bar, corner of its grid, 0 or 1 each)
    measures: dict[str, float]


def _p(*xyz: float) -> np.ndarray:
    return np.array(xyz, dtype=np.float64)


def _legs(m: dict[str, float], x: float, y: float, top: float) -> list[Bar]:
    """Four legs, from the floor up into the plate; they spread towards the floor and may taper."""
    bars, thick, foot = [], m["leg"] / 2, m["leg"] / 2 * m["taper"]
    for name, sx, sy in (("front left", 1, -1), ("front right", -1, -1), ("back left", 1, 1), ("back right", -1, 1)):
        spread = m["splay"] * top
        floor = _p(sx * (x + spread), sy * (y + spread), 0)
        bars.append(Bar(f"{name} leg", floor, _p(sx * x, sy * y, top), (foot,) * 2, (thick,) * 2, m["roundness"]))
    return bars


def _on(leg: Bar, z: float) -> np.ndarray:
    """The centre of a leg at height z."""
    return leg.a + (leg.b - leg.a) * (z - leg.a[2]) / (leg.b[2] - leg.a[2])


def _stretchers(m: dict[str, float], legs: list[Bar], z: float) -> list[Bar]:
    """An H between the legs."""
    half = 0.3 * m["leg"] * min(1.0, m["taper"])
    sides = [Bar(f"{side} stretcher", _on(legs[k], z), _on(legs[k + 2], z), (half,) * 2, (half,) * 2, m["roundness"])
             for side, k in (("left", 0), ("right", 1))]  # fmt: skip
    left, right = ((side.a + side.b) / 2 for side in sides)
    return [*sides, Bar("cross stretcher", left, right, (0.7 * half,) * 2, (0.7 * half,) * 2, m["roundness"])]


def chair(rng: np.random.Generator, full: bool) -> Piece:
    """A chair with a slatted back; armrests and stretchers are optional unless ``full``."""
    m = {"width": rng.uniform(0.42, 0.58), "depth": rng.uniform(0.4, 0.54), "height": rng.uniform(0.4, 0.5),
         "plate": rng.uniform(0.025, 0.06), "leg": rng.uniform(0.032, 0.055), "taper": rng.uniform(0.5, 1.0),
         "splay": rng.uniform(0.0, 0.12), "roundness": float(rng.choice([0.0, 0.0, 0.6, 1.0])),
         "back": rng.uniform(0.35, 0.62), "tilt": rng.uniform(0.08, 0.28), "slats": int(rng.integers(2, 6)),
         "arms": int(rng.random() < 0.5), "stretchers": int(rng.random() < 0.6), "arm_height": rng.uniform(0.18, 0.24),
         "rail": rng.uniform(0.04, 0.09)}  # fmt: skip
    if full:
        m |= {"slats": 5, "arms": 1, "stretchers": 1}
    w, d, h, t = m["width"] / 2, m["depth"] / 2, m["height"], m["plate"]
    seat = Bar("seat", _p(0, 0, h), _p(0, 0, h + t), (w, d), (w, d), 0.35 * m["roundness"])
    legs = _legs(m, 0.78 * w, 0.78 * d, h + 0.4 * t)
    post = 0.4 * m["leg"]
    px, py, z0, z1 = 0.76 * w, 0.74 * d, h + 0.6 * t, h + m["back"]

    def back(x: float, z: float) -> np.ndarray:
        return _p(x, py + m["tilt"] * (z - z0), z)

    posts = [Bar(f"{side} post", back(s * px, z0), back(s * px, z1), (post,) * 2, (0.8 * post,) * 2, m["roundness"])
             for side, s in (("left", 1), ("right", -1))]  # fmt: skip
    low, high = h + t + 0.1 * m["back"], z1 - 0.6 * m["rail"]
    broad, narrow = (0.55 * post, m["rail"] / 2), (0.55 * post, 0.016)
    rails = [
        Bar("top rail", back(-px, high), back(px, high), broad, broad),
        Bar("low rail", back(-px, low), back(px, low), narrow, narrow),
    ]
    slats, number = [], int(m["slats"])
    for i in range(number):
        x = px * (2 * (i + 1) / (number + 1) - 1)
        wide = min(0.026, 0.5 * px / (number + 1))
        slats.append(Bar(f"slat {i + 1}", back(x, low), back(x, high), (wide, 0.3 * post), (wide, 0.3 * post)))
    arms = []
    if m["arms"]:
        z, front = h + t + m["arm_height"], -0.6 * d
        for side, s in (("left", 1), ("right", -1)):
            flat = (0.022, 0.012)
            arms.append(Bar(f"{side} armrest", back(s * px, z), _p(s * px, front - 0.05, z), flat, flat))
            thin = (0.013, 0.013)
            arms.append(
                Bar(
                    f"{side} arm support",
                    _p(s * px, front, h + 0.6 * t),
                    _p(s * px, front, z),
                    thin,
                    thin,
                    m["roundness"],
                )
            )
    stretchers = _stretchers(m, legs, 0.42 * h) if m["stretchers"] else []
    bars = [seat, *legs, *posts, *rails, *slats, *arms, *stretchers]
    genus = 2 + number + 2 * int(m["arms"]) + 3 * int(m["stretchers"])
    marks = {"seat front left": (0, (1, 0, 1)), "seat front right": (0, (0, 0, 1)), "seat back left": (0, (1, 1, 1)),
             "seat back right": (0, (0, 1, 1)), "back left": (5, (1, 1, 1)), "back right": (6, (0, 1, 1))}  # fmt: skip
    return Piece(bars, genus, marks | _feet(1), m)


def table(rng: np.random.Generator, full: bool) -> Piece:
    """A table, square-cornered to round, with aprons under the top."""
    m = {"width": rng.uniform(0.8, 1.8), "depth": rng.uniform(0.6, 0.95), "height": rng.uniform(0.45, 0.78),
         "plate": rng.uniform(0.022, 0.05), "leg": rng.uniform(0.045, 0.085), "taper": rng.uniform(0.45, 1.0),
         "splay": rng.uniform(0.0, 0.14), "roundness": float(rng.choice([0.0, 0.0, 0.6, 1.0])),
         "top_roundness": float(rng.choice([0.0, 0.25, 0.9])), "apron": rng.uniform(0.05, 0.1),
         "inset": rng.uniform(0.55, 0.72), "stretchers": int(rng.random() < 0.4 or full),
         "stretcher_height": rng.uniform(0.15, 0.4)}  # fmt: skip
    w, d, h, t = m["width"] / 2, m["depth"] / 2, m["height"], m["plate"]
    top = Bar("top", _p(0, 0, h), _p(0, 0, h + t), (w, d), (w, d), m["top_roundness"])
    legs = _legs(m, m["inset"] * w, m["inset"] * d, h + 0.4 * t)
    aprons = []
    for name, i, j in (("front", 1, 0), ("back", 3, 2), ("left", 0, 2), ("right", 1, 3)):
        z = h + 0.3 * t - m["apron"] / 2
        ends = np.array([legs[k].b * (1, 1, 0) + (0, 0, z) for k in (i, j)])
        # A little beyond the middle of the legs, so that the ends of two aprons have no common points.
        ends += 0.15 * m["leg"] * np.sign(ends - ends.mean(axis=0)) * (abs(ends[1] - ends[0]) > 1e-9)
        half = (
            (0.2 * m["leg"], m["apron"] / 2)
            if i != j and name in ("front", "back")
            else (m["apron"] / 2, 0.2 * m["leg"])
        )
        half = (0.2 * m["leg"], m["apron"] / 2)
        aprons.append(Bar(f"{name} apron", ends[0], ends[1], half, half))
    stretchers = _stretchers(m, legs, m["stretcher_height"] * h) if m["stretchers"] else []
    marks = {"top front left": (0, (1, 0, 1)), "top front right": (0, (0, 0, 1)), "top back left": (0, (1, 1, 1)),
             "top back right": (0, (0, 1, 1))}  # fmt: skip
    return Piece([top, *legs, *aprons, *stretchers], 3 * int(m["stretchers"]), marks | _feet(1), m)


def shelf(rng: np.random.Generator, full: bool) -> Piece:
    """Shelves between two sides, with dividers, and with or without a back."""
    m = {"width": rng.uniform(0.6, 1.2), "depth": rng.uniform(0.26, 0.42), "height": rng.uniform(0.9, 1.9),
         "side": rng.uniform(0.018, 0.04), "board": rng.uniform(0.016, 0.035), "boards": int(rng.integers(3, 7)),
         "back": int(rng.random() < 0.5 or full), "panel": rng.uniform(0.008, 0.014), "leg": rng.uniform(0.03, 0.055),
         "taper": rng.uniform(0.5, 1.0), "splay": 0.0, "roundness": float(rng.choice([0.0, 1.0])),
         "feet": rng.uniform(0.06, 0.16), "dividers": int(rng.integers(0, 3)),
         "skew": rng.uniform(0.3, 0.7)}  # fmt: skip
    if full:
        m |= {"boards": 5, "dividers": 2}
    w, d, h, f = m["width"] / 2, m["depth"] / 2, m["height"], m["feet"]
    s, t = m["side"] / 2, m["board"] / 2
    levels, walls = int(m["boards"]), int(m["dividers"])
    sides = [
        Bar(f"{side} side", _p(k * w, 0, f), _p(k * w, 0, h), (s, d), (s, d))
        for side, k in (("left", 1), ("right", -1))
    ]
    heights = np.linspace(f + 0.03, h - 0.03, levels)
    boards = [
        Bar(f"board {i + 1}", _p(0, 0.004, z - t), _p(0, 0.004, z + t), (w, d - 0.008), (w, d - 0.008))
        for i, z in enumerate(heights)
    ]
    dividers = []
    for i in range(walls):
        x = w * (2 * m["skew"] - 1) * (-1) ** i
        k = i * (levels - 2)  # in the lowest compartment, and in the highest
        dividers.append(
            Bar(
                f"divider {i + 1}",
                _p(x, 0.004, heights[k]),
                _p(x, 0.004, heights[k + 1]),
                (0.8 * t, d - 0.02),
                (0.8 * t, d - 0.02),
            )
        )
    panel = []
    if m["back"]:
        p = m["panel"] / 2
        panel = [Bar("back panel", _p(0, d - 0.02, heights[0]), _p(0, d - 0.02, heights[-1]), (w, p), (w, p))]
    feet = [leg._replace(name=leg.name.replace("leg", "foot")) for leg in _legs(m, 0.8 * w, 0.6 * d, f + 0.03)]
    marks = {"top left": (0, (1, 0, 1)), "top right": (1, (0, 0, 1)), "top back left": (0, (1, 1, 1)),
             "top back right": (1, (0, 1, 1))}  # fmt: skip
    bars = [*sides, *boards, *feet, *dividers, *panel]
    genus = 0 if m["back"] else levels - 1 + walls
    return Piece(bars, genus, marks | _feet(2 + levels), m)


def _feet(first: int) -> dict[str, tuple[int, tuple[int, int, int]]]:
    """The outer corners of four legs on the floor."""
    names = ("front left", "front right", "back left", "back right")
    corners = ((1, 0, 0), (0, 0, 0), (1, 1, 0), (0, 1, 0))
    return {f"{n} foot": (first + k, c) for k, (n, c) in enumerate(zip(names, corners, strict=True))}


CATEGORIES = {make.__name__: make for make in (chair, table, shelf)}
