"""The points of a training step, for all samplers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace

import torch
from torch import Tensor


@dataclass(frozen=True, eq=False)
class Surface:
    """Points of the zero level with their colours in the images."""

    points: Tensor  # (n, 3)
    gradients: Tensor  # (n, 3), of the field there
    views: Tensor  # (n,)
    directions: Tensor  # (n, 3), unit, from the camera
    colors: Tensor  # (n, 3)

    def __getitem__(self, rows: Tensor | slice) -> Surface:
        return Surface(*(getattr(self, field.name)[rows] for field in fields(self)))

    def __len__(self) -> int:
        return len(self.points)

    @staticmethod
    def joined(parts: list[Surface]) -> Surface:
        """One after the other."""
        return Surface(*(torch.cat([getattr(part, field.name) for part in parts]) for field in fields(Surface)))


@dataclass(frozen=True, eq=False)
class Wanted:
    """Points that should be inside, or outside, and their weights: 1 is a drawn pixel."""

    points: Tensor  # (n, 3)
    weights: Tensor  # (n,)

    @staticmethod
    def alike(points: Tensor, weight: float = 1.0) -> Wanted:
        """Points of equal weight."""
        return Wanted(points, torch.full_like(points[:, 0], weight))

    def and_also(self, other: Wanted) -> Wanted:
        """The points of both."""
        return Wanted(torch.cat([self.points, other.points]), torch.cat([self.weights, other.weights]))

    def __getitem__(self, rows: Tensor | slice) -> Wanted:
        return Wanted(self.points[rows], self.weights[rows])

    def __len__(self) -> int:
        return len(self.points)


@dataclass(frozen=True, eq=False)
class Samples:
    """The points of a step, or of a part of it."""

    surface: Surface
    occupied: Wanted  # on rays within a mask that should be inside
    free: Wanted  # on rays outside a mask
    space: Tensor  # (s, 3), anywhere in the ball
    pixels: int  # of the whole step: the number of the first three kinds together

    @property
    def x(self) -> Tensor:
        """All points."""
        return torch.cat([self.surface.points, self.occupied.points, self.free.points, self.space])

    def chunks(self, size: int) -> Iterator[Samples]:
        """Parts of about ``size`` points, each with its share of all kinds."""
        kinds = (self.surface, self.occupied, self.free, self.space)
        parts = max(1, -(-sum(len(kind) for kind in kinds) // size))
        for i in range(parts):
            surface, occupied, free, space = (
                slice(len(kind) * i // parts, len(kind) * (i + 1) // parts) for kind in kinds
            )
            yield replace(
                self,
                surface=self.surface[surface],
                occupied=self.occupied[occupied],
                free=self.free[free],
                space=self.space[space],
            )
