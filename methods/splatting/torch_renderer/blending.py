"""Colours of pixels from those of the splats that they show (Eq. 3.8), and their gradients."""

from __future__ import annotations

import torch
from torch import Tensor

from .ragged import add_rows
from .raster import Lists


def seen_weights(lists: Lists) -> Tensor:
    """Weights of the entries, 0 of hidden ones: (h, w, K) tensor."""
    layers = torch.arange(lists.rho.shape[2], device=lists.rho.device)
    return torch.where(layers < lists.front[..., None], lists.rho, 0)


def blend(lists: Lists, attributes: Tensor) -> tuple[Tensor, Tensor]:
    """The image (h, w, c), and the sum of the weights of each pixel (h, w); both are 0 in the background.

    Parameters
    ----------
    lists : Lists
    attributes : (n, c) tensor
    """
    weights = seen_weights(lists)
    total = weights.sum(2)
    image = weights.new_zeros(*total.shape, attributes.shape[1])
    if len(attributes):
        for layer in range(weights.shape[2]):
            image += weights[..., layer, None] * attributes[lists.index[..., layer].clamp_min(0)]
    return torch.where((total > 0)[..., None], image / total[..., None], 0), total


def blend_back(lists: Lists, total: Tensor, gradient: Tensor, count: int) -> Tensor:
    """The gradient of the attributes, a (count, c) float64 tensor, from that of the image (h, w, c)."""
    weights = seen_weights(lists)
    back = torch.zeros(count, gradient.shape[2], dtype=torch.float64, device=gradient.device)
    for layer in range(weights.shape[2]):
        rows, columns = torch.nonzero(weights[..., layer] > 0, as_tuple=True)
        share = weights[rows, columns, layer] / total[rows, columns]
        add_rows(back, lists.index[rows, columns, layer], share[:, None] * gradient[rows, columns])
    return back
