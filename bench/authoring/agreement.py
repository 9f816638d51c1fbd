"""Check that the exact surface a dataset gives with a mesh is the surface of that mesh.

A mesh deviates from its smooth surface by the rise of the arcs above their chords. An edge of length h at which two
faces meet under the angle a (0 where they are flat) stands for an arc of about that angle, which rises h/2 tan(a/4)
above its chord. The tolerance between surface and mesh thus follows from the mesh: small for a fine tessellation,
larger for a coarse one. A surface of another size, place or handedness is detected with any tessellation.

All lengths are in the frame of a case, in which the farthest vertex is at radius 1.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InvalidOutput
from ..geometry.mesh_surface import MeshSurface
from ..geometry.sampling import sample_uniform
from ..seeds import generator

if TYPE_CHECKING:
    from trimesh import Trimesh

    from ..contract.shape import Surface

SAMPLES = 4000  # of the surface
QUERIES = 1000  # points whose closest points are computed
REFERENCE = 40_000  # samples of the mesh: the expected distribution of the surface's own
CELLS = 40
# Of all shipped shapes no sample is farther off than 2.5 times the rise above a chord, and none farther than h/4.
RISES = 4.0
EDGES = 1 / 3
LEAST = 2e-4  # where the mesh is flat
EXACT = 1e-4  # tolerance of the closest point of a point on the surface
SHARE = 0.01  # of the samples that may be out of tolerance: creases, tips cut off by the tessellation
UNEVEN = 0.15  # tolerated share of misplaced samples; chance alone gives 0.04
ANGLE = np.radians(15)  # between a normal and the face's, beyond the angles at which the faces around meet


@dataclass(frozen=True)
class _Truth:
    """A mesh, and the tolerances for the surface it approximates."""

    mesh: Trimesh

    @cached_property
    def surface(self) -> MeshSurface:
        return MeshSurface(self.mesh)

    @cached_property
    def bends(self) -> np.ndarray:
        """(f,) angles: the largest under which faces meet at an edge that a face touches."""
        faces = np.asarray(self.mesh.faces)
        at_face = np.zeros(len(faces))
        np.maximum.at(at_face, self.mesh.face_adjacency.ravel(), np.repeat(self.mesh.face_adjacency_angles, 2))
        at_vertex = np.zeros(len(self.mesh.vertices))
        np.maximum.at(at_vertex, faces.ravel(), np.repeat(at_face, 3))
        return at_vertex[faces].max(axis=1)

    @cached_property
    def tolerances(self) -> np.ndarray:
        """(f,) lengths: how far the surface may be from each face."""
        corners = np.asarray(self.mesh.vertices)[self.mesh.faces]
        edges = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
        return np.minimum(RISES * edges / 2 * np.tan(self.bends / 4), EDGES * edges) + LEAST


def disagreements(mesh: Trimesh, surface: Surface) -> list[str]:
    """The differences between ``surface`` and the surface of ``mesh``, one sentence each; none if they agree.

    Parameters
    ----------
    mesh : Trimesh with faces, in the frame of a case (farthest vertex at radius 1)
    surface : Surface, in the same frame
    """
    found = []
    try:
        for sentence in _sentences(_Truth(mesh), surface):
            if sentence:
                found.append(sentence)
    except InvalidOutput as error:  # no points and normals: nothing else can be compared
        found.append(str(error))
    return found


def _sentences(truth: _Truth, surface: Surface) -> Iterator[str | None]:
    """One for each property compared, or None where it agrees."""
    rng = generator("agreement")
    points, normals = _arrays("surface.sample", surface.sample(SAMPLES, rng), SAMPLES)
    yield _off_the_mesh(truth, points, "surface.sample")
    yield _turned_normals(truth, points, normals, "surface.sample")
    yield _uneven(truth, points, rng)
    yield _not_idempotent(surface, points[:QUERIES], normals[:QUERIES])
    yield from _closest_to_mesh(truth, surface, rng)
    yield from _closest_from_afar(truth, surface, points[:QUERIES], normals[:QUERIES], rng)


def _arrays(what: str, given: tuple[np.ndarray, np.ndarray], count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) and unit normals (n, 3) returned by a surface; :class:`InvalidOutput` if they are not."""
    points, normals = (np.asarray(array, dtype=np.float64) for array in given)
    for name, array in (("points", points), ("normals", normals)):
        if array.shape != (count, 3):
            raise InvalidOutput(f"{what}: expected {name} of the shape ({count}, 3), got {array.shape}")
        if not np.isfinite(array).all():
            raise InvalidOutput(f"{what}: some {name} are NaN or infinite")
    lengths = np.linalg.norm(normals, axis=1)
    if np.abs(lengths - 1).max() > 1e-5:
        raise InvalidOutput(f"{what}: normals have lengths from {lengths.min():.3g} to {lengths.max():.3g}; expected 1")
    return points, normals


