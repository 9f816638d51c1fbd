"""The base of the methods that the thesis trains on true distances."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from bench import Frame, Run, UsageError

from ...learned.fitting.fitted import Fitted
from ...learned.fitting.trained import at_least
from .weights import OrientedWeights

if TYPE_CHECKING:
    from ...learned.training.loop import Sampling


@dataclass(frozen=True)
class Supervised(OrientedWeights, Fitted):
    """Fits true distances to the reference, as in the thesis, or, if there are none, oriented points by Eq. 4.4.

    The loss of such a field depends on the batch: the squared error for distances, otherwise Eq. 4.4. Adam's
    default betas suit these methods better than IDF's (0.1, 0.9); no others are published for them.
    """

    supervision: Literal["distances", "oriented"] = "distances"  # true distances (thesis), or the points and Eq. 4.4
    samples: int = 500_000  # points whose true distances are sampled beforehand
    redraw: int = 0  # draw them again after this many steps (NGLOD: ten epochs, 9,770); 0 to keep them

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check_weights()
        if self.supervision not in ("distances", "oriented"):
            raise ValueError(f"supervision: expected distances or oriented, got {self.supervision!r}")
        at_least(self, samples=5, redraw=0)

    @property
    def uses_normals(self) -> bool:
        """Distances do not need them."""
        return self.supervision == "oriented"

    def sampler(self, points: np.ndarray, normals: np.ndarray, frame: Frame, run: Run) -> Sampling:
        """NGLOD's mixture of points with true distances, in the unit of the field's frame; or oriented points.

        Raises
        ------
        UsageError
            If true distances are wanted and there is no reference to measure them to.
        """
        from ...learned.training.batches import DistanceSampler

        if self.supervision == "oriented":
            return super().sampler(points, normals, frame, run)
        if not run.has_truth:
            raise UsageError(
                f"{self.name}: is trained on true distances to a reference, but there is no reference; "
                "use method.supervision=oriented to fit the points and normals of the input instead"
            )

        def distances(x: np.ndarray) -> np.ndarray:
            return run.true_distances(frame.invert(x)) / frame.radius

        pool = {"count": self.samples, "redraw": self.redraw}
        return DistanceSampler(points, normals, self.batch, run.torch_generator(), distances, **pool)
