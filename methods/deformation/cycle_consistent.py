"""Cycle-consistent deformation: points are moved by layers whose matrices a network predicts from both shapes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from bench import PointCloud, Run, register

if TYPE_CHECKING:
    from trimesh import Trimesh

    from bench import TrainingData

    from .networks.adaptive_network import AdaptiveNetwork


@register("method", cite="after Groueix et al. 2019", requires=("torch", "safetensors", "trimesh"))
@dataclass(frozen=True)
class CycleConsistent:
    """After Unsupervised Cycle-Consistent Deformation (Groueix et al. 2019): a baseline of Neural Cages.

    As released: the network (8,436,117 parameters at width 1; from a pair's code it predicts 24,972 numbers: matrices
    that are added to the identity), the mean distance from the target to the deformed shape, in that direction only,
    cycles through two and three shapes that project to points of the shapes on their path, with gradients through the
    last step only, and known deformations at the beginning.

    Ours: narrower layers, and the network predicts the displacement of a point (an option of the released code that is
    off), which a short training needs. The third of a triplet is any shape (released: all three among 20 neighbours),
    the known deformations are scalings (released: rotations of up to 40 degrees, too), and no shape is rotated or
    shifted: those of a benchmark stand upright in their boxes. The cycles' errors are squared distances.
    """

    width: float = 0.25  # factor of all channels (released: 1)
    residual: bool = True  # whether the network predicts displacements instead of positions (released: False)
    points: int = 512  # of a shape that its encoders see (released: 2,500); 1,024 at most
    two_cycle: float = 1.0  # weight of cycles through two shapes
    three_cycle: float = 1.0  # of cycles through three shapes
    early: float = 0.06  # share of the training on known deformations (30 of 500 epochs)
    scale: float = 0.25  # shapes in training are scaled by up to this along each axis
    strangers: float = 0.5  # share of new pairs in training, made of shapes of two pairs
    steps: int = 3000  # of training; 0 for as many as its seconds allow
    batch: int = 4  # triplets of a step (released: 16)
    learning_rate: float = 1e-3  # of Adam
    decay: float = 0.03  # factor of the learning rate over the last fifth of training

    examples_by: ClassVar[tuple[str, ...]] = ()
    trained_by: ClassVar[tuple[str, ...]] = (
        *("width", "residual", "points", "two_cycle", "three_cycle", "early", "scale", "strangers"),
        *("steps", "batch", "learning_rate", "decay"),
    )

    def __post_init__(self) -> None:
        from .training.settings import check_training, check_weights

        check_training(self)
        check_weights(self, ("two_cycle", "three_cycle", "early"))

    def examples(self, data: TrainingData, run: Run) -> Mapping[str, np.ndarray]:
        """Points of the source and of the target of each pair."""
        from .training.pairs import pairs_of

        return pairs_of(data, run)

    def fit(self, examples: Mapping[str, np.ndarray], run: Run) -> Mapping[str, np.ndarray]:
        """The weights of the network, by name."""
        import torch

        from .training.cycle_training import CycleTraining

        torch.set_num_threads(run.threads)
        network = self._network(torch.Generator().manual_seed(run.seed)).to(run.device)
        run.parameters = sum(parameter.numel() for parameter in network.parameters())
        return CycleTraining(network, examples, self, run).weights()

    def deform(self, source: Trimesh, target: Trimesh | PointCloud, run: Run) -> Trimesh:
        """The source, each vertex moved by the network."""
        from .networks.boxed import deform_by

        return deform_by(self._network(), source, target, self.points, run)

    def _network(self, generator: Any = None) -> AdaptiveNetwork:
        from .networks.adaptive_network import AdaptiveNetwork

        return AdaptiveNetwork(self.width, self.residual, generator)
