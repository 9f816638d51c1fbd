"""Midpoints between neighbours, moved down a learned distance: any ratio."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from bench import PointCloud, Run, register
from bench.geometry.farthest import load_compiled

if TYPE_CHECKING:
    from bench import TrainingData

    from .networks.distance_network import DistanceNetwork


@register("method", cite="after He et al. 2023", requires=("torch", "safetensors", "scipy", "numba"))
@dataclass(frozen=True)
class GradPu:
    """After Grad-PU (He et al. 2023): midpoints of neighbours, moved by gradient descent on a learned distance.

    The paper's: midpoints of the eight nearest points, thinned by farthest points; a network of local features that
    predicts a point's distance to the surface; ten steps down its gradient; any ratio.

    Ours: the network. It has 76,418 parameters; the paper's has 69,633, and sees patches of 256 points, normalised, and
    a global feature. This one uses lengths in units of the local spacing, and heights over local planes: it needs no
    patches, and does not depend on the size of the cloud. It learns signed distances to the exact surface; the paper's
    learns unsigned ones to the nearest of four times as many points. The distance is that of the input in all rounds,
    not of the previous round's output; the steps descend half the squared distance, and the result is thinned.
    """

    neighbours: int = 16  # of a point
    width: int = 64  # channels of the features
    iterations: int = 5  # of the descent (He et al.: 10)
    rate: float = 0.5  # of a step; 1 reaches the surface in one step if the distance is exact
    keep: bool = False  # whether the points of the input stay in place instead of moving too
    points: int = 256  # of a patch in training
    bases: tuple[int, ...] = (625, 2500)  # points of the clouds in training; 0 for the clouds of the sensor
    scans: tuple[str, ...] = ()  # instead of bases, sensors of four times as many points each, the sparsest first
    noise: float = 0.0025  # of the inputs in training, relative to the radius of the shape
    steps: int = 9200  # of training; 0 for as many as its seconds allow
    batch: int = 8  # patches of a step (He et al.: 32)
    learning_rate: float = 1e-3  # of Adam
    decay: float = 0.05  # factor of the learning rate over the last fifth of training

    examples_by: ClassVar[tuple[str, ...]] = ("bases", "scans")
    trained_by: ClassVar[tuple[str, ...]] = (
        *("neighbours", "width", "points", "bases", "scans", "noise", "steps", "batch", "learning_rate", "decay"),
    )

    def __post_init__(self) -> None:
        from .settings import check_training

        check_training(self, scans=1)
        for name in ("neighbours", "width", "iterations"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: expected at least 1, got {getattr(self, name)}")
        if not 0 < self.rate <= 1:
            raise ValueError(f"rate: expected a number above 0 and at most 1, got {self.rate}")

    def examples(self, data: TrainingData, run: Run) -> Mapping[str, np.ndarray]:
        """Clouds of each shape, points near them, and their exact distances to the surface."""
        from .training.clouds import pack
        from .training.gradient_training import clouds_of

        of_cases = list(clouds_of(data, run, self.bases, self.scans))
        packed = pack((number, [cloud, queries]) for number, cloud, queries, _ in of_cases)
        return packed | {"truths": np.concatenate([truths for *_, truths in of_cases]).astype(np.float32)}

    def fit(self, examples: Mapping[str, np.ndarray], run: Run) -> Mapping[str, np.ndarray]:
        """The weights of the network, by name."""
        import torch

        from .training.gradient_training import Plan, Training

        torch.set_num_threads(run.threads)
        network = self._network(torch.Generator().manual_seed(run.seed)).to(run.device)
        run.parameters = sum(parameter.numel() for parameter in network.parameters())
        own = {name: getattr(self, name) for name in Plan.__dataclass_fields__}
        return Training(network, examples, Plan(**own), run).weights()

    prepare = staticmethod(load_compiled)

    def upsample(self, cloud: PointCloud, ratio: int, run: Run) -> PointCloud:
        """Exactly ``ratio`` times as many points, in arbitrary order."""
        import torch

        from bench.geometry.check import check_points

        from ..learned.networks.loading import loaded
        from .patches.descent import LearnedDistance, grow
        from .patches.whole import whole

        check_points(cloud.points, "grad_pu", at_least=2)
        torch.set_num_threads(run.threads)
        network = loaded(self._network(), run)
        points, frame = whole(cloud.points)
        distance = LearnedDistance(network, points, run.device)
        grown = grow(points, ratio * len(points), distance, self.iterations, self.rate)
        if not self.keep:
            grown[: len(points)] = distance.descend(points, self.iterations, self.rate)
        return PointCloud(frame.restore(grown[None])[0])

    def _network(self, generator: Any = None) -> DistanceNetwork:
        from .networks.distance_network import DistanceNetwork

        return DistanceNetwork(self.width, self.neighbours, generator)
