"""Small scenes of splats, and cameras in general position."""

from __future__ import annotations

import numpy as np

from bench.methods.splatting.renderer.camera import Camera


def crooked_camera(width=24, height=20, distance=3.0):
    """A rotated camera with skew, different focal lengths and an off-centre principal point."""
    camera = Camera.looking_at(np.array([0.4, -0.7, -distance]), np.zeros(3), np.array([0.2, 1.0, 0.1]), 1.0, 1, 1)
    intrinsics = np.array([[1.3 * width, 0.8, 0.47 * width], [0, 1.2 * width, 0.55 * height], [0, 0, 1]])
    return Camera(camera.extrinsics, intrinsics, width, height)


def random_splats(count, seed=0, channels=3):
    """Points in a ball, normals mostly towards the camera, widths and colours: all different."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.8, 0.8, (count, 3))
    normals = rng.normal(size=(count, 3)) + [0, 0, -1.5]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return points, normals, rng.uniform(0.1, 1.0, (count, channels)), rng.uniform(0.05, 0.2, count)


def ball(count, width=2.0):
    """Points of the unit sphere, evenly spread along a spiral, with their normals, colours and widths."""
    k = np.arange(count) + 0.5
    z, angle = 1 - 2 * k / count, k * np.pi * (3 - np.sqrt(5))
    around = np.sqrt(1 - z * z)
    points = np.column_stack([around * np.cos(angle), around * np.sin(angle), z])
    colors = 0.1 + 0.9 * np.clip(points @ np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]]), 0, 1)
    return points, points.copy(), colors, np.full(count, width / np.sqrt(count))
