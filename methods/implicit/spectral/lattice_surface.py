"""The zero level of a periodic lattice: its points for a loss, with gradients, and its mesh."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from bench import InvalidOutput

from ...learned.meshing.marching import REACH
from .spectral_poisson import from_lattice, to_lattice

if TYPE_CHECKING:
    from trimesh import Trimesh


def vertices(chi: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """The zeros of chi, which is linear along the edges of the lattice: the vertices of marching cubes.

    Parameters
    ----------
    chi : (r, r, r) tensor, negative inside

    Returns
    -------
    places : (v, 3) tensor, in cells
    gradient : (v, 3) tensor, of chi there, per cell, by central differences
    values : (v,) tensor
        chi at the places, 0; through them a loss of the places reaches chi, see :func:`pull`.
    """
    fixed, r = chi.detach(), len(chi)
    negative = fixed < 0
    strides = torch.tensor([r * r, r, 1], device=chi.device)
    nodes, axes = [], []
    for axis in range(3):
        crossed = negative.narrow(axis, 0, r - 1) != negative.narrow(axis, 1, r - 1)
        nodes.append(crossed.nonzero())
        axes.append(torch.full_like(nodes[-1][:, 0], axis))
    node, number = torch.cat(nodes), torch.cat(axes)
    low, high = _within(r)
    near = ((node >= low) & (node < high)).all(1)
    node, number = node[near], number[near]
    axis = torch.nn.functional.one_hot(number, 3)
    if not len(node):
        raise InvalidOutput("the indicator no longer has a zero crossing; try a smaller learning_rate")
    first, flat = (node * strides).sum(1), chi.reshape(-1)
    second = first + strides[number]
    a, b = fixed.reshape(-1)[first], fixed.reshape(-1)[second]
    along = a / (a - b)
    gradient = _slope(fixed, node) * (1 - along)[:, None] + _slope(fixed, node + axis) * along[:, None]
    values = (1 - along) * flat.gather(0, first) + along * flat.gather(0, second)
    return node + axis * along[:, None], gradient, values


def _within(resolution: int) -> tuple[int, int]:
    """The first and the last node of the box of the shape.

    Zeros farther out do not belong to the surface: around an open scan the periodic indicator must change its sign
    once more, and does so at the lattice's border.
    """
    places = to_lattice(torch.tensor([-REACH, REACH]), resolution)
    return math.floor(places[0]), math.ceil(places[1])


def _slope(chi: Tensor, node: Tensor) -> Tensor:
    """Central differences at nodes (v, 3), around the corner where the lattice ends."""
    r = len(chi)
    slopes = []
    for axis in torch.eye(3, dtype=torch.long, device=chi.device):
        up, down = (node + axis).remainder(r).unbind(1), (node - axis).remainder(r).unbind(1)
        slopes.append((chi[up] - chi[down]) / 2)
    return torch.stack(slopes, 1)


def pull(values: Tensor, gradient: Tensor, by_place: Tensor) -> Tensor:
    """A scalar whose derivative by chi is that of a loss with the derivatives ``by_place`` (v, 3) by the vertices.

    A vertex stays on the surface: chi(p) = 0 gives dp = -n dchi / |grad chi|, along the normal n. (Shape as Points
    omits the length, which for its chi is about the same everywhere.)
    """
    square = gradient.square().sum(1).clamp(min=1e-12)
    return -((by_place * gradient).sum(1) / square * values).sum()


def mesh(chi: Tensor) -> Trimesh:
    """The surface with faces towards positive values, in the frame of the shape; open where it leaves the shape's box.

    Raises
    ------
    InvalidOutput
        If there is none.
    """
    from skimage.measure import marching_cubes
    from trimesh import Trimesh

    first, last = _within(len(chi))
    values = chi.detach()[3 * (slice(first, last + 1),)].cpu().numpy()
    low, high = values.min(), values.max()
    if not low < 0 < high:
        raise InvalidOutput(f"the indicator has no zero crossing: its values are {low:.3g} to {high:.3g}")
    V, F, _, _ = marching_cubes(values, 0.0, gradient_direction="descent")
    V = from_lattice(torch.from_numpy(V.astype(np.float64)) + first, len(chi)).numpy()
    return Trimesh(V, F, process=False)
