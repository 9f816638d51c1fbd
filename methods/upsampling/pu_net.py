"""PU-Net: maps a patch to four times as many points, by features at several scales and branches of layers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from bench import PointCloud, Run, register
from bench.geometry.farthest import load_compiled

if TYPE_CHECKING:
    from bench import TrainingData

    from .networks.pu_network import PuNetwork


@register("method", cite="Yu et al. 2018", requires=("torch", "safetensors", "scipy", "numba"))
@dataclass(frozen=True)
class PuNet:
    """PU-Net (Yu et al. 2018): 814,307 parameters, four times as many points; 16 times by two passes, or ``times=16``.

    The loss is 100 times the earth mover's distance, the repulsion, and 1e-5 of half the squares of the weights. The
    published patches have 1,024 points (``method=pu_net_thesis``); radii are for those, and are widened by
    sqrt(1024 / points). Between two passes, and after the last one, farthest points are selected, to the exact count.
    """

    points: int = 156  # of a patch (thesis: 1,024); all points if a cloud has fewer
    overlap: float = 3.0  # patches that a point is in, on average
    central: int = 1  # number of patches, where a point is nearest the seed, whose copies of it count (thesis: 0, all)
    times: int = 4  # ratio of one pass: a branch of layers for each copy
    bases: tuple[int, ...] = (625, 2500)  # points of the clouds in training; 0 for the clouds of the sensor
    scans: tuple[str, ...] = ()  # instead of bases, sensors of ``times`` as many points each, the sparsest first
    subset: bool = False  # learn from uneven random parts of the truths, as published, instead of clouds of their own
    noise: float = 0.0025  # of the inputs in training, relative to the radius of the shape
    jitter: float = 0.01  # of every other patch in training, relative to its radius (thesis: 0.025)
    scale: float = 0.1  # patches in training are scaled by up to this
    shift: float = 0.0  # and moved by up to this (thesis: 0.1)
    repulsion: float = 1.0  # weight of the loss that keeps points apart
    steps: int = 3200  # of training; 0 for as many as its seconds allow
    batch: int = 8  # patches of a step (thesis: 28)
    learning_rate: float = 1e-3  # of Adam
    decay: float = 0.05  # factor of the learning rate over the last fifth of training (thesis: 1)
    tolerance: float = 1.0  # of the matching on CUDA, relative to the mean distance; on the CPU it is exact

    examples_by: ClassVar[tuple[str, ...]] = ("bases", "scans", "times")
    trained_by: ClassVar[tuple[str, ...]] = (
        *("points", "times", "bases", "scans", "subset", "noise", "jitter", "scale", "shift"),
        *("repulsion", "steps", "batch", "learning_rate", "decay", "tolerance"),
    )

    def __post_init__(self) -> None:
        from .settings import check_training

        check_training(self)
        if self.times < 2:
            raise ValueError(f"times: expected at least 2, got {self.times}")
        if not self.repulsion >= 0:
            raise ValueError(f"repulsion: expected at least 0, got {self.repulsion}")

    def examples(self, data: TrainingData, run: Run) -> Mapping[str, np.ndarray]:
        """Pairs of clouds of each shape: inputs, and Poisson disks of ``times`` as many points as truths."""
        from .training.clouds import pack
        from .training.pairs import pairs_of

        of_cases = enumerate(pairs_of(data, run, self.bases, self.scans, self.times))
        return pack((number, pair) for number, (_, pairs) in of_cases for pair in pairs)

    def fit(self, examples: Mapping[str, np.ndarray], run: Run) -> Mapping[str, np.ndarray]:
        """The weights of the network, by name."""
        import torch

        from .training.pu_training import Plan, Training

        torch.set_num_threads(run.threads)
        network = self._network(torch.Generator().manual_seed(run.seed)).to(run.device)
        run.parameters = sum(parameter.numel() for parameter in network.parameters())
        own = {name: getattr(self, name) for name in Plan.__dataclass_fields__}
        return Training(network, examples, Plan(**own), self._widening(), run).weights()

    prepare = staticmethod(load_compiled)

    def upsample(self, cloud: PointCloud, ratio: int, run: Run) -> PointCloud:
        """Exactly ``ratio`` times as many points.

        A ratio that is not a power of ``times`` is reached from the next power by thinning.
        """
        import torch

        from bench.geometry.check import check_points

        from ..learned.networks.loading import loaded
        from .patches.passes import in_passes

        check_points(cloud.points, "pu_net", at_least=1)
        torch.set_num_threads(run.threads)
        network = loaded(self._network(), run)
        how = (self.times, self.points, self.overlap)
        return PointCloud(in_passes(cloud.points, ratio, *how, network, run, self.central))

    def _network(self, generator: Any = None) -> PuNetwork:
        from .networks.pu_network import PuNetwork

        return PuNetwork(self._widening(), generator, self.times)

    def _widening(self) -> float:
        return math.sqrt(1024 / self.points)
