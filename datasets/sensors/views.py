"""Positions of scanners."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Pose(NamedTuple):
    """A scanner's position and axes."""

    center: np.ndarray
    """(3,) array"""
    axes: np.ndarray
    """(3, 3) array, its rows: right, down and forward, of unit length"""


def fibonacci_sphere(count: int) -> np.ndarray:
    """``count`` evenly spread unit vectors: a (count, 3) array."""
    index = np.arange(count)
    z = 1 - (2 * index + 1) / count
    around = index * np.pi * (3 - np.sqrt(5))  # the golden angle
    ring = np.sqrt(1 - z**2)
    return np.stack([ring * np.cos(around), ring * np.sin(around), z], axis=1)


def turntable(count: int, elevation: float, start: float) -> np.ndarray:
    """``count`` unit vectors in equal steps around z, at an elevation, from the azimuth ``start``, in degrees."""
    around = np.radians(start) + 2 * np.pi * np.arange(count) / count
    up = np.full(count, np.radians(elevation))
    return np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], axis=1)


def rotation_about(axis: np.ndarray, angle: float) -> np.ndarray:
    """The (3, 3) rotation matrix about a unit vector by an angle in radians (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def look_at(center: np.ndarray, target: np.ndarray) -> Pose:
    """A pose at ``center`` that looks at ``target``, upright where that is possible."""
    forward = (target - center) / np.linalg.norm(target - center)
    up = np.array([0.0, 0.0, 1.0]) if abs(forward[2]) < 0.999 else np.array([0.0, 1.0, 0.0])
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    return Pose(center, np.stack([right, np.cross(forward, right), forward]))
