"""The gradient of the neural mesh renderer: edges that move along rows and columns (Kato et al. 2018)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from .hard import HardDrawn, span


@dataclass(frozen=True, eq=False)
class ScanLineDrawn(HardDrawn):
    """A plain image whose pixels are assumed to change linearly until an edge has moved over them.

    If an edge of a visible face crosses a row, each pixel of the row outside the face would get the face's colour
    if the edge moved there, and each pixel inside would get the colour next to the edge. The change of the
    loss, divided by the distance, is the derivative by the crossing, if the move lowers the loss, and zero if not; the
    ends of the edge share it as they move the crossing. The same for columns.

    Unlike in the publication, pixels whose surface is nearer to the camera by ``gap`` are left out, as the face would
    move behind them. Distances count at least half a pixel.
    """

    gap: float = 0.05  # the face does not change pixels that are nearer to the camera by more

    def motion(self, slope: np.ndarray) -> np.ndarray:
        """The gradient (v, 3) by the vertices on the screen; depths have none."""
        gradient = np.zeros_like(self.scene.screen)
        visible = np.zeros(len(self.scene.faces), dtype=np.bool_)
        visible[self.seen.face[self.seen.face >= 0]] = True
        for axis in range(2):
            # A scan line is a row of the arrays: columns are rows of the transposed image.
            face, depth, image, loss = (
                np.ascontiguousarray(array.swapaxes(0, 1)) if axis else array
                for array in (self.seen.face, self.seen.depth, self.image, slope)
            )
            _scan(self.scene.screen, self.scene.faces, visible, axis, face, depth, image, loss, self.gap, gradient)
        return gradient


@njit(cache=True, error_model="numpy")
def _scan(screen, faces, visible, axis, seen, depth, image, slope, gap, gradient):
    """Add the derivatives by coordinate ``axis`` of the vertices; lines are rows of the arrays."""
    lines, across = 1 - axis, seen.shape[1]
    for f in range(len(faces)):
        if not visible[f]:
            continue
        for k in range(3):
            a, b, opposite = faces[f, k], faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
            along = screen[b, lines] - screen[a, lines]
            first, last = span(
                min(screen[a, lines], screen[b, lines]), max(screen[a, lines], screen[b, lines]), len(seen)
            )
            if along == 0:
                continue
            # Where the extended edge passes the third corner: the face lies on the corner's side.
            t = (screen[opposite, lines] - screen[a, lines]) / along
            passing = screen[a, axis] + t * (screen[b, axis] - screen[a, axis])
            outwards = 1 if screen[opposite, axis] < passing else -1
            for line in range(first, last + 1):
                t = (line + 0.5 - screen[a, lines]) / along
                crossing = screen[a, axis] + t * (screen[b, axis] - screen[a, axis])
                if not -1 <= crossing <= across + 1:
                    continue
                inner = math.ceil(crossing - 0.5) - 1 if outwards > 0 else math.floor(crossing - 0.5) + 1
                if inner < 0 or inner >= across or seen[line, inner] != f:
                    continue
                of_line = seen[line], depth[line], image[line], slope[line]
                by_crossing = _by_crossing(f, crossing, inner, outwards, of_line, gap)
                gradient[a, axis] += (1 - t) * by_crossing
                gradient[b, axis] += t * by_crossing


@njit(cache=True, error_model="numpy")
def _by_crossing(f, crossing, inner, outwards, of_line, gap):
    """The derivative by the place where an edge of face ``f`` crosses a line of pixels."""
    seen, depth, image, slope = of_line
    across, channels = image.shape
    total = 0.0
    outer = inner + outwards
    j = outer
    while 0 <= j < across:
        if not depth[j] < depth[inner] - gap:
            change = 0.0
            for c in range(channels):
                change += slope[j, c] * (image[inner, c] - image[j, c])
            if change < 0:
                total += change * outwards / max(abs(j + 0.5 - crossing), 0.5)
        j += outwards
    j = inner
    while 0 <= outer < across and 0 <= j < across and seen[j] == f:
        change = 0.0
        for c in range(channels):
            change += slope[j, c] * (image[outer, c] - image[j, c])
        if change < 0:
            total -= change * outwards / max(abs(j + 0.5 - crossing), 0.5)
        j -= outwards
    return total
