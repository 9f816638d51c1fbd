"""Guidance as a parameter of methods fitted by Eq. 4.4."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import Frame, Run

from ...learned.fitting.fitted import Fitted
from .weights import OrientedWeights

if TYPE_CHECKING:
    from ...learned.training.loop import Sampling


@dataclass(frozen=True)
class Guided(OrientedWeights, Fitted):
    """Fitted by Eq. 4.4, and optionally at the beginning by guesses: see :mod:`..losses.guidance`."""

    guided: float = 0.0  # share of the training in which the sign in space is guessed from the points; 0 for none

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check_weights()
        if not 0 <= self.guided <= 1:
            raise ValueError(f"guided: expected 0 to 1, got {self.guided}")

    def sampler(self, points: np.ndarray, normals: np.ndarray, frame: Frame, run: Run) -> Sampling:
        """Oriented points; points of the space have a guessed distance, unless the field is already fitted."""
        from ..losses.guidance import GuidedSampler

        if self.load or not self.guided:
            return super().sampler(points, normals, frame, run)
        return GuidedSampler(points, normals, self.batch, run.torch_generator())