def _closest(surface: Surface, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return _arrays("surface.closest", surface.closest(points), len(points))


def _off_the_mesh(truth: _Truth, points: np.ndarray, what: str) -> str | None:
    at = truth.surface.project(points)
    return _beyond(at.distance, truth.tolerances[at.faces], f"{what}: %s of its points are off the mesh")


def _beyond(distances: np.ndarray, tolerances: np.ndarray | float, what: str) -> str | None:
    """A sentence where more than a hundredth of ``distances`` is beyond its tolerance."""
    beyond = distances > tolerances
    if beyond.mean() <= SHARE:
        return None
    worst = np.argmax(distances - tolerances)
    allowed = np.broadcast_to(tolerances, distances.shape)[worst]
    share = f"{100 * beyond.mean():.0f} %"
    return f"{what % share}, up to {distances[worst]:.2g} of the radius; expected at most {allowed:.2g}"


def _turned_normals(truth: _Truth, points: np.ndarray, normals: np.ndarray, what: str) -> str | None:
    faces = truth.surface.project(points).faces
    cosines = np.einsum("ni,ni->n", normals, truth.surface.normals[faces])
    against = (cosines < 0).mean()
    if against > SHARE:
        return f"{what}: {100 * against:.0f} % of the normals point against those of the mesh's faces"
    beyond = np.arccos(np.clip(cosines, -1, 1)) > truth.bends[faces] + ANGLE
    if beyond.mean() > SHARE:
        return f"{what}: {100 * beyond.mean():.0f} % of the normals are not those of the mesh's faces there"
    return None


def _uneven(truth: _Truth, points: np.ndarray, rng: np.random.Generator) -> str | None:
    """Compare the counts of surface and mesh samples in cells around points spread over the mesh."""
    from scipy.spatial import cKDTree

    reference, _ = sample_uniform(truth.mesh, REFERENCE, rng)
    cells = cKDTree(_spread(reference[:2000], CELLS))
    expected, counted = (np.bincount(cells.query(p)[1], minlength=CELLS) / len(p) for p in (reference, points))
    left_out = expected[(counted < 0.1 * expected) & (expected > 20 / len(points))].sum()
    if left_out > 0:
        return f"surface.sample: leaves out at least {100 * left_out:.0f} % of the mesh's area"
    moved = np.abs(expected - counted).sum() / 2
    if moved > UNEVEN:
        return f"surface.sample: is not uniform by area: {100 * moved:.0f} % of the samples should be elsewhere"
    return None


def _spread(points: np.ndarray, count: int) -> np.ndarray:
    """``count`` of ``points`` (n, 3), by farthest-point sampling."""
    chosen = [0]
    distances = np.full(len(points), np.inf)
    for _ in range(count - 1):
        distances = np.minimum(distances, np.linalg.norm(points - points[chosen[-1]], axis=1))
        chosen.append(int(distances.argmax()))
    return points[chosen]


def _not_idempotent(surface: Surface, points: np.ndarray, normals: np.ndarray) -> str | None:
    """A point of the surface must be its own closest point, with the normal it was sampled with."""
    closest, there = _closest(surface, points)
    moved = np.linalg.norm(closest - points, axis=1)
    sentence = _beyond(moved, EXACT, "surface.closest: moves %s of the points that surface.sample gave")
    if sentence is None and (np.einsum("ni,ni->n", there, normals) < np.cos(ANGLE)).mean() > SHARE:
        return "surface.closest: its normals are not those of surface.sample at the same points"
    return sentence


def _closest_to_mesh(truth: _Truth, surface: Surface, rng: np.random.Generator) -> list[str | None]:
    """Points of the mesh must be close to the surface."""
    points, faces = sample_uniform(truth.mesh, QUERIES, rng)
    closest, normals = _closest(surface, points)
    distances = np.linalg.norm(closest - points, axis=1)
    far = _beyond(distances, truth.tolerances[faces], "surface.closest: %s of the mesh is away from the surface")
    return [far, None if far else _turned_normals(truth, closest, normals, "surface.closest")]


def _closest_from_afar(
    truth: _Truth, surface: Surface, points: np.ndarray, normals: np.ndarray, rng: np.random.Generator
) -> list[str | None]:
    """Points near the surface and anywhere in the box must be equally far from surface and mesh."""
    beside = points + rng.normal(scale=0.05, size=(len(points), 1)) * normals
    queries = np.concatenate([beside, rng.uniform(-1.1, 1.1, size=(QUERIES // 4, 3))])
    closest, _ = _closest(surface, queries)
    at = truth.surface.project(queries)
    distances = np.linalg.norm(closest - queries, axis=1)
    off = _off_the_mesh(truth, closest, "surface.closest")
    farther = _beyond(
        distances - at.distance, truth.tolerances[at.faces], "surface.closest: there are closer points for %s"
    )
    return [off, farther]
