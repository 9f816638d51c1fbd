"""Outlines by formula: blobs of a few waves, polygons with round corners, stars."""

from __future__ import annotations

import numpy as np

from .pieces import polygon, spline

WAVES = 8  # most waves around a blob
LEAST = 0.35  # least radius of a blob, relative to its mean


def blob(rng: np.random.Generator) -> np.ndarray:
    """A smooth body: a positive radius of up to eight waves over the angle, squeezed in one direction."""
    angles = np.linspace(0, 2 * np.pi, 12 * WAVES, endpoint=False)
    k = np.arange(2, WAVES + 1)
    heights = rng.normal(size=len(k)) / k ** rng.uniform(0.3, 1.2)
    waves = np.cos(np.outer(angles, k) + rng.uniform(0, 2 * np.pi, len(k))) @ heights
    radius = 1 + waves * min(rng.uniform(0.3, 0.6) / np.abs(waves).max(), (1 - LEAST) / max(-waves.min(), 1e-9))
    points = radius[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return spline(_turned(points * [1, rng.uniform(0.6, 1)], rng))


def rounded(rng: np.random.Generator) -> np.ndarray:
    """A polygon of three to nine corners, all rounded by the same share."""
    n = int(rng.integers(3, 10))
    angles = 2 * np.pi * (np.arange(n) + rng.uniform(-0.25, 0.25, n)) / n
    corners = rng.uniform(0.75, 1.0, n)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return polygon(_turned(corners * [1, rng.uniform(0.6, 1)], rng), rng.uniform(0.2, 0.7))


def star(rng: np.random.Generator, sharp: bool) -> np.ndarray:
    """A star of four to eight tips, sharp or round."""
    n = int(rng.integers(4, 9))
    angles = np.pi * (np.arange(2 * n) + rng.uniform(-0.12, 0.12, 2 * n)) / n
    radii = np.where(np.arange(2 * n) % 2, rng.uniform(0.4, 0.65), 1.0) * rng.uniform(0.92, 1.08, 2 * n)
    corners = radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return polygon(_turned(corners, rng), 0.0 if sharp else rng.uniform(0.25, 0.6))


def _turned(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    angle = rng.uniform(0, 2 * np.pi)
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, s], [-s, c]])
