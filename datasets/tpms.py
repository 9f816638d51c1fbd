"""Triply periodic minimal surfaces in a ball: gyroid, Schwarz P and Schwarz D, as thin sheets and as solids."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sin, sqrt
from typing import Literal, NamedTuple

import numpy as np

from bench import Shape, generator, register

from .common.family import Family, spread
from .common.rotations import random_rotation
from .surfaces.blending import smooth_max
from .surfaces.implicit import Body, ImplicitSurface, box_of_ball

STEEPEST = sqrt(3)  # the largest |gradient| of all three functions, reached at their flat points
THICKNESS = (0.055, 0.095)  # of sheets where they are thinnest; the ball has the radius 1
LEVEL = 0.2  # largest |t| of solids
DEEPEST = {"gyroid": 1.5, "schwarz_p": 3.0, "schwarz_d": sqrt(2)}  # the largest |g|
FINENESS = {"gyroid": 0.0115, "schwarz_p": 0.0095, "schwarz_d": 0.0138}  # step of the grid per cell of the diameter
MIDDLE, FLAT = 0.0, pi / 2  # of each coordinate at the ball's centre


class Window(NamedTuple):
    """A range of sizes over which the genus does not change, for any drawn thickness or level."""

    centre: float
    fewest: float  # periods along the diameter
    most: float
    genus: int


WINDOWS = {
    ("gyroid", "sheet"): (
        Window(MIDDLE, 1.37, 1.43, 10),
        Window(MIDDLE, 1.82, 1.88, 26),
    ),
    ("schwarz_p", "solid"): (
        Window(FLAT, 1.52, 1.73, 3),
        Window(FLAT, 1.98, 2.12, 5),
        Window(FLAT, 2.42, 2.51, 11),
    ),
    ("schwarz_d", "sheet"): (
        Window(MIDDLE, 1.31, 1.35, 18),
        Window(MIDDLE, 1.47, 1.57, 30),
        Window(MIDDLE, 1.97, 2.0, 70),
    ),
    ("gyroid", "solid"): (
        Window(MIDDLE, 1.52, 1.58, 5),
        Window(MIDDLE, 1.96, 2.04, 13),
        Window(MIDDLE, 2.75, 2.76, 36),
    ),
    ("schwarz_p", "sheet"): (
        Window(MIDDLE, 1.35, 1.65, 5),
        Window(FLAT, 1.35, 1.57, 6),
        Window(MIDDLE, 1.9, 2.35, 17),
        Window(FLAT, 2.08, 2.24, 22),
        Window(FLAT, 2.57, 2.68, 40),
        Window(MIDDLE, 2.68, 2.78, 57),
    ),
    ("schwarz_d", "solid"): (Window(MIDDLE, 1.62, 1.73, 15), Window(MIDDLE, 2.11, 2.14, 35)),
}
SYMMETRY = {
    ("gyroid", "sheet", MIDDLE): "rotation 3 and inversion",
    ("gyroid", "solid", MIDDLE): "rotation 3",
    ("schwarz_p", "sheet", MIDDLE): "octahedral",
    ("schwarz_p", "sheet", FLAT): "rotation 3, mirrors and inversion",
    ("schwarz_p", "solid", FLAT): "rotation 3 and mirrors",
    ("schwarz_d", "sheet", MIDDLE): "rotation 3, mirrors and inversion",
    ("schwarz_d", "solid", MIDDLE): "rotation 3 and mirrors",
}


@register("dataset", requires=("scipy", "skimage", "trimesh"))
@dataclass(frozen=True)
class Tpms(Family):
    """Gyroid, Schwarz P and Schwarz D in a ball, as sheets and solids; exact samples, normals and closest points.

    A sheet is a thin layer around the minimal surface ``g = 0``, with a round rim at the ball; a solid is one of its
    two sides, ``g <= t``, with a blunt edge at the ball. Sizes are drawn from ranges over which the genus is known (3
    to 70), thickness or t at random, and shapes are rotated at random.
    """

    kind: Literal["all", "gyroid", "schwarz_p", "schwarz_d"] = "all"  # of minimal surface
    form: Literal["all", "sheet", "solid"] = "all"  # a sheet around it, or one of its sides

    def __post_init__(self) -> None:
        for name, known in (("kind", tuple(DEEPEST)), ("form", ("sheet", "solid"))):
            if getattr(self, name) not in ("all", *known):
                raise ValueError(f"{name}: expected one of all, {', '.join(known)}; got {getattr(self, name)!r}")

    def _shape(self, split: str, index: int) -> Shape:
        variants = [v for v in WINDOWS if self.kind in ("all", v[0]) and self.form in ("all", v[1])]
        kind, form = variants[index % len(variants)]
        windows = WINDOWS[kind, form]
        window = windows[int(len(windows) * spread(index))]
        rng = generator("tpms", split, index)
        cells, share, rotation = rng.uniform(window.fewest, window.most), rng.random(), random_rotation(rng)
        surface = ImplicitSurface(lambda: _body(kind, form, window.centre, cells, share, rotation))
        info = {"kind": kind, "form": form, "genus": window.genus, "cells": cells}
        if form == "sheet":
            thickness = _thickness(share)
            # The rim is half a thickness outside the ball, and reaches nearly to the sides of the box.
            info["thickness"] = thickness / (2 * sqrt(3) * (1 + thickness / 2))
        else:
            info["level"] = _level(share)
        info["symmetry"] = SYMMETRY[kind, form, window.centre]
        return Shape(
            f"tpms-{split}-{index:03d}-{kind}-{form}",
            lambda: surface.mesh,
            surface=surface,
            tags=(kind, form),
            info=info,
            exactness="implicit",
        )


def _thickness(share: float) -> float:
    return THICKNESS[0] + share * (THICKNESS[1] - THICKNESS[0])


def _level(share: float) -> float:
    return LEVEL * (2 * share - 1)


def _body(kind: str, form: str, centre: float, cells: float, share: float, rotation: np.ndarray) -> Body:
    thickness = _thickness(share) if form == "sheet" else None
    level = _level(share) if thickness is None else _sheet_level(kind, cells, thickness)
    field = ClippedLevel(kind, cells, centre, rotation, level, sheet=form == "sheet")
    return Body(field, *box_of_ball(1.1), max(0.018, FINENESS[kind] * cells))


def _sheet_level(kind: str, cells: float, thickness: float) -> float:
    """The w for which the sheet ``|g| <= w`` has the given thickness at the flat points, where it is thinnest.

    Along the diagonal of the coordinates through a flat point, g is a function of one coordinate s.
    """
    s = thickness / 2 * pi * cells / sqrt(3)
    return {"gyroid": 1.5 * sin(2 * s), "schwarz_p": 3 * sin(s), "schwarz_d": 3 * sin(s) - 2 * sin(s) ** 3}[kind]


class ClippedLevel:
    """``g <= t`` within the unit ball, with a smooth edge; or the sheet ``|g| <= t`` with a round rim.

    The coordinates of g are ``pi cells x + centre``, and g is divided by its steepest slope, so that like a signed
    distance the function is nowhere steeper than 1 (at the rim of a sheet, than the root of 2).
    """

    def __init__(self, kind: str, cells: float, centre: float, rotation: np.ndarray, level: float, *, sheet: bool):
        self.kind, self.centre, self.turn, self.sheet = kind, centre, rotation, sheet
        self.wave = pi * cells
        self.scale = 1 / (self.wave * STEEPEST)
        self.level = level * self.scale
        self.edge = 0.85 * (DEEPEST[kind] * self.scale + self.level)  # most of the depth of a solid

    def value(self, points: np.ndarray) -> np.ndarray:
        """``f`` at points (n, 3): an (n,) array."""
        return self.gradient(points)[0]

    def gradient(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``f`` and its gradient at points (n, 3): (n,) and (n, 3) arrays."""
        g, slope = periodic(self.kind, self.wave * np.einsum("ij,nj->ni", self.turn, points) + self.centre)
        g, slope = self.scale * g, np.einsum("ij,ni->nj", self.turn, slope) / STEEPEST
        radius = np.sqrt(np.einsum("ni,ni->n", points, points))
        outward = points / np.maximum(radius, 1e-300)[:, None]
        if not self.sheet:
            return smooth_max(g - self.level, slope, radius - 1, outward, self.edge)
        over = np.maximum(radius - 1, 0)
        distance = np.sqrt(g * g + over * over)
        gradient = (g[:, None] * slope + over[:, None] * outward) / np.maximum(distance, 1e-300)[:, None]
        return distance - self.level, gradient

    def range(self, centres: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
        """A lower and an upper bound of ``f`` in the balls about ``centres`` (n, 3): two (n,) arrays."""
        value = self.value(centres)
        change = radius * (sqrt(2) if self.sheet else 1)
        return value - change, value + change


def periodic(kind: str, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nodal approximation g of a minimal surface, of period 2 pi in each coordinate, and its gradient.

    Parameters
    ----------
    kind : "gyroid", "schwarz_p" or "schwarz_d"
    points : (n, 3) array

    Returns
    -------
    value : (n,) array
    gradient : (n, 3) array
    """
    (sx, sy, sz), (cx, cy, cz) = np.sin(points).T, np.cos(points).T
    if kind == "gyroid":
        value = sx * cy + sy * cz + sz * cx
        parts = cx * cy - sz * sx, cy * cz - sx * sy, cz * cx - sy * sz
    elif kind == "schwarz_p":
        value = cx + cy + cz
        parts = -sx, -sy, -sz
    else:
        value = sx * sy * sz + sx * cy * cz + cx * sy * cz + cx * cy * sz
        parts = (
            cx * sy * sz + cx * cy * cz - sx * sy * cz - sx * cy * sz,
            sx * cy * sz - sx * sy * cz + cx * cy * cz - cx * sy * sz,
            sx * sy * cz - sx * cy * sz - cx * sy * sz + cx * cy * cz,
        )
    return value, np.stack(parts, axis=1)
