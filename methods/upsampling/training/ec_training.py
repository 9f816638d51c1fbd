"""The training of EC-Net."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from bench import Run

from ...learned.training.decaying import DecayingTraining
from ...learned.training.resumable import step_generator
from ..losses.nearest_surface import squared_to_segments, squared_to_triangles
from ..losses.repulsion import hinge_repulsion
from ..networks.ec_network import EcNetwork
from ..networks.neighbours import gather, nearest
from .edges import EdgedSurfaces
from .pairs import Augmentation, Patches, held_out
from .pu_training import VALIDATED, adam

SURFACE, EDGE, APART, DISTANCE = 500.0, 50.0, 500.0, 5.0  # weights of the four terms
CUT = 0.5  # of distances to edges, in radii of the patch
NEAR = 0.15  # points nearer to an edge than this are attracted to it
TRUST = 20_000  # steps after which only the predicted distances decide which points are near
RADIUS, LEAST = 0.07, 0.001  # of the repulsion, for 1,024 points in a patch


@dataclass(frozen=True)
class Plan:
    """The settings of the training; the fields are those of the method."""

    points: int
    triangles: int
    segments: int
    noise: float
    jitter: float
    scale: float
    shift: float
    steps: int
    batch: int
    learning_rate: float
    decay: float


class Training(DecayingTraining):
    """Loss and validation of a network; random draws depend only on the run's seed and the number of a step.

    Parameters
    ----------
    network : EcNetwork
    examples : mapping
        Of :func:`.clouds.pack` and :func:`.edges.pack_edged`.
    plan : Plan
    widening : float
        Factor of the published radii.
    run : Run
    """

    def __init__(self, network: EcNetwork, examples: Mapping[str, np.ndarray], plan: Plan, widening: float, run: Run):
        self.network, self.plan, self.run, self.seed, self.widening = network, plan, run, run.seed, widening
        self.pairs, self.held_out = held_out(examples, plan.points, run.device)
        self.surfaces = EdgedSurfaces(examples, run.device)
        self.optimizer = adam(network, network.last, plan.learning_rate, run.device)

    def loss(self, step: int) -> Tensor:
        """The sum of the four terms for a batch; the weight decay is in the optimiser."""
        plan = self.plan
        how = Augmentation(plan.noise, plan.jitter, plan.scale, plan.shift)
        patches = self.pairs.draw(plan.batch, step_generator(self.seed, step), how)
        triangles, segments = self.surfaces.around(patches, plan.triangles, plan.segments)
        output, predicted = self.network(patches.inputs)
        unit = patches.scales.square()[:, None]
        to_edge = squared_to_segments(output, segments)
        # The root has no derivative at 0; values that are cut off or not near have none either.
        distance = to_edge.detach().sqrt().clamp_max(CUT)
        near = near_edges(distance, predicted.detach(), max(0.5 - step / TRUST, 0.0))
        surface = (squared_to_triangles(output, triangles) / unit).mean()
        edge = (near * to_edge.clamp_max(CUT**2) / unit).sum() / (near.sum() + 1)
        apart = hinge_repulsion(output, RADIUS * self.widening, LEAST * self.widening**2)
        error = ((distance - predicted).square() / unit).mean()
        return SURFACE * surface + EDGE * edge + APART * apart + DISTANCE * error

    @torch.no_grad()
    def validate(self) -> float:
        """Distances from new points to the truth and vice versa, relative to those of the inputs.

        Both are of the crop: the points of the truth that are nearer to the seed than the farthest upsampled input.
        """
        how = Augmentation(self.plan.noise)
        patches = self.held_out.draw(VALIDATED, step_generator(self.seed, 0, "validation"), how)
        output, _ = self.network(patches.inputs)
        kept = output.shape[2] // 4
        truths = patches.truths[:, :, : output.shape[2]]
        return float(
            (_both_ways(output, patches, truths) / _both_ways(patches.inputs[:, :, :kept], patches, truths)).mean()
        )


def near_edges(distance: Tensor, predicted: Tensor, trust: float) -> Tensor:
    """Which new points are attracted to edges (Yu et al. 2018b, section 3.3, as released): a mask of 0 and 1.

    Of the quarter of the points with the smallest predictions, those with ``trust`` times the true distance plus
    ``1 - trust`` times the predicted one at most 0.15.

    Parameters
    ----------
    distance, predicted : (b, n) tensors
    trust : float
    """
    count = max(1, distance.shape[1] // 4)
    least = predicted.topk(count, dim=1, largest=False).indices
    chosen = torch.zeros_like(distance).scatter_(1, least, 1.0)
    return chosen * (trust * distance + (1 - trust) * predicted <= NEAR)


def _both_ways(points: Tensor, patches: Patches, truths: Tensor) -> Tensor:
    """Mean squared distances from points to all truths, plus those from the truths of the crop to points: (b,)."""

    def one_way(queries: Tensor, others: Tensor) -> Tensor:
        found = gather(others, nearest(queries, others, 1))[:, :, 0]
        return (queries - found).square().sum(0).mean(1)

    return one_way(points, patches.truths) + one_way(truths, points)
