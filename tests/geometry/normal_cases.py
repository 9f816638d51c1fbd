"""Clouds whose exact normals are known, for the tests and the table of estimated normals."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
import trimesh

from bench import Shape
from bench.geometry.sampling import face_normals, sample_uniform
from bench.plugins.registry import load_plugins, registry

Cloud = tuple[np.ndarray, np.ndarray]  # points and exact normals, both (n, 3)
MESHES: dict[str, Callable[[], trimesh.Trimesh]] = {
    "sphere": lambda: trimesh.creation.icosphere(6),
    "cube": lambda: trimesh.creation.box((2 / 3**0.5,) * 3),
    "torus": lambda: trimesh.creation.torus(0.7, 0.3, 128, 128),
    "plate": lambda: trimesh.creation.box((1.4, 1.4, 0.1)),
}


@functools.cache
def shape(name: str) -> Shape:
    """A mesh by name, or the first test shape of a dataset, in the frame of a case: its radius is 1."""
    if name in MESHES:
        return Shape(name, MESHES[name]()).framed()[0]
    load_plugins([])
    return next(iter(registry().find("dataset", name).cls().shapes("test"))).framed()[0]


def noisy(name: str, count: int, noise: float, seed: int = 0, kind: str = "normal") -> Cloud:
    """Random points of a shape, with noise of a standard deviation per axis, and their normals before the noise."""
    rng = np.random.default_rng(seed)
    mesh = shape(name).mesh
    points, faces = sample_uniform(mesh, count, rng)
    normals = face_normals(mesh)[faces]
    if name == "sphere":
        points = normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    elif shape(name).is_exact:
        points, normals = shape(name).surface.closest(points)
    draw = rng.normal(size=points.shape) if kind == "normal" else rng.laplace(size=points.shape) / 2**0.5
    return points + noise * draw, normals


def rings(ratio: float, count: int = 60, noise: float = 0.0, along: str = "any", seed: int = 0) -> Cloud:
    """A sphere of rings, ``ratio`` times denser along the equator than across; noise along the ray or isotropic."""
    rng = np.random.default_rng(seed)
    theta = (np.arange(count) + 0.5) / count * np.pi
    phi = np.linspace(0, 2 * np.pi, round(2 * count * ratio), endpoint=False)
    theta, phi = np.meshgrid(theta, phi, indexing="ij")
    normals = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1).reshape(-1, 3)
    if along == "ray":
        return normals * (1 + noise * rng.normal(size=(len(normals), 1))), normals
    return normals + noise * rng.normal(size=normals.shape), normals


def scans(name: str, sensor: str, views: int, misrotation: float, misshift: float, seed: int = 0) -> Cloud:
    """Partial scans of a shape, each moved by a small rigid motion, and the normals that move with them."""
    made = shape(name)
    scanner = registry().find("sensor", sensor).cls
    options = {"misrotation": misrotation, "misshift": misshift, "normals": "exact"}
    cloud = scanner(views=views, **options).sense(made, np.random.default_rng(seed))
    return cloud.points, cloud.normals


def plain(points: np.ndarray, k: int) -> np.ndarray:
    """Plane fits to k neighbours, the point itself included, computed naively."""
    from scipy.spatial import cKDTree

    normals = np.empty_like(points)
    tree = cKDTree(points)
    for begin in range(0, len(points), 10_000):
        local = points[tree.query(points[begin : begin + 10_000], k)[1]]
        local = local - local.mean(axis=1, keepdims=True)
        normals[begin : begin + 10_000] = np.linalg.eigh(np.swapaxes(local, 1, 2) @ local)[1][:, :, 0]
    return normals


def degrees(normals: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Angles between unoriented normals."""
    return np.degrees(np.arccos(np.minimum(np.abs(np.einsum("ni,ni->n", normals, truth)), 1)))
