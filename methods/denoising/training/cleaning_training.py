"""The training of PointCleanNet: balls around noisy points, and the clean positions of their centres."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from bench import Run

from ...learned.training.resumable import step_generator
from ..networks.cleaning_network import CleaningNetwork
from ..networks.nearby import squared_distances
from ..patches.frames import principal_frames, random_turns
from .clouds import Clouds, on_discs
from .normalised import NormalisedTraining

VALIDATED = 32  # held-out regions
CENTRES = 8  # balls of a region
CLEAN = 256  # exact points of a ball, at most
NEAREST, FARTHEST = 0.99, 0.01  # weights of the squared distances to the nearest and the farthest clean point
SCALE = 100.0  # of the loss


@dataclass(frozen=True)
class Plan:
    """The settings of the training; the fields are those of the method."""

    points: int
    radius: float
    noise: tuple[float, float]
    steps: int
    batch: int
    learning_rate: float
    decay: float


class Batch(NamedTuple):
    """Balls in their own frames, in radii."""

    patches: Tensor
    """(b, n, 3) tensor: the centre at 0; padded by zeros if there are fewer points"""
    clean: Tensor
    """(b, m, 3) tensor: exact points of the ball, with copies if there are fewer"""
    nearest: Tensor
    """(b, 3) tensor: the point of the surface nearest the centre"""


class Training(NormalisedTraining):
    """Loss and validation of a network; random draws depend only on the run's seed and the number of a step.

    Parameters
    ----------
    network : CleaningNetwork
    examples : mapping
        Of :func:`.clouds.clouds_of`.
    plan : Plan
    run : Run
    """

    def __init__(self, network: CleaningNetwork, examples: Mapping[str, np.ndarray], plan: Plan, run: Run):
        self.network, self.plan, self.run = network, plan, run
        self.clouds, self.held_out = Clouds(examples), Clouds(examples, held_out=True)
        self.optimizer = torch.optim.Adam(network.parameters(), lr=plan.learning_rate, fused=run.device != "cpu")

    def loss(self, step: int) -> Tensor:
        """The published loss."""
        batch = self.batch(self.clouds, self.plan.batch, step_generator(self.run.seed, step))
        moved = self.network(batch.patches)
        return cleaning_loss(moved, batch.clean)

    def error(self) -> float:
        """The mean squared error of moved centres of held-out balls, over that of unmoved ones."""
        rng = step_generator(self.run.seed, 0, "validation")
        moved, unmoved = [], []
        for _ in range(VALIDATED // 4):
            batch = self.batch(self.held_out, 4 * CENTRES, rng)
            moved.append((self.network(batch.patches) - batch.nearest).square().sum(1))
            unmoved.append(batch.nearest.square().sum(1))
        return float(torch.cat(moved).mean() / torch.cat(unmoved).mean())

    def batch(self, clouds: Clouds, count: int, rng: np.random.Generator) -> Batch:
        """Balls, several of each region."""
        regions = -(-count // CENTRES)
        drawn = [self._balls(clouds, min(CENTRES, count - CENTRES * r), rng) for r in range(regions)]
        return Batch(*(torch.cat(parts).to(self.run.device) for parts in zip(*drawn, strict=True)))

    def _balls(self, clouds: Clouds, count: int, rng: np.random.Generator) -> tuple[Tensor, Tensor, Tensor]:
        """``count`` balls around noisy points in the middle of a region."""
        region, radius = clouds.region(self.plan.radius, self.plan.noise, rng)
        inner = np.flatnonzero(region.noisy.norm(dim=1).numpy() < radius)
        inner = inner if len(inner) else np.arange(len(region.noisy))
        centres = region.noisy[torch.from_numpy(rng.choice(inner, count, replace=len(inner) < count))]
        patches = [ball(region.noisy, centre, radius, self.plan.points, rng) for centre in centres]
        clean = [ball(region.surface, centre, radius, CLEAN, rng, again=True) for centre in centres]
        nearest = on_discs(centres[None], region.surface[None], region.normals[None], region.disc)[0] - centres
        turns = random_turns(count, rng) @ principal_frames(torch.stack(patches).numpy())
        turned = torch.from_numpy(turns.astype(np.float32)).transpose(1, 2)
        nearest = (nearest / radius)[:, None] @ turned
        return torch.stack(patches) @ turned, torch.stack(clean) @ turned, nearest[:, 0]


def ball(
    points: Tensor, centre: Tensor, radius: float, count: int, rng: np.random.Generator, again: bool = False
) -> Tensor:
    """``count`` random points of a ball, in its frame and in radii: (count, 3).

    If there are fewer, zeros follow: copies of the centre. With ``again``, the points themselves are repeated,
    and if there are none, the nearest one.
    """
    relative = (points - centre) / radius
    squared = relative.square().sum(1).numpy()
    inside = np.flatnonzero(squared <= 1)
    if again and not len(inside):
        inside = squared.argmin(axis=0, keepdims=True)
    if len(inside) > count:
        inside = rng.choice(inside, count, replace=False)
    elif again:
        inside = inside[np.arange(count) % len(inside)]
    filled = torch.zeros(count, 3)
    filled[: len(inside)] = relative[torch.from_numpy(inside)]
    return filled


def cleaning_loss(moved: Tensor, clean: Tensor) -> Tensor:
    """100 (0.99 min + 0.01 max) of the squared distances of points (b, 3) to their clean ones (b, m, 3); the mean."""
    squared = squared_distances(moved[:, None], clean)[:, 0]
    return SCALE * (NEAREST * squared.amin(1) + FARTHEST * squared.amax(1)).mean()
