"""Cameras that view parts of a cloud from outside."""

from __future__ import annotations

import numpy as np

from ..fitting.views import Lights
from ..renderer.camera import Camera

AROUND = 100  # neighbours whose mean normal is the viewing direction of a point
WOBBLE = 0.01  # random change of that direction
SUN, AMBIENT = 0.9, 0.3


def close_ups(
    points: np.ndarray, normals: np.ndarray, count: int, pixels: int, span: float, rng: np.random.Generator
) -> tuple[list[Camera], Lights]:
    """Cameras that view points far from each other, along the normals there; each has three lights.

    The lights are red, green and blue, at right angles to each other, the first along the view, as those of the images
    of a rig. (As released: farthest points of the cloud, mean normals of 100 neighbours.)

    Parameters
    ----------
    points, normals : (n, 3) arrays
    count : int
    pixels : int
        Along each side of the images.
    span : float
        Width of the field of view, in the unit of the points.
    rng : numpy Generator
    """
    from scipy.spatial import cKDTree

    from bench.geometry.farthest import farthest_points

    # From another point each time: the first one is random.
    order = np.roll(np.arange(len(points)), -int(rng.integers(len(points))))
    targets = points[order[farthest_points(points[order], min(count, len(points)), taken=1)]]
    _, around = cKDTree(points).query(targets, min(AROUND, len(points)))
    outward = normals[np.asarray(around).reshape(len(targets), -1)].mean(axis=1)
    outward += WOBBLE * rng.normal(size=outward.shape)
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)
    # Far away, with a long lens, as released: seven radii of the cloud.
    distance = 7 * np.linalg.norm(points - points.mean(axis=0), axis=1).max()
    focal = pixels * distance / span
    cameras, directions = [], []
    for target, out in zip(targets, outward, strict=True):
        up = rng.normal(size=3)
        cameras.append(Camera.looking_at(target + distance * out, target, up, focal, pixels, pixels))
        right, down, _ = cameras[-1].rotation
        directions.append([out, right, down])
    colors = np.tile(SUN * np.eye(3), (len(cameras), 1, 1))
    return cameras, Lights(np.array(directions), colors, np.full((len(cameras), 3), AMBIENT))
