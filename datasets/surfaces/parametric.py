"""Surfaces of patches ``x(u, v)`` in closed form: exact samples, normals and foot points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from .basins import Basins, best_of
from .foot_points import refine
from .jets import Jet
from .patch_mesh import WeldedMesh, patch_grid, weld
from .refining import refined

if TYPE_CHECKING:
    from scipy.spatial import cKDTree
    from trimesh import Trimesh

CHUNK = 20_000  # number of places that are evaluated at a time: their jets stay in the processor's cache
MARGIN = 1.1  # factor from the largest computed value of dA in a cell to its bound
MOST_SIDES = 24  # most grid points of one vertex that are tried if a foot point ends there: at a pole there are many


@dataclass(frozen=True, eq=False)
class Chart:
    """A formula x(u, v) of one or several patches."""

    position: Callable[[Jet, Jet], Jet]  # from u and v to the point, a vector
    flip: bool = False  # whether the outward normal is x_v cross x_u
    lost: int = 0  # how many orders of derivatives the formula uses up (1 if it needs the normal of another surface)


@dataclass(frozen=True, eq=False)
class Patch:
    """A rectangle of parameters, and the grid that tessellates it."""

    chart: int  # which of the surface's charts
    u: np.ndarray  # ascending grid lines; the first and the last are the border
    v: np.ndarray
    levels: np.ndarray | None = None  # how often the columns are halved in each row, see patch_grid
    reach: tuple[float, float] = (0.0, 0.0)  # how far in u and v the formula is valid beyond the patch
    fixed: bool = False  # whether faces must not depend on the form; otherwise quads are split along shorter diagonals


class ParametricSurface:
    """An exact surface of patches; a :class:`bench.Surface`.

    Parameters
    ----------
    make : function without arguments that returns charts and patches
        Called on first use, so that a list of shapes costs nothing.
    rotation : (3, 3) array, optional
        Applied last.
    refine : bool
        Whether the mesh is refined where it cuts off the curvature of the surface, see :func:`refining.refined`. For
        charts without poles.
    """

    def __init__(
        self, make: Callable[[], tuple[Sequence[Chart], Sequence[Patch]]], rotation: Any = None, *, refine: bool = False
    ):
        self._make, self._rotation, self._fine = make, rotation, refine

    @cached_property
    def parts(self) -> tuple[list[Chart], list[Patch]]:
        """The charts and the patches."""
        charts, patches = self._make()
        return list(charts), list(patches)

    # -- the formula -----------------------------------------------------------------------------------------------

    def evaluate(self, chart: np.ndarray, u: np.ndarray, v: np.ndarray, order: int) -> np.ndarray:
        """Taylor coefficients (1, 3 or 6, n, 3) of the surface at (u, v) of the given charts, each (n,).

        In the order x, x_u, x_v, x_uu / 2, x_uv, x_vv / 2.
        """
        result = np.empty(((1, 3, 6)[order], len(u), 3))
        for k, formula in enumerate(self.parts[0]):
            rows = np.flatnonzero(chart == k)
            for part in np.split(rows, range(CHUNK, len(rows), CHUNK)):
                if len(part):
                    jet = formula.position(*Jet.variables(u[part], v[part], order + formula.lost))
                    result[:, part] = np.moveaxis(jet.truncate(order).c, 1, 2)
        # einsum, not a matrix product: the sum is the same to the last bit with every linear algebra library.
        return result if self._rotation is None else np.einsum("ij,tnj->tni", self._rotation, result)

    def at(self, patch: np.ndarray, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The points at (u, v) of the given patches, each (n,), and their outward unit normals: two (n, 3) arrays."""
        chart = self._table["chart"][patch]
        x, x_u, x_v = self.evaluate(chart, u, v, 1)
        normals = np.cross(x_u, x_v)
        lengths = np.linalg.norm(normals, axis=1)
        poles = np.flatnonzero(~(lengths > 1e-14 * np.linalg.norm(x_u, axis=1) * self._size))
        if len(poles):  # there the normal is the limit from within the patch
            low, high = self._table["low"][patch[poles]], self._table["high"][patch[poles]]
            inward = np.stack([u[poles], v[poles]], axis=1)
            inward += 1e-6 * ((low + high) / 2 - inward)
            _, a, b = self.evaluate(chart[poles], inward[:, 0], inward[:, 1], 1)
            normals[poles] = np.cross(a, b)
            lengths[poles] = np.linalg.norm(normals[poles], axis=1)
        sign = np.where(self._table["flip"][patch], -1.0, 1.0)
        return x, normals * (sign / lengths)[:, None]

    @cached_property
    def _table(self) -> dict[str, np.ndarray]:
        """The properties of the patches, one row for each: its chart, its borders, the range of its foot points."""
        charts, patches = self.parts
        low, high = (np.array([(p.u[end], p.v[end]) for p in patches]) for end in (0, -1))
        reach = np.array([p.reach for p in patches])
        chart = np.array([p.chart for p in patches])
        flip = np.array([charts[k].flip for k in chart])
        # At a pole, Newton's method has no direction: it starts a fraction of a cell beside it.
        inset = [np.array([self._pole_inset(p, end) for p in patches]) for end in (0, -1)]
        return {
            "chart": chart,
            "flip": flip,
            "low": low,
            "high": high,
            "from": low - reach,
            "to": high + reach,
            "lowest start": low[:, 0] - reach[:, 0] + inset[0],
            "highest start": high[:, 0] + reach[:, 0] - inset[1],
        }

    def _pole_inset(self, patch: Patch, end: int) -> float:
        """A third of the cell at the first (0) or the last (-1) line of u if that is a pole; otherwise 0."""
        v = np.linspace(patch.v[0], patch.v[-1], 5)
        points = self.evaluate(np.full(5, patch.chart), np.full(5, patch.u[end]), v, 0)[0]
        inside = self.evaluate(np.full(5, patch.chart), np.full(5, patch.u[len(patch.u) // 2]), v, 0)[0]
        is_pole = np.ptp(points, axis=0).max() < 1e-6 * np.ptp(inside, axis=0).max()
        return abs(patch.u[end] - patch.u[1 if end == 0 else -2]) / 3 if is_pole else 0.0

    # -- the mesh --------------------------------------------------------------------------------------------------

    @cached_property
    def grid(self) -> tuple[WeldedMesh, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """The tessellation; patch, u, v of all grid points; which of them are on the border of their patch."""
        charts, patches = self.parts
        grids = [patch_grid(p.u, p.v, p.levels) for p in patches]
        patch = np.repeat(np.arange(len(patches)), [len(g.u) for g in grids])
        u, v = (np.concatenate([getattr(g, name) for g in grids]) for name in "uv")
        points = self.evaluate(self._table["chart"][patch], u, v, 0)[0]
        starts = np.cumsum([0] + [len(g.u) for g in grids])
        border = np.concatenate([start + g.border for start, g in zip(starts, grids, strict=False)])
        flips, fixed = [charts[p.chart].flip for p in patches], [p.fixed for p in patches]
        return weld(points, grids, flips, fixed), patch, u, v, border

    def mesh(self) -> Trimesh:
        """The tessellation; its vertices lie on the surface. With ``refine``, edges that are too far off are halved."""
        from trimesh import Trimesh

        welded, patch, u, v, _ = self.grid
        if not self._fine:
            return Trimesh(welded.vertices, welded.faces, process=False)
        places = np.stack([patch, u, v], axis=1)[welded.corners]
        return Trimesh(*refined(welded.vertices, welded.faces, self._at_places, places), process=False)

    def _at_places(self, _: np.ndarray, places: np.ndarray) -> np.ndarray:
        """The points (n, 3) at patch, u, v (n, 3)."""
        patch = np.rint(places[:, 0]).astype(np.int64)
        return self.evaluate(self._table["chart"][patch], places[:, 1], places[:, 2], 0)[0]

    @cached_property
    def _size(self) -> float:
        return float(np.linalg.norm(np.ptp(self.grid[0].vertices, axis=0)))

    # -- sampling --------------------------------------------------------------------------------------------------

    @cached_property
    def _cells(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Patch, lower corner (c, 2), width (c, 2), bound of dA per du dv, cumulative bound of the area of the cells.

        The bound is the largest value at corners and middles of the cell and of the cells around it, with a margin:
        cells are smaller than the features of a surface, so neighbours detect a peak inside a cell.
        """
        corners, widths, bounds, owners = [], [], [], []
        for k, patch in enumerate(self.parts[1]):
            at_corners = self._elements(patch, patch.u, patch.v)
            at_middles = self._elements(patch, _middles(patch.u), _middles(patch.v))
            bounds.append(MARGIN * _largest_around(at_corners, at_middles).ravel())
            low = np.meshgrid(patch.u[:-1], patch.v[:-1], indexing="ij")
            wide = np.meshgrid(np.diff(patch.u), np.diff(patch.v), indexing="ij")
            corners.append(np.stack([m.ravel() for m in low], axis=1))
            widths.append(np.stack([m.ravel() for m in wide], axis=1))
            owners.append(np.full(low[0].size, k))
        corners, widths, bounds, owners = (np.concatenate(x) for x in (corners, widths, bounds, owners))
        return owners, corners, widths, bounds, np.cumsum(bounds * widths.prod(axis=1))

    def _elements(self, patch: Patch, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """dA per du dv on the grid over the lines u and v of a patch."""
        at_u, at_v = (m.ravel() for m in np.meshgrid(u, v, indexing="ij"))
        _, x_u, x_v = self.evaluate(np.full(len(at_u), patch.chart), at_u, at_v, 1)
        element = np.linalg.norm(np.cross(x_u, x_v), axis=1)
        return np.nan_to_num(element, nan=0.0, posinf=0.0).reshape(len(u), len(v))

    def sample(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """``count`` points, uniform by area of the exact surface, and their outward unit normals.

        A cell of the grid is drawn by a bound of its area; a point in it is accepted in proportion to its dA.
        """
        owners, corners, widths, bounds, cumulative = self._cells
        kept, missing = [], count
        while missing > 0:
            tries = int(1.35 * missing) + 16
            cell = np.searchsorted(cumulative, rng.random(tries) * cumulative[-1], side="right")
            cell = np.minimum(cell, len(cumulative) - 1)
            places = corners[cell] + rng.random((tries, 2)) * widths[cell]
            patch = owners[cell]
            x_u, x_v = self.evaluate(self._table["chart"][patch], places[:, 0], places[:, 1], 1)[1:]
            element = np.linalg.norm(np.cross(x_u, x_v), axis=1)
            accepted = np.flatnonzero(rng.random(tries) * bounds[cell] < element)[:missing]
            kept.append((patch[accepted], places[accepted]))
            missing -= len(accepted)
        if not kept:
            return np.empty((0, 3)), np.empty((0, 3))
        patch, places = (np.concatenate(parts) for parts in zip(*kept, strict=True))
        return self.at(patch, *places.T)

    # -- closest points --------------------------------------------------------------------------------------------

    @cached_property
    def _tree(self) -> Any:
        """A tree over the triangles."""
        from bench.geometry.closest import TriangleTree

        return TriangleTree(self.grid[0].vertices, self.grid[0].faces)

    @cached_property
    def _border(self) -> tuple[cKDTree, np.ndarray, np.ndarray, np.ndarray]:
        """A tree over the vertices on borders; their grid points, sorted by vertex; the first and number for each."""
        from scipy.spatial import cKDTree

        welded, _, _, _, border = self.grid
        border = border[welded.vertex[border] >= 0]
        border = border[np.argsort(welded.vertex[border], kind="stable")]
        vertices, first, number = np.unique(welded.vertex[border], return_index=True, return_counts=True)
        return cKDTree(welded.vertices[vertices]), border, first, number

    def closest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The foot point of each of ``points`` (n, 3) and its outward unit normal: two (n, 3) arrays.

        From the closest point of the tessellation, by Newton's method in (u, v). If that ends on the border of a
        patch, it starts again from the nearest places on other borders, and the best result counts; far from the
        surface, from every vertex that is nearer than its neighbours, among the nearest 64.
        """
        points = np.asarray(points, dtype=np.float64)
        if not len(points):
            return np.empty((0, 3)), np.empty((0, 3))
        patch, places = self._foot_parameters(points)
        return self.at(patch, *places.T)

    def _foot_parameters(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        patch, start = self._start(points)
        places, square = self._refine(points, patch, start)
        stuck = np.flatnonzero(self._on_border(patch, places))
        if len(stuck):
            _, grid_patch, u, v, _ = self.grid
            tree, border, first, number = self._border
            ends = places[stuck]
            feet = self.evaluate(self._table["chart"][patch[stuck]], ends[:, 0], ends[:, 1], 0)[0]
            nearest = tree.query(feet)[1]
            # All grid points of the vertex; if there are very many, as at a pole, an even selection.
            sides = np.minimum(number[nearest], MOST_SIDES)
            rows = np.repeat(np.arange(len(stuck)), sides)
            k = np.arange(len(rows)) - np.repeat(np.cumsum(sides) - sides, sides)
            other = border[first[nearest[rows]] + k * number[nearest[rows]] // sides[rows]]
            twin, at = grid_patch[other], np.stack([u[other], v[other]], axis=1)
            trial, trial_square = self._refine(points[stuck[rows]], twin, at)
            best = best_of(rows, trial_square)
            best = best[trial_square[best] < square[stuck]]
            patch[stuck[rows[best]]], places[stuck[rows[best]]] = twin[best], trial[best]
            square[stuck[rows[best]]] = trial_square[best]
        self._other_basins(points, patch, places, square)
        return patch, places

    def _other_basins(self, points: np.ndarray, patch: np.ndarray, places: np.ndarray, square: np.ndarray) -> None:
        """Start again from other bumps that may be as near; nearer results are written into the arrays."""
        rows, starts = self._basins.starts(points, np.sqrt(square))
        if not len(rows):
            return
        welded, grid_patch, u, v, _ = self.grid
        at = welded.representative[starts]
        there, from_ = grid_patch[at], np.stack([u[at], v[at]], axis=1)
        trial, trial_square = self._refine(points[rows], there, from_)
        best = best_of(rows, trial_square)
        best = best[trial_square[best] < square[rows[best]]]
        patch[rows[best]], places[rows[best]], square[rows[best]] = there[best], trial[best], trial_square[best]

    @cached_property
    def _basins(self) -> Basins:
        return Basins(self.grid[0].vertices, self.grid[0].faces)

    def _start(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Patch and parameters (n, 2) of the closest point of the tessellation."""
        from bench.geometry.mesh_surface import barycentric

        welded, patch, u, v, _ = self.grid
        found = self._tree.closest(points)
        weights = np.stack(barycentric(found.points, welded.vertices, welded.faces[found.faces]), axis=1)
        corners = welded.corners[found.faces]
        places = np.stack([(weights * u[corners]).sum(axis=1), (weights * v[corners]).sum(axis=1)], axis=1)
        return patch[corners[:, 0]], places

    def _refine(self, points: np.ndarray, patch: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        table = self._table
        chart, longest = table["chart"][patch], (table["high"] - table["low"])[patch] / 4
        start = start.copy()
        start[:, 0] = np.clip(start[:, 0], table["lowest start"][patch], table["highest start"][patch])
        return refine(
            points, start, table["from"][patch], table["to"][patch], longest, self._size,
            lambda rows, places, order: self.evaluate(chart[rows], places[:, 0], places[:, 1], order),
        )  # fmt: skip

    def _on_border(self, patch: np.ndarray, places: np.ndarray) -> np.ndarray:
        low, high = self._table["from"][patch], self._table["to"][patch]
        near = 1e-9 * (high - low)  # steps onto a border end within rounding of it
        return ((places <= low + near) | (places >= high - near)).any(axis=1)


def _middles(lines: np.ndarray) -> np.ndarray:
    return (lines[1:] + lines[:-1]) / 2


def _largest_around(corners: np.ndarray, middles: np.ndarray) -> np.ndarray:
    """For each cell of a grid, the largest of the values at corners and middles of it and its eight neighbours."""
    largest = np.maximum(np.maximum(corners[:-1], corners[1:])[:, :-1], np.maximum(corners[:-1], corners[1:])[:, 1:])
    largest = np.pad(np.maximum(largest, middles), 1, mode="edge")
    largest = np.maximum(np.maximum(largest[:-2], largest[1:-1]), largest[2:])
    return np.maximum(np.maximum(largest[:, :-2], largest[:, 1:-1]), largest[:, 2:])
