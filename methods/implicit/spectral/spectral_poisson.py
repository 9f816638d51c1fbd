"""Differentiable Poisson reconstruction by Fourier transforms (Peng et al. 2021, Shape as Points, section 3.1).

Oriented points are spread onto a periodic lattice as a vector field v, and the indicator is the function whose gradient
fits it, laplace chi = div v: in frequencies, one product. Everything is differentiable by the points and the normals.
Here chi is negative inside, as all fields of this family, and normals point outwards. (Values are read by
``gather``: on CPUs the gradient of ``[...]`` is summed by several threads in random order.)
"""

from __future__ import annotations

import math
from functools import reduce
from operator import add

import torch
from torch import Tensor

SIDE = 2.4  # of the cube of the lattice about the origin: the shape has radius 1, and its periodic copies are far away


def to_lattice(points: Tensor, resolution: int) -> Tensor:
    """From the frame of the shape to units of cells, with node 0 at the corner of the cube."""
    return (points / SIDE + 0.5) * resolution


def from_lattice(places: Tensor, resolution: int) -> Tensor:
    """From units of cells to the frame of the shape."""
    return (places / resolution - 0.5) * SIDE


def _corners(places: Tensor, resolution: int) -> tuple[Tensor, Tensor]:
    """The numbers of the nodes of cells around points (n, 3), and their trilinear weights: (8, n) each."""
    low = places.detach().floor()
    w = places - low
    low = low.long()
    rows, weights = [], []
    for corner in range(8):
        node: Tensor | int = 0
        weight: Tensor | float = 1.0
        for axis in range(3):
            up = corner >> axis & 1
            node = node * resolution + (low[:, axis] + up).remainder(resolution)
            weight = weight * (w[:, axis] if up else 1 - w[:, axis])
        assert isinstance(node, Tensor) and isinstance(weight, Tensor)
        rows.append(node)
        weights.append(weight)
    return torch.stack(rows), torch.stack(weights)


def spread(places: Tensor, values: Tensor, resolution: int) -> Tensor:
    """Values (n, c) at places (n, 3), distributed to the corners of their cells: (c, r, r, r)."""
    rows, weights = _corners(places, resolution)
    rows = rows.view(-1)
    empty = weights.new_zeros(resolution**3)
    channels = [empty.scatter_add(0, rows, (weights * part).view(-1)) for part in values.t()]
    return torch.stack(channels).view(-1, *[resolution] * 3)


def interpolate(lattice: Tensor, places: Tensor) -> Tensor:
    """The values (n,) of a lattice (r, r, r) at places (n, 3): the transpose of :func:`spread`."""
    rows, weights = _corners(places, len(lattice))
    return (lattice.reshape(-1).gather(0, rows.view(-1)).view_as(weights) * weights).sum(0)


def frequencies(resolution: int, device: torch.device) -> tuple[Tensor, Tensor, Tensor]:
    """Numbers of periods along each axis, as ``rfftn`` orders them, broadcastable; 0 for the one without a sign."""
    k = torch.fft.fftfreq(resolution, 1 / resolution, device=device)
    half = torch.fft.rfftfreq(resolution, 1 / resolution, device=device)
    k, half = (part.where(part.abs() != resolution / 2, torch.zeros_like(part)) for part in (k, half))
    return k[:, None, None], k[None, :, None], half[None, None, :]


def solve(v: Tensor, sigma: float) -> Tensor:
    """chi (r, r, r) of mean 0 with laplace chi = div v, smoothed, for v (3, r, r, r) on a unit cube.

    In frequencies k (periods): chi = -i g(k) (k . v) / (2 pi |k|^2), with g = exp(-2 sigma^2 |k|^2 / r^2): a Gaussian
    of standard deviation sigma / pi cells.
    """
    resolution = v.shape[-1]
    k = frequencies(resolution, v.device)
    square = reduce(add, (part.square() for part in k)).to(v.dtype)
    factor = torch.exp(-2 * (sigma / resolution) ** 2 * square) / (2 * math.pi * square.clamp(min=1))
    spectrum = torch.fft.rfftn(v, dim=(1, 2, 3))
    divergence = sum(part.to(v.dtype) * along for part, along in zip(k, spectrum, strict=True))
    return torch.fft.irfftn(divergence * factor * -1j, s=v.shape[1:])


def indicator(points: Tensor, normals: Tensor, resolution: int, sigma: float) -> Tensor:
    """chi (r, r, r) of oriented points: 0 on average at the points, and of size 1/2 at half of the nodes.

    Away from a closed surface that is +-1/2. (Shape as Points scales by the value in the corner of the cube, which is
    near 0 for an open sheet, whose two sides have opposite signs of chi.)

    Parameters
    ----------
    points : (n, 3) tensor, in the cube [-1.2, 1.2]^3
    normals : (n, 3) tensor
        Outward; their lengths are weights.
    sigma : float
        See :func:`solve`.
    """
    places = to_lattice(points, resolution)
    chi = solve(spread(places, normals, resolution), sigma)
    chi = chi - interpolate(chi, places).mean()
    some = chi.detach()[::2, ::2, ::2] if resolution > 64 else chi.detach()
    return chi / (2 * some.abs().median()).clamp(min=1e-12)


def evenly(points: Tensor, resolution: int = 64) -> Tensor:
    """Weights (n,) of mean 1 that compensate an uneven density of points, measured over two cells."""
    places = to_lattice(points, resolution)
    counts = spread(places, torch.ones_like(points[:, :1]), resolution)
    k = frequencies(resolution, points.device)
    smooth = torch.exp(-2 * (2 * math.pi / resolution) ** 2 * reduce(add, (part.square() for part in k)))
    counts = torch.fft.irfftn(torch.fft.rfftn(counts[0]) * smooth, s=counts.shape[1:])
    weights = 1 / interpolate(counts, places).clamp(min=1e-3)
    return weights / weights.mean()
