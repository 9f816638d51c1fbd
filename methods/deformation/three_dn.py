"""3DN: a network predicts the offset of each vertex from both shapes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from bench import PointCloud, Run, register

if TYPE_CHECKING:
    from trimesh import Trimesh

    from bench import TrainingData

    from .networks.offset_network import OffsetNetwork


@register("method", cite="after Wang et al. 2019", requires=("torch", "safetensors", "trimesh"))
@dataclass(frozen=True)
class ThreeDn:
    """After 3DN, 3D Deformation Network (Wang et al. 2019): a baseline of Neural Cages.

    As released: the network (8,046,089 parameters at width 1, without batch normalisation), and the terms of the loss
    with their relative weights: squared Chamfer distance and earth mover's distance, the Chamfer distance of the mirror
    image, the order of points a small step apart, and the Laplacian.

    Ours: narrower layers. The earth mover's distance is that of a Sinkhorn matching of a part of the points (released:
    an approximate matching of all, and of the mirror image too). A mesh and its points have one Chamfer term: the faces
    are so small that points of the deformed mesh are deformed points (released: two, of weights 1 and 0.1). The
    Laplacian is that of nearest neighbours among points (released: of the mesh). Order counts only along the axis of
    the step (released: along all three, which penalises half of all rotations). Shapes are also paired with themselves.
    """

    width: float = 0.25  # factor of all channels (released: 1)
    points: int = 512  # of a shape that its encoder sees (released: 2,048); 1,024 at most
    earth_mover: float = 0.2  # weight of the earth mover's distance, a length, relative to the squared Chamfer distance
    matched: int = 128  # points of that matching
    mirror: float = 0.1  # weight of the Chamfer distance of the mirror image
    plane: Literal["x", "y", "z"] = "x"  # the coordinate that is mirrored
    order: float = 0.1  # weight of the order of points
    laplacian: float = 0.02  # weight of the change of the Laplacian
    neighbours: int = 8  # of a point, for the Laplacian
    scale: float = 0.25  # shapes in training are scaled by up to this along each axis
    strangers: float = 0.5  # share of new pairs in training, made of shapes of two pairs
    steps: int = 3000  # of training; 0 for as many as its seconds allow
    batch: int = 4  # pairs of a step, each in both directions
    learning_rate: float = 1e-3  # of Adam (released: 5e-4)
    decay: float = 0.03  # factor of the learning rate over the last fifth of training

    examples_by: ClassVar[tuple[str, ...]] = ()
    trained_by: ClassVar[tuple[str, ...]] = (
        *("width", "points", "earth_mover", "matched", "mirror", "plane", "order", "laplacian", "neighbours"),
        *("scale", "strangers", "steps", "batch", "learning_rate", "decay"),
    )

    def __post_init__(self) -> None:
        from .training.settings import check_training, check_weights

        check_training(self)
        check_weights(self, ("earth_mover", "mirror", "order", "laplacian"))
        if self.plane not in ("x", "y", "z"):
            raise ValueError(f"plane: expected x, y or z, got {self.plane!r}")
        if self.matched < 1:
            raise ValueError(f"matched: expected at least 1, got {self.matched}")
        if not 1 <= self.neighbours < self.points:
            raise ValueError(f"neighbours: expected 1 to {self.points - 1} (points - 1), got {self.neighbours}")

    def examples(self, data: TrainingData, run: Run) -> Mapping[str, np.ndarray]:
        """Points of the source and of the target of each pair."""
        from .training.pairs import pairs_of

        return pairs_of(data, run)

    def fit(self, examples: Mapping[str, np.ndarray], run: Run) -> Mapping[str, np.ndarray]:
        """The weights of the network, by name."""
        import torch

        from .training.offset_training import OffsetTraining

        torch.set_num_threads(run.threads)
        network = self._network(torch.Generator().manual_seed(run.seed)).to(run.device)
        run.parameters = sum(parameter.numel() for parameter in network.parameters())
        return OffsetTraining(network, examples, self, run).weights()

    def deform(self, source: Trimesh, target: Trimesh | PointCloud, run: Run) -> Trimesh:
        """The source, each vertex with its offset."""
        from .networks.boxed import deform_by

        return deform_by(self._network(), source, target, self.points, run)

    def _network(self, generator: Any = None) -> OffsetNetwork:
        from .networks.offset_network import OffsetNetwork

        return OffsetNetwork(self.width, generator)
