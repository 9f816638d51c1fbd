"""Parts of the pairs of images, for a step of the training."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from .stored import LIGHTEST

TRIES = 8  # places to try for a crop with enough covered pixels
ENOUGH = 0.6  # of the pixels of a crop


class Batch(NamedTuple):
    """Crops of pairs."""

    noisy: Tensor
    """(b, 3, h, w) tensor; 0 in the background"""
    clean: Tensor
    """(b, 3, h, w) tensor"""
    covered: Tensor
    """(b, 1, h, w) tensor of bool: where the noisy cloud is visible"""

    def error(self, image: Tensor) -> Tensor:
        """The mean absolute difference to the clean images, over covered pixels."""
        return ((image - self.clean).abs() * self.covered).sum() / (3 * self.covered.sum()).clamp_min(1)


class Crops:
    """The pairs of images of some shapes.

    Parameters
    ----------
    examples : mapping
        ``noisy``, ``clean`` and ``shapes`` of :func:`.pairs.pairs_of`.
    size : int
        Pixels along each side of a crop, at most those of the images.
    device : str
    held_out : bool
        Take the last tenth of the shapes, at least one; otherwise the others (all, if there is only one).
    """

    def __init__(self, examples: Mapping[str, np.ndarray], size: int, device: str, held_out: bool = False):
        self._noisy, self._clean = examples["noisy"], examples["clean"]
        shapes = np.unique(examples["shapes"])
        last = shapes[len(shapes) - max(1, len(shapes) // 10) :]
        mine = np.isin(examples["shapes"], last) == held_out
        self._mine = np.flatnonzero(mine) if mine.any() else np.arange(len(mine))
        self._size = min(size, *self._noisy.shape[1:3])
        self._device = device

    def draw(self, count: int, rng: np.random.Generator) -> Batch:
        """``count`` crops of random images, most of whose pixels are covered.

        Half of them are transposed. The lights from the right (green) and from below (blue) are exchanged too, so that
        the image is still consistent with the lights.
        """
        both = [self._crop(int(number), rng) for number in rng.choice(self._mine, count)]
        crops = torch.from_numpy(np.array(both)).to(self._device).permute(1, 0, 4, 2, 3)  # (2, b, 3, h, w)
        noisy, clean = (crop.float().mul(LIGHTEST / 255) for crop in crops)
        noisy, clean = (crop.contiguous(memory_format=torch.channels_last) for crop in (noisy, clean))
        return Batch(noisy, clean, (noisy > 0).any(1, keepdim=True))

    def _crop(self, number: int, rng: np.random.Generator) -> np.ndarray:
        """(2, h, w, 3) uint8: the noisy image and the clean one."""
        height, width = self._noisy.shape[1:3]
        size, best, most = self._size, (0, 0), -1.0
        for _ in range(TRIES):
            row, column = (int(rng.integers(side - size + 1)) for side in (height, width))
            share = float((self._noisy[number, row : row + size, column : column + size, 0] > 0).mean())
            if share > most:
                best, most = (row, column), share
            if most >= ENOUGH:
                break
        row, column = best
        part = np.s_[number, row : row + size, column : column + size]
        crop = np.stack([self._noisy[part], self._clean[part]])
        return crop.transpose(0, 2, 1, 3)[..., [0, 2, 1]] if rng.random() < 0.5 else crop
