"""The training of a learned distance: queries near clouds, and their distances to the surface."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch
from torch import Tensor

from bench import Run

from ...learned.training.decaying import DecayingTraining
from ...learned.training.resumable import step_generator
from ..networks.distance_network import DistanceNetwork
from ..networks.neighbours import gather
from .clouds import Clouds, rotations
from .pu_training import VALIDATED

if TYPE_CHECKING:
    from bench import TrainingData

NEIGHBOURS = 8  # of a point; queries lie between it and one of them
PER_POINT = 4  # queries made for each point of a cloud


@dataclass(frozen=True)
class Plan:
    """The settings of the training; the fields are those of the method."""

    points: int
    noise: float
    steps: int
    batch: int
    learning_rate: float
    decay: float


def clouds_of(
    data: TrainingData, run: Run, bases: tuple[int, ...], scans: tuple[str, ...]
) -> Iterator[tuple[int, np.ndarray, np.ndarray, np.ndarray]]:
    """The number of each case, a cloud (m, 3), queries (4 m, 3) near it, and their exact values.

    These are (4 m, 4): the distance to the surface, positive outside, and the normal at the closest point.

    Parameters
    ----------
    data : TrainingData
    run : Run
        Receives the progress.
    bases : tuple of int
        Points of the clouds, evenly spread on the exact surface; 0 for the cloud of the sensor.
    scans : tuple of str
        Instead of them, sensors that make the clouds.
    """
    from bench import generator
    from bench.geometry.poisson_disk import sample_poisson_disk

    kinds: tuple[str | int, ...] = scans or bases
    for number, case in enumerate(data.cases):
        for which in kinds:
            rng = generator(data.seed, case.id, str(which))
            if isinstance(which, str):
                cloud = data.sense(case, which, rng).points
            else:
                cloud = sample_poisson_disk(case.reference, which, rng)[0] if which else case.input["cloud"].points
            queries = queries_near(cloud, rng)
            closest, normals = case.reference.surface.closest(queries)
            offsets = queries - closest
            side = np.where((offsets * normals).sum(axis=1) < 0, -1.0, 1.0)
            yield number, cloud, queries, np.column_stack([side * np.linalg.norm(offsets, axis=1), normals])
        run.progress(number + 1, data.count)


def queries_near(cloud: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Points (4 m, 3) between neighbours of a cloud (m, 3), and off them by up to about a spacing."""
    from scipy.spatial import cKDTree

    k = min(NEIGHBOURS + 1, len(cloud))
    distance, index = cKDTree(cloud).query(cloud, np.arange(1, k + 1))
    of = np.repeat(np.arange(len(cloud)), PER_POINT)
    other = index[of, rng.integers(k, size=len(of))]
    # Half of them as near as at the end of the descent, half as far as at its start.
    spread = distance[of, : 1 + NEIGHBOURS // 2].mean(axis=1) * rng.choice([0.1, 0.5], len(of))
    place = cloud[of] + rng.random((len(of), 1)) * (cloud[other] - cloud[of])
    return place + spread[:, None] * rng.standard_normal((len(of), 3))


class Batch(NamedTuple):
    """Patches of clouds, and queries in them."""

    points: Tensor
    """(3, b, n) tensor"""
    queries: Tensor
    """(3, b, q) tensor"""
    distances: Tensor
    """(b, q) tensor: those of the queries to the surface, positive outside"""
    normals: Tensor
    """(3, b, q) tensor: outward, at the points closest to the queries"""


class Queries(Clouds):
    """Clouds and queries, packed in pairs by :func:`.clouds.pack`, and the ``truths`` of the queries."""

    def __init__(self, examples: Mapping[str, np.ndarray], points: int, device: str, held_out: bool = False):
        super().__init__(examples, lambda count: min(points, count), device, held_out)
        self._truths = torch.from_numpy(np.array(examples["truths"])).to(device)
        self._truth_starts = np.concatenate([[0], examples["counts"][:, 1].cumsum()])[:-1]

    def draw(self, count: int, rng: np.random.Generator, noise: float) -> Batch:
        """Patches around random points, with as many queries, in the half nearest the middle."""
        weights = np.array([len(group) for group in self._groups])
        group = int(rng.choice(len(weights), p=weights / weights.sum()))
        size = self.sizes[group]
        pyramids = rng.choice(self._groups[group], count)
        clouds, places = self.stack(pyramids, 0), self.stack(pyramids, 1)
        seeds = clouds.seeds(rng)
        inner = (places.points - seeds).square().sum(0).argsort(dim=1, stable=True)
        half = np.minimum(PER_POINT * size // 2, places.counts)
        chosen = np.stack([rng.choice(number, size, replace=False) for number in half])
        index = inner.gather(1, torch.from_numpy(chosen).to(inner.device))
        starts = torch.from_numpy(self._truth_starts[pyramids]).to(index.device)
        exact = self._truths[starts[:, None] + index]
        turn = torch.from_numpy(rotations(count, rng)).to(clouds.points)
        jitter = np.clip(rng.normal(size=(3, count, size)), -3, 3) * noise

        def moved(x: Tensor) -> Tensor:
            return torch.einsum("bij,jbn->ibn", turn, x).contiguous()

        points = clouds.around(seeds, size)
        points = points + torch.from_numpy(jitter).to(points)
        queries = gather(places.points, index[:, None])[:, :, 0]
        return Batch(moved(points), moved(queries), exact[..., 0], moved(exact[..., 1:].permute(2, 0, 1)))


class Training(DecayingTraining):
    """Loss and validation of a network; random draws depend only on the run's seed and the number of a step.

    Parameters
    ----------
    network : DistanceNetwork
    examples : mapping
        Clouds and queries of :func:`.clouds.pack`, and ``truths``.
    plan : Plan
    run : Run
    """

    network: DistanceNetwork

    def __init__(self, network: DistanceNetwork, examples: Mapping[str, np.ndarray], plan: Plan, run: Run):
        self.network, self.plan, self.run, self.seed = network, plan, run, run.seed
        self.clouds = Queries(examples, plan.points, run.device)
        self.held_out = Queries(examples, plan.points, run.device, held_out=True)
        self.optimizer = torch.optim.Adam(network.parameters(), lr=plan.learning_rate, fused=run.device != "cpu")

    def loss(self, step: int) -> Tensor:
        """The mean error of the distance at queries, in spacings of the clouds."""
        rng = step_generator(self.seed, step)
        return self._error(self.clouds.draw(self.plan.batch, rng, self.plan.noise))

    @torch.no_grad()
    def validate(self) -> float:
        """The same on held-out patches."""
        rng = step_generator(self.seed, 0, "validation")
        return float(self._error(self.held_out.draw(VALIDATED, rng, self.plan.noise)))

    def _error(self, batch: Batch) -> Tensor:
        local = self.network.encode(batch.points)
        distances, normals = self.network(batch.queries, local)
        side = torch.where((normals * batch.normals).sum(0) < 0, -1.0, 1.0)
        error = (distances - side * batch.distances).abs()
        return (error / local.units.mean(1, keepdim=True)).mean()
