"""One image of surfels, and the gradients of a loss by all its inputs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...learned.compiled.threads import use
from ..renderer.camera import Camera
from .compositing import (
    BY_CENTRE,
    BY_DEPTH,
    BY_FEATURES,
    BY_NORMAL,
    BY_OPACITY,
    BY_PLANE,
    BY_U,
    BY_V,
    FEATURES,
    WEIGHT,
    composite,
    composite_back,
    gathered,
)
from .footprints import Footprints, Surfels, footprints


class Slopes(NamedTuple):
    """Gradients of a loss by surfels, in the world."""

    positions: np.ndarray
    """(n, 3) array"""
    frames: np.ndarray
    """(n, 3, 3) array: by the columns of the frames, each as an independent vector"""
    scales: np.ndarray
    """(n, 2) array"""
    opacities: np.ndarray
    """(n,) array"""
    colors: np.ndarray
    """(n, 3) array"""
    screen: np.ndarray
    """(n,) array: length of the gradient by the position in the plane of the image, in 1 / pixels"""
    weights: np.ndarray
    """(n,) array: not a gradient, but the share of a surfel in the image, in pixels"""


@dataclass(frozen=True, eq=False)
class Rendered:
    """The result of :func:`render`.

    Parameters
    ----------
    maps : (h, w, 9) float64 array
        Sums over the surfels of a pixel, each times its weight: colour (3), normal in the axes of the camera (3),
        1, depth, depth squared.
    light : (h, w) float64 array
        The transmittance of all surfels: 1 minus the sum of the weights.
    seen : Surfels
        In the axes of the camera.
    prints : Footprints
    features : (n, 6) float64 array
        Colours and normals.
    last : (h, w) int64 array
        The end of each pixel in the list of its tile.
    camera : Camera
    """

    maps: np.ndarray
    light: np.ndarray
    seen: Surfels
    prints: Footprints
    features: np.ndarray
    last: np.ndarray
    camera: Camera

    @property
    def image(self) -> np.ndarray:
        """(h, w, 3) array, on black."""
        return self.maps[..., :3]

    @property
    def covered(self) -> np.ndarray:
        """(h, w) array: the sums of the weights."""
        return self.maps[..., FEATURES]

    def back(self, slopes: np.ndarray) -> Slopes:
        """The gradients of a loss, from its slopes (h, w, 9) by the maps."""
        prints, seen = self.prints, self.seen
        known = (prints.table, self.features, prints.starts, prints.members, self.camera.lens(), self.light, self.last)
        of_members = composite_back(*known, np.ascontiguousarray(slopes, dtype=np.float64))
        by = gathered(of_members, prints.members, len(seen.positions))
        fx, fy, skew, _, _ = self.camera.lens()
        x, y, z = seen.positions.T
        positions, frames = np.zeros_like(seen.positions), np.zeros_like(seen.frames)
        scales = np.zeros_like(seen.scales)
        for axis, start in enumerate((BY_U, BY_V)):
            # U = tangent / scale and U_AT = U . position
            inverse, tangent = 1 / seen.scales[:, axis, None], seen.frames[:, :, axis]
            at = by[:, start + 3, None]
            scaled = by[:, start : start + 3] + at * seen.positions
            frames[:, :, axis] = scaled * inverse
            scales[:, axis] = -(scaled * tangent).sum(1) * inverse[:, 0] ** 2
            positions += at * tangent * inverse
        plane = by[:, BY_PLANE, None]
        frames[:, :, 2] = by[:, BY_NORMAL : BY_NORMAL + 3] + plane * seen.positions
        frames[:, :, 2] += by[:, BY_FEATURES + 3 : BY_FEATURES + 6]
        positions += plane * seen.frames[:, :, 2]
        column, row = by[:, BY_CENTRE], by[:, BY_CENTRE + 1]
        positions[:, 0] += column * fx / z
        positions[:, 1] += (column * skew + row * fy) / z
        positions[:, 2] += by[:, BY_DEPTH] - (column * (fx * x + skew * y) + row * fy * y) / z**2
        turn = self.camera.rotation.T
        return Slopes(
            positions @ turn.T,
            turn @ frames,
            scales,
            by[:, BY_OPACITY],
            by[:, BY_FEATURES : BY_FEATURES + 3],
            np.hypot(positions[:, 0], positions[:, 1]) * np.abs(z) / fx,
            by[:, WEIGHT],
        )


def render(surfels: Surfels, colors: np.ndarray, camera: Camera, threads: int = 1) -> Rendered:
    """An image of surfels (Huang et al. 2024, Eq. 4 to 12). Those whose normals point away are not drawn.

    Parameters
    ----------
    surfels : Surfels
        In the world.
    colors : (n, 3) array
    camera : Camera
    threads : int
        For drawing, and for the gradients until the next call; the result does not depend on it.
    """
    use(threads)
    seen = surfels.in_camera(camera)
    prints = footprints(seen, camera)
    features = np.concatenate([colors, seen.frames[:, :, 2]], axis=1)
    size = (camera.width, camera.height)
    maps, light, last = composite(prints.table, features, prints.starts, prints.members, camera.lens(), size)
    return Rendered(maps, light, seen, prints, features, last, camera)
