"""The gradient descent of one deformed cage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from torch import Tensor

from bench import Run

from ...learned.training.schedules import late_decay
from ..coordinates.deforming import Coordinates, deformed
from ..coordinates.harmonic import HarmonicCoordinates
from ..losses.planes import neighbourhoods
from ..losses.terms import asymmetry, chamfer, plane_terms
from ..meshes.boxes import Boxed


@dataclass(frozen=True)
class Settings:
    """The settings of the descent; the fields are those of the method."""

    coordinates: Coordinates | Literal["harmonic"]
    points: int
    redraw: int
    p2f: float
    normal: float
    symmetry: float
    neighbours: int
    steps: int
    learning_rate: float


class Descent:
    """A cage, and the deformed cage during the descent.

    Parameters
    ----------
    settings : Settings
    pair : Boxed
    cage : (n, 3) array
    faces : (f, 3) int array
    run : Run
    """

    def __init__(self, settings: Settings, pair: Boxed, cage: np.ndarray, faces: np.ndarray, run: Run):
        self._settings, self._faces, self._run = settings, faces, run
        self._cage = torch.from_numpy(cage)[None].float()
        self._moved = self._cage.clone().requires_grad_(True)
        self._source, self._target = (torch.from_numpy(cloud).float() for cloud in (pair.source, pair.target))
        self._spread = None
        if settings.coordinates == "harmonic":
            self._spread = HarmonicCoordinates(cage, faces)

    def run(self) -> np.ndarray:
        """Descend; returns the deformed cage (n, 3) of the last step, or of the last one in time."""
        settings, run = self._settings, self._run
        optimizer = torch.optim.Adam([self._moved], settings.learning_rate)
        for step in range(settings.steps):
            if not run.time_for_more():
                break
            if step % settings.redraw == 0:
                source, target, near, weights = self._drawn()
            for group in optimizer.param_groups:
                group["lr"] = settings.learning_rate * late_decay(step / settings.steps, 0.5)
            optimizer.zero_grad()
            moved = self._followed(source, weights)
            self._loss(source, moved, target, near).backward()
            optimizer.step()
            run.progress(step + 1, settings.steps)
        return self._moved.detach()[0].double().numpy()

    def deformed(self, points: np.ndarray) -> np.ndarray:
        """The deformed positions of points (n, 3)."""
        if self._spread is not None:
            return self._spread(points) @ self._moved.detach()[0].double().numpy()
        with torch.no_grad():
            place = torch.from_numpy(points)[None]
            return self._placed(place, self._cage.double(), self._moved.double())[0][0].numpy()

    def _placed(self, points: Tensor, cage: Tensor, moved: Tensor) -> tuple[Tensor, Tensor]:
        """The deformed positions of points (1, p, 3), and their coordinates."""
        coordinates = self._settings.coordinates
        assert coordinates != "harmonic"  # those are computed elsewhere
        return deformed(points, cage, self._faces, moved, coordinates, self._run.threads)

    def _some(self, cloud: Tensor) -> Tensor:
        rows = self._run.rng.choice(len(cloud), min(self._settings.points, len(cloud)), replace=False)
        return cloud[torch.from_numpy(rows)][None]

    def _drawn(self) -> tuple[Tensor, Tensor, Tensor, Tensor | None]:
        """Some of the points, their neighbourhoods, and their coordinates, which do not change."""
        source, target = self._some(self._source), self._some(self._target)
        weights = None
        if self._spread is not None:
            weights = torch.from_numpy(self._spread(source[0].numpy())).float()[None]
        elif self._settings.coordinates == "mean_value":
            with torch.no_grad():
                _, weights = self._placed(source, self._cage, self._moved)
        return source, target, neighbourhoods(source, self._settings.neighbours), weights

    def _followed(self, source: Tensor, weights: Tensor | None) -> Tensor:
        if weights is not None:
            return weights @ self._moved
        return self._placed(source, self._cage, self._moved)[0]

    def _loss(self, source: Tensor, moved: Tensor, target: Tensor, near: Tensor) -> Tensor:
        settings = self._settings
        loss = chamfer(moved, target)
        if settings.p2f or settings.normal:
            flat, straight = plane_terms(source, moved, near)
            loss = loss + settings.p2f * flat + settings.normal * straight
        return loss + settings.symmetry * asymmetry(moved) if settings.symmetry else loss
