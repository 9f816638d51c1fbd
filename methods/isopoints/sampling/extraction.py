"""All three stages together: iso-points of a field, from any points near it (thesis 4.2.1, figure 4.14)."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor
from torch.nn import functional as F

from bench import PointCloud

from .fields import Differentiable, differentiable
from .projection import STEPS, Projection, project
from .resampling import Resampling, resample
from .thinning import thinned
from .upsampling import NEIGHBOURS, upsample

BASE = 0.75  # of the wanted points are spread first, the others are inserted into gaps
MOST = 4  # at most this many times the wanted points are projected


@dataclass(frozen=True)
class Extraction:
    """The settings of an extraction of iso-points."""

    count: int
    rounds: int = 1  # of thinning, spreading and inserting
    resampling: Resampling = field(default_factory=lambda: Resampling(iterations=3))
    edges: float | None = None  # insertions prefer edges: see `candidates`
    neighbours: int = NEIGHBOURS
    tolerance: float = 1e-5
    steps: int = STEPS  # of Newton's method from the start
    reach: float = 1.2  # points farther from the origin are dropped


@dataclass(frozen=True, eq=False)
class IsoPoints:
    """Points on the zero level of a field."""

    points: Tensor  # (n, 3)
    normals: Tensor  # (n, 3), unit gradients of the field
    evaluations: int  # of the field


class NoLevel(ValueError):
    """No start reached the zero level."""


def extract(of: Differentiable, starts: Tensor, how: Extraction) -> IsoPoints:
    """``how.count`` points on the zero level, evenly spaced, from starts (n, 3) near it.

    Raises
    ------
    NoLevel
        If fewer than two starts arrive there.
    """
    stages = _Stages(of, how)
    stages.take(project(of, starts[: MOST * how.count], tolerance=how.tolerance, steps=how.steps))
    for _ in range(how.rounds):
        stages.thin()
        stages.spread()
        stages.fill()
        if how.edges is None:  # spread inserted points; at edges they stay dense
            stages.spread()
    stages.fill()  # where some have left the level on the way
    return IsoPoints(stages.at.points, F.normalize(stages.at.gradients, dim=1), stages.evaluations)


def iso_cloud(field: object, count: int, generator: torch.Generator, how: Extraction | None = None) -> PointCloud:
    """Iso-points of a whole field within the unit ball, in its coordinates, with normals.

    Parameters
    ----------
    field : a field of the bench, or any function of points (n, 3) to values (n,)
    count : int
    generator : torch.Generator
        Draws the starts, on the device of the field.
    how : Extraction, optional
        Three rounds by default.

    Raises
    ------
    NoLevel
        If the field has none there.
    """
    starts = in_ball(MOST * count, 1.0, generator)
    iso = extract(differentiable(field), starts, how or Extraction(count, rounds=3))
    points, normals = (part.double().cpu().numpy() for part in (iso.points, F.normalize(iso.normals.double(), dim=1)))
    return PointCloud(points, normals)


def in_ball(count: int, radius: float, generator: torch.Generator) -> Tensor:
    """Points (count, 3), uniform in a ball around the origin."""
    device = generator.device
    directions = torch.randn(count, 3, generator=generator, device=device)
    radii = radius * torch.rand(count, 1, generator=generator, device=device) ** (1 / 3)
    return radii * F.normalize(directions, dim=1)


class _Stages:
    """The points between the stages: those that are on the level."""

    def __init__(self, of: Differentiable, how: Extraction):
        self._of, self._how = of, how
        self.evaluations = 0
        self.at: Projection

    def take(self, result: Projection) -> None:
        """Keep those of a stage's points that have converged, and are not too far away."""
        self.evaluations += result.evaluations
        rows = result.values.abs() <= self._how.tolerance
        rows &= torch.linalg.vector_norm(result.points, dim=1) <= self._how.reach
        if rows.sum() < 2:
            raise NoLevel(f"{int(rows.sum())} of {len(rows)} points have found the zero level of the field")
        self.at = result.at(rows)

    def thin(self) -> None:
        """Remove crowded points."""
        self.at = self.at.at(thinned(self.at.points, max(2, round(BASE * self._how.count))))

    def spread(self) -> None:
        """Space the points evenly."""
        self.take(resample(self._of, self.at, self._how.resampling, self._how.tolerance))

    def fill(self) -> None:
        """Insert points up to the wanted number."""
        how = self._how
        if len(self.at.points) < how.count:
            self.take(
                upsample(
                    self._of, self.at, how.count, edges=how.edges, neighbours=how.neighbours, tolerance=how.tolerance
                )
            )
