"""The mesh of ``f = 0``: marching cubes in a narrow band, coarse to fine, in a box aligned with the surface.

The triangles of each of the 256 patterns of signs are libigl's, asked once; numpy puts them together. On a sphere at
512 (a million cells) this takes half the time of libigl's own sparse marching cubes, 0.9 s against 1.9 s, and a third
of its memory, most of which goes into a Python dictionary of edges. The other candidate, Lewiner's table in
scikit-image, works on dense blocks in float32 and puts vertices inside of cells. libigl's table is a manifold: on
white noise, where all patterns meet, every edge has two faces and the faces at every vertex form one fan (tested).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from bench import InvalidOutput

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from trimesh import Trimesh

BASE = 32  # cells along the shortest side of a lattice at its coarsest level, which is evaluated everywhere
COARSE = 64  # cells along the shortest side of the domain in the search for the box of the surface
SLACK = 1.5  # a field may be so much steeper between lattice points than they tell
TYPICAL = 0.5  # of the ups and downs of a field near its zeros, so much happens in cells of at most its typical slope
NEAREST = 1e-4  # a vertex is no nearer to a lattice point, in spacings: values of 0 give small faces, not flat ones
CHUNK = 1 << 16  # cells at a time
CORNERS = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)])
# From corner j of a cube of side 1 to the farthest point of its half-sized child at corner i.
REACH = np.sqrt(np.where(CORNERS[:, None] == CORNERS, 0.25, 1.0).sum(axis=-1)) * (1 + 1e-9)
# The twelve edges of a cell, each from its lower end: numbers of corners, and along which axis.
EDGES = np.array(
    [(a, b) for a in range(8) for b in range(8) if np.array_equal(np.sort(CORNERS[b] - CORNERS[a]), (0, 0, 1))]
)
EDGE_AXES = (CORNERS[EDGES[:, 1]] - CORNERS[EDGES[:, 0]]).argmax(axis=1)


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
    on_progress: Callable[[int, int], None] | None = None,
) -> Trimesh:
    """The surface ``field = 0`` within a domain, as a mesh with outward faces, that is towards positive values.

    As in the released code of the thesis: a coarse lattice over the domain finds the surface, the principal axes of
    which align a box; the box's shortest side gets ``resolution`` samples, the other sides the same spacing. Unlike
    there, the field is evaluated only near its zeros (:func:`march`), and the box holds all cells of the coarse lattice
    that may hold surface, so that a part that lies between its points is not lost.

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
        The box is at least so far from the coarse surface, on each side. Empty space costs no evaluations, but
        spacing: the thesis's margin of 0.2 makes it ``1 + 0.4 / side`` times as large, and so the error of a surface
        with a side of 1 twice. None is needed: the coarse cells that hold the surface leave about 0.05 on each side.
    max_aspect : float, at least 1
        No side gets more than so many times ``resolution`` samples: a thin plate would otherwise take them squared.
    lipschitz : float, optional
        A bound of the field's slope, see :func:`march`; by default it is estimated.
    max_cells : int
        With more cells than this near the surface the field counts as noise. A cell takes up to 100 bytes.
    on_progress : function of steps done and steps in all

    Returns
    -------
    Trimesh
        Its ``metadata`` holds the number of ``evaluations`` and the ``spacing``.

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
    sampler = Sampler(field, domain, batch, on_progress)
    lattice = _fitted_lattice(sampler, resolution, align, margin, max_aspect, lipschitz, max_cells)
    vertices, faces = march(sampler, lattice, lipschitz=lipschitz, max_cells=max_cells)
    sampler.report(1.0)
    metadata = {"evaluations": sampler.count, "spacing": lattice.spacing}
    return Trimesh(vertices, faces, process=False, metadata=metadata)


