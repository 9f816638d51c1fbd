"""The mesh of ``f = 0``: marching cubes in a narrow band, coarse to fine, in a box aligned with the surface."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Literal

import numpy as np

from .lattice import BASE, Band, Lattice
from .narrow_band import ROOM, Sampler, children_of, finest_band
from .triangles import triangulate

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from trimesh import Trimesh

REACH = 1.05  # half a side of the marched box: a fitted surface may extend a little beyond the box of the points
COARSE = 64  # cells along the shortest side of the domain in the search for the box of the surface


def extract(
    field: Callable[[np.ndarray], np.ndarray],
    *,
    resolution: int,
    domain: tuple[ArrayLike, ArrayLike] = (-1.0, 1.0),
    align: Literal["pca", "axes"] = "pca",
    margin: float = 0.0,
    max_aspect: float = 5.0,
    lipschitz: float | None = None,
    batch: int = 65_536,
    max_cells: int = 1 << 26,
    seconds: float = math.inf,
    on_progress: Callable[[int, int], None] | None = None,
) -> Trimesh:
    """The surface ``field = 0`` within a domain, as a mesh with faces outward, towards positive values.

    As in the released code of the thesis: a coarse lattice over the domain finds the surface, whose principal axes
    align a box; the box's shortest side gets ``resolution`` samples, the other sides the same spacing. Unlike
    there, the field is evaluated only near its zeros (:func:`march`), and the box contains all cells of the coarse
    lattice that may contain surface, so that no part between lattice points is lost.

    The mesh is closed where the surface lies within the domain. Where it leaves the domain it is cut off, open, within
    two cells of the border. The field is never evaluated outside of the domain.

    Parameters
    ----------
    field : function from points (n, 3) float64 to values (n,) of any float type, negative inside
        Called for at most ``batch`` points at a time.
    resolution : int, at least 8
        Samples along the shortest side of the box.
    domain : two points (3,) or numbers
        The lowest and the highest corner.
    align : "pca" or "axes"
        The box is aligned with the principal axes of the surface or with the coordinate axes.
    margin : float
        The least distance between box and coarse surface, on each side. Empty space costs no evaluations, but
        spacing: the thesis's margin of 0.2 makes it ``1 + 0.4 / side`` times as large, and so doubles the error of a
        surface with a side of 1. None is needed: the coarse cells of the surface leave about 0.05 on each side.
    max_aspect : float, at least 1
        No side gets more than this many times ``resolution`` samples: on thin plates their number would explode.
    lipschitz : float, optional
        A bound on the field's slope, see :func:`march`; by default it is estimated.
    max_cells : int
        With more cells near the surface the field counts as noise. A cell takes up to 100 bytes.
    seconds : float
        The available time. The spacing is halved from level to level, and a level that would take too long is
        left out: the surface is ``coarser`` by 2, 4 or more, with at least 32 samples along the shortest side (8 if
        even those would take too long).
    on_progress : function of steps done and steps in all

    Returns
    -------
    Trimesh
        Its ``metadata`` holds the number of ``evaluations``, the ``spacing``, and by which factor this is ``coarser``
        than requested: 1, unless the time was too short.

    Raises
    ------
    InvalidOutput
        If the field has no zero crossing, is not finite somewhere, or crosses zero nearly everywhere.

    Example
    -------
    >>> ball = extract(lambda points: np.linalg.norm(points, axis=1) - 0.5, resolution=64)
    >>> ball.is_watertight, round(float(ball.volume), 2)
    (True, 0.52)
    """
    from trimesh import Trimesh

    if resolution < 8:
        raise ValueError(f"resolution: expected at least 8, got {resolution}")
    if align not in ("pca", "axes"):
        raise ValueError(f"align: expected pca or axes, got {align!r}")
    if not margin >= 0:
        raise ValueError(f"margin: expected at least 0, got {margin}")
    if not max_aspect >= 1:
        raise ValueError(f"max_aspect: expected at least 1, got {max_aspect}")
    until = time.perf_counter() + seconds
    sampler = Sampler(field, domain, batch, on_progress)
    lattice = _fitted_lattice(sampler, resolution, align, margin, max_aspect, lipschitz, max_cells, until)
    band = _surface_band(sampler, lattice, lipschitz, max_cells, until)
    vertices, faces = triangulate(band)
    sampler.report(1.0)
    spacing = band.level.spacing
    metadata = {"evaluations": sampler.count, "spacing": spacing, "coarser": round(spacing / lattice.spacing)}
    return Trimesh(vertices, faces, process=False, metadata=metadata)


def march(
    sampler: Sampler, lattice: Lattice, *, lipschitz: float | None = None, max_cells: int = 1 << 26
) -> tuple[np.ndarray, np.ndarray]:
    """Marching cubes over a lattice of any size, with evaluations only near the surface.

    The coarsest level of the lattice, 32 cells along its shortest side, is evaluated everywhere. A cell whose corners
    have one sign loses those of its eight half-sized children that are proven empty: a field of slope at most L is not
    zero within ``|f(corner)| / L`` of any corner. A whole cell is empty if its corners are farther from zero than L
    times half its diagonal, but for a child a single far corner often suffices. The remaining cells are halved, and
    evaluated at their new points.

    L is the larger of ``lipschitz`` and 1.5 times the slope of the field in the cell, by differences along its edges.
    Without ``lipschitz``, 1.5 times the typical slope of the coarsest cells near the surface replaces it, so the
    unit of the field does not matter. If L bounds the slopes, the result equals that of the dense lattice. If it does
    not, only closed parts that contain no evaluated point can be missed: cells are added wherever a change of sign
    continues into a cell that was dropped, so the surface never gets holes.

    For a surface of area A and the spacing h there are O(A / h^2) evaluations (for a distance seven to twelve times
    A / h^2, plus those of the coarsest level), with 60 to 70 bytes for each. Time is proportional to them, except for
    merges of sorted arrays.

    Parameters
    ----------
    sampler : Sampler
    lattice : Lattice
    lipschitz : float, optional
        For a signed distance, 1 is enough; infinity makes the evaluation dense.
    max_cells : int

    Returns
    -------
    vertices : (v, 3) array
    faces : (f, 3) int array

    Raises
    ------
    InvalidOutput
        If the field has no zero crossing, is not finite somewhere, or crosses zero nearly everywhere.
    """
    return triangulate(_surface_band(sampler, lattice, lipschitz, max_cells))


def _surface_band(
    sampler: Sampler, lattice: Lattice, lipschitz: float | None, max_cells: int, until: float = math.inf
) -> Band:
    """The finest band that is finished by the time ``until``; it contains a surface."""
    if lipschitz is not None and not lipschitz > 0:
        raise ValueError(f"lipschitz: expected a positive number, got {lipschitz}")
    band, _ = finest_band(sampler, lattice, lipschitz, max_cells, (0.1, 0.95), until)
    if not len(band.crossed[0]):
        raise sampler.no_crossing()
    return band


def _fitted_lattice(
    sampler: Sampler,
    resolution: int,
    align: str,
    margin: float,
    max_aspect: float,
    lipschitz: float | None,
    max_cells: int,
    until: float,
) -> Lattice:
    """The lattice over a box of all that may be surface, found by a coarse lattice over the domain.

    The coarsest level of a flat box has many points, all of them near the surface. If it would not be finished by the
    time ``until``, it is made coarser, but not to fewer points than the lattice over the domain had.
    """
    started = time.perf_counter()
    coarse = Lattice.over(sampler.low, sampler.high, np.eye(3), COARSE + 1)
    band, bound = finest_band(sampler, coarse, lipschitz, max_cells, (0.0, 0.1))
    level, children = children_of(band, bound)
    if not len(children):
        raise sampler.no_crossing()
    children = level.touching(children, sampler.low, sampler.high)
    # A cell's corners are within half its diagonal of its middle, for any rotation of the box.
    middles = level.points(children, 0.5)
    surface = middles
    if len(band.crossed[0]):
        vertices, faces = triangulate(band)
        axes = _principal_axes(vertices[faces]) if align == "pca" else np.eye(3)
        surface = vertices
    else:  # the whole surface is smaller than a coarse cell: any axes will do
        axes = np.eye(3)
    half = level.spacing / 2 * np.abs(axes).sum(axis=1)
    low = np.minimum((surface @ axes.T).min(axis=0) - margin, (middles @ axes.T).min(axis=0) - half)
    high = np.maximum((surface @ axes.T).max(axis=0) + margin, (middles @ axes.T).max(axis=0) + half)
    lattice = Lattice.over(low, high, axes, resolution, max_aspect)
    each = ROOM * (time.perf_counter() - started) / sampler.count
    for base in (BASE // 2, BASE // 4):
        coarser = Lattice.over(low, high, axes, resolution, max_aspect, base)
        in_time = time.perf_counter() + each * _coarsest_points(lattice) < until
        if in_time or _coarsest_points(coarser) < sampler.count:
            break
        lattice = coarser
    return lattice


def _coarsest_points(lattice: Lattice) -> int:
    return math.prod(lattice.level(lattice.levels).shape)


def _principal_axes(triangles: np.ndarray) -> np.ndarray:
    """The principal axes of a surface given as triangles (f, 3, 3), uniform by area: a right-handed frame in rows."""
    sides = triangles[:, 1:] - triangles[:, :1]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 2
    centre = area @ triangles.mean(axis=1) / area.sum()
    triangles = triangles - centre
    # The integral of x x^T over a triangle a, b, c is area / 12 (a a^T + b b^T + c c^T + s s^T) with s = a + b + c.
    vectors = np.concatenate([triangles, triangles.sum(axis=1, keepdims=True)], axis=1)
    scatter = np.einsum("f,fki,fkj->ij", area / 12, vectors, vectors)
    axes = np.linalg.eigh(scatter)[1].T
    axes *= np.sign(axes[np.arange(3), np.abs(axes).argmax(axis=1)])[:, None]  # eigenvectors have no sign of their own
    axes[2] = np.cross(axes[0], axes[1])
    return axes
