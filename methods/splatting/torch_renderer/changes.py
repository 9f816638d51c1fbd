"""The change of a pixel when a splat moves onto it, or leaves it, as in :mod:`..renderer.changes`.

The cases of splats in the list of a pixel depend only on the pixel, so they are tables.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from ..renderer.blocks import LEAF
from ..renderer.settings import Drawing
from .ellipses import Ellipses
from .ragged import pick
from .raster import Lists


class Pixels(NamedTuple):
    """The a pixels with a gradient, those of a smallest block one after the other.

    All changes are derivatives of the loss times the change of the pixel's colours, summed over channels.
    """

    number: Tensor
    """(h w,) int64 tensor: the row of a pixel in the tables below, -1 for none"""
    leaf: Tensor
    """(a,) int64 tensor: the smallest block"""
    middle: Tensor
    """(a, 2) tensor: column and row"""
    index: Tensor  # type: ignore[assignment]  # tuples have a method of this name, not needed here
    """(a, K) int64 tensor: the list"""
    front: Tensor
    """(a,) int64 tensor"""
    pull: Tensor
    """(a, c) tensor: the derivative of the loss by the colours"""
    of_image: Tensor
    """(a,) tensor: that times the colours"""
    total: Tensor
    """(a,) tensor: sum of weights"""
    first: Tensor
    """(a,) tensor: depth of the first entry, inf for none"""
    last: Tensor
    """(a,) tensor: depth of the last visible entry, -inf for none"""
    depth: Tensor
    """(a, K) tensor: depths of visible entries, otherwise inf"""
    rho: Tensor
    """(a, K) tensor: weights of visible entries, otherwise 0"""
    value: Tensor
    """(a, K) tensor: weights times the change from the image's colour to that of the entry"""
    leaving: Tensor
    """(a, K) tensor: case (c), the change if a visible entry leaves"""
    forward: Tensor
    """(a, K) tensor: case (b), the derivative by the depth of a hidden entry"""


def pixels_of(
    ellipses: Ellipses,
    lists: Lists,
    total: Tensor,
    image: Tensor,
    attributes: Tensor,
    gradient: Tensor,
    unit: float,
    how: Drawing,
) -> Pixels:
    """The tables of the pixels that have a gradient.

    Parameters
    ----------
    ellipses : Ellipses
    lists : Lists
    total : (h, w) tensor
    image, gradient : (h, w, c) tensors
    attributes : (n, c) tensor
    unit : float
        Size of a pixel at the depth 1.
    how : Drawing
    """
    _, width, layers = lists.index.shape
    row, column, leaf = _in_order(gradient)
    pixel, every = row * width + column, torch.arange(len(row), device=row.device)
    number = torch.full(total.shape, -1, dtype=torch.int64, device=row.device).flatten().index_copy(0, pixel, every)
    tables = (*lists, gradient, total, (gradient * image).sum(2))
    index, depth, rho, front, pull, total, of_image = pick(pixel, *(each.flatten(0, 1) for each in tables))
    of_entries = torch.zeros_like(rho)
    if len(attributes):
        for layer in range(layers):
            of_entries[:, layer] = (pull * attributes[index[:, layer].clamp_min(0)]).sum(1)
    value = torch.where(index >= 0, rho * (of_entries - of_image[:, None]), 0)
    forward = torch.zeros_like(rho)
    if how.occlusion and len(attributes):
        ahead = math.sqrt(how.epsilon) * unit * ellipses.position[:, 2][index.clamp_min(0)]
        forward = _forward(value / (total[:, None] + rho), depth, ahead)
    seen = torch.arange(layers, device=row.device) < front[:, None]
    stays = torch.where((front == 1)[:, None], _second_layer(depth, how.depth_limit), seen)
    last = depth.gather(1, (front - 1).clamp_min(0)[:, None])[:, 0]
    return Pixels(
        number=number,
        leaf=leaf,
        middle=torch.stack([column, row], dim=1).to(rho) + 0.5,
        index=index,
        front=front,
        pull=pull,
        of_image=of_image,
        total=total,
        first=depth[:, 0],
        last=torch.where(front > 0, last, -torch.inf),
        depth=torch.where(seen, depth, torch.inf),
        rho=torch.where(seen, rho, 0),
        value=torch.where(seen, value, 0),
        leaving=_leaving(stays, rho, value, of_image),
        forward=forward,
    )


def _in_order(gradient: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Row, column and smallest block of the pixels (h, w) that have a gradient, in the order of the blocks."""
    row, column = torch.nonzero((gradient != 0).any(2), as_tuple=True)
    across = (gradient.shape[1] + LEAF - 1) // LEAF
    leaf, order = (row // LEAF * across + column // LEAF).sort(stable=True)
    row, column = pick(order, row, column)
    return row, column, leaf


def _forward(change: Tensor, depth: Tensor, ahead: Tensor) -> Tensor:
    """Case (b) of entries (a, K): decreases of the loss, over the distance to the first entry and ``ahead`` of it."""
    return torch.where(change < 0, change / (depth[:, :1] - depth - ahead), 0)


def _second_layer(depth: Tensor, limit: float) -> Tensor:
    """Which entries (a, K) appear if the first, the only visible one, leaves."""
    found = torch.zeros_like(depth, dtype=torch.bool)
    if depth.shape[1] > 1:
        found[:, 1:] = depth[:, 1:] - depth[:, 1:2] <= limit
    return found


def _leaving(stays: Tensor, rho: Tensor, value: Tensor, of_image: Tensor) -> Tensor:
    """The change of the loss if each entry (a, K) leaves, and the others among those that may stay do stay."""
    found = torch.empty_like(rho)
    for entry in range(rho.shape[1]):
        others = stays.clone()
        others[:, entry] = False
        weight = torch.where(others, rho, 0).sum(1)
        mean = torch.where(others, value, 0).sum(1) / weight
        found[:, entry] = torch.where(weight > 0, mean, -of_image)
    return found


def change_with(pixels: Pixels, pixel: Tensor, z: Tensor, peak: Tensor, own: Tensor, limit: float) -> Tensor:
    """Cases (a) and (b): the change of the loss if splats move onto pixels, (m,); increases are set to 0.

    Parameters
    ----------
    pixels : Pixels
    pixel : (m,) int64 tensor
        Rows of the tables.
    z, peak, own : (m,) tensors
        Of the splats: depth, weight at the centre, colour times the gradient.
    limit : float
    """
    of_image, total, last = pick(pixel, pixels.of_image, pixels.total, pixels.last)
    change = own - of_image
    found = peak * change / (peak + total)
    hides = torch.nonzero(last - limit > z)[:, 0]  # some visible splats
    pixel, z, peak, change = pick(hides, pixel, z, peak, change)
    depth, rho, value = pick(pixel, pixels.depth, pixels.rho, pixels.value)
    beside = depth - limit <= z[:, None]
    weight, value = (torch.where(beside, each, 0).sum(1) for each in (rho, value))
    found[hides] = (peak * change + value) / (peak + weight)
    return found.clamp_max(0)


def entry_of(pixels: Pixels, pixel: Tensor, splat: Tensor) -> Tensor:
    """The places of splats in the lists of pixels, or -1: (m,) int64 tensor."""
    same = pixels.index.index_select(0, pixel) == splat[:, None]
    places = torch.arange(same.shape[1], device=same.device)
    return torch.where(same, places, -1).amax(1)
