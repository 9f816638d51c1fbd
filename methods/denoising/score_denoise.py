"""Points moved along the learned gradient of the density of the noisy surface."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from bench import PointCloud, Run, register
from bench.geometry.farthest import load_compiled

if TYPE_CHECKING:
    from bench import TrainingData

    from .networks.score_network import ScoreNetwork


@register("method", cite="after Luo and Hu 2021", requires=("torch", "safetensors", "scipy", "numba"))
@dataclass(frozen=True)
class ScoreDenoise:
    """After ScoreDenoise (Luo and Hu 2021): 187,291 parameters; points follow a learned score to the surface.

    The paper's: the network (dense edge convolutions on a graph that changes with the features, a residual network
    conditioned on them), the offset to the surface as the learned score, thirty steps of 0.2 times 0.95 ** t, the mean
    score of the four nearest points.

    Ours: the network learns a correction of the offset to a local plane, a patch is seen in its principal axes, and
    channels are normalised point by point, all of which a short training needs. Lengths are in radii of a patch (paper:
    in that of the cloud), so that the result does not depend on the density, and patches have 256 points (paper:
    1,000). A point takes its features from the patch in which it is most central, and then all points move together
    (paper: patch by patch). Training positions also lie part of the way to the surface; their offsets are to discs
    around clean points, denser than the input, with exact normals (paper: to clean points). The loss is relative to the
    noise of a patch.
    """

    points: int = 256  # of a patch (Luo and Hu: 1,000); all points if a cloud has fewer
    neighbours: int = 16  # of a point, along whose edges features are computed
    width: int = 128  # channels of the score
    overlap: float = 3.0  # patches that a point is in, on average
    around: int = 4  # nearest points whose mean score a position gets
    iterations: int = 30  # steps of a pass
    step: float = 0.2  # of the score, in the first step
    step_decay: float = 0.95  # factor of it from step to step
    passes: int = 1  # number of passes, each with new features of the previous output
    bases: tuple[int, ...] = (20000, 60000)  # points of the clouds in training, the sparsest first
    noise: tuple[float, float] = (0.008, 0.045)  # least and largest in training, relative to the radius of the shape
    queries: int = 96  # points of a patch whose score is learned, at four positions each
    steps: int = 5000  # of training; 0 for as many as its seconds allow
    batch: int = 6  # patches of a step
    learning_rate: float = 1e-3  # of Adam
    decay: float = 0.02  # factor of the learning rate over the last half of training

    examples_by: ClassVar[tuple[str, ...]] = ("bases",)
    trained_by: ClassVar[tuple[str, ...]] = (
        *("points", "neighbours", "width", "bases", "noise", "queries", "steps", "batch", "learning_rate", "decay"),
    )

    def __post_init__(self) -> None:
        from .settings import check_training

        check_training(self)
        for name in ("neighbours", "width", "around", "iterations", "passes", "queries"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: expected at least 1, got {getattr(self, name)}")
        if not self.overlap >= 1:
            raise ValueError(f"overlap: expected at least 1, got {self.overlap}")
        for name in ("step", "step_decay"):
            if not 0 < getattr(self, name) <= 1:
                raise ValueError(f"{name}: expected a number above 0 and at most 1, got {getattr(self, name)}")

    def examples(self, data: TrainingData, run: Run) -> Mapping[str, np.ndarray]:
        """Clouds of each shape without noise, with exact normals."""
        from .training.clouds import clouds_of

        return clouds_of(data, run, self.bases)

    def fit(self, examples: Mapping[str, np.ndarray], run: Run) -> Mapping[str, np.ndarray]:
        """The weights of the network, by name."""
        import torch

        from .training.score_training import Plan, Training

        torch.set_num_threads(run.threads)
        network = self._network(torch.Generator().manual_seed(run.seed)).to(run.device)
        run.parameters = sum(parameter.numel() for parameter in network.parameters())
        own = {name: getattr(self, name) for name in Plan.__dataclass_fields__}
        return Training(network, examples, Plan(**own), run).weights()

    prepare = staticmethod(load_compiled)

    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        """As many points as the input has, in its order, without normals."""
        import torch

        from bench.geometry.check import check_points

        from ..learned.networks.loading import loaded
        from .patches.ascent import Score, ascend

        check_points(cloud.points, "score_denoise", at_least=2)
        torch.set_num_threads(run.threads)
        network = loaded(self._network(), run)
        points = np.array(cloud.points, dtype=np.float64)
        for done in range(self.passes):
            score = Score(network, points, self.points, self.overlap, run.device)
            steps = (self.iterations, self.step, self.step_decay)
            points = ascend(score, self.around, *steps, run, done * self.iterations, self.passes * self.iterations)
            run.trace(PointCloud(points))
        return PointCloud(points)

    def _network(self, generator: Any = None) -> ScoreNetwork:
        from .networks.score_network import ScoreNetwork

        return ScoreNetwork(self.neighbours, self.width, generator)
