"""Tubes of constant radius around closed curves: exact meshes, samples and closest points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil, pi
from typing import TYPE_CHECKING

import numpy as np

from .tangents import dot, tangents

if TYPE_CHECKING:
    from scipy.spatial import cKDTree
    from trimesh import Trimesh

SAMPLES = 2048  # of a curve: dense enough that the nearest one lies in the basin of the nearest point


@dataclass(frozen=True, eq=False)
class FourierCurve:
    """The closed curve ``c(s) = sum over k of a_k cos(k s) + b_k sin(k s)``, for s from 0 to 2 pi.

    Circles, ellipses, torus knots and many other knots are short sums of this kind.
    """

    frequencies: np.ndarray  # (k,) integers
    cosine: np.ndarray  # (k, 3)
    sine: np.ndarray  # (k, 3)

    def at(self, s: np.ndarray, order: int = 0) -> list[np.ndarray]:
        """``c`` and its derivatives up to ``order`` at s (n,): a list of (n, 3) arrays."""
        phase = self.frequencies * np.asarray(s)[:, None]
        c, d = np.cos(phase), np.sin(phase)
        results = []
        for _ in range(order + 1):
            results.append(np.einsum("nk,ki->ni", c, self.cosine) + np.einsum("nk,ki->ni", d, self.sine))
            c, d = -self.frequencies * d, self.frequencies * c
        return results

    def moved(self, rotation: np.ndarray, shift: np.ndarray) -> FourierCurve:
        """This curve turned by ``rotation`` (3, 3), then shifted."""
        cosine, sine = (np.einsum("ij,kj->ki", rotation, part) for part in (self.cosine, self.sine))
        frequencies = np.append(self.frequencies, 0)
        return FourierCurve(frequencies, np.vstack([cosine, shift]), np.vstack([sine, np.zeros(3)]))

    @cached_property
    def _samples(self) -> tuple[np.ndarray, np.ndarray]:
        s = np.arange(SAMPLES) * (2 * pi / SAMPLES)
        return s, self.at(s)[0]

    @cached_property
    def _tree(self) -> cKDTree:
        from scipy.spatial import cKDTree

        return cKDTree(self._samples[1])

    @cached_property
    def length(self) -> float:
        """The length; the trapezoidal rule is exact to rounding for a smooth closed curve."""
        speed = np.linalg.norm(self.at(self._samples[0], 1)[1], axis=1)
        return float(speed.mean() * 2 * pi)

    @cached_property
    def curvature(self) -> float:
        """The largest curvature at the samples."""
        _, first, second = self.at(self._samples[0], 2)
        speed = np.linalg.norm(first, axis=1)
        return float((np.linalg.norm(np.cross(first, second), axis=1) / speed**3).max())

    @cached_property
    def _is_circle(self) -> bool:
        """Whether this is a circle, perhaps shifted: then the nearest point has a closed form."""
        a, b = self.cosine[0], self.sine[0]
        plain = self.frequencies[0] == 1 and not self.frequencies[1:].any()
        return bool(plain and abs(a @ b) < 1e-14 * (a @ a) and abs(a @ a - b @ b) < 1e-14 * (a @ a))

    def foot(self, points: np.ndarray) -> np.ndarray:
        """The parameter s of the nearest point of the curve for each of ``points`` (n, 3).

        In closed form for a circle, otherwise by Newton's method from the nearest of 2,048 samples; a step that comes
        no nearer is shortened.
        """
        if self._is_circle:
            away = points - self.cosine[1:].sum(axis=0)
            return np.arctan2(away @ self.sine[0], away @ self.cosine[0])
        s = self._samples[0][self._tree.query(points)[1]]
        active, damping = np.arange(len(points)), np.ones(len(points))
        for _ in range(40):
            p, now = points[active], s[active]
            c, first, second = self.at(now, 2)
            away = c - p
            slope, bend = dot(away, first), dot(first, first) + dot(away, second)
            step = -slope / np.where(bend > 1e-3 * dot(first, first), bend, dot(first, first))
            longest = 8 * pi / SAMPLES
            trial = now + damping[active] * np.clip(step, -longest, longest)
            moved = self.at(trial)[0] - p
            # Rounding must not stop a nearly converged point.
            better = dot(moved, moved) <= dot(away, away) * (1 + np.where(np.abs(step) < 1e-5, 1e-13, 0))
            s[active[better]] = trial[better]
            damping[active] = np.where(better, 1.0, damping[active] / 4)
            active = active[(np.abs(step) > 1e-11) & (damping[active] > 1e-9)]
            if not len(active):
                break
        return s


def nearest_approach(curves: Sequence[FourierCurve], *, samples: int = 200) -> float:
    """The least distance between two parts of ``curves``: of different ones, or far apart along the same one.

    Parts of one curve count where the distance is stationary in both (a doubly critical pair): a local minimum of the
    distance over pairs of ``samples`` parameters, then refined by Newton's method.
    """
    s = np.arange(samples) * (2 * pi / samples)
    points = [curve.at(s)[0] for curve in curves]
    least = np.inf
    for i, one in enumerate(curves):
        for j in range(i, len(curves)):
            square = ((points[i][:, None] - points[j][None]) ** 2).sum(axis=-1)
            around = [np.roll(square, (a, b), (0, 1)) for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b]
            lowest = np.logical_and.reduce([square <= other for other in around])
            if i == j:
                apart = np.abs(np.arange(samples)[:, None] - np.arange(samples)[None])
                lowest &= np.minimum(apart, samples - apart) > samples // 60
            for a, b in np.argwhere(lowest):
                least = min(least, _refined_distance(one, curves[j], s[a], s[b]))
    return least


def _refined_distance(one: FourierCurve, other: FourierCurve, a: float, b: float) -> float:
    """The distance of two curves near the parameters a and b, by Newton's method in both."""
    best = np.inf
    for _ in range(6):
        (c, c1, c2), (d, d1, d2) = (
            [row[0] for row in curve.at(np.array([t]), 2)] for curve, t in ((one, a), (other, b))
        )
        away = c - d
        best = min(best, float(np.sqrt((away**2).sum())))
        hessian = np.array([[c1 @ c1 + away @ c2, -(c1 @ d1)], [-(c1 @ d1), d1 @ d1 - away @ d2]])
        determinant = hessian[0, 0] * hessian[1, 1] - hessian[0, 1] ** 2
        if determinant <= 0 or hessian[0, 0] <= 0:
            break
        g, h = away @ c1, -(away @ d1)
        a -= (hessian[1, 1] * g - hessian[0, 1] * h) / determinant
        b -= (hessian[0, 0] * h - hessian[0, 1] * g) / determinant
    return best


