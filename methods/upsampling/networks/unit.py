"""The unit of MPU: maps a patch of points to one of twice as many."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from .bilateral import Nearby, interpolate
from .dense_features import DenseFeatures, Pointwise
from .expansion import CodeExpansion
from .set_abstraction import Branches, PointFeatures

PU_NET_RADII = (0.1, 0.2, 0.4, 0.6)  # twice the published ones, which are for patches of 1,024 points, not of 312


@dataclass(frozen=True)
class Form:
    """The architecture of the units of a network."""

    growth: int = 12
    layers: int = 3
    neighbours: int = 32
    code: float = 0.2
    skip: float = 0.2  # weight of the features of the level before; 0 for none
    features: Literal["dense", "pu_net"] = "dense"
    expansion: Literal["code", "pu_net"] = "code"


class _PuNetFeatures(PointFeatures):
    """The features of PU-Net, and the coordinates: 259 channels."""

    outputs = PointFeatures.outputs + 3

    def forward(self, points: Tensor) -> Tensor:
        return torch.cat([super().forward(points), points])


class Unit(nn.Module):
    """Features, their expansion, and an offset to each copy of a point (Wang et al. 2019, section 3.2).

    Parameters
    ----------
    form : Form
    generator : torch.Generator, optional
        The weights are drawn from it, on the CPU.

    Notes
    -----
    76,027 parameters with the default form.
    """

    features: DenseFeatures | PointFeatures
    expansion: CodeExpansion | Branches

    def __init__(self, form: Form, generator: torch.Generator | None = None):
        super().__init__()
        self.skip = form.skip
        if form.features == "dense":
            self.features = DenseFeatures(form.growth, form.layers, form.neighbours, generator)
        else:
            self.features = _PuNetFeatures(PU_NET_RADII, generator=generator)
        channels = self.features.outputs
        if form.expansion == "code":
            self.expansion = CodeExpansion(channels, form.code, generator)
        else:
            self.expansion = Branches(channels, 2, generator)
        self.hidden = Pointwise(128, 64, generator)
        self.offset = Pointwise(64, 3, generator)
        with torch.no_grad():
            self.offset.weight *= 0.1  # an untrained unit hardly moves points

    def forward(self, points: Tensor, nearby: Nearby | None = None) -> tuple[Tensor, Tensor]:
        """Twice as many points.

        Parameters
        ----------
        points : (3, b, n) tensor
            Normalised patches.
        nearby : Nearby, optional
            Features of the level before.

        Returns
        -------
        dense : (3, b, 2 n) tensor
            All first copies, then all second ones, in the frame of ``points``.
        features : (c, b, n) tensor
            For interpolation by the next level.
        """
        features = self.features(points)
        if nearby is not None and self.skip:
            features = features + self.skip * interpolate(features, nearby)
        offset = self.offset(F.relu(self.hidden(self.expansion(features))))
        return points.repeat(1, 1, 2) + offset, features


class Units(nn.Module):
    """The units of all levels, each with its own weights: 304,108 parameters for four with the default form."""

    def __init__(self, count: int, form: Form, generator: torch.Generator | None = None):
        super().__init__()
        self.units = nn.ModuleList(Unit(form, generator) for _ in range(count))

    def __len__(self) -> int:
        return len(self.units)

    def __getitem__(self, level: int) -> Unit:
        """The unit of a level, from 0; a single unit serves all levels."""
        unit = self.units[min(level, len(self.units) - 1)]
        assert isinstance(unit, Unit)
        return unit
