"""Pixels of an image grouped into blocks, for splats that are far away, as in :mod:`..renderer.blocks`."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ..renderer.blocks import CLASSES, LEAF, SIGNS
from .changes import Pixels
from .ragged import add_rows


class Blocks(NamedTuple):
    """The blocks of all levels, and their classes of pixels."""

    starts: list[int]
    """The first block of each level, from those of LEAF pixels across to one of all pixels, and the number of blocks"""
    shapes: list[tuple[int, int]]
    """Of each level, rows and columns of blocks"""
    count: Tensor  # type: ignore[assignment]  # tuples have a method of this name, not needed here
    """(blocks,) int64 tensor: classes that have pixels"""
    begin: Tensor
    """(blocks,) int64 tensor: their first rows in the tables below"""
    middle: Tensor
    """(classes, 2) tensor: mean column and row of the pixels, weighted by the gradient, as all means"""
    share: Tensor
    """(classes,) tensor: mean share that a typical splat would have in the pixels' colours"""
    depth: Tensor
    """(classes,) tensor: mean depth of visible splats, inf if there are none"""
    of_image: Tensor
    """(classes,) tensor: sum of the shares times the gradient times the colours"""
    pull: Tensor
    """(classes, c) tensor: sum of the shares times the gradient"""
    seen: Tensor
    """(classes,) bool tensor: whether any splat is visible there"""


def pyramid(pixels: Pixels, size: tuple[int, int], typical: float) -> Blocks:
    """The blocks of an image.

    Parameters
    ----------
    pixels : Pixels
    size : (int, int)
        Height and width of the image.
    typical : float
        Weight of a splat, for which shares of pixels are computed.
    """
    rows, columns = (-(-side // LEAF) for side in size)
    share, seen, slope = typical / (pixels.total + typical), pixels.front > 0, pixels.pull.abs().sum(1)
    signs = pixels.pull[:, :SIGNS] > 0
    which = seen.long() << SIGNS
    for channel in range(signs.shape[1]):
        which |= signs[:, channel].long() << channel
    depth = torch.where(seen, pixels.first, 0)
    means = slope[:, None] * torch.stack([torch.ones_like(share), *pixels.middle.unbind(1), share, depth], dim=1)
    values = torch.cat([means, (share * pixels.of_image)[:, None], share[:, None] * pixels.pull], dim=1)
    level = torch.zeros(rows * columns * CLASSES, values.shape[1], dtype=torch.float64, device=values.device)
    add_rows(level, pixels.leaf * CLASSES + which, values)
    level = level.reshape(rows, columns, -1)
    levels = [level]
    while max(level.shape[:2]) > 1:
        level = torch.nn.functional.pad(level, (0, 0, 0, level.shape[1] % 2, 0, level.shape[0] % 2))
        level = level[::2, ::2] + level[::2, 1::2] + level[1::2, ::2] + level[1::2, 1::2]
        levels.append(level)
    shapes, starts = [(each.shape[0], each.shape[1]) for each in levels], [0]
    for rows, columns in shapes:
        starts.append(starts[-1] + rows * columns)
    sums = torch.cat([each.reshape(-1, CLASSES, values.shape[1]) for each in levels])
    block, which = torch.nonzero(sums[..., 0] > 0, as_tuple=True)
    sums = sums[block, which]
    seen, count = which >> SIGNS > 0, torch.bincount(block, minlength=starts[-1])
    means = sums[:, 1:5] / sums[:, :1]
    depth = torch.where(seen, means[:, 3], torch.inf)
    tables = (means[:, :2], means[:, 2], depth, sums[:, 5], sums[:, 6:])
    middle, share, depth, of_image, pull = (each.contiguous().to(values) for each in tables)
    return Blocks(starts, shapes, count, count.cumsum(0) - count, middle, share, depth, of_image, pull, seen)