class TubeSurface:
    """All points at the distance ``radius`` from closed curves; a :class:`bench.Surface`.

    The radius must stay below the reach: below half the nearest approach and the least radius of curvature. Then the
    surface is one smooth torus per curve, and the distance to it is ``| |p - c| - radius |`` for the nearest point c of
    all curves.

    Parameters
    ----------
    make : function without arguments that returns the curves and the radius
    edge : float
        Length of the mesh's edges in radii, along the curve and around it.
    """

    def __init__(self, make: Callable[[], tuple[Sequence[FourierCurve], float]], *, edge: float = 0.12):
        self._make, self._edge = make, edge

    @cached_property
    def _made(self) -> tuple[Sequence[FourierCurve], float]:
        return self._make()

    @property
    def curves(self) -> Sequence[FourierCurve]:
        """The curves."""
        return self._made[0]

    @property
    def radius(self) -> float:
        """The radius of the tubes."""
        return self._made[1]

    @cached_property
    def mesh(self) -> Trimesh:
        """A tessellation with exact vertices: rings across the curves, without twist."""
        from trimesh import Trimesh

        vertices, faces, first = [], [], 0
        for curve in self.curves:
            v, f = self._tessellate(curve)
            vertices.append(v)
            faces.append(f + first)
            first += len(v)
        return Trimesh(np.vstack(vertices), np.vstack(faces), process=False)

    def _tessellate(self, curve: FourierCurve) -> tuple[np.ndarray, np.ndarray]:
        rings = max(24, ceil(curve.length / (self._edge * self.radius)))
        around = max(12, ceil(2 * pi / self._edge))
        s = _equal_arcs(curve, rings)
        centre, tangent = curve.at(s, 1)
        tangent = tangent / np.linalg.norm(tangent, axis=1, keepdims=True)
        one, two = _untwisted_frames(centre, tangent)
        # Every other ring is turned by half a step, so that the faces are nearly equilateral.
        angle = (np.arange(around) + 0.5 * (np.arange(rings) % 2)[:, None]) * (2 * pi / around)
        offset = np.cos(angle)[..., None] * one[:, None] + np.sin(angle)[..., None] * two[:, None]
        vertices = (centre[:, None] + self.radius * offset).reshape(-1, 3)
        i, j = np.meshgrid(np.arange(rings), np.arange(around), indexing="ij")
        here, there = i * around, (i + 1) % rings * around
        ahead, odd = (j + 1) % around, (i % 2 == 1) & (i + 1 < rings)
        a, b, c, d = here + j, here + ahead, there + j, there + ahead
        even = np.stack([np.stack([a, b, c], -1), np.stack([b, d, c], -1)], axis=2)
        turned = np.stack([np.stack([a, b, d], -1), np.stack([a, d, c], -1)], axis=2)
        faces = np.where(odd[..., None, None], turned, even).reshape(-1, 3)
        return vertices, faces

    def sample(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """``count`` points, uniform by area of the exact surface, and their outward unit normals."""
        lengths = np.cumsum([curve.length for curve in self.curves])  # the area of a tube is 2 pi radius length
        which = np.minimum(np.searchsorted(lengths, rng.random(count) * lengths[-1]), len(lengths) - 1)
        points, normals = np.empty((2, count, 3))
        for k, curve in enumerate(self.curves):
            rows = np.flatnonzero(which == k)
            points[rows], normals[rows] = self._sample_one(curve, len(rows), rng)
        return points, normals

    def _sample_one(self, curve: FourierCurve, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """By rejection: the area element is ``radius |c'| (1 - radius k . n)`` with the curvature vector k."""
        fastest = 1.001 * float(np.linalg.norm(curve.at(curve._samples[0], 1)[1], axis=1).max())
        largest = fastest * (1 + self.radius * curve.curvature * 1.001)
        kept, missing = [(np.empty((0, 3)), np.empty((0, 3)))], count
        while missing > 0:
            drawn = int(1.1 * missing * largest * 2 * pi / curve.length) + 16
            c, first, second = curve.at(rng.random(drawn) * 2 * pi, 2)
            speed = np.sqrt(dot(first, first))
            tangent = first / speed[:, None]
            bend = (second - dot(second, tangent)[:, None] * tangent) / (speed**2)[:, None]
            one, two = tangents(tangent)
            angle = rng.random((drawn, 1)) * 2 * pi
            normal = np.cos(angle) * one + np.sin(angle) * two
            element = speed * (1 - self.radius * dot(bend, normal))
            accepted = np.flatnonzero(rng.random(drawn) * largest < element)[:missing]
            kept.append(((c + self.radius * normal)[accepted], normal[accepted]))
            missing -= len(accepted)
        points, normals = (np.concatenate(parts) for parts in zip(*kept, strict=True))
        return points, normals

    def closest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The foot point of each of ``points`` (n, 3) and its outward unit normal: two (n, 3) arrays."""
        points = np.asarray(points, dtype=np.float64)
        best, closest, normals = np.full(len(points), np.inf), np.empty((len(points), 3)), np.empty((len(points), 3))
        for curve in self.curves if len(points) else ():
            s = curve.foot(points)
            centre, tangent = curve.at(s, 1)
            away = points - centre
            distance = np.sqrt(dot(away, away))
            tangent = tangent / np.linalg.norm(tangent, axis=1, keepdims=True)
            # On the curve itself all directions across it are equally near.
            on_curve = distance < 1e-12 * self.radius
            normal = np.where(on_curve[:, None], tangents(tangent)[0], away / np.maximum(distance, 1e-300)[:, None])
            nearer = distance < best
            best[nearer], normals[nearer] = distance[nearer], normal[nearer]
            closest[nearer] = (centre + self.radius * normal)[nearer]
        return closest, normals


def _equal_arcs(curve: FourierCurve, count: int) -> np.ndarray:
    """Parameters of ``count`` points of the curve at equal distances along it."""
    s = np.linspace(0, 2 * pi, SAMPLES + 1)
    speed = np.linalg.norm(curve.at(s, 1)[1], axis=1)
    arc = np.concatenate([[0], np.cumsum((speed[1:] + speed[:-1]) / 2)])
    return np.interp(np.arange(count) * arc[-1] / count, arc, s)


def _untwisted_frames(centre: np.ndarray, tangent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors across the curve at each point, with the least rotation along it, and the same at both ends.

    The double reflection of Wang et al. (2008); then the remaining angle is spread evenly.
    """
    count = len(centre)
    one = np.empty((count + 1, 3))
    one[0] = tangents(tangent[:1])[0][0]
    for i in range(count):
        j = (i + 1) % count
        chord = centre[j] - centre[i]
        square = chord @ chord
        mirrored, t = (
            one[i] - 2 / square * (chord @ one[i]) * chord,
            tangent[i] - 2 / square * (chord @ tangent[i]) * chord,
        )
        second = tangent[j] - t
        one[i + 1] = mirrored - 2 / (second @ second) * (second @ mirrored) * second
    left = np.arctan2(np.cross(one[0], one[-1]) @ tangent[0], one[0] @ one[-1])
    angle = (-left * np.arange(count) / count)[:, None]
    one = one[:-1] - dot(one[:-1], tangent)[:, None] * tangent
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    two = np.cross(tangent, one)
    return np.cos(angle) * one + np.sin(angle) * two, np.cos(angle) * two - np.sin(angle) * one


def circle(radius: float = 1.0) -> FourierCurve:
    """The circle about the origin in the plane z = 0."""
    return ellipse(radius, radius)


def ellipse(a: float, b: float) -> FourierCurve:
    """The ellipse with the half axes a in x and b in y."""
    return FourierCurve(np.array([1]), np.array([[a, 0, 0]]), np.array([[0, b, 0]]))


def torus_knot(p: int, q: int, minor: float, *, bulge: float = 1.0) -> FourierCurve:
    """The (p, q) torus knot: p times around the axis z at the radius 1, q times around a tube of radius ``minor``.

    ``c(s) = ((1 + minor cos q s) cos p s, (1 + minor cos q s) sin p s, bulge minor sin q s)``
    """
    half = minor / 2
    return FourierCurve(
        np.array([p, q + p, abs(q - p), q]),
        np.array([[1, 0, 0], [half, 0, 0], [half, 0, 0], [0, 0, 0]], dtype=float),
        np.array([[0, 1, 0], [0, half, 0], [0, -half if q > p else half, 0], [0, 0, bulge * minor]], dtype=float),
    )
