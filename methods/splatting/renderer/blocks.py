"""Pixels of an image grouped into blocks, for splats that are far away.

The gradient of a splat from a pixel is Delta I Delta p / |Delta p|^2 (Eq. 3.12). Summed over a block, it depends on the
splat through its own colour, weight and depth, in which it is linear or nearly so: a block stores sums and means over
its pixels. Blocks form a pyramid, from those of four pixels across to one of all pixels.

A pixel contributes if that lowers the loss (Eq. 3.13), which is not linear, so the pixels of a block are in classes: by
the signs of the first three channels of the gradient, and by whether any splat is visible there. Within a class nearly
all pixels contribute, or none.
"""

from __future__ import annotations

import numpy as np
from numba import njit

LEAF = 4  # pixels across the smallest block
SIGNS = 3  # channels whose signs define the class
CLASSES = 2 << SIGNS


@njit(cache=True, error_model="numpy")
def pyramid(gradient, of_image, total, depth, front, active, typical):
    """The pyramid of blocks, one level after the other, from those of LEAF pixels across to one of all pixels.

    Returns
    -------
    starts : (levels + 1,) int array
        Of the levels among the blocks.
    shapes : (levels, 2) int array
        Rows and columns of blocks.
    count, classes : (blocks,) and (blocks, CLASSES) int arrays
        The number of classes with pixels, and these classes.
    sums : (blocks, CLASSES, 6 + c) array
        The size of the gradient; means of column, row, share and depth of the front, weighted by it; sums of the
        gradient times the image, and of the gradient, both times the share. The share is what a splat of the weight
        ``typical`` would have of the pixel's colour.
    """
    height, width, channels = gradient.shape
    rows, columns = (height + LEAF - 1) // LEAF, (width + LEAF - 1) // LEAF
    levels = 1
    while (max(rows, columns) - 1) >> (levels - 1):
        levels += 1
    shapes, starts = np.zeros((levels, 2), np.int64), np.zeros(levels + 1, np.int64)
    for level in range(levels):
        shapes[level, 0], shapes[level, 1] = rows, columns
        starts[level + 1] = starts[level] + rows * columns
        rows, columns = (rows + 1) // 2, (columns + 1) // 2
    sums = np.zeros((starts[levels], CLASSES, 6 + channels))
    for i in range(height):
        for j in range(width):
            if not active[i, j]:
                continue
            size, which = 0.0, 0
            for c in range(channels):
                size += abs(gradient[i, j, c])
                if c < SIGNS and gradient[i, j, c] > 0:
                    which |= 1 << c
            if front[i, j] > 0:
                which |= 1 << SIGNS
            block = i // LEAF * shapes[0, 1] + j // LEAF
            sums[block, which, 0] += size
            sums[block, which, 1] += size * (j + 0.5)
            sums[block, which, 2] += size * (i + 0.5)
            share = typical / (total[i, j] + typical)
            sums[block, which, 3] += size * share
            sums[block, which, 5] += share * of_image[i, j]
            if front[i, j] > 0:
                sums[block, which, 4] += size * depth[i, j, 0]
            for c in range(channels):
                sums[block, which, 6 + c] += share * gradient[i, j, c]
    for level in range(levels - 1):
        for i in range(shapes[level, 0]):
            for j in range(shapes[level, 1]):
                child = starts[level] + i * shapes[level, 1] + j
                parent = starts[level + 1] + i // 2 * shapes[level + 1, 1] + j // 2
                for which in range(CLASSES):  # loops: array expressions take many times as long to compile
                    for c in range(6 + channels):
                        sums[parent, which, c] += sums[child, which, c]
    count, classes = np.zeros(len(sums), np.int64), np.zeros((len(sums), CLASSES), np.int64)
    for block in range(len(sums)):
        for which in range(CLASSES):
            if sums[block, which, 0] > 0:
                classes[block, count[block]] = which
                count[block] += 1
                for c in range(1, 5):
                    sums[block, which, c] /= sums[block, which, 0]
    return starts, shapes, count, classes, sums


@njit(cache=True, error_model="numpy")
def of_block(k, u, v, z, peak, pixel_size, sums, block, which, attributes, epsilon, limit, occlusion, typical):
    """The contribution of one class of a block to the gradient of one splat, which is visible at none of its pixels."""
    change = -sums[block, which, 5]
    for c in range(attributes.shape[1]):
        change += sums[block, which, 6 + c] * attributes[k, c]
    if change >= 0:
        return 0.0, 0.0, 0.0
    share, depth = sums[block, which, 3], sums[block, which, 4]
    dx, dy = sums[block, which, 1] - u, sums[block, which, 2] - v
    squared = dx * dx + dy * dy + epsilon
    gz = 0.0
    if which >> SIGNS and z + limit < depth:  # it hides all visible splats
        change /= share
    elif which >> SIGNS:
        change *= peak / (typical * (1 - share) + peak * share)
        if occlusion and z - depth > limit:
            dz = depth - z
            gz = change * dz / (squared * pixel_size * pixel_size + dz * dz)
    factor = change / squared
    return factor * dx, factor * dy, gz
