"""The gradient of OpenDR: the image's own differences times the motion of the surface (Loper and Black 2014)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from .hard import HardDrawn


@dataclass(frozen=True, eq=False)
class DifferencesDrawn(HardDrawn):
    """A plain image that moves with its surface: dI = -(dI/dx) dx, where dI/dx are differences of neighbouring pixels.

    A central difference is the mean of those to both sides, so each pair of neighbours counts half for either pixel.
    The motion is that of the surface seen at the pixel; at an occlusion boundary it is, for both pixels, that of the
    surface in front: what lies behind it is uncovered or hidden, but does not move the boundary.
    """

    gap: float = 0.1  # neighbours whose depths differ by more lie on two surfaces

    def motion(self, slope: np.ndarray) -> np.ndarray:
        """The gradient (v, 3) by the vertices on the screen; depths have none."""
        gradient = np.zeros_like(self.scene.screen)
        _differences(self.scene.faces, *self.seen, self.image, slope, self.gap, gradient)
        return gradient


@njit(cache=True, error_model="numpy")
def _differences(faces, seen, depth, weights, image, slope, gap, gradient):
    height, width = seen.shape
    for axis in range(2):
        for i in range(height - axis):
            for j in range(width - 1 + axis):
                k, m = i + axis, j + 1 - axis  # the neighbour
                here, there = seen[i, j], seen[k, m]
                if here == there:  # flat colours: no difference
                    continue
                of_here, of_there = 0.0, 0.0
                for c in range(image.shape[2]):
                    difference = image[k, m, c] - image[i, j, c]
                    of_here -= 0.5 * slope[i, j, c] * difference
                    of_there -= 0.5 * slope[k, m, c] * difference
                if there < 0 or (here >= 0 and depth[k, m] - depth[i, j] > gap):
                    of_here, of_there = of_here + of_there, 0.0
                elif here < 0 or depth[i, j] - depth[k, m] > gap:
                    of_here, of_there = 0.0, of_here + of_there
                for corner in range(3):
                    if here >= 0:
                        gradient[faces[here, corner], axis] += weights[i, j, corner] * of_here
                    if there >= 0:
                        gradient[faces[there, corner], axis] += weights[k, m, corner] * of_there
