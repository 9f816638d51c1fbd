"""The surface ``f(x) = 0`` of a function in closed form, f < 0 inside: mesh, samples and closest points.

Everything is exact up to rounding: vertices and samples are moved onto f = 0 by Newton's method, closest points solve
the equations of the nearest point, normals are gradients. Only the topology of the surface comes from a grid.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .band import sample_near_zero
from .basins import Basins, best_of
from .field import Field
from .refining import refined
from .tangents import dot, tangents

if TYPE_CHECKING:
    from scipy.spatial import cKDTree
    from trimesh import Trimesh

    from bench.geometry.mesh_surface import MeshSurface


CHUNK = 4096  # points at a time, so that a function's intermediate arrays stay in the processor's cache
OFFSETS = ((0.382, 0.236, 0.146), (0.171, 0.618, 0.447), (0.729, 0.293, 0.874))  # of the grid, in steps
NEAREST = 0.05  # least initial distance of a vertex from a grid point, in steps, so that every face has an area
BOUND = 1.15  # of the area element in a face relative to its middle, in rejection sampling


class Body(NamedTuple):
    """A function and the region of its surface."""

    field: Field
    low: np.ndarray  # corners of a box that holds the surface
    high: np.ndarray
    step: float  # of the grid for the mesh; the thinnest wall should be at least two steps


class ImplicitSurface:
    """The exact surface ``f = 0``; a :class:`bench.Surface`.

    Parameters
    ----------
    make_body : function without arguments that returns a :class:`Body`
        Called on first use, so that a list of shapes costs nothing.
    largest : bool
        Whether the surface is the largest connected part of ``f = 0`` (by faces) instead of all parts.
    refine : bool
        Whether the mesh is refined where it cuts off the curvature of the surface, see :func:`refining.refined`.
    """

    def __init__(self, make_body: Callable[[], Body], *, largest: bool = True, refine: bool = True):
        self._make_body, self._largest, self._fine = make_body, largest, refine

    @cached_property
    def body(self) -> Body:
        """The function, its box and the step of its grid."""
        return self._make_body()

    @cached_property
    def mesh(self) -> Trimesh:
        """A closed manifold tessellation whose vertices lie on the surface, with edges of about the grid's step.

        With ``refine``, edges that are too far from the surface are halved.

        Raises
        ------
        ValueError
            If no grid tried gives a closed manifold: the step is too large for the surface.
        """
        from trimesh import Trimesh

        from bench.geometry.topology import count_topology

        for offset in OFFSETS:
            vertices, faces = self._march(np.array(offset))
            if self._largest and len(faces):
                vertices, faces = _largest_component(vertices, faces)
            counts = count_topology(vertices, faces)
            if counts.watertight and counts.genus is not None:
                vertices = self._settle(vertices, faces)
                if self._fine:
                    vertices, faces = refined(vertices, faces, lambda middles, _: self.project(middles)[0])
                return Trimesh(vertices, faces, process=False)
        raise ValueError(f"step: expected a grid that resolves the surface, got {self.body.step}; try a smaller one")

    def _march(self, offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Marching cubes over a grid with offsets that avoid symmetric shapes: vertices (v, 3) and faces (f, 3)."""
        from skimage.measure import marching_cubes

        field, low, high, step = self.body
        origin = np.asarray(low, dtype=np.float64) - (1.5 + offset) * step
        volume = sample_near_zero(field, origin, np.ceil((high - origin) / step).astype(int) + 2, step)
        if not volume.min() < 0 < volume.max():
            return np.empty((0, 3)), np.empty((0, 3), dtype=np.int64)
        vertices, faces, _, _ = marching_cubes(volume, 0.0)
        vertices = vertices.astype(np.float64)
        corner = np.floor(vertices)
        part = vertices - corner
        on_edge = (part > 0).sum(axis=1) <= 1
        inner = np.clip(part, NEAREST, 1 - NEAREST)
        # For a vertex exactly on a grid point the edge is unknown; the projection separates it from others.
        vertices = np.where(on_edge[:, None] & (part > 0), corner + inner, vertices)
        return origin + step * vertices, faces.astype(np.int64)

    def _settle(self, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
        """The vertices on the surface, moved along it towards the mean of their neighbours for better shaped faces."""
        from scipy.sparse import coo_array

        ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        adjacency = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(len(vertices),) * 2).tocsr()
        rows, degree = ends[np.lexsort((ends[:, 1], ends[:, 0])), 0], np.diff(adjacency.indptr)
        vertices, normals = self.project(vertices, iterations=2)
        for _ in range(3):
            # Where the normal turns too far within an edge, a tangential move would fold the faces.
            turn = np.minimum.reduceat(dot(normals[rows], normals[adjacency.indices]), adjacency.indptr[:-1])
            weight = 0.5 * np.clip(2.5 * turn - 1.25, 0, 1)
            move = weight[:, None] * (adjacency @ vertices / degree[:, None] - vertices)
            moved = vertices + move - dot(move, normals)[:, None] * normals
            vertices, normals = self.project(moved, iterations=1)
        return self.project(vertices)[0]

    # -- points on the surface -------------------------------------------------------------------------------------

    def project(self, points: np.ndarray, *, iterations: int = 30) -> tuple[np.ndarray, np.ndarray]:
        """Points near the surface moved onto it along gradients, and the unit normals there: two (n, 3) arrays.

        Not the closest points; the difference grows with the curvature of the surface. After few ``iterations`` of
        Newton's method the points are only near the surface.
        """
        x, active = np.array(points, dtype=np.float64), np.arange(len(points))
        normals, longest = np.zeros_like(x), self.body.step
        for _ in range(iterations):
            value, gradient = self._gradient(x[active])
            square = np.maximum(dot(gradient, gradient), 1e-300)
            normals[active] = gradient / np.sqrt(square)[:, None]
            length = np.abs(value) / np.sqrt(square)
            # One more step after the last measured one costs a subtraction and gains the last digits.
            shorten = np.minimum(1, longest / np.maximum(length, longest))
            x[active] -= (shorten * value / square)[:, None] * gradient
            active = active[length > 1e-9 * self._size]
            if not len(active):
                break
        return x, normals

    @cached_property
    def _size(self) -> float:
        return float(np.linalg.norm(np.asarray(self.body.high) - self.body.low))

    def _gradient(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        from bench.geometry.neighbours import curve_order

        value, gradient = np.empty(len(points)), np.empty((len(points), 3))
        # Neighbours in space are evaluated together: a function with local parts evaluates only the nearby ones.
        order = curve_order(points) if len(points) > CHUNK else np.arange(len(points))
        for start in range(0, len(points), CHUNK):
            part = order[start : start + CHUNK]
            value[part], gradient[part] = self.body.field.gradient(points[part])
        return value, gradient

    def normals(self, points: np.ndarray) -> np.ndarray:
        """The unit gradients of f at points (n, 3): an (n, 3) array."""
        gradient = self._gradient(points)[1]
        return gradient / np.linalg.norm(gradient, axis=1, keepdims=True)

    # -- sampling --------------------------------------------------------------------------------------------------

    def sample(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """``count`` points, uniform by area of the exact surface, and their outward unit normals.

        The mesh and the surface correspond along lines between them in the (interpolated) normals of the vertices. A
        point of a face is accepted with a probability in proportion to the area element of the surface over it. Where
        the element varies by more than 15 % within one face, in folds that the mesh hardly resolves, the sampling
        density is too low.
        """
        faces, cumulative, middle = self._faces
        kept: list[tuple[np.ndarray, np.ndarray]] = []
        missing = count
        while missing > 0:
            drawn = int(1.05 * BOUND * missing) + 16
            chosen = np.searchsorted(cumulative, np.sort(rng.random(drawn)) * cumulative[-1], side="right")
            chosen = rng.permutation(np.minimum(chosen, len(faces) - 1))
            u, v = rng.random((2, drawn))
            u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
            points, normals, element = self._over_faces(chosen, u, v)
            accepted = np.flatnonzero(rng.random(drawn) * BOUND * middle[chosen] < element)[:missing]
            kept.append((points[accepted], normals[accepted]))
            missing -= len(accepted)
        if not kept:
            return np.empty((0, 3)), np.empty((0, 3))
        points, normals = (np.concatenate(parts) for parts in zip(*kept, strict=True))
        return points, normals

    @cached_property
    def _corners(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        vertices = np.asarray(self.mesh.vertices)
        return vertices, self.normals(vertices), np.asarray(self.mesh.faces)

    @cached_property
    def _faces(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The faces, the running sum of their areas on the surface, and the area element over their middle."""
        faces = self._corners[2]
        third = np.full(len(faces), 1 / 3)
        element = np.maximum(self._over_faces(np.arange(len(faces)), third, third)[2], 0.0)
        return faces, np.cumsum(element), element

    def _over_faces(
        self, chosen: np.ndarray, u: np.ndarray, v: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The surface points over the points (u, v) of faces, their normals, and the area elements d(area) / du dv."""
        vertices, vertex_normals, faces = self._corners
        (a, b, c), (at_a, at_b, at_c) = ([of[faces[chosen, i]] for i in range(3)] for of in (vertices, vertex_normals))
        q_u, q_v, direction_u, direction_v = b - a, c - a, at_b - at_a, at_c - at_a
        u, v = u[:, None], v[:, None]
        start, direction = a + u * q_u + v * q_v, at_a + u * direction_u + v * direction_v
        height, normals = self._height(start, direction)
        # x = q + t D with q and D linear in (u, v): the plane of (q_u + t D_u, q_v + t D_v) seen along D.
        t = height[:, None]
        volume = dot(np.cross(q_u + t * direction_u, q_v + t * direction_v), direction)
        return start + t * direction, normals, volume / dot(direction, normals)

    def _height(self, start: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``t`` with ``f(start + t direction) = 0`` near t = 0, and the unit normals there: (n,) and (n, 3) arrays."""
        t, normals, active = np.zeros(len(start)), np.empty_like(start), np.arange(len(start))
        for _ in range(20):
            value, gradient = self._gradient(start[active] + t[active, None] * direction[active])
            normals[active] = gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
            step = np.clip(value / dot(gradient, direction[active]), -self.body.step, self.body.step)
            t[active] -= step
            active = active[np.abs(step) > 1e-9 * self._size]
            if not len(active):
                break
        return t, normals

    # -- closest points --------------------------------------------------------------------------------------------

    @cached_property
    def _mesh_surface(self) -> MeshSurface:
        from bench.geometry.mesh_surface import MeshSurface

        return MeshSurface(self.mesh)

    def closest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The foot point of each of ``points`` (n, 3) and its outward unit normal: two (n, 3) arrays.

        Newton's method along the surface from the closest point of the mesh, with curvatures from differences of the
        exact gradient; a step that comes no nearer is shortened. If another side of the surface may be as near, the
        method also starts from the nearest vertex there; far from the surface, from every vertex that is nearer than
        its neighbours, among the nearest 64.
        """
        points = np.asarray(points, dtype=np.float64)
        if not len(points):
            return np.empty((0, 3)), np.empty((0, 3))
        x, normals = self._descend(points, self._mesh_surface.closest(points)[0])
        again, starts = self._other_starts(points, x, normals)
        if len(again):
            other, other_normals = self._descend(points[again], starts)
            nearer = _square(points[again] - other) < _square(points[again] - x[again])
            x[again[nearer]], normals[again[nearer]] = other[nearer], other_normals[nearer]
        self._other_basins(points, x, normals)
        return x, normals

    def _other_basins(self, points: np.ndarray, x: np.ndarray, normals: np.ndarray) -> None:
        """Start again from other parts that may be as near; nearer results are written into the arrays."""
        square = _square(points - x)
        rows, starts = self._basins.starts(points, np.sqrt(square))
        if not len(rows):
            return
        trial, trial_normals = self._descend(points[rows], self._corners[0][starts])
        best = best_of(rows, _square(points[rows] - trial))
        best = best[_square(points[rows[best]] - trial[best]) < square[rows[best]]]
        x[rows[best]], normals[rows[best]] = trial[best], trial_normals[best]

    @cached_property
    def _basins(self) -> Basins:
        return Basins(self._corners[0], self._corners[2], self._vertex_tree)

    def _other_starts(self, points: np.ndarray, x: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points (indices) for which a vertex on another side of the mesh may be nearer than x, and these vertices."""
        vertices, vertex_normals, _ = self._corners
        distance, nearest = self._vertex_tree.query(points, k=min(12, len(vertices)))
        square = _square(points - x)
        other_side = np.einsum("nki,ni->nk", vertex_normals[nearest], normals) < 0.8
        # The foot point is within about half an edge of some vertex.
        candidate = other_side & (distance**2 < square[:, None] + self.body.step**2)
        candidate |= distance < np.sqrt(square)[:, None] - 1e-9 * self._size
        again = np.flatnonzero(candidate.any(axis=1))
        return again, vertices[nearest[again, candidate[again].argmax(axis=1)]]

    @cached_property
    def _vertex_tree(self) -> cKDTree:
        from scipy.spatial import cKDTree

        return cKDTree(self._corners[0])

    def _descend(self, points: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """From ``starts`` (n, 3) near the surface to the points at least distance from ``points``, and the normals."""
        x, normals = self.project(starts)
        active, damping = np.arange(len(points)), np.ones(len(points))
        tiny = 1e-9 * self._size
        for _ in range(40):
            p, y, n = points[active], x[active], normals[active]
            step, bend = self._step_towards(p, y, n)
            length = np.sqrt(_square(step))
            shorten = damping[active] * np.minimum(1, 2 * self.body.step / np.maximum(length, tiny))
            trial, found = self.project(y + shorten[:, None] * step - (shorten**2 * bend / 2)[:, None] * n)
            # Rounding must not stop a nearly converged point.
            slack = np.where(length < 1e-5 * self._size, 1e-14 * self._size**2, 0)
            better = _square(p - trial) <= _square(p - y) + slack
            x[active[better]], normals[active[better]] = trial[better], found[better]
            damping[active] = np.where(better, 1.0, damping[active] / 4)
            # Convergence is quadratic: after a step below 1e-9 the error is at rounding level.
            active = active[np.where(better, length, shorten * length) > tiny]
            if not len(active):
                break
        return x, normals

    def _step_towards(self, p: np.ndarray, x: np.ndarray, n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The tangent step from x towards the foot point of p (n, 3), and the curvature along it times its square.

        With the shape operator S the surface is ``x + u - (u . S u / 2) n`` for tangents u, so that the distance to
        ``p = x + t + s n`` is stationary at ``(I + s S) u = t``.
        """
        e1, e2 = tangents(n)
        away = p - x
        t1, t2, s = dot(away, e1), dot(away, e2), dot(away, n)
        h = 1e-6 * self._size
        around = np.concatenate([x + d for d in (h * e1, h * e2, -h * e1, -h * e2)])
        gradients = np.split(self._gradient(around)[1], 4)  # one call: its overhead equals hundreds of points
        slope = np.linalg.norm(gradients[0] + gradients[1] + gradients[2] + gradients[3], axis=1) / 4 * 2 * h
        d1, d2 = gradients[0] - gradients[2], gradients[1] - gradients[3]
        s11, s22, s12 = dot(d1, e1) / slope, dot(d2, e2) / slope, (dot(d1, e2) + dot(d2, e1)) / (2 * slope)
        a11, a22, a12 = 1 + s * s11, 1 + s * s22, s * s12
        # Where the distance is not convex, shift its curvatures up: then the step is a descent step.
        lowest = (a11 + a22) / 2 - np.hypot((a11 - a22) / 2, a12)
        shift = np.where(lowest < 1e-3, 0.1 - lowest, 0.0)
        a11, a22 = a11 + shift, a22 + shift
        determinant = a11 * a22 - a12 * a12
        u1, u2 = (a22 * t1 - a12 * t2) / determinant, (a11 * t2 - a12 * t1) / determinant
        bend = s11 * u1 * u1 + 2 * s12 * u1 * u2 + s22 * u2 * u2
        return u1[:, None] * e1 + u2[:, None] * e2, bend


def _square(a: np.ndarray) -> np.ndarray:
    return dot(a, a)


def _largest_component(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The vertices and faces of the part with the most faces; of equal parts the first."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    ends = np.concatenate([faces[:, :2], faces[:, 1:]])
    graph = coo_array((np.ones(len(ends), dtype=bool), (ends[:, 0], ends[:, 1])), shape=(len(vertices),) * 2)
    count, label = connected_components(graph, directed=False)
    if count == 1:
        return vertices, faces
    face_label = label[faces[:, 0]]
    chosen = int(np.bincount(face_label, minlength=count).argmax())
    kept = label == chosen
    return vertices[kept], (np.cumsum(kept) - 1)[faces[face_label == chosen]]


def box_of_ball(radius: float) -> tuple[np.ndarray, np.ndarray]:
    """The corners of the box about the ball of ``radius`` at the origin."""
    return np.full(3, -radius), np.full(3, radius)
