"""ALIGNet: space around the source is deformed by a monotone control grid."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from bench import PointCloud, Run, register

if TYPE_CHECKING:
    from trimesh import Trimesh

    from bench import TrainingData

    from .networks.grid_network import GridNetwork


@register("method", cite="after Hanocka et al. 2018", requires=("torch", "safetensors", "trimesh"))
@dataclass(frozen=True)
class Alignnet:
    """After ALIGNet (Hanocka et al. 2018): a baseline of Neural Cages.

    As published: convolutions over both shapes as volumes, a bottleneck that predicts the increments of a control grid
    of 8 points per axis, whose absolute values are summed along each axis, linear interpolation between the points of
    the grid, and an L1 penalty that keeps the increments even.

    The released code is two-dimensional; **the network in space is ours**, with its order of layers. So are the
    volumes: cells that contain points, since a cloud has no inside. Alignment is by the squared Chamfer distance of the
    deformed points (published: by the smooth L1 distance of solid volumes; with shells of one cell a short training did
    not learn from that), shapes are also paired with themselves, and no parts of the targets are left out in training,
    because the targets of a benchmark are complete.
    """

    cells: int = 8  # points of the control grid along each axis
    voxels: int = 32  # cells of a volume along each axis; a multiple of 4
    channels: int = 20  # of the convolutions
    narrow: int = 20  # channels of the bottleneck, from which a grid is made
    points: int = 512  # of a shape, from which its volume is made; 1,024 at most
    even: float = 0.05  # weight of the mean deviation of an increment (released: 1e-5 of the sum over 100 pairs)
    scale: float = 0.25  # shapes in training are scaled by up to this along each axis
    strangers: float = 0.5  # share of new pairs in training, made of shapes of two pairs
    steps: int = 6000  # of training; 0 for as many as its seconds allow
    batch: int = 4  # pairs of a step, each in both directions (published: 100 pairs)
    learning_rate: float = 1e-3  # of Adam
    decay: float = 0.03  # factor of the learning rate over the last fifth of training

    examples_by: ClassVar[tuple[str, ...]] = ()
    trained_by: ClassVar[tuple[str, ...]] = (
        *("cells", "voxels", "channels", "narrow", "points", "even", "scale", "strangers"),
        *("steps", "batch", "learning_rate", "decay"),
    )

    def __post_init__(self) -> None:
        from .training.settings import check_training, check_weights

        check_training(self)
        check_weights(self, ("even",))
        for name in ("channels", "narrow"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: expected at least 1, got {getattr(self, name)}")
        if self.cells < 2:
            raise ValueError(f"cells: expected at least 2, got {self.cells}")
        if self.voxels < 4 or self.voxels % 4:
            raise ValueError(f"voxels: expected a multiple of 4, got {self.voxels}")

    def examples(self, data: TrainingData, run: Run) -> Mapping[str, np.ndarray]:
        """Points of the source and of the target of each pair."""
        from .training.pairs import pairs_of

        return pairs_of(data, run)

    def fit(self, examples: Mapping[str, np.ndarray], run: Run) -> Mapping[str, np.ndarray]:
        """The weights of the network, by name."""
        import torch

        from .training.grid_training import GridTraining

        torch.set_num_threads(run.threads)
        network = self._network(torch.Generator().manual_seed(run.seed)).to(run.device)
        run.parameters = sum(parameter.numel() for parameter in network.parameters())
        return GridTraining(network, examples, self, run).weights()

    def deform(self, source: Trimesh, target: Trimesh | PointCloud, run: Run) -> Trimesh:
        """The source in the space that the grid deforms."""
        from .networks.boxed import deform_by

        return deform_by(self._network(), source, target, self.points, run)

    def _network(self, generator: Any = None) -> GridNetwork:
        from .networks.grid_network import GridNetwork

        return GridNetwork(self.cells, self.voxels, self.channels, self.narrow, generator)
