"""Samples by ray tracing: the baseline (Yariv et al. 2020)."""

from __future__ import annotations

import torch

from ..sampling.extraction import in_ball
from ..sampling.fields import Differentiable, evaluated
from .samples import Samples, Surface, Wanted
from .scene import Pixels, Scene
from .tracing import Tracing, trace


class RaySampler:
    """Traces rays through random pixels of a few views.

    Within the mask a hit is a point of the surface; on a ray without a hit, the point of the least value should be
    inside. Outside of the mask hits and points of least values should be outside.

    Parameters
    ----------
    network : Differentiable
        The trained one.
    scene : Scene
    views : int
        Of a step.
    samples : int
        Pixels of a step, all views together.
    space : int
        Points of a step anywhere in the ball.
    generator : torch.Generator
    """

    def __init__(
        self,
        network: Differentiable,
        scene: Scene,
        views: int,
        samples: int,
        space: int,
        generator: torch.Generator,
        tracing: Tracing | None = None,
    ):
        self._network, self._scene, self._pixels = network, scene, Pixels(scene, generator)
        self.views, self._samples, self._space = min(views, len(scene)), samples, space
        self._generator, self._tracing = generator, tracing or Tracing()
        self.evaluations = 0

    def draw(self) -> Samples:
        """The next step's points."""
        scene = self._scene
        views = self._pixels.views(self.views)
        view, place, _ = self._pixels.any(views, max(1, self._samples // len(views)))
        rays, inside = scene.rays(view, place), scene.inside(view, place)
        traced = trace(self._network, rays, self._tracing, search=inside)  # type: ignore[arg-type]
        self.evaluations += traced.evaluations
        hit = traced.hit & inside
        points = traced.points[hit]
        _, gradients = evaluated(self._network, points)
        surface = Surface(points, gradients, view[hit], rays.directions[hit], scene.colors(view[hit], place[hit]))
        space = in_ball(self._space, self._tracing.radius, self._generator)
        occupied, free = Wanted.alike(traced.points[inside & ~hit]), Wanted.alike(traced.points[~inside])
        return Samples(surface, occupied, free, space, len(view))
