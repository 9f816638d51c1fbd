"""The surface ``x = r(u) u`` over the unit sphere, r a sum of spherical harmonics, with exact samples and normals."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from .basins import Basins, best_of
from .harmonics import HarmonicSum
from .tangents import dot, tangents

if TYPE_CHECKING:
    from scipy.spatial import cKDTree
    from trimesh import Trimesh

Terms = tuple[np.ndarray, np.ndarray, np.ndarray]  # r, and its gradient and Hessian as a polynomial in space
LONGEST_STEP = 0.2  # of Newton's method, as an angle


@lru_cache(maxsize=4)
def icosphere(subdivisions: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit vertices (10 * 4^k + 2, 3) and faces (20 * 4^k, 3) of the k times subdivided icosahedron."""
    from trimesh.creation import icosphere

    sphere = icosphere(subdivisions)
    vertices = sphere.vertices / np.linalg.norm(sphere.vertices, axis=1, keepdims=True)
    faces = np.array(sphere.faces)
    for array in (vertices, faces):
        array.setflags(write=False)
    return vertices, faces


class StarSurface:
    """The exact surface ``x = r(u) u``; a :class:`bench.Surface`.

    Parameters
    ----------
    make_radius : function without arguments that returns r, a positive :class:`HarmonicSum`
        Called on first use, so that a list of shapes costs nothing.
    """

    def __init__(self, make_radius: Callable[[], HarmonicSum]):
        self._make_radius = make_radius

    @cached_property
    def radius(self) -> HarmonicSum:
        """The function r on the unit sphere."""
        return self._make_radius()

    def mesh(self, subdivisions: int) -> Trimesh:
        """A tessellation whose vertices lie on the surface; its error falls fourfold with each subdivision."""
        from trimesh import Trimesh

        directions, faces = icosphere(subdivisions)
        return Trimesh(self.radius.value(directions)[:, None] * directions, faces, process=False)

    def at(self, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The surface points over unit ``directions`` (n, 3), and their outward unit normals: two (n, 3) arrays."""
        r, gradient = self.radius.gradient(directions)
        # A tangent of the surface is (t . grad r) u + r t for each tangent t of the sphere: orthogonal to r u - grad r.
        normals = r[:, None] * directions - gradient
        return r[:, None] * directions, normals / np.linalg.norm(normals, axis=1, keepdims=True)

    # -- sampling --------------------------------------------------------------------------------------------------

    def sample(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """``count`` points, uniform by area of the exact surface, and their outward unit normals.

        By rejection: a uniform direction is accepted with the probability ``dA / largest dA``.
        """
        largest, mean = self._area_elements
        kept: list[tuple[np.ndarray, np.ndarray]] = []
        missing = count
        while missing > 0:
            directions = rng.normal(size=(int(1.1 * missing * largest / mean) + 16, 3))
            directions /= np.linalg.norm(directions, axis=1, keepdims=True)
            r, gradient = self.radius.gradient(directions)
            element = _area_element(r, gradient)
            accepted = np.flatnonzero(rng.random(len(directions)) * largest < element)[:missing]
            u, r, gradient = directions[accepted], r[accepted, None], gradient[accepted]
            normals = r * u - gradient
            kept.append((r * u, normals / np.linalg.norm(normals, axis=1, keepdims=True)))
            missing -= len(accepted)
        if not kept:
            return np.empty((0, 3)), np.empty((0, 3))
        points, normals = (np.concatenate(parts) for parts in zip(*kept, strict=True))
        return points, normals

    @cached_property
    def _area_elements(self) -> tuple[float, float]:
        """A proven upper bound of dA per solid angle, and its mean.

        Along every great circle ``(dA)^2 = r^2 (r^2 + |grad r|^2)`` is a non-negative trigonometric polynomial of
        degree N = 4 L. By M. Riesz, within the distance d of its maximum M it is at least ``M cos^2(N d / 2)``. So the
        maximum over a grid of covering radius d bounds M.
        """
        degree = 4 * max(self.radius.degree, 1)
        subdivisions = next(k for k in range(3, 10) if degree * _covering_radius(k) < 1 or k == 9)
        directions, _ = icosphere(subdivisions)
        elements = _area_element(*self.radius.gradient(directions))
        largest = float(elements.max()) / np.cos(degree * _covering_radius(subdivisions) / 2)
        return largest, float(elements.mean())

    # -- closest points --------------------------------------------------------------------------------------------

    def closest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The foot point of each of ``points`` (n, 3) and its outward unit normal: two (n, 3) arrays.

        Newton's method on the sphere for ``min |p - r(u) u|^2``, from the nearest vertex of a fine tessellation; it
        never moves from there to a worse point. Far from the surface, from all of the nearest 64 vertices that are
        nearer than their neighbours.
        """
        points = np.asarray(points, dtype=np.float64)
        if not len(points):
            return np.empty((0, 3)), np.empty((0, 3))
        tree = self._start[2]
        distance, nearest = tree.query(points)
        x, normals = self.at(self._foot_directions(points, nearest))
        rows, starts = self._basins.starts(points, distance)
        if len(rows):
            trial, trial_normals = self.at(self._foot_directions(points[rows], starts))
            square = ((points[rows] - trial) ** 2).sum(axis=1)
            best = best_of(rows, square)
            best = best[square[best] < ((points - x)[rows[best]] ** 2).sum(axis=1)]
            x[rows[best]], normals[rows[best]] = trial[best], trial_normals[best]
        return x, normals

    @cached_property
    def _basins(self) -> Basins:
        return Basins(self._start[2].data, icosphere(6)[1], self._start[2])

    @cached_property
    def _start(self) -> tuple[np.ndarray, Terms, cKDTree]:
        """Directions, the terms of r there, and a tree of the surface points over them."""
        from scipy.spatial import cKDTree

        directions, _ = icosphere(6)
        terms = self.radius.hessian(directions)
        return directions, terms, cKDTree(terms[0][:, None] * directions)

    def _foot_directions(self, points: np.ndarray, nearest: np.ndarray, *, iterations: int = 50) -> np.ndarray:
        """For each of ``points`` (n, 3), from the vertex ``nearest`` (n,) of the tessellation: an (n, 3) array."""
        directions, known, _ = self._start
        result = directions[nearest]
        active, p, u, terms = np.arange(len(points)), points, result, tuple(term[nearest] for term in known)
        damping = np.ones(len(points))
        for _ in range(iterations):
            step = damping[:, None] * _newton_step(p, u, *terms)
            trial = u + step
            trial /= np.linalg.norm(trial, axis=1, keepdims=True)
            # Convergence is quadratic: after a step below 1e-7 the error is about 1e-13.
            arrived = dot(step, step) < 1e-14
            result[active[arrived]] = trial[arrived]
            active, p, u, trial, damping = (rows[~arrived] for rows in (active, p, u, trial, damping))
            if not len(active):
                break
            terms, trial_terms = tuple(term[~arrived] for term in terms), self.radius.hessian(trial)
            # Rounding must not stop a nearly converged point.
            better = _half_square(p, trial, trial_terms[0]) <= _half_square(p, u, terms[0]) + 1e-15
            u, *terms = (_choose(better, new, old) for new, old in zip((trial, *trial_terms), (u, *terms), strict=True))
            damping = np.where(better, 1.0, damping / 4)
            result[active] = u
        return result


def _area_element(r: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """dA per solid angle: r sqrt(r^2 + |grad r|^2)."""
    return r * np.sqrt(r**2 + (gradient**2).sum(axis=1))


@lru_cache(maxsize=16)
def _covering_radius(subdivisions: int) -> float:
    """The largest angle from any direction to the nearest vertex of the icosphere."""
    vertices, faces = icosphere(subdivisions)
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    centres = np.cross(b - a, c - a)
    centres /= np.linalg.norm(centres, axis=1, keepdims=True)
    return float(np.arccos(np.clip((centres * a).sum(axis=1), -1, 1)).max())


def _half_square(p: np.ndarray, u: np.ndarray, r: np.ndarray) -> np.ndarray:
    return ((p - r[:, None] * u) ** 2).sum(axis=1) / 2


def _choose(which: np.ndarray, new: np.ndarray, old: np.ndarray) -> np.ndarray:
    return np.where(which.reshape(-1, *(1,) * (new.ndim - 1)), new, old)


def _newton_step(p: np.ndarray, u: np.ndarray, r: np.ndarray, gradient: np.ndarray, hessian: np.ndarray) -> np.ndarray:
    """The tangent step at u towards the minimum of ``E = |p - r(u) u|^2 / 2`` on the sphere: (n, 3)."""
    e1, e2 = tangents(u)
    q = dot(p, u)
    t1, t2 = dot(p, e1), dot(p, e2)
    g1, g2 = dot(gradient, e1), dot(gradient, e2)
    # The second derivatives of r along the sphere, as in HarmonicSum.hessian:
    he1, he2, radial = _times(hessian, e1), _times(hessian, e2), dot(gradient, u)
    r11, r12, r22 = dot(e1, he1) - radial, dot(e1, he2), dot(e2, he2) - radial
    # With p . u(s) = q + t . s - q |s|^2 / 2 and r(s) = r + g . s + s . R s / 2, up to third order:
    # E(s) = E(0) + ((r - q) g - r t) . s + s . ((r - q) R + g g^T - g t^T - t g^T + r q I) s / 2.
    s1, s2 = (r - q) * g1 - r * t1, (r - q) * g2 - r * t2
    a11 = (r - q) * r11 + g1 * g1 - 2 * g1 * t1 + r * q
    a22 = (r - q) * r22 + g2 * g2 - 2 * g2 * t2 + r * q
    a12 = (r - q) * r12 + g1 * g2 - g1 * t2 - t1 * g2
    # Where E is not convex, shift its curvatures up: then the step is a descent step.
    lowest = (a11 + a22) / 2 - np.hypot((a11 - a22) / 2, a12)
    shift = np.where(lowest < 1e-6, 0.1 - lowest, 0.0)
    a11, a22 = a11 + shift, a22 + shift
    determinant = a11 * a22 - a12 * a12
    step = ((a12 * s2 - a22 * s1) / determinant)[:, None] * e1 + ((a12 * s1 - a11 * s2) / determinant)[:, None] * e2
    length = np.sqrt(dot(step, step))
    return step * np.minimum(1, LONGEST_STEP / np.maximum(length, LONGEST_STEP))[:, None]


def _times(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return np.einsum("nij,nj->ni", matrices, vectors)
