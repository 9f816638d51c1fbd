"""The base of all scanners: scans from several views, registered with some error, and merged."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from bench import BadInput, PointCloud, Shape
from bench.geometry.normals import estimate_normals

from ..common.rotations import random_rotation
from .checks import expect, expect_choice, expect_count, expect_length
from .scene import Scene
from .spoiling import random_directions
from .views import Pose, fibonacci_sphere, look_at, rotation_about, turntable

RIGS = ("sphere", "turntable")
NORMALS = ("pca", "exact", "none")


class Scan(NamedTuple):
    """The measurements of one view."""

    points: np.ndarray
    """(n, 3) array, as measured"""
    hits: np.ndarray
    """(n, 3) array: the points of the mesh that were measured"""
    faces: np.ndarray
    """(n,) int array, of the hits"""
    center: np.ndarray
    """(3,) array: where the scanner stood"""
    turn: np.ndarray
    """(3, 3) array: the rotation by registration"""

    @classmethod
    def of(cls, pose: Pose, points: np.ndarray, hits: np.ndarray, faces: np.ndarray) -> Scan:
        """The points as a scanner at ``pose`` measured them."""
        return cls(points, hits, faces, pose.center, np.eye(3))

    def at(self, chosen: np.ndarray) -> Scan:
        """Some of the measurements, by index."""
        return self._replace(points=self.points[chosen], hits=self.hits[chosen], faces=self.faces[chosen])


@dataclass(frozen=True)
class Scanner:
    """Base of the scanners; a subclass defines :meth:`measure`. Its fields are the common parameters.

    The number of points depends on the shape. Lengths are relative to the bounding-sphere radius, which is 1 in the
    frame of a case.
    """

    views: int = 8  # number of positions of the scanner
    rig: Literal["sphere", "turntable"] = "sphere"  # positions all around (turned at random), or in a ring around z
    elevation: float = 20.0  # of the turntable's ring, in degrees above the horizon
    distance: float = 3.0  # of the scanner from the middle of the shape, in bounding-sphere radii; more than 1
    misrotation: float = 0.0  # degrees by which each scan is turned, about its centroid and a random axis
    misshift: float = 0.0  # standard deviation in x, y, z of the shift of each scan, relative to the radius
    max_points: int = 20_000  # larger clouds are reduced to a random subset of this size; 0 is no limit
    normals: Literal["pca", "exact", "none"] = "pca"  # estimated and turned to the scanner, exact at the hit, or none

    def __post_init__(self) -> None:
        expect_count("views", self.views)
        expect_choice("rig", self.rig, RIGS)
        expect(-90 <= self.elevation <= 90, "elevation", "-90 to 90", self.elevation)
        expect(1.01 <= self.distance < np.inf, "distance", "at least 1.01: outside the bounding sphere", self.distance)
        expect(0 <= self.misrotation <= 180, "misrotation", "0 to 180", self.misrotation)
        expect_length("misshift", self.misshift)
        expect(self.max_points == 0 or self.max_points >= 3, "max_points", "0, or at least 3", self.max_points)
        expect_choice("normals", self.normals, NORMALS)

    def measure(self, scene: Scene, pose: Pose, rng: np.random.Generator) -> Scan:
        """The scan from one position."""
        raise NotImplementedError

    def poses(self, scene: Scene, rng: np.random.Generator) -> list[Pose]:
        """The positions, all looking at the middle of the shape."""
        if self.rig == "turntable":
            directions = turntable(self.views, self.elevation, rng.uniform(0, 360))
        else:
            directions = fibonacci_sphere(self.views) @ random_rotation(rng).T
        return [look_at(scene.center + self.distance * scene.radius * d, scene.center) for d in directions]

    def sense(self, shape: Shape, rng: np.random.Generator) -> PointCloud:
        """The merged scans of a shape.

        Raises
        ------
        BadInput
            If no view measures anything.
        """
        placing, registering, measuring, thinning = rng.spawn(4)
        scene = Scene(shape.mesh)
        scans = []
        for pose in self.poses(scene, placing):
            scan, error = self.measure(scene, pose, *measuring.spawn(1)), *registering.spawn(1)
            if len(scan.points):
                scans.append(self._misregistered(scan, error))
        found = sum(len(scan.points) for scan in scans)
        least = 3 if self.normals == "pca" else 1  # fewer points do not determine a plane
        if found < least:
            name = re.sub(r"(?<!^)(?=[A-Z])", "_", type(self).__name__).lower()
            raise BadInput(
                f"sensor {name}: {found} points of {shape.id} were measured from {self.views} views, expected at least "
                f"{least}; try more views, more rays or a larger distance"
            )
        scans = self._thinned(scans, thinning)
        return PointCloud(np.concatenate([scan.points for scan in scans]), self._normals(scans, scene, shape))

    def _misregistered(self, scan: Scan, rng: np.random.Generator) -> Scan:
        """The scan turned about its centroid, and shifted."""
        axis, shift = random_directions(1, rng)[0], self.misshift * rng.normal(size=3)
        if not self.misrotation and not self.misshift:
            return scan
        turn = rotation_about(axis, np.radians(self.misrotation))
        centroid = scan.points.mean(axis=0)
        points = (scan.points - centroid) @ turn.T + centroid + shift
        return scan._replace(points=points, turn=turn)

    def _thinned(self, scans: list[Scan], rng: np.random.Generator) -> list[Scan]:
        """A random subset of all measurements together, if there are more than ``max_points``."""
        counts = [len(scan.points) for scan in scans]
        if not 0 < self.max_points < sum(counts):
            return scans
        chosen = np.sort(rng.permutation(sum(counts))[: self.max_points])
        first = np.cumsum([0, *counts])
        parts = np.split(chosen, np.searchsorted(chosen, first[1:-1]))
        thinned = [scan.at(part - start) for scan, part, start in zip(scans, parts, first[:-1], strict=True)]
        return [scan for scan in thinned if len(scan.points)]

    def _normals(self, scans: list[Scan], scene: Scene, shape: Shape) -> np.ndarray | None:
        if self.normals == "none":
            return None
        if self.normals == "pca":
            normals = estimate_normals(np.concatenate([scan.points for scan in scans])).normals
            toward = np.concatenate([scan.center - scan.points for scan in scans])
            away = np.einsum("ni,ni->n", normals, toward) < 0
            return np.where(away[:, None], -normals, normals)
        return np.concatenate([self._exact(scan, scene, shape) @ scan.turn.T for scan in scans])

    def _exact(self, scan: Scan, scene: Scene, shape: Shape) -> np.ndarray:
        """The normals where the surface was hit: the exact ones if the shape has them, otherwise of the triangles."""
        return shape.surface.closest(scan.hits)[1] if shape.is_exact else scene.normals[scan.faces]


def survives_grazing(cosine: np.ndarray, lost: float, safe: float, rng: np.random.Generator) -> np.ndarray:
    """Whether measurements at grazing angles survive: none below ``lost``, all above ``safe``, linear between."""
    return rng.random(len(cosine)) < np.clip((cosine - lost) / max(safe - lost, 1e-12), 0, 1)
