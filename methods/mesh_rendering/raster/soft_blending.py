"""Colours of pixels from the faces near them, and their gradients."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

FAINT = -40.0  # smaller exponents count as minus infinity


@njit(cache=True, error_model="numpy")
def blend(face, pixel, score, depth, colors, count, gamma, far):
    """The image (count, 4); and for each pair its probability, and its weight as a share of the pixel's."""
    image = np.zeros((count, 4))
    nearest = np.full(count, far)
    for p in range(len(face)):
        nearest[pixel[p]] = min(nearest[pixel[p]], depth[p])
    total = np.empty(count)
    for i in range(count):
        total[i] = math.exp((nearest[i] - far) / gamma)
    likely, share = np.empty(len(face)), np.empty(len(face))
    for p in range(len(face)):
        i = pixel[p]
        small = math.exp(-abs(score[p]))
        likely[p] = (1.0 if score[p] >= 0 else small) / (1 + small)
        behind = (nearest[i] - depth[p]) / gamma
        share[p] = likely[p] * math.exp(behind) if behind > FAINT else 0.0
        total[i] += share[p]
        # The logarithm of the probability that nothing covers: log(1 - D) = -log(1 + exp(score))
        image[i, 3] -= max(score[p], 0.0) + math.log1p(small)
    for p in range(len(face)):
        if share[p] > 0:
            share[p] /= total[pixel[p]]
            for c in range(3):
                image[pixel[p], c] += share[p] * colors[face[p], c]
    for i in range(count):
        image[i, 3] = -math.expm1(image[i, 3])
    return image, likely, share


@njit(cache=True, error_model="numpy")
def blend_back(face, pixel, colors, image, likely, share, slope, gamma):
    """The derivatives by the scores (p,), the depths (p,) and the colours (f, 3)."""
    of_score, of_depth = np.empty(len(face)), np.zeros(len(face))
    of_colors = np.zeros_like(colors)
    for p in range(len(face)):
        i, f = pixel[p], face[p]
        # d of the product of (1 - D) = -D times it, d score
        of_score[p] = slope[i, 3] * (1 - image[i, 3]) * likely[p]
        if share[p] == 0:
            continue
        by_share = 0.0
        for c in range(3):
            by_share += slope[i, c] * (colors[f, c] - image[i, c])
            of_colors[f, c] += slope[i, c] * share[p]
        of_score[p] += by_share * share[p] * (1 - likely[p])  # d log D = (1 - D) d score
        of_depth[p] = -by_share * share[p] / gamma
    return of_score, of_depth, of_colors
