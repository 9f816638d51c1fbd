"""The plain image of a mesh: at each pixel the nearest face, with a depth buffer."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numba import njit

from .scene import NEAR, Scene


class Seen(NamedTuple):
    """The visible face of each pixel."""

    face: np.ndarray
    """(h, w) int32 array: number of the face, -1 for the background"""
    depth: np.ndarray
    """(h, w) float64 array: infinite for the background"""
    weights: np.ndarray
    """(h, w, 3) float64 array: the pixel's barycentric coordinates in the face on the screen"""


def rasterise(scene: Scene) -> Seen:
    """The nearest face at the centre of every pixel. Both sides are drawn; of equal depths the first face wins."""
    return Seen(*_rasterise(scene.screen, scene.faces, scene.width, scene.height))


@dataclass(frozen=True, eq=False)
class HardDrawn:
    """A plain image. Its gradient is that of the colours only; subclasses add that by moving vertices."""

    scene: Scene
    seen: Seen
    image: np.ndarray

    @classmethod
    def of(cls, scene: Scene, **more: float) -> Self:
        """Draw a scene."""
        seen = rasterise(scene)
        covered = seen.face >= 0
        image = np.zeros((scene.height, scene.width, 4))
        image[covered, :3] = scene.colors[seen.face[covered]]
        image[covered, 3] = 1
        return cls(scene, seen, image, **more)

    def backward(self, slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See :class:`.scene.Drawn`."""
        covered = self.seen.face >= 0
        faces, count = self.seen.face[covered], len(self.scene.faces)
        by_channel = [np.bincount(faces, slope[covered, channel], count) for channel in range(3)]
        return self.motion(slope), np.stack(by_channel, axis=1)

    def motion(self, slope: np.ndarray) -> np.ndarray:
        """The gradient (v, 3) by the vertices on the screen, with constant colours: none."""
        return np.zeros_like(self.scene.screen)


@njit(cache=True, error_model="numpy")
def span(low, high, count):
    """The first and last of ``count`` pixels whose centres lie between two coordinates; last < first for none."""
    first = min(max(math.ceil(low - 0.5), 0.0), float(count))
    last = max(min(math.floor(high - 0.5), count - 1.0), -1.0)
    return int(first), int(last)


@njit(cache=True, error_model="numpy")
def _rasterise(screen, faces, width, height):
    seen = np.full((height, width), -1, np.int32)
    nearest = np.zeros((height, width))  # inverse depth: linear on the screen
    weights = np.zeros((height, width, 3))
    for f in range(len(faces)):
        ax, ay, az = screen[faces[f, 0]]
        bx, by, bz = screen[faces[f, 1]]
        cx, cy, cz = screen[faces[f, 2]]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if min(az, bz, cz) < NEAR or not abs(area) > 0:
            continue
        left, right = span(min(ax, bx, cx), max(ax, bx, cx), width)
        top, bottom = span(min(ay, by, cy), max(ay, by, cy), height)
        for i in range(top, bottom + 1):
            y = i + 0.5
            for j in range(left, right + 1):
                x = j + 0.5
                u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                w = ((ax - x) * (by - y) - (ay - y) * (bx - x)) / area
                if u < 0 or v < 0 or w < 0:
                    continue
                inverse = u / az + v / bz + w / cz
                if inverse > nearest[i, j]:
                    nearest[i, j], seen[i, j] = inverse, f
                    weights[i, j, 0], weights[i, j, 1], weights[i, j, 2] = u, v, w
    return seen, 1 / nearest, weights
