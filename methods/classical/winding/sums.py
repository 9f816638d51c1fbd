"""The sums over sources of a winding number field, compiled; each for the points of some leaves.

With d from a target to a source, and without sources for which |d| is below the width:

    number    w = sum m . d / |d|^3
    adjoint   a = -sum s d / |d|^3
    steepest  -grad w = sum m / |d|^3 - 3 d (m . d) / |d|^5

The inner loop runs over the targets of a leaf, which lie side by side, in single precision: several at a time.
"""

from __future__ import annotations

import numpy as np
from numba import njit

compiled = njit(cache=True, nogil=True, fastmath=True, error_model="numpy")


@compiled
def number(first, last, starts, begins, runs, places, moments, squared, out):
    """Of leaves from first to last: moments (sources, 3) to values (1, n)."""
    one = np.float32(1)
    for leaf in range(first, last):
        low, high = starts[leaf], starts[leaf + 1]
        x, y, z, w = places[0, low:high], places[1, low:high], places[2, low:high], out[0, low:high]
        for run in range(begins[leaf], begins[leaf + 1]):
            for source in range(runs[run, 0], runs[run, 1]):
                sx, sy, sz = places[0, source], places[1, source], places[2, source]
                mx, my, mz = moments[source, 0], moments[source, 1], moments[source, 2]
                for t in range(high - low):
                    dx, dy, dz = sx - x[t], sy - y[t], sz - z[t]
                    d2 = dx * dx + dy * dy + dz * dz
                    far = max(d2, squared)
                    weight = one / (far * np.sqrt(far))
                    w[t] += (dx * mx + dy * my + dz * mz) * weight * np.float32(d2 >= squared)


@compiled
def adjoint(first, last, starts, begins, runs, places, moments, squared, out):
    """Of leaves from first to last: moments (sources, 1) to vectors (3, n)."""
    one = np.float32(1)
    for leaf in range(first, last):
        low, high = starts[leaf], starts[leaf + 1]
        x, y, z = places[0, low:high], places[1, low:high], places[2, low:high]
        ax, ay, az = out[0, low:high], out[1, low:high], out[2, low:high]
        for run in range(begins[leaf], begins[leaf + 1]):
            for source in range(runs[run, 0], runs[run, 1]):
                sx, sy, sz = places[0, source], places[1, source], places[2, source]
                moment = moments[source, 0]
                for t in range(high - low):
                    dx, dy, dz = sx - x[t], sy - y[t], sz - z[t]
                    d2 = dx * dx + dy * dy + dz * dz
                    far = max(d2, squared)
                    weight = moment * (one / (far * np.sqrt(far))) * np.float32(d2 >= squared)
                    ax[t] -= dx * weight
                    ay[t] -= dy * weight
                    az[t] -= dz * weight


@compiled
def steepest(first, last, starts, begins, runs, places, moments, squared, out):
    """Of leaves from first to last: moments (sources, 3) to vectors (3, n)."""
    one, three = np.float32(1), np.float32(3)
    for leaf in range(first, last):
        low, high = starts[leaf], starts[leaf + 1]
        x, y, z = places[0, low:high], places[1, low:high], places[2, low:high]
        gx, gy, gz = out[0, low:high], out[1, low:high], out[2, low:high]
        for run in range(begins[leaf], begins[leaf + 1]):
            for source in range(runs[run, 0], runs[run, 1]):
                sx, sy, sz = places[0, source], places[1, source], places[2, source]
                mx, my, mz = moments[source, 0], moments[source, 1], moments[source, 2]
                for t in range(high - low):
                    dx, dy, dz = sx - x[t], sy - y[t], sz - z[t]
                    d2 = dx * dx + dy * dy + dz * dz
                    far = max(d2, squared)
                    weight = one / (far * np.sqrt(far)) * np.float32(d2 >= squared)
                    along = three * (dx * mx + dy * my + dz * mz) / far
                    gx[t] += (mx - along * dx) * weight
                    gy[t] += (my - along * dy) * weight
                    gz[t] += (mz - along * dz) * weight
