"""The number of neighbours for estimating a normal: as many as noise demands and the shape allows, point by point.

A plane through k neighbours has two errors. The *random* error, from noise and from the accident of sampling, falls as
k grows; its variance follows from the variances of the neighbourhood itself. The *bias*, from curvature and edges,
grows with k; it shows as a difference between the normals of small and large neighbourhoods that is larger than their
random errors explain. The size with the least sum of squares is chosen (Lepski 1991; Goldenshluger and Lepski 2011;
for normals in the spirit of Mitra, Nguyen and Guibas 2004, who need the noise to be known).

Two kinds of neighbourhoods are useless, however precise they look: those that are *lines*, as along a scan line that
is much denser than the lines are apart, and those of scattered points along one (noise of the range). In the first,
the largest variance grows with the square of k, where that of a surface grows with k. In the second, nearly all
normals of a region turn as soon as the neighbourhoods reach the next line, and stay as they are from there on.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .planes import Planes

if TYPE_CHECKING:
    from scipy.sparse import csr_array

SIZES = (8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256)
REGION = 48  # neighbours over which squared differences, of few degrees of freedom each, are averaged

LINE = 1.5  # the exponent of k, between a surface's 1 and a line's 2, with which a line's largest variance grows
ARC = 0.07  # middle over largest variance of points along an arc of 2 rad: less is no surface, but a curved line
FEW = 0.05  # share of lines among the neighbourhoods of a region that is no accident
CLEAR = np.radians(20) ** 2  # the random error (squared) above which a small neighbourhood is no judge of larger ones
DOUBT = 1.2  # by how much the random error of the smaller neighbourhood may be underestimated
CAUTION = 1.2  # weight of the random error against the bias: the displacement of a noisy point is not in it
EVEN = 1.25  # the smallest size is taken whose risk is at most so many times the least: samples may be regular
TURN = np.radians(50) ** 2  # mean squared turn of the normals of a region; 61 degrees where they turn at random
SETTLED = np.radians(12) ** 2  # mean squared turn of the normals of a region that has settled
RANDOM = np.pi - 2  # mean square of the angle between two axes that are independent: no error is larger


class Choice(NamedTuple):
    """The sizes of neighbourhoods that were chosen for n points."""

    index: np.ndarray  # type: ignore[assignment]  # hides tuple.index, which nobody calls here
    """(n,) int array, of the size in ``planes.sizes``"""
    is_plane: np.ndarray
    """(n,) bool array: whether any size gave a plane"""
    noise: np.ndarray
    """(n,) array: which share of the variance along the normal is noise, the rest being curvature or a second sheet"""


def choose_size(planes: Planes, region: np.ndarray) -> Choice:
    """The size with the least estimated error for every point.

    Parameters
    ----------
    planes : at the sizes of :data:`SIZES` that there are points for
    region : (n, r) int array, the nearest neighbours of each point, itself included
    """
    n, count = planes.offsets.shape
    if count < 3:
        return Choice(np.full(n, count - 1), np.ones(n, dtype=bool), np.ones(n))
    mean = _mean_over(region)
    error, noise = (mean @ table for table in _random_error(planes))
    usable = ~_lines(planes, mean)
    usable[:, 0] = False  # only there to tell how fast the next sizes grow
    turn, judged = np.zeros((n, count), np.float32), np.zeros((n, count), bool)
    bias, pairs = np.zeros((n, count), np.float32), {}
    for large in range(2, count):
        pairs[large] = mean @ np.stack([_turn(planes.normals, small, large) for small in range(1, large)], axis=1)
        if large >= 3:
            turn[:, large - 2], judged[:, large - 2] = pairs[large][:, large - 3], True
    turn[:, ~judged[0]] = turn[:, judged[0]][:, -1:] if judged.any() else 0.0
    usable &= ~_before_a_turn(turn, judged, error, usable)
    judges = usable & (error < CLEAR)
    for large, turns in pairs.items():
        for small, found in enumerate(turns.T, start=1):
            # What both have of the noise is the same points' noise; what curvature adds differs from size to size.
            common = error[:, large] * np.minimum(1, noise[:, small] / noise[:, large])
            excess = found - DOUBT * error[:, small] - error[:, large] + 2 * common
            # The smaller one is biased too: in proportion to its size where it is curvature, not at all before an edge.
            excess /= 1 - planes.sizes[small] / planes.sizes[large]
            bias[:, large] = np.maximum(bias[:, large], np.where(judges[:, small], excess, 0))
    risk = np.where(usable, bias + CAUTION * error, 10 + 1 / planes.sizes)
    chosen = (risk <= EVEN * risk.min(axis=1, keepdims=True)).argmax(axis=1)
    rows, smallest = np.arange(n), np.where(judges.any(axis=1), judges.argmax(axis=1), chosen)
    return Choice(chosen, np.any(usable, axis=1), np.minimum(1, noise[rows, smallest] / noise[rows, chosen]))


def _random_error(planes: Planes) -> tuple[np.ndarray, np.ndarray]:
    """The variance of the angle of each normal, and the unbiased variance along it; both (n, s).

    To first order an axis of a covariance of k points turns toward the axis of variance l by an angle of variance
    ``l0 l / (k (l - l0)^2)`` (Anderson 1963); where l0 and l meet, the axes are arbitrary.
    """
    flat, middle, wide = np.moveaxis(planes.variances.astype(np.float64), 2, 0)
    tiny = 1e-30 + 1e-14 * wide
    noise = np.maximum(flat * planes.sizes / np.maximum(planes.sizes - 3, 1), tiny)
    towards = [other / np.maximum(other - flat, tiny) ** 2 for other in (middle, wide)]
    # How broad the samples happen to lie varies too: in the mean of 1 / l, k becomes k - 4 (inverse Wishart).
    error = noise / np.maximum(planes.sizes - 4, 1) * sum(towards)
    return error / (1 + error / RANDOM), noise


def _lines(planes: Planes, mean: csr_array) -> np.ndarray:
    """Whether the neighbourhoods of a region are lines, or grow like lines and not like a surface; (n, s).

    Over about twice the size the largest variance of a line grows too fast; and the middle one does so when the next
    line is reached.
    """
    _, middle, wide = np.moveaxis(planes.variances, 2, 0)
    lines = mean @ (middle < ARC * wide).astype(np.float32) > FEW
    wide, middle, sizes = mean @ wide, mean @ middle, planes.sizes
    for large in range(1, len(sizes)):
        small = max(0, large - 2)
        growth = (sizes[large] / sizes[small]) ** LINE
        lines[:, large] |= wide[:, large] > wide[:, small] * growth
        lines[:, small] |= middle[:, large] > middle[:, small] * growth
    return lines


def _before_a_turn(turn: np.ndarray, judged: np.ndarray, error: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """Whether the normals of the region still turn, all of them, at this size or a larger one, and then settle."""
    turning = judged & (turn > TURN)
    settled = usable & (turn < SETTLED) & (error < SETTLED / 4)
    turning &= np.logical_or.accumulate(settled[:, ::-1], axis=1)[:, ::-1]
    return np.logical_or.accumulate(turning[:, ::-1], axis=1)[:, ::-1]


def _turn(normals: np.ndarray, small: int, large: int) -> np.ndarray:
    """The squared angle between the unoriented normals of two sizes; (n,)."""
    cosine = np.abs(np.einsum("ni,ni->n", normals[:, small], normals[:, large]))
    return np.arccos(np.minimum(cosine, 1)) ** 2


def _mean_over(region: np.ndarray) -> csr_array:
    """The matrix that takes values of points to their means over the points' regions."""
    from scipy.sparse import csr_array

    n, width = region.shape
    starts = np.arange(0, n * width + 1, width)
    return csr_array((np.full(n * width, 1 / width, dtype=np.float32), region.ravel(), starts), shape=(n, n))