class Sampler:
    """A field that is asked in batches, never outside of the domain, and that keeps count.

    Outside of the domain it has the value of the nearest point within: this is no steeper than the field.

    Attributes
    ----------
    count : int, points evaluated
    least, largest : float, the range of all values
    """

    def __init__(
        self,
        field: Callable[[np.ndarray], np.ndarray],
        domain: tuple[ArrayLike, ArrayLike] = (-1.0, 1.0),
        batch: int = 65_536,
        on_progress: Callable[[int, int], None] | None = None,
    ):
        self.low, self.high = (np.broadcast_to(np.asarray(c, dtype=np.float64), 3) for c in domain)
        if not (self.low < self.high).all() or not np.isfinite([self.low, self.high]).all():
            raise ValueError(f"domain: expected a lower and a higher corner, got {domain}")
        if batch < 1:
            raise ValueError(f"batch: expected at least 1, got {batch}")
        self.count, self.least, self.largest = 0, np.inf, -np.inf
        self._field, self._batch, self._on_progress, self._done = field, batch, on_progress, 0

    def values(self, level: Level, nodes: np.ndarray, span: tuple[float, float]) -> np.ndarray:
        """The field at nodes (n,) of a level: an (n,) float64 array; this is the ``span`` of the whole work."""
        values = np.empty(len(nodes))
        for start in range(0, len(nodes), self._batch):
            points = np.clip(level.points(nodes[start : start + self._batch]), self.low, self.high)
            part = np.asarray(self._field(points))
            if part.shape != (len(points),):
                raise ValueError(f"field: expected values ({len(points)},) for {len(points)} points, got {part.shape}")
            if not np.isfinite(part).all():
                raise InvalidOutput(
                    f"the field is not finite at {(~np.isfinite(part)).sum()} of {len(points)} points, "
                    f"for instance at {points[~np.isfinite(part)][0].round(6).tolist()}"
                )
            values[start : start + len(points)] = part
            self.count += len(points)
            self.least, self.largest = min(self.least, float(part.min())), max(self.largest, float(part.max()))
            self.report(span[0] + (span[1] - span[0]) * (start + len(points)) / len(nodes))
        return values

    def report(self, done: float) -> None:
        """Say which fraction of the work is done."""
        if self._on_progress and round(100 * done) > self._done:
            self._done = round(100 * done)
            self._on_progress(self._done, 100)

    def no_crossing(self) -> InvalidOutput:
        """The error of a field without a surface."""
        if self.least >= 0 or self.largest < 0:
            sign = "negative" if self.largest < 0 else "positive" if self.least > 0 else "positive or zero"
            found = f"all {self.count:,} values are {sign}"
        else:
            found = f"{self.count:,} values from {self.least:.3g} to {self.largest:.3g}, no neighbours with two signs"
        return InvalidOutput(f"the field has no zero crossing in the domain: {found}")


@dataclass(frozen=True, eq=False)
class Lattice:
    """A turned cubical lattice; ``cells`` is a multiple of ``2 ** levels`` along each axis."""

    origin: np.ndarray  # (3,)
    axes: np.ndarray  # (3, 3), a unit vector in each row
    spacing: float
    cells: tuple[int, int, int]
    levels: int  # how often the spacing is halved

    @classmethod
    def over(
        cls, low: np.ndarray, high: np.ndarray, axes: np.ndarray, samples: int, max_aspect: float = np.inf
    ) -> Lattice:
        """The lattice about a box, given in the coordinates of ``axes``, with ``samples`` along its shortest side."""
        extent = high - low
        spacing = float(max(extent.min(), extent.max() / max_aspect)) / (samples - 1)
        levels = max(0, round(np.log2((samples - 1) / BASE)))
        # Whole blocks: the lattice juts out of the box a little, which in a narrow band costs nothing.
        cells = np.ceil(extent / (spacing * 2**levels) - 1e-6).astype(int) * 2**levels
        origin = ((low + high - cells * spacing) / 2) @ axes
        return cls(origin, axes, spacing, tuple(cells.tolist()), levels)

    def level(self, number: int) -> Level:
        """Every ``2 ** number``-th point."""
        shape = tuple((n >> number) + 1 for n in self.cells)
        return Level(self.origin, self.axes, self.spacing * 2**number, shape)


