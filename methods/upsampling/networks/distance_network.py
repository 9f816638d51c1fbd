"""A learned distance to the surface that a cloud was sampled from, for any point near it."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from .dense_features import Pointwise
from .neighbours import gather, nearest

CELL = 4  # neighbours whose mean distance is the unit of a point
AROUND = 8  # points of the cloud that a query uses


class Local(NamedTuple):
    """The features of a cloud."""

    points: Tensor
    """(3, b, n) tensor"""
    units: Tensor
    """(b, n) tensor: the spacing at each point"""
    normals: Tensor
    """(3, b, n) unit tensor, to the side to which the neighbours curve"""
    features: Tensor
    """(c, b, n) tensor"""


class EdgeBlock(nn.Module):
    """Two layers on the edges to the neighbours in space, their maximum, and a layer on it and the input."""

    def __init__(self, inputs: int, width: int, generator: torch.Generator | None):
        super().__init__()
        self.own, self.other = Pointwise(inputs, width, generator), Pointwise(inputs, width, generator)
        self.edge, self.second = Pointwise(4, width, generator), Pointwise(width, width, generator)
        self.out = Pointwise(inputs + width, width, generator)

    def forward(self, features: Tensor, index: Tensor, edges: Tensor) -> Tensor:
        """Features (inputs, b, n), neighbours (b, k, n) and edges (4, b, k, n) to features (width, b, n)."""
        x = self.edge(edges) + gather(self.other(features), index) + self.own(features)[:, :, None]
        pooled = self.second(F.relu(x)).amax(2)
        return F.relu(self.out(torch.cat([features, pooled])))


class DistanceNetwork(nn.Module):
    """Features of the points of a cloud, and from those around a query its distance to the surface.

    Its inputs are lengths in units of the local spacing, heights over the planes of points and their neighbours, and
    angles between these planes. So it is equivariant to scaling, translation and rotation of the cloud: there are no
    patches, and the size of the cloud does not matter. A plane's normal points to the side to which the neighbours
    curve: if they do not, the side does not matter. Each of the points around a query gives an estimate, its height
    over the plane plus a correction, and a weight; smooth activations make the distance differentiable.

    Parameters
    ----------
    width : int
        Channels.
    neighbours : int
        Of a point of the cloud.
    generator : torch.Generator, optional
        The weights are drawn from it, on the CPU.

    Notes
    -----
    76,418 parameters for a width of 64.
    """

    def __init__(self, width: int = 64, neighbours: int = 16, generator: torch.Generator | None = None):
        super().__init__()
        self.neighbours = neighbours
        self.first = Pointwise(4, width, generator)
        self.blocks = nn.ModuleList(EdgeBlock(width, width, generator) for _ in range(3))
        self.of_features = Pointwise(width, 2 * width, generator)
        self.of_offset = Pointwise(4, width, generator)
        self.hidden = Pointwise(width, width, generator)
        self.last = Pointwise(width, 2, generator)
        with torch.no_grad():  # its initial output is the mean height over the planes
            self.last.weight.zero_()

    def encode(self, points: Tensor, index: Tensor | None = None) -> Local:
        """The features of clouds.

        Parameters
        ----------
        points : (3, b, n) tensor, n >= 2
        index : (b, k, n) int64 tensor, optional
            The ``neighbours + 1`` nearest points of each, itself among them; found here if not given.
        """
        with torch.no_grad():
            index = nearest(points, points, self.neighbours + 1) if index is None else index
            offsets = gather(points, index) - points[:, :, None]
            squared = offsets.square().sum(0)
            order = squared.argsort(dim=1, stable=True)[:, 1:]  # without the point itself, or a copy of it
            index, squared = index.gather(1, order), squared.gather(1, order)
            offsets = offsets.gather(2, order.expand(3, *order.shape))
            gaps = squared.sqrt()
            # If a point has copies, the unit is computed from more neighbours, or finally from the whole cloud.
            units = gaps[:, :CELL].mean(1)
            units = torch.where(units > 1e-3 * gaps.mean(1), units, gaps.mean(1))
            units = torch.where(units > 1e-9, units, units.mean(1, keepdim=True).clamp_min(1e-9))
            offsets, length = offsets / units[:, None], gaps / units[:, None]
            normals, start = _planes(offsets)
            other = gather(normals, index)
            heights = (normals[:, :, None] * offsets).sum(0), (other * offsets).sum(0)
            edges = torch.stack([*heights, (normals[:, :, None] * other).sum(0), length])
        features = F.relu(self.first(start))
        for block in self.blocks:
            features = block(features, index, edges)
        return Local(points, units, normals, self.of_features(features))

    def forward(self, queries: Tensor, local: Local, index: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Distances to the surface.

        Parameters
        ----------
        queries : (3, b, m) tensor
        local : Local
            Of the clouds, by :meth:`encode`.
        index : (b, k, m) int64 tensor, optional
            The ``AROUND`` points nearest each query; found here if not given.

        Returns
        -------
        distances : (b, m) tensor
            In the unit of the points, differentiable in the queries. They are signed, since an unsigned distance has
            no slope where the side of a query is uncertain. The sign is positive on the side to which the returned
            normal points, and has no other meaning.
        normals : (3, b, m) tensor
            Those of the points nearest the queries.
        """
        if index is None:
            index = nearest(queries, local.points, AROUND)
        around, units = gather(local.points, index), gather(local.units[None], index)
        normals = gather(local.normals, index)
        offsets = (queries[:, :, None] - around) / units
        squared = offsets.square().sum(0, keepdim=True)
        height = (offsets * normals).sum(0, keepdim=True)
        along = (squared - height.square()).clamp_min(1e-12).sqrt()
        length = squared.clamp_min(1e-12).sqrt()
        # A product: heights over curved surfaces are linear in those over planes, with factors given by the features.
        slope, shift = gather(local.features, index).chunk(2)
        x = slope * self.of_offset(torch.cat([height, height.abs(), along, length])) + shift
        correction, score = self.last(F.silu(self.hidden(F.silu(x))))
        # Near points count more; the weight of the farthest fades out, so that the result hardly jumps when it changes.
        fading = (1 - length[0] / length[0].amax(1, keepdim=True).clamp_min(1e-9)).clamp_min(1e-4)
        weight = torch.softmax(score + fading.log(), dim=1)
        with torch.no_grad():
            first = squared.argmin(2)[:, :, None].expand(3, -1, -1, -1)
            normal = normals.gather(2, first)
            side = torch.where((normals * normal).sum(0) < 0, -units[0], units[0])
        return (weight * (height[0] + correction) * side).sum(1), normal[:, :, 0]


def _planes(offsets: Tensor) -> tuple[Tensor, Tensor]:
    """Normals (3, b, n) of planes through points, by the offsets (3, b, k, n) to their neighbours.

    Also a summary of the neighbours, (4, b, n): the three deviations along the axes, and their curving.
    """
    covariance = torch.einsum("ibkn,jbkn->bnij", offsets, offsets) / offsets.shape[2]
    spread, axes = torch.linalg.eigh(covariance)
    normals = axes[..., 0].permute(2, 0, 1)
    bend = (normals * offsets.mean(2)).sum(0)
    normals = torch.where(bend < 0, -normals, normals)
    return normals, torch.cat([spread.clamp_min(0).sqrt().permute(2, 0, 1), bend.abs()[None]])
