"""An exact surface and its mesh: which are one shape, and which are not."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest
from trimesh import Trimesh
from trimesh.creation import box, icosphere

from bench.authoring.agreement import disagreements
from bench.geometry.mesh_surface import MeshSurface


class Sphere:
    """The unit sphere, exactly."""

    def sample(self, count, rng):
        points = rng.normal(size=(count, 3))
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        return points, points

    def closest(self, points):
        on = points / np.linalg.norm(points, axis=1, keepdims=True)
        return on, on


@cache
def lump(subdivisions: int) -> Trimesh:
    """A smooth body without any symmetry, at some fineness; the farthest point is near radius 1."""
    mesh = icosphere(subdivisions)
    x, y, z = mesh.vertices.T
    vertices = mesh.vertices * (0.7 + 0.15 * x + 0.1 * np.sin(3 * y + 1) + 0.08 * np.cos(4 * z + x))[:, None]
    return Trimesh(vertices, mesh.faces, process=False)


@cache
def fine() -> MeshSurface:
    """So fine (20,480 faces) that it is the smooth body itself for a coarser mesh."""
    return MeshSurface(lump(5))


MESH = 3  # subdivisions of the mesh that is compared with it


@pytest.mark.parametrize("subdivisions", range(6))
def test_a_sphere_agrees_with_its_tessellations_coarse_and_fine(subdivisions):
    assert disagreements(icosphere(subdivisions), Sphere()) == []


@pytest.mark.parametrize("subdivisions", [2, 3, 4])
def test_a_body_agrees_with_its_tessellations(subdivisions):
    assert disagreements(lump(subdivisions), fine()) == []


def test_a_polyhedron_agrees_with_itself_however_it_is_divided():
    coarse = box((1.2, 1.0, 0.8))
    assert disagreements(coarse, MeshSurface(coarse.subdivide().subdivide())) == []
    assert disagreements(coarse.subdivide(), MeshSurface(coarse)) == []


@dataclass
class Moved:
    """A surface under ``x -> A x + b``, for an A that is orthogonal but for its scale."""

    surface: Any
    A: np.ndarray
    b: np.ndarray | float = 0.0

    @property
    def turn(self) -> np.ndarray:
        return self.A / abs(np.linalg.det(self.A)) ** (1 / 3)

    def sample(self, count, rng):
        points, normals = self.surface.sample(count, rng)
        return points @ self.A.T + self.b, normals @ self.turn.T

    def closest(self, points):
        closest, normals = self.surface.closest((points - self.b) @ np.linalg.inv(self.A).T)
        return closest @ self.A.T + self.b, normals @ self.turn.T


def rotation(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


@pytest.mark.parametrize(
    "moved",
    [
        Moved(fine(), 1.5 * np.eye(3)),
        Moved(fine(), 1.03 * np.eye(3)),
        Moved(fine(), 0.9 * np.eye(3)),
        Moved(fine(), np.eye(3), np.array([0.03, 0, 0])),
        Moved(fine(), np.diag([-1.0, 1, 1])),
        Moved(fine(), rotation(0.2)),
        Moved(fine(), np.eye(3)[[1, 2, 0]]),
    ],
    ids=["larger by half", "larger by 3 %", "smaller", "shifted", "mirrored", "rotated", "axes exchanged"],
)
def test_a_surface_of_another_size_place_or_handedness_is_found_out(moved):
    found = disagreements(lump(MESH), moved)
    assert any("surface.sample" in words and "off the mesh" in words for words in found)
    assert any("surface.closest" in words for words in found)


def test_the_finer_the_mesh_the_less_may_be_off():
    """By the sagitta of an edge: a shift that a coarse mesh hides shows on a fine one."""
    shifted = Moved(Sphere(), np.eye(3), np.array([0.004, 0, 0]))
    assert disagreements(icosphere(2), shifted) == []
    assert disagreements(icosphere(5), shifted)


class Changed:
    """The right surface but for what is given."""

    def __init__(self, sample=None, closest=None):
        self._sample, self._closest = sample, closest

    def sample(self, count, rng):
        return self._sample(count, rng) if self._sample else fine().sample(count, rng)

    def closest(self, points):
        return self._closest(points) if self._closest else fine().closest(points)


def chosen(keep, times=8):
    """Samples that pass a lottery with the probability ``keep(points)``."""

    def sample(count, rng):
        points, normals = fine().sample(times * count, rng)
        at = np.flatnonzero(rng.random(len(points)) < keep(points))[:count]
        assert len(at) == count
        return points[at], normals[at]

    return sample


def with_normals(change, of):
    def made(*args):
        points, normals = of(*args)
        return points, change(points, normals)

    return made


def nearest_sample(points):
    """Points of the surface, but not the closest ones."""
    cloud, normals = fine().sample(60, np.random.default_rng(5))
    at = np.linalg.norm(points[:, None] - cloud, axis=2).argmin(axis=1)
    return cloud[at], normals[at]


def upper_half():
    mesh = lump(5)
    return MeshSurface(Trimesh(mesh.vertices, mesh.faces[mesh.triangles_center[:, 2] > 0], process=False))


SAMPLE, CLOSEST = fine().sample, fine().closest
WRONG = {
    "normals point inwards": (Changed(with_normals(lambda p, n: -n, SAMPLE)), "sample.*point against"),
    "some normals point inwards": (
        Changed(with_normals(lambda p, n: np.where(p[:, :1] > 0.4, -n, n), SAMPLE)),
        "sample.*point against",
    ),
    "normals of another place": (
        Changed(with_normals(lambda p, n: n[:, [1, 2, 0]], SAMPLE)),
        "point against|are not those of the mesh",
    ),
    "normals of closest points inwards": (
        Changed(closest=with_normals(lambda p, n: -n, CLOSEST)),
        "closest.*(point against|are not those of surface.sample)",
    ),
    "normals have no unit length": (Changed(with_normals(lambda p, n: 2 * n, SAMPLE)), "lengths from 2 to 2"),
    "a point is NaN": (Changed(lambda c, rng: (np.full((c, 3), np.nan), np.ones((c, 3)))), "NaN"),
    "too few samples": (Changed(lambda c, rng: SAMPLE(c - 1, rng)), r"shape \(4000, 3\), got \(3999, 3\)"),
    "samples cover half": (Changed(chosen(lambda p: p[:, 2] > 0)), "sample: leaves out at least [345]. %"),
    "samples crowd": (Changed(chosen(lambda p: np.exp(3 * p[:, 0] - 3), 60)), "leaves out at least|not uniform"),
    "closest covers half": (upper_half(), "closest: .*of the mesh is away from the surface"),
    "closest is not the closest": (Changed(closest=nearest_sample), "closest: moves|there are closer points"),
    "closest does not project": (Changed(closest=lambda p: (p, CLOSEST(p)[1])), "closest: .*off the mesh"),
    "closest is a little off": (
        Changed(closest=lambda p: (CLOSEST(p)[0] + [0.001, 0, 0], CLOSEST(p)[1])),
        "closest: moves",
    ),
    "closest forgets a point": (Changed(closest=lambda p: tuple(a[1:] for a in CLOSEST(p))), "expected points of"),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
def test_a_wrong_surface_is_found_out_and_reported(what):
    surface, words = WRONG[what]
    assert re.search(words, "\n".join(disagreements(lump(MESH), surface)))


def test_what_is_said_names_share_and_distance():
    (words, *_) = disagreements(icosphere(4), Moved(Sphere(), 1.5 * np.eye(3)))
    assert words.startswith("surface.sample: 100 % of its points are off the mesh, up to 0.5")
    assert "of the radius; expected at most" in words