class Level(NamedTuple):
    """One level of a lattice. Nodes are numbered along the last axis first; a cell has the number of its first node."""

    origin: np.ndarray
    axes: np.ndarray
    spacing: float
    shape: tuple[int, int, int]  # nodes along each axis

    @property
    def strides(self) -> np.ndarray:
        """From one node's number to the next, along each axis: (3,)."""
        return np.array([self.shape[1] * self.shape[2], self.shape[2], 1])

    def coordinates(self, nodes: np.ndarray) -> np.ndarray:
        """The integer coordinates of nodes: (3, n)."""
        return np.stack(np.unravel_index(nodes, self.shape))

    def points(self, nodes: np.ndarray, shift: ArrayLike = 0.0) -> np.ndarray:
        """Where nodes are, moved by ``shift`` spacings (a number or (3, n)) along the axes: (n, 3)."""
        x, y, z = self.spacing * (self.coordinates(nodes) + shift)
        # Not as a product of matrices: a node must not lie elsewhere in another batch, by as little as a last digit.
        return np.stack([x * a + y * b + z * c + o for a, b, c, o in zip(*self.axes, self.origin, strict=True)], axis=1)

    def touching(self, cells: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Those of the cells whose circumscribed ball touches a box of space."""
        middle = self.points(cells, 0.5)
        outside = np.maximum(np.abs(middle - (low + high) / 2) - (high - low) / 2, 0)
        return cells[np.einsum("ni,ni->n", outside, outside) <= 0.75 * self.spacing**2]


@dataclass(frozen=True, eq=False)
class Band:
    """Cells of a level that may hold surface, with the values at their corners; all numbers ascend."""

    level: Level
    cells: np.ndarray  # (c,)
    nodes: np.ndarray  # (n,), the corners of the cells
    values: np.ndarray  # (n,)

    def corners(self, cells: np.ndarray) -> np.ndarray:
        """For each corner and each of the cells the place in ``nodes``: (8, c)."""
        places = np.empty((8, len(cells)), dtype=np.int64)
        for j, (x, y, z) in enumerate(CORNERS):
            if not z:
                places[j] = _places(self.nodes, cells + self.level.strides @ (x, y, 0))
                places[j + 4] = places[j] + 1  # both are nodes, and their numbers follow each other
        return places

    @cached_property
    def crossed(self) -> tuple[np.ndarray, np.ndarray]:
        """The cells whose corners have both signs (c,), and their signs: bit j for a negative corner j."""
        cells, signs = [self.cells[:0]], [np.empty(0, dtype=np.uint8)]
        for part in _chunks(self.cells):
            sign = np.packbits(self.values[self.corners(part)] < 0, axis=0, bitorder="little")[0]
            mixed = (sign != 0) & (sign != 255)
            cells.append(part[mixed])
            signs.append(sign[mixed])
        return np.concatenate(cells), np.concatenate(signs)


def march(
    sampler: Sampler, lattice: Lattice, *, lipschitz: float | None = None, max_cells: int = 1 << 26
) -> tuple[np.ndarray, np.ndarray]:
    """Marching cubes over a lattice of any size, with evaluations only near the surface.

    The coarsest level of the lattice, 32 cells along its shortest side, is evaluated everywhere. A cell whose corners
    have one sign loses those of its eight half-sized children that are proven empty: a field of slope L at most is not
    zero within ``|f(corner)| / L`` of any corner. So is a whole cell if its corners are farther from zero than L times
    half its diagonal, but a single far corner often suffices for a child on the other side. What is left is halved,
    and evaluated at its new points.

    L is the larger of ``lipschitz`` and 1.5 times the slope of the field in the cell, by differences along its edges.
    Without ``lipschitz``, 1.5 times the typical slope of the coarsest cells near the surface takes its place, so the
    unit of the field does not matter. If L bounds the slopes, the result is the one of the dense lattice. If it does
    not, only closed parts can be missed that hold no evaluated point: cells are added wherever a change of sign goes
    on into a cell that was dropped, so the surface never gets holes.

    For a surface of area A and the spacing h there are O(A / h^2) evaluations (for a distance seven to twelve times
    A / h^2, and those of the coarsest level), with 60 to 70 bytes for each. Time grows like them, but for merges of
    sorted arrays.

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
    if lipschitz is not None and not lipschitz > 0:
        raise ValueError(f"lipschitz: expected a positive number, got {lipschitz}")
    band, _ = _finest_band(sampler, lattice, lipschitz, max_cells, (0.1, 0.95))
    return _triangulate(sampler, band)


def _fitted_lattice(
    sampler: Sampler,
    resolution: int,
    align: str,
    margin: float,
    max_aspect: float,
    lipschitz: float | None,
    max_cells: int,
) -> Lattice:
    """The lattice over a box of all that may be surface, by a coarse look at the domain."""
    coarse = Lattice.over(sampler.low, sampler.high, np.eye(3), COARSE + 1)
    band, bound = _finest_band(sampler, coarse, lipschitz, max_cells, (0.0, 0.1))
    level, children = _children(band, bound)
    if not len(children):
        raise sampler.no_crossing()
    children = level.touching(children, sampler.low, sampler.high)
    # A cell's corners are within half its diagonal of its middle, whichever way the box is turned.
    middles = level.points(children, 0.5)
    surface = middles
    if len(band.crossed[0]):
        vertices, faces = _triangulate(sampler, band)
        axes = _principal_axes(vertices[faces]) if align == "pca" else np.eye(3)
        surface = vertices
    else:  # all of it is smaller than a coarse cell: any axes will do
        axes = np.eye(3)
    half = level.spacing / 2 * np.abs(axes).sum(axis=1)
    low = np.minimum((surface @ axes.T).min(axis=0) - margin, (middles @ axes.T).min(axis=0) - half)
    high = np.maximum((surface @ axes.T).max(axis=0) + margin, (middles @ axes.T).max(axis=0) + half)
    return Lattice.over(low, high, axes, resolution, max_aspect)


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


def _finest_band(
    sampler: Sampler, lattice: Lattice, lipschitz: float | None, max_cells: int, span: tuple[float, float]
) -> tuple[Band, float]:
    """The band at the spacing of the lattice, by way of all coarser levels, and the least bound of slopes in use."""
    level = lattice.level(lattice.levels)
    cells = _numbers(level, np.indices(np.array(level.shape) - 1).reshape(3, -1))
    nodes, values, bound = np.empty(0, dtype=np.int64), np.empty(0), None
    share, begin = (span[1] - span[0]) * 3 / (4 ** (lattice.levels + 1) - 1), span[0]
    for step in range(lattice.levels + 1):
        end = begin + share * 4**step  # each level has about four times as many cells
        band = _evaluate(sampler, level, cells, nodes, values, max_cells, (begin, end))
        bound = _slope_bound(band, lipschitz) if bound is None else bound
        if step == lattice.levels:
            break
        level, cells = _children(band, bound)
        if not len(cells):
            raise sampler.no_crossing()
        # Corners of cells have even coordinates in the next level, where they are corners again.
        nodes, values = _numbers(level, 2 * band.level.coordinates(band.nodes)), band.values
        begin = end
    return band, bound


def _evaluate(
    sampler: Sampler,
    level: Level,
    cells: np.ndarray,
    nodes: np.ndarray,
    values: np.ndarray,
    max_cells: int,
    span: tuple[float, float],
) -> Band:
    """The band of ``cells`` and of those into which its surface goes on, given the values at some nodes."""
    while True:
        cells = level.touching(cells, sampler.low, sampler.high)
        if len(cells) > max_cells:
            raise InvalidOutput(
                f"the field is near zero nearly everywhere: more than {max_cells:,} cells of size {level.spacing:.3g} "
                "may hold surface; it is no distance to a surface, or the resolution is too high for it"
            )
        corners = cells
        for stride in level.strides:
            corners = _union(corners, corners + stride)
        # Not all known nodes are corners still: those of cells that were dropped are forgotten.
        place = _places(corners, nodes)
        still = corners[place] == nodes
        found, new = np.empty(len(corners)), np.ones(len(corners), dtype=bool)
        found[place[still]], new[place[still]] = values[still], False
        found[new] = sampler.values(level, corners[new], span)
        band = Band(level, cells, corners, found)
        lost = _lost_neighbours(sampler, band)
        if not len(lost):
            return band
        cells, nodes, values = _union(cells, lost), corners, found


def _lost_neighbours(sampler: Sampler, band: Band) -> np.ndarray:
    """The cells that are not in the band, but share a face with both signs with one that is."""
    level, (crossed, signs), lost = band.level, band.crossed, [band.cells[:0]]
    coordinates = level.coordinates(crossed)
    for axis in range(3):
        for side in (0, 1):
            face = int(np.packbits(CORNERS[:, axis] == side, bitorder="little")[0])
            leaves = (signs & face != 0) & (signs & face != face)
            leaves &= coordinates[axis] != side * (level.shape[axis] - 2)
            neighbours = crossed[leaves] + (2 * side - 1) * level.strides[axis]
            lost.append(neighbours[band.cells[_places(band.cells, neighbours)] != neighbours])
    return level.touching(np.unique(np.concatenate(lost)), sampler.low, sampler.high)


def _slope_bound(band: Band, lipschitz: float | None) -> float:
    """What the slope of the field is taken to be at least, from a band that covers the domain.

    It is that of cells near a zero, as far as they can tell; elsewhere it does not matter. Weighted by themselves,
    slopes of flat parts (a truncated distance) do not count, nor do a few jumps.
    """
    if lipschitz is not None:
        return lipschitz
    slopes, near = [], []
    for cells in _chunks(band.cells):
        values = band.values[band.corners(cells)]
        slopes.append(_slopes(values, band.level.spacing))
        near.append(np.abs(values).min(axis=0) <= 2 * band.level.spacing * slopes[-1])
    slopes, near = np.concatenate(slopes), np.concatenate(near)
    slopes = np.sort(slopes[near] if near.any() else slopes)
    ascent = np.cumsum(slopes)
    return SLACK * float(slopes[np.searchsorted(ascent, TYPICAL * ascent[-1])])


def _slopes(values: np.ndarray, spacing: float) -> np.ndarray:
    """The slope in cells, from the steepest of the four edges along each axis: (c,) from values (8, c)."""
    square = np.zeros(values.shape[1])
    for axis in range(3):
        first, second = EDGES[axis == EDGE_AXES].T
        square += np.abs(values[first] - values[second]).max(axis=0) ** 2
    return np.sqrt(square) / spacing


def _children(band: Band, bound: float) -> tuple[Level, np.ndarray]:
    """The next level, and the half-sized cells there that may hold surface."""
    spacing = band.level.spacing
    level = band.level._replace(spacing=spacing / 2, shape=tuple(2 * n - 1 for n in band.level.shape))
    kept = []
    for cells in _chunks(band.cells):
        values = band.values[band.corners(cells)]
        first = _numbers(level, 2 * band.level.coordinates(cells))
        negative = values < 0
        mixed = negative.any(axis=0) & ~negative.all(axis=0)
        # How far the cell is empty about each corner, in spacings; a cell without slope keeps nothing, or all if L = 0.
        bound_here = np.maximum(bound, SLACK * _slopes(values, spacing))
        values = np.abs(values)
        for corner, reach in zip(CORNERS, REACH, strict=True):
            keep = mixed | (values <= bound_here * spacing * reach[:, None]).all(axis=0)
            kept.append(first[keep] + level.strides @ corner)
    return level, np.sort(np.concatenate(kept))


def _chunks(numbers: np.ndarray) -> list[np.ndarray]:
    return [numbers[start : start + CHUNK] for start in range(0, len(numbers), CHUNK)]


def _numbers(level: Level, coordinates: np.ndarray) -> np.ndarray:
    """The numbers of the nodes at integer coordinates (3, n)."""
    return level.strides @ coordinates


def _places(numbers: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Where the ``wanted`` (w,) are in ``numbers``, both ascending; any place for those that are not there: (w,)."""
    places = []
    for part in _chunks(wanted):
        first, span = part[0], part[-1] + 1 - part[0]
        begin, end = np.searchsorted(numbers, (first, first + span))
        if span < 32 * len(part):  # as a rule: looked up in a table, which is five times as fast as searching
            table = np.zeros(span, dtype=np.int64)
            table[numbers[begin:end] - first] = np.arange(begin, end)
            places.append(table[part - first])
        else:
            places.append(np.minimum(begin + np.searchsorted(numbers[begin:end], part), len(numbers) - 1))
    return np.concatenate(places) if places else np.empty(0, dtype=np.int64)


def _union(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The union of two ascending arrays; a stable sort merges them in linear time."""
    both = np.concatenate([a, b])
    both.sort(kind="stable")
    return both[np.concatenate([[True], both[1:] != both[:-1]])] if len(both) else both


# -- triangles -----------------------------------------------------------------------------------------------------


@lru_cache(maxsize=1)
def _table() -> tuple[np.ndarray, np.ndarray]:
    """For each pattern of signs (bit j: corner j is negative) the number of triangles, and their edges (256, 5, 3)."""
    import igl

    counts, triangles = np.zeros(256, dtype=np.int64), np.zeros((256, 5, 3), dtype=np.int64)
    middles = CORNERS[EDGES].mean(axis=1)
    for pattern in range(1, 255):
        signs = np.where(pattern >> np.arange(8) & 1, -1.0, 1.0)
        V, F, _ = igl.marching_cubes(signs, CORNERS.astype(np.float64), np.arange(8)[None], 0.0)
        edges = np.abs(V[:, None] - middles).sum(axis=-1).argmin(axis=1)  # between -1 and 1 the zero is in the middle
        counts[pattern], triangles[pattern, : len(F)] = len(F), edges[F]
    return counts, triangles


def _triangulate(sampler: Sampler, band: Band) -> tuple[np.ndarray, np.ndarray]:
    """Marching cubes over the cells of a band: vertices (v, 3) and faces (f, 3)."""
    counts, triangles = _table()
    faces, used = [], np.zeros(3 * len(band.nodes), dtype=bool)  # an edge of the lattice: its lower node and its axis
    for cells, signs in zip(*map(_chunks, band.crossed), strict=True):
        corners = band.corners(cells)
        there = np.arange(5) < counts[signs][:, None]
        cell, edge = there.nonzero()[0][:, None], triangles[signs][there]
        faces.append(3 * corners[EDGES[edge, 0], cell] + EDGE_AXES[edge])
        used[faces[-1]] = True
    if not faces:
        raise sampler.no_crossing()
    number = np.cumsum(used, dtype=np.int32)
    number -= 1
    faces = np.concatenate([number[part] for part in faces]).astype(np.int64)
    return _vertices(band, np.flatnonzero(used)), faces


def _vertices(band: Band, edges: np.ndarray) -> np.ndarray:
    """Where the field, linear along lattice edges, is zero: (v, 3)."""
    vertices = []
    upper = np.empty_like(edges)
    for axis, stride in enumerate(band.level.strides):
        along = edges % 3 == axis
        upper[along] = _places(band.nodes, band.nodes[edges[along] // 3] + stride)
    for part, high in zip(_chunks(edges), _chunks(upper), strict=True):
        low, axis = np.divmod(part, 3)
        one, two = band.values[low], band.values[high]
        along = np.clip(one / (one - two), NEAREST, 1 - NEAREST)
        vertices.append(band.level.points(band.nodes[low], along * (axis == np.arange(3)[:, None])))
    return np.concatenate(vertices)
