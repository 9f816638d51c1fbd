"""The points of a step: points of the cloud with weights, iso-points, points of the space, points of false sheets."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ...learned.training.batches import Batch


@dataclass(frozen=True, eq=False)
class RegularisedBatch(Batch):
    """``x`` is the cloud's points, ``on`` of them, then ``iso`` iso-points, then points of the space, then false ones.

    Attributes
    ----------
    weights : (on,) tensor
        Eq. 4.15: the weights of the points of the cloud.
    iso : int
    iso_normals : (iso, 3) tensor
        From the iso-points around, up to the sign.
    counts : (int, int, int, int)
        Points of the four kinds in the whole step.
    bounds : (m,) tensor
        For points of sheets that the cloud does not confirm: a lower bound of the field (an upper one if negative).
    facing : (s, 3) tensor
        For points of the space: the normals of the nearest points of the cloud, times exp(-2 d^2), d the distance to
        them.
    """

    weights: Tensor
    iso: int
    iso_normals: Tensor
    counts: tuple[int, int, int, int]
    bounds: Tensor
    facing: Tensor

    def chunks(self, size: int) -> Iterator[RegularisedBatch]:
        """Parts of about ``size`` points, each with its share of the four kinds."""
        parts = max(1, -(-len(self.x) // size))
        false = len(self.bounds)
        kinds = self.x.split([self.on, self.iso, len(self.x) - self.on - self.iso - false, false])
        on, iso, space, off = (torch.tensor_split(kind, parts) for kind in kinds)
        normals, weights = torch.tensor_split(self.normals, parts), torch.tensor_split(self.weights, parts)
        iso_normals, bounds = torch.tensor_split(self.iso_normals, parts), torch.tensor_split(self.bounds, parts)
        facing = torch.tensor_split(self.facing, parts)
        for i in range(parts):
            yield replace(
                self,
                x=torch.cat([on[i], iso[i], space[i], off[i]]),
                on=len(on[i]),
                normals=normals[i],
                weights=weights[i],
                iso=len(iso[i]),
                iso_normals=iso_normals[i],
                bounds=bounds[i],
                facing=facing[i],
            )
