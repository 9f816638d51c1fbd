"""Closed plane curves of cubic Bezier pieces: exact samples by arc length, exact closest points, thin ribbons."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from trimesh import Trimesh

TURN = 0.5  # radians by which the control polygon of an arc turns at most; closest points search arc by arc
SHARE = 1 / 40  # of the length of all curves that an arc has at most
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)  # of an arc's length: exact to about 1e-13
STEPS = 12  # most steps of Newton's method: near a centre of curvature each gains a third of the remaining distance
STARTS = np.linspace(0, 1, 5)  # parameters on an arc; the search for the foot point starts at the nearest one
PAIRS = 2_000_000  # of points and arcs that are evaluated together
WANDER = 0.15  # largest shift of an even sample in mean gaps: gaps are 0.7 to 1.3 of the mean


class _Arcs(NamedTuple):
    """The curves divided into short arcs."""

    curve: np.ndarray  # (s,) index of the curve of each arc
    points: np.ndarray  # (s, 4, 2) control points
    lengths: np.ndarray  # (s,)
    ends: np.ndarray  # (s,) lengths from the beginning of the first curve
    centres: np.ndarray  # (s, 2) of the balls around the control points: an arc lies in their convex hull
    radii: np.ndarray  # (s,)


class PlaneCurves:
    """Closed curves in the plane z = 0, as a :class:`bench.Surface` of one dimension less.

    Samples are uniform by arc length, normals lie in the plane and point outwards. Such a surface has no area that
    defines the spacing of evenly spread points, so it has :meth:`sample_evenly`, which
    :func:`bench.geometry.poisson_disk.sample_poisson_disk` calls.

    Parameters
    ----------
    make : function without arguments, called once
        The control points of the pieces of each closed curve, a sequence of (m, 4, 2) arrays. A piece begins where the
        previous one ends, the first where the last ends. The inside is on the left: outlines are counter-clockwise,
        holes clockwise. Where the tangents of neighbouring pieces differ there is a corner.
    """

    def __init__(self, make: Callable[[], Sequence[np.ndarray]]):
        self._make = make

    @cached_property
    def curves(self) -> list[np.ndarray]:
        """The control points of each curve, (m, 4, 2)."""
        return [np.asarray(curve, dtype=np.float64) for curve in self._make()]

    @cached_property
    def _arcs(self) -> _Arcs:
        rough = sum(np.linalg.norm(np.diff(curve, axis=1), axis=2).sum() for curve in self.curves)
        arcs = [_split(curve, SHARE * rough) for curve in self.curves]
        points = np.concatenate(arcs)
        lengths, centres = _length(points, np.ones(len(points))), points.mean(axis=1)
        return _Arcs(
            curve=np.repeat(np.arange(len(arcs)), [len(a) for a in arcs]),
            points=points,
            lengths=lengths,
            ends=np.cumsum(lengths),
            centres=centres,
            radii=np.linalg.norm(points - centres[:, None], axis=2).max(axis=1),
        )

    @property
    def lengths(self) -> np.ndarray:
        """(curves,) the length of each curve."""
        return np.bincount(self._arcs.curve, weights=self._arcs.lengths)

    # -- bench.Surface ---------------------------------------------------------------------------------------------

    def sample(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """``count`` points, uniform by arc length, and their unit normals in the plane: two (count, 3) arrays."""
        return self.at(rng.random(count) * self._arcs.ends[-1])

    def sample_evenly(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """``count`` points at even distances along the curves, and their unit normals: two (count, 3) arrays.

        Each curve gets its share of the points by its length and a random start, and each point shifts by up to 0.15 of
        the gap. So gaps along a curve are 0.7 to 1.3 of their mean, as with the densest packing of Poisson disks.
        """
        lengths = self.lengths
        begins = np.cumsum(lengths) - lengths
        places = []
        for n, length, begin in zip(_shares(lengths, count), lengths, begins, strict=True):
            order = np.arange(n) + rng.random() + rng.uniform(-WANDER, WANDER, n)
            places.append(begin + order / max(n, 1) % 1 * length)
        return self.at(np.concatenate(places))

    def closest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The closest point of the curves to each of ``points`` (n, 3), and the unit normal there: two (n, 3) arrays.

        Arcs whose balls around the control points are farther than the nearest known point are skipped; on the others
        Newton's method finds the foot point. In a corner the normal is that of one of its sides.
        """
        flat = np.asarray(points, dtype=np.float64)[:, :2]
        arc, t = np.zeros(len(flat), dtype=np.int64), np.zeros(len(flat))
        rows = max(PAIRS // len(self._arcs.points), 1)
        for first in range(0, len(flat), rows):
            part = slice(first, first + rows)
            arc[part], t[part] = self._feet(flat[part])
        return self._points(arc, t)

    def at(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points and unit normals (n, 3) at lengths (n,) along all curves, one after the other."""
        points, lengths, ends = self._arcs.points, self._arcs.lengths, self._arcs.ends
        arc = np.minimum(np.searchsorted(ends, places, side="right"), len(ends) - 1)
        wanted = places - (ends - lengths)[arc]
        t = np.clip(wanted / lengths[arc], 0, 1)
        for _ in range(STEPS):
            step = (_length(points[arc], t) - wanted) / np.linalg.norm(_derivative(points[arc], t), axis=1)
            t = np.clip(t - step, 0, 1)
            if np.abs(step).max(initial=0.0) < 1e-12:
                break
        return self._points(arc, t)

    def _points(self, arc: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points and normals (n, 3) at parameters ``t`` of arcs."""
        flat, tangent = _point(self._arcs.points[arc], t), _derivative(self._arcs.points[arc], t)
        tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
        zero = np.zeros(len(t))
        return np.column_stack([flat, zero]), np.column_stack([tangent[:, 1], -tangent[:, 0], zero])

    def _feet(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The arc, and the parameter on it, of the closest point to each of ``points`` (n, 2)."""
        away = np.linalg.norm(points[:, None] - self._arcs.centres, axis=2)
        known = np.linalg.norm(points[:, None] - self._arcs.points[:, 0], axis=2).min(axis=1)
        point, arc = np.nonzero(away - self._arcs.radii <= known[:, None] * (1 + 1e-12))
        t, distance = _foot(self._arcs.points[arc], points[point])
        order = np.lexsort((distance, point))
        best = order[np.unique(point[order], return_index=True)[1]]
        return arc[best], t[best]

    # -- the mesh --------------------------------------------------------------------------------------------------

    def ribbon(self, height: float, tolerance: float, longest: float) -> Trimesh:
        """A ribbon perpendicular to the plane: the curves from z = -height / 2 to height / 2, with outward faces.

        Parameters
        ----------
        height : float
        tolerance : float
            The largest distance of an edge from the curve; its ends lie on the curve.
        longest : float
            The longest edge.
        """
        from trimesh import Trimesh

        vertices, faces, begin = [], [], 0
        for number in range(len(self.curves)):
            line = self._polyline(self._arcs.points[self._arcs.curve == number], tolerance, longest)
            n = len(line)
            z = np.full((n, 1), height / 2)
            vertices += [np.hstack([line, -z]), np.hstack([line, z])]
            low = begin + np.arange(n)
            low_next, high, high_next = begin + (np.arange(n) + 1) % n, low + n, begin + n + (np.arange(n) + 1) % n
            faces += [np.stack([low, low_next, high_next], axis=1), np.stack([low, high_next, high], axis=1)]
            begin += 2 * n
        return Trimesh(np.concatenate(vertices), np.concatenate(faces), process=False)

    @staticmethod
    def _polyline(arcs: np.ndarray, tolerance: float, longest: float) -> np.ndarray:
        """(n, 2) points on a curve, with chords near it."""
        t = np.tile(STARTS, (len(arcs), 1))
        d, dd = ((f(arcs[:, None], t)) for f in (_derivative, _second))
        speed = np.linalg.norm(d, axis=2)
        bend = np.abs(d[..., 0] * dd[..., 1] - d[..., 1] * dd[..., 0]) / speed**3
        chord = np.minimum(longest, np.sqrt(8 * tolerance / np.maximum(bend.max(axis=1), 1e-12)))
        steps = np.ceil(speed.max(axis=1) / chord).astype(int)
        which = np.repeat(np.arange(len(arcs)), steps)
        within = np.arange(len(which)) - np.repeat(np.cumsum(steps) - steps, steps)
        return _point(arcs[which], within / steps[which])


# -- cubic Bezier curves: control points (..., 4, 2) at parameters (...) -----------------------------------------------


def _point(arcs: np.ndarray, t: np.ndarray) -> np.ndarray:
    s, t = 1 - t[..., None], t[..., None]
    a, b, c, d = np.moveaxis(arcs, -2, 0)
    return s**3 * a + 3 * s**2 * t * b + 3 * s * t**2 * c + t**3 * d


def _derivative(arcs: np.ndarray, t: np.ndarray) -> np.ndarray:
    s, t = 1 - t[..., None], t[..., None]
    a, b, c = np.moveaxis(3 * np.diff(arcs, axis=-2), -2, 0)
    return s**2 * a + 2 * s * t * b + t**2 * c


def _second(arcs: np.ndarray, t: np.ndarray) -> np.ndarray:
    a, b = np.moveaxis(6 * np.diff(arcs, n=2, axis=-2), -2, 0)
    return (1 - t[..., None]) * a + t[..., None] * b


def _length(arcs: np.ndarray, t: np.ndarray) -> np.ndarray:
    """(n,) lengths of arcs (n, 4, 2) from 0 to ``t`` (n,)."""
    at = t[:, None] * (NODES + 1) / 2
    return np.linalg.norm(_derivative(arcs[:, None], at), axis=2) @ WEIGHTS * t / 2


def _split(pieces: np.ndarray, longest: float) -> np.ndarray:
    """The pieces (m, 4, 2) cut in halves until each turns little and is short; in their order."""
    place = np.arange(len(pieces), dtype=np.float64)
    width = np.ones(len(pieces))
    while True:
        sides = np.diff(pieces, axis=1)
        angles = np.arctan2(sides[..., 1], sides[..., 0])
        turn = np.abs((np.diff(angles, axis=1) + np.pi) % (2 * np.pi) - np.pi).sum(axis=1)
        cut = (turn > TURN) | (np.linalg.norm(sides, axis=2).sum(axis=1) > longest)
        if not cut.any():
            return pieces
        a, b, c, d = np.moveaxis(pieces[cut], 1, 0)
        ab, bc, cd = (a + b) / 2, (b + c) / 2, (c + d) / 2  # de Casteljau
        abc, bcd = (ab + bc) / 2, (bc + cd) / 2
        middle = (abc + bcd) / 2
        halves = np.concatenate([np.stack([a, ab, abc, middle], axis=1), np.stack([middle, bcd, cd, d], axis=1)])
        half = width[cut] / 2
        pieces = np.concatenate([pieces[~cut], halves])
        place = np.concatenate([place[~cut], place[cut], place[cut] + half])
        width = np.concatenate([width[~cut], half, half])
        order = np.argsort(place)
        pieces, place, width = pieces[order], place[order], width[order]


def _foot(arcs: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The parameter (n,) of the closest point of each arc (n, 4, 2) to its point (n, 2), and the distance (n,)."""
    tried = np.linalg.norm(_point(arcs[:, None], np.tile(STARTS, (len(arcs), 1))) - points[:, None], axis=2)
    start = STARTS[tried.argmin(axis=1)]
    low, high = np.clip(start - STARTS[1], 0, 1), np.clip(start + STARTS[1], 0, 1)
    t, best, least = start, start, tried.min(axis=1)
    for _ in range(STEPS):
        away, d = _point(arcs, t) - points, _derivative(arcs, t)
        slope, square = np.einsum("ni,ni->n", away, d), np.einsum("ni,ni->n", d, d)
        bend = square + np.einsum("ni,ni->n", away, _second(arcs, t))
        low, high = np.where(slope < 0, t, low), np.where(slope < 0, high, t)
        # At the centre of curvature Newton's step is unbounded, and beyond it leads to a maximum: then halve instead.
        ahead = t - slope / np.where(bend > 0, bend, square)
        t = np.where((bend > 0) & (ahead >= low) & (ahead <= high), ahead, (low + high) / 2)
        distance = np.linalg.norm(_point(arcs, t) - points, axis=1)
        nearer = distance < least
        best, least = np.where(nearer, t, best), np.where(nearer, distance, least)
    return best, least


def _shares(lengths: np.ndarray, count: int) -> np.ndarray:
    """Integer shares of ``count`` in proportion to lengths: the largest remainders get one more."""
    exact = count * lengths / lengths.sum()
    shares = np.floor(exact).astype(int)
    shares[np.argsort(shares - exact, kind="stable")[: count - shares.sum()]] += 1
    return shares
