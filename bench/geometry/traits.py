"""Measured traits of a surface: the tags by which leaderboards are sliced.

Every shape is measured alike, whatever it was made from: on its mesh, in the frame of a case (farthest vertex at
radius 1), at points that are uniform by area. Where neighbouring faces turn by less than 30 degrees the mesh stands for
a round surface, so a finer or coarser tessellation of one shape has the same traits.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from .topology import count_topology
from .walks import Terrain

NEAR = 0.03  # radii of the shape: how far, along the surface, the normal is followed
TURN = 30.0  # degrees more to one side than to the other, within NEAR, that make an edge
SHARP, SMOOTH = 0.02, 0.002  # shares of the surface near edges: at least, at most
THICKNESS, THIN = 0.06, 0.03  # radii; the share of the surface above a wall thinner than that
GAP, CONTACT = 0.06, 0.01  # radii; the share of the surface across a gap narrower than that
HIGH_GENUS = 10
OCTAVES = 5  # of radii of patches: NEAR, twice that, ...
DETAIL, MULTISCALE = 3.75, 0.5  # degrees that normals vary by in an octave; the share of the surface where they do

POINTS, SOME = 2000, 400  # for turns and walls; for the octaves
WAYS, STOPS = 8, 3  # directions from each point; where on the way to NEAR the normal is looked at
PAIRS = 100  # points before a gap that are tried for a way along the surface

TAGS = ("sharp", "smooth", "thin", "near_contact", "high_genus", "multiscale", "open")
"""The tags that are measured, in the order in which rows have them."""


class Traits(NamedTuple):
    """The measures of one shape."""

    edges: float
    """share from which the normal turns by 30 degrees more to one side than to the other, within 0.03 on the surface"""
    thin: float
    """share where the ray inwards leaves the body within 0.06"""
    contact: float
    """share where the ray outwards meets the surface within 0.06, at a place to which no short way along it leads"""
    detail: float
    """degrees by which normals vary in every octave of patch radii from 0.03 to 0.48, over half of the surface"""
    genus: int
    """sum over the components; -1 where it is not defined"""
    components: int
    boundary_edges: int

    @property
    def tags(self) -> tuple[str, ...]:
        """Those of :data:`TAGS` that hold."""
        holds = {
            "sharp": self.edges >= SHARP,
            "smooth": self.edges <= SMOOTH,
            "thin": self.thin >= THIN,
            "near_contact": self.contact >= CONTACT,
            "high_genus": self.genus >= HIGH_GENUS,
            "multiscale": self.detail >= DETAIL,
            "open": self.boundary_edges > 0,
        }
        return tuple(tag for tag in TAGS if holds[tag])

    def arrays(self) -> dict[str, np.ndarray]:
        """The measures as arrays, to be stored."""
        return {name: np.asarray(float(value)) for name, value in self._asdict().items()}

    @classmethod
    def of(cls, arrays: Mapping[str, np.ndarray]) -> Traits:
        """The measures from :meth:`arrays`."""
        whole = ("genus", "components", "boundary_edges")
        return cls._make((int if name in whole else float)(arrays[name]) for name in cls._fields)


def all_tags(traits: Traits, declared: Iterable[str]) -> tuple[str, ...]:
    """The measured tags, then the declared ones; of those, names that are measured do not count."""
    return (*traits.tags, *(tag for tag in declared if tag not in TAGS))


def measure_traits(vertices: np.ndarray, faces: np.ndarray) -> Traits:
    """Measure a mesh in the frame of a case.

    The points are the same for the same mesh, and turn with it.

    Parameters
    ----------
    vertices : (v, 3) array
        Lengths are in its units: the farthest vertex from the middle of the box is to be at 1.
    faces : (f, 3) int array
    """
    counts = count_topology(vertices, faces)
    terrain = Terrain(vertices, faces)
    if not len(terrain.faces):  # a point cloud, or no area: nothing is known of its surface
        return Traits(np.nan, np.nan, np.nan, np.nan, -1, counts.components, counts.boundary_edges)
    at, points = _sample(terrain)
    turn, detail = _turns(terrain, at, points)
    walls, gaps = _Rays(terrain, at, points).walls_and_gaps(outside_in=counts.watertight)
    return Traits(
        edges=float((turn > np.radians(TURN)).mean()),
        thin=float(walls.mean()),
        contact=float(gaps),
        detail=detail,
        genus=-1 if counts.genus is None else counts.genus,
        components=counts.components,
        boundary_edges=counts.boundary_edges,
    )


def _sample(terrain: Terrain) -> tuple[np.ndarray, np.ndarray]:
    """Faces (n,) and points (n, 3) in them, uniform by area and spread evenly over the order of the faces."""
    rng = np.random.default_rng(0)
    cumulative = np.cumsum(terrain.areas)
    heights = (np.arange(POINTS) + rng.random(POINTS)) / POINTS * cumulative[-1]
    at = np.minimum(np.searchsorted(cumulative, heights, side="right"), len(cumulative) - 1)
    u, v = rng.random((2, POINTS))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    return at, np.einsum("nk,nki->ni", np.stack([1 - u - v, u, v], axis=1), terrain.corners[at])


def _turns(terrain: Terrain, at: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, float]:
    """How much more normals turn to one side than to the other, in radians (n,), and how they vary in every octave."""
    angles = 2 * np.pi * (np.random.default_rng(1).random(len(at))[:, None] + np.arange(WAYS) / WAYS)
    start = terrain.normals_at(at, terrain.weights_at(at, points))
    far = np.zeros(len(at), dtype=bool)
    far[:: len(at) // SOME] = True
    near = NEAR * np.arange(1, STOPS + 1) / STOPS
    turn = np.empty(len(at))
    for chosen, more in ((~far, []), (far, NEAR * np.arange(2, 2 ** (OCTAVES - 1) + 1))):
        rows = np.flatnonzero(chosen)
        normals = terrain.walk(
            np.repeat(at[rows], WAYS),
            np.repeat(points[rows], WAYS, axis=0),
            angles[rows].ravel(),
            np.concatenate([near, more]),
        ).reshape(len(rows), WAYS, -1, 3)
        turn[rows] = _one_sided(start[rows], normals[:, :, :STOPS])
    return turn, _detail(start[rows], normals[:, :, STOPS - 1 :].mean(axis=1))


def _one_sided(start: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """By how much the turns of the normal to two opposite sides differ, in radians: the most over all ways and stops.

    A turn is a vector along its axis. Where a surface is bent evenly, be it a ball or a thin wire, those to the two
    sides are opposite and add up to zero; beside an edge one of them is zero.

    Parameters
    ----------
    start : (n, 3) array
    normals : (n, ways, stops, 3) array; ways k and k + ways / 2 are opposite; zero where a walk has ended
    """
    axis = np.cross(start[:, None, None], normals)
    sine, cosine = np.linalg.norm(axis, axis=-1), np.einsum("ni,nwsi->nws", start, normals)
    # The axis of a turn by pi is any; where a walk has ended, the turn is unknown and its way is left out.
    turns = axis * (np.arctan2(sine, cosine) / np.maximum(sine, 1e-9))[..., None]
    known = (normals != 0).any(axis=-1)
    half = WAYS // 2
    both = known[:, :half] & known[:, half:]
    over = np.arctan2(sine, cosine)
    apart = np.linalg.norm(turns[:, :half] + turns[:, half:], axis=-1)
    # Beyond three quarters of a half turn, the axis is lost: what counts is whether one side alone turns that far.
    lost = np.maximum(over[:, :half], over[:, half:]) > 0.75 * np.pi
    apart = np.where(lost, np.abs(over[:, :half] - over[:, half:]), apart)
    return np.where(both, apart, 0).max(axis=(1, 2))


def _detail(start: np.ndarray, rings: np.ndarray) -> float:
    """The least over the octaves of what normals vary by on a share MULTISCALE of the surface, in degrees.

    Each octave compares the mean normals of two geodesic patches about the same point, the one twice as wide as the
    other; the first compares the narrowest patch with the point. What counts is how far the narrower mean is off the
    direction of the wider one. On a sphere or a wire both have one direction, though the wider one is shorter: only
    what varies within the patch counts.

    Parameters
    ----------
    start : (n, 3) array, the normals of the points
    rings : (n, s, 3) array, mean normals on circles about them, at equal steps
    """
    weighted = np.cumsum(rings * np.arange(1, rings.shape[1] + 1)[:, None], axis=1)
    patches = [start]
    for octave in range(OCTAVES):
        r = 2**octave
        patches.append(weighted[:, r - 1] / (r * (r + 1) / 2))
    steps = [_sideways(one, wider) for one, wider in zip(patches[:-1], patches[1:], strict=True)]
    return float(np.degrees(min(np.quantile(step, 1 - MULTISCALE) for step in steps)))


def _sideways(vectors: np.ndarray, others: np.ndarray) -> np.ndarray:
    """The lengths of vectors (n, 3) across the directions of others (n, 3): (n,); 0 where the other has none."""
    along = others / np.maximum(np.linalg.norm(others, axis=1, keepdims=True), 1e-9)
    across = vectors - np.einsum("ni,ni->n", vectors, along)[:, None] * along
    return np.where(along.any(axis=1), np.linalg.norm(across, axis=1), 0)


class _Rays:
    """Rays from points along their faces' normals, inwards and outwards."""

    def __init__(self, terrain: Terrain, at: np.ndarray, points: np.ndarray):
        import igl

        self.terrain, self.at, self.points = terrain, at, points
        self._mesh = np.ascontiguousarray(terrain.vertices), np.ascontiguousarray(terrain.faces)
        self._tree = igl.AABB()
        self._tree.init(*self._mesh)

    def walls_and_gaps(self, *, outside_in: bool) -> tuple[np.ndarray, float]:
        """Which points are above a thin wall (n,), and the share of those across a narrow gap.

        ``outside_in``: whether a mesh of negative volume is one whose faces look inwards.
        """
        volume = np.einsum("ni,ni->", self.terrain.corners[:, 0], self.terrain.normals * self.terrain.areas[:, None])
        outward = -1.0 if outside_in and volume < 0 else 1.0
        walls, _, _ = self._hits(-outward, THICKNESS)
        rows, reach, hit = self._hits(outward, GAP)
        thin = np.zeros(len(self.at), dtype=bool)
        thin[walls] = True
        tried = np.arange(len(rows))[:: -(-len(rows) // PAIRS) or 1]
        apart = [not connected(self.terrain, self.points[r], 2 * d, self.at[r], h)
                 for r, d, h in zip(rows[tried], reach[tried], hit[tried], strict=True)]  # fmt: skip
        return thin, len(rows) / len(self.at) * float(np.mean(apart)) if apart else 0.0

    def _hits(self, sign: float, limit: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The points whose ray meets, within ``limit``, a face that looks the other way; how far; which face."""
        normals = sign * self.terrain.normals[self.at]
        start = np.ascontiguousarray(self.points + 1e-6 * normals)
        face, length, _ = self._tree.intersect_ray_first(*self._mesh, start, np.ascontiguousarray(normals), limit)
        facing = np.einsum("ni,ni->n", normals, sign * self.terrain.normals[np.maximum(face, 0)]) < 0
        rows = np.flatnonzero((face >= 0) & (length < limit) & facing)
        return rows, length[rows], face[rows]


def connected(terrain: Terrain, centre: np.ndarray, radius: float, one: int, other: int) -> bool:
    """Whether a way over the surface leads from face ``one`` to ``other`` without leaving a ball about ``centre``."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    low, high = terrain.boxes
    within = [(low[k] < centre[k] + radius) & (high[k] > centre[k] - radius) for k in range(3)]
    inside = np.flatnonzero(within[0] & within[1] & within[2])
    half = (3 * inside[:, None] + np.arange(3)).ravel()
    across = terrain.opposite[half]
    corners = terrain.corners.take(inside, axis=0)
    start = corners.reshape(-1, 3)
    along = corners.take([1, 2, 0], axis=1).reshape(-1, 3) - start
    share = np.clip(np.einsum("ni,ni->n", centre - start, along) / np.einsum("ni,ni->n", along, along), 0, 1)
    near = ((start + share[:, None] * along - centre) ** 2).sum(axis=1) < radius**2
    half, across = half[near & (across >= 0)] // 3, across[near & (across >= 0)] // 3
    label = np.full(len(terrain.faces), -1)
    faces = np.unique(np.concatenate([half, across, [one, other]]))
    label[faces] = np.arange(len(faces))
    graph = coo_array((np.ones(len(half)), (label[half], label[across])), shape=(len(faces),) * 2)
    parts = connected_components(graph, directed=False)[1]
    return bool(parts[label[one]] == parts[label[other]])
