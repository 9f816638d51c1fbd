"""Small sources with several parts or with defects, for the tests of registration."""

from __future__ import annotations

import numpy as np
from trimesh import Trimesh
from trimesh.creation import box, icosphere

from bench import PointCloud
from bench.geometry.mesh_surface import MeshSurface
from bench.geometry.subdivision import divided


def bar(low, high, rounds=3):
    """The vertices and faces of a closed box between two corners, with subdivided faces."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    cube = box(extents=high - low)
    return divided(cube.vertices + (low + high) / 2, cube.faces, rounds)


def joined(*meshes):
    """Several meshes as one, not welded."""
    firsts = np.cumsum([0] + [len(vertices) for vertices, _ in meshes])
    faces = np.concatenate([faces + first for (_, faces), first in zip(meshes, firsts[:-1], strict=True)])
    return Trimesh(np.concatenate([vertices for vertices, _ in meshes]), faces, process=False)


def stool(rounds=3):
    """A board on two legs that reach into it: three closed parts."""
    return joined(
        bar((-0.6, -0.3, 0.2), (0.6, 0.3, 0.35), rounds),
        bar((-0.5, -0.1, -0.6), (-0.35, 0.1, 0.3), rounds),
        bar((0.35, -0.1, -0.6), (0.5, 0.1, 0.3), rounds),
    )


def with_accidents():
    """A ball whose upper half has its own vertices, with a sliver, a face of zero area and two unused vertices."""
    ball = icosphere(subdivisions=2)
    V, F = np.array(ball.vertices), np.array(ball.faces)
    up = ball.triangles_center[:, 2] > 0
    F[up] += len(V)
    a, b = np.concatenate([V, V])[F[0, :2]]
    extra = np.array([(a + b) / 2 + 1e-7 * a, [3.0, 0, 0], [0, 0, -2]])
    n = 2 * len(V)
    F = np.concatenate([F, [[F[0, 0], F[0, 1], n], [F[0, 0], F[0, 0], F[0, 1]]]])
    return Trimesh(np.concatenate([V, V, extra]), F, process=False)


def turn(degrees, axis=(1.0, 2.0, 3.0)):
    """A rotation matrix."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(np.radians(degrees) * np.array(axis) / np.linalg.norm(axis)).as_matrix()


def cloud_of(mesh, count=2000, normals=True):
    """Points of a mesh."""
    points, directions = MeshSurface(mesh).sample(count, np.random.default_rng(5))
    return PointCloud(points, directions if normals else None)


def moved(mesh, linear, shift=(0.0, 0, 0)):
    """A mesh under an affine map."""
    return Trimesh(mesh.vertices @ np.asarray(linear).T + shift, mesh.faces, process=False)


def far_from(mesh, target, count=3000):
    """The larger of the two mean distances of points of one mesh to the other."""
    pairs = ((mesh, target), (target, mesh))
    return max(np.linalg.norm(p - MeshSurface(b).closest(p)[0], axis=1).mean() for a, b in pairs
               for p in [cloud_of(a, count).points])  # fmt: skip
