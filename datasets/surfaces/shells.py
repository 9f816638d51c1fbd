"""Charts of walls of constant thickness: the offset of a surface, and the ends that close it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .jets import Jet, cos, cross, normalize, sin, unit_normal

Position = Callable[[Jet, Jet], Jet]


def offset(middle: Position, distance: float, pole: float | None = None) -> Position:
    """The surface at ``distance`` along ``x_u`` cross ``x_v``; it uses up one order of derivatives.

    If u = 0 is a pole where the surface is flat, ``pole`` is the smallest u at which the normal is evaluated.
    """

    def position(u: Jet, v: Jet) -> Jet:
        x = middle(u, v)
        beside = x if pole is None or (u.value >= pole).all() else middle(u + (np.maximum(u.value, pole) - u.value), v)
        return x + unit_normal(beside) * distance

    return position


def round_end(middle: Position, at: float, axis: int, outward: float, half: float) -> Position:
    """The half tube that closes the wall of half-thickness ``half`` about ``middle`` along a border.

    Parameters
    ----------
    at : float
        The parameter of the border.
    axis : int
        Which parameter is fixed there: 0 for u, 1 for v.
    outward : float
        1 where the surface ends at its highest parameter, -1 at the lowest.

    Returns
    -------
    function of (s, t)
        s in -pi/2..pi/2 runs from the lower side (against the normal) to the upper one, t along the border.
    """

    def position(s: Jet, t: Jet) -> Jet:
        fixed = _constant(t, at)
        jets = Jet.variables(fixed, t.value, t.order) if axis == 0 else Jet.variables(t.value, fixed, t.order)
        x = middle(*jets)
        normal = unit_normal(x)
        along = normalize(x.derivative(1 - axis)).truncate(normal.order)
        # Only the derivatives along the border are kept of the jets by (u, v), as functions of t.
        x, normal, along = (_along(j, 1 - axis) for j in (x.truncate(normal.order), normal, along))
        beyond = cross(along, normal) * (outward if axis == 0 else -outward)
        s = s.truncate(normal.order)
        return x + (beyond * cos(s) + normal * sin(s)) * half

    return position


def flat_end(middle: Position, at: float, axis: int, half: float) -> Position:
    """The strip that closes the wall along a border, straight across: s in -1..1, t along the border."""

    def position(s: Jet, t: Jet) -> Jet:
        fixed = _constant(t, at)
        jets = Jet.variables(fixed, t.value, t.order) if axis == 0 else Jet.variables(t.value, fixed, t.order)
        x = middle(*jets)
        normal = unit_normal(x)
        x, normal = (_along(j, 1 - axis) for j in (x.truncate(normal.order), normal))
        return x + normal * (s.truncate(normal.order) * half)

    return position


def _constant(t: Jet, value: float) -> np.ndarray:
    return np.full_like(t.value, value)


def _along(jet: Jet, axis: int) -> Jet:
    """A function of (u, v) on a line of constant u (axis 1) or v (axis 0), as a function of the second parameter."""
    c = np.zeros_like(jet.c)
    for order in range(jet.order + 1):
        first = order * (order + 1) // 2  # the terms of a degree run from du^order to dv^order
        c[first + order] = jet.c[first + (order if axis == 1 else 0)]
    return Jet(c)
