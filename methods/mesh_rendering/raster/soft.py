"""The soft rasteriser: every face covers every pixel near it with some probability (Liu et al. 2019)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .scene import Scene
from .soft_blending import blend, blend_back
from .soft_pairs import near_pairs, pairs_back

LEAST = 9.21  # pairs are left out below a probability of 1e-4: sigmoid(-9.21)


class Pairs(NamedTuple):
    """Faces and the pixels near them, face by face."""

    face: np.ndarray
    """(p,) int32 array"""
    pixel: np.ndarray
    """(p,) int32 array: row times width plus column"""
    edge: np.ndarray
    """(p,) int8 array: the edge from corner k to corner k + 1 that is nearest to the pixel"""
    place: np.ndarray
    """(p,) float64 array: the place of the nearest point on that edge, 0 to 1"""
    score: np.ndarray
    """(p,) float64 array: squared distance to the nearest edge over sigma, positive inside, negative outside"""
    depth: np.ndarray
    """(p,) float64 array: of the face at the pixel; outside of it, at its nearest point"""


def pairs_of(scene: Scene, sigma: float) -> Pairs:
    """The faces near each pixel, with squared distances. ``sigma`` is in square pixels."""
    return Pairs(*near_pairs(scene.screen, scene.faces, scene.width, scene.height, sigma, LEAST))


@dataclass(frozen=True, eq=False)
class SoftDrawn:
    """A soft image, with its exact gradient.

    A face covers a pixel with the probability D = sigmoid(+-d^2 / sigma), d the distance to its nearest edge, plus
    inside. The pixel is covered with 1 - product of (1 - D); its colour is the mean of the faces' colours with weights
    D exp(-depth / gamma), including a black background of weight exp(-far / gamma).
    """

    scene: Scene
    pairs: Pairs
    image: np.ndarray
    likely: np.ndarray
    """(p,) array: the probabilities D of the pairs"""
    share: np.ndarray
    """(p,) array: the share of each pair in its pixel's colour"""
    sigma: float
    gamma: float

    @classmethod
    def of(cls, scene: Scene, sigma: float, gamma: float) -> SoftDrawn:
        """Draw a scene.

        Parameters
        ----------
        scene : Scene
        sigma : float
            In squared half widths of the image, as published.
        gamma : float
            A length, in units of depth.
        """
        sigma = sigma * (scene.width / 2) ** 2
        pairs = pairs_of(scene, sigma)
        count = scene.width * scene.height
        image, likely, share = blend(
            pairs.face, pairs.pixel, pairs.score, pairs.depth, scene.colors, count, gamma, scene.far
        )
        return cls(scene, pairs, image.reshape(scene.height, scene.width, 4), likely, share, sigma, gamma)

    def backward(self, slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See :class:`.scene.Drawn`."""
        flat, slope = self.image.reshape(-1, 4), np.ascontiguousarray(slope.reshape(-1, 4), dtype=np.float64)
        pairs, scene = self.pairs, self.scene
        of_score, of_depth, of_colors = blend_back(
            pairs.face, pairs.pixel, scene.colors, flat, self.likely, self.share, slope, self.gamma
        )
        of_screen = pairs_back(scene.screen, scene.faces, scene.width, self.sigma, *pairs, of_score, of_depth)
        return of_screen, of_colors
