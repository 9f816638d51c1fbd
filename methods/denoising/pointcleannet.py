"""Each point moved by the output of a network for the ball around it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from bench import BadInput, PointCloud, Run, register

if TYPE_CHECKING:
    from bench import TrainingData

    from .networks.cleaning_network import CleaningNetwork


@register("method", cite="after Rakotosaona et al. 2019", requires=("torch", "safetensors", "scipy"))
@dataclass(frozen=True)
class Pointcleannet:
    """After PointCleanNet (Rakotosaona et al. 2019), an eighth as wide: 156,456 parameters.

    A network with a point transform (a rotation) and a feature transform (a matrix) maps the ball around each point to
    the move of its centre. Three passes; after each, the mean move of 100 neighbours is subtracted. The loss is 100
    times the squared distance to the nearest clean point, plus a hundredth of that to the farthest. ``width=1`` is the
    published network, of 27,948,248 parameters, which takes an hour for 20,000 points.

    Ours: the width, 128 points of a ball (theirs: 500), seen in their principal axes, a move that is added to the one
    onto the ball's plane, channels that are normalised point by point, no activation at the end of the last blocks
    (theirs makes all outputs positive), Adam instead of gradient descent at a rate of 1e-8, and minutes of training.
    Outliers are not detected, for which they have another network.
    """

    width: float = 0.125  # factor of all widths (theirs: 1)
    points: int = 128  # of a ball (theirs: 500), a random part if there are more
    radius: float = 0.05  # of a ball, relative to the diagonal of the box
    passes: int = 3
    correction: int = 100  # neighbours whose mean move is subtracted after each pass; 0 for none
    bases: tuple[int, ...] = (20000, 60000)  # points of the clouds in training, the sparsest first
    noise: tuple[float, float] = (0.008, 0.045)  # least and largest in training, relative to the radius of the shape
    steps: int = 5000  # of training; 0 for as many as its seconds allow
    batch: int = 64  # balls of a step
    learning_rate: float = 1e-3  # of Adam
    decay: float = 0.02  # factor of the learning rate over the last half of training

    examples_by: ClassVar[tuple[str, ...]] = ("bases",)
    trained_by: ClassVar[tuple[str, ...]] = (
        *("width", "points", "radius", "bases", "noise", "steps", "batch", "learning_rate", "decay"),
    )

    def __post_init__(self) -> None:
        from .settings import check_training

        check_training(self)
        if not 0 < self.width <= 1:
            raise ValueError(f"width: expected a number above 0 and at most 1, got {self.width}")
        if not 0 < self.radius < 1:
            raise ValueError(f"radius: expected a number between 0 and 1, got {self.radius}")
        for name, least in (("passes", 1), ("correction", 0)):
            if getattr(self, name) < least:
                raise ValueError(f"{name}: expected at least {least}, got {getattr(self, name)}")

    def examples(self, data: TrainingData, run: Run) -> Mapping[str, np.ndarray]:
        """Clouds of each shape without noise, with exact normals."""
        from .training.clouds import clouds_of

        return clouds_of(data, run, self.bases)

    def fit(self, examples: Mapping[str, np.ndarray], run: Run) -> Mapping[str, np.ndarray]:
        """The weights of the network, by name."""
        import torch

        from .training.cleaning_training import Plan, Training

        torch.set_num_threads(run.threads)
        network = self._network(torch.Generator().manual_seed(run.seed)).to(run.device)
        run.parameters = sum(parameter.numel() for parameter in network.parameters())
        own = {name: getattr(self, name) for name in Plan.__dataclass_fields__}
        return Training(network, examples, Plan(**own), run).weights()

    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        """As many points as the input has, in its order, without normals."""
        import torch

        from bench.geometry.check import check_points

        from ..learned.networks.loading import loaded
        from .patches.cleaning import displacements, without_shrinking

        check_points(cloud.points, "pointcleannet", at_least=2)
        torch.set_num_threads(run.threads)
        network = loaded(self._network(), run)
        points = np.array(cloud.points, dtype=np.float64)
        radius = self.radius * float(np.linalg.norm(np.ptp(points, axis=0)))
        if not radius > 0:
            raise BadInput(f"pointcleannet: all {len(points)} points coincide; expected points of a surface")
        for done in range(self.passes):
            moves = displacements(network, points, radius, self.points, run)
            if moves is None:
                break
            points = points + without_shrinking(points, moves, self.correction)
            run.progress(done + 1, self.passes)
            run.trace(PointCloud(points))
        return PointCloud(points)

    def _network(self, generator: Any = None) -> CleaningNetwork:
        from .networks.cleaning_network import CleaningNetwork

        return CleaningNetwork(self.width, generator)
