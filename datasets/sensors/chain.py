"""A sensor that combines others."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from bench import PointCloud, Shape, Step, Views, build_steps, given_by, register

if TYPE_CHECKING:
    from bench import Plugin


@register("sensor", requires=("open3d",))
@dataclass(frozen=True)
class Chain:
    """Sensors one after the other: a source of points or a rig of cameras, then effects that degrade its output.

    The same as calling the steps one by one, each with its own generator: ``rng.spawn(len(steps))``. So a step's
    randomness does not depend on the draws of the steps before it.
    """

    steps: tuple[Any, ...] = ("poisson_disk", {"gaussian": {"sigma": 0.005}})  # names, or {name: {parameter: value}}

    def __post_init__(self) -> None:
        _ = self._built  # reports mistakes here, not when the first cloud is made

    @cached_property
    def _built(self) -> tuple[Step, ...]:
        if isinstance(self.steps, str):
            raise ValueError(f"steps: expected a list, got {self.steps!r}; write [{self.steps}]")
        return build_steps(self.steps)

    @property
    def gives(self) -> str:
        """The kind of output of the first step."""
        return given_by(*self._built[0])

    @property
    def plugins(self) -> tuple[Plugin, ...]:
        """The plugins of the steps, in their order."""
        return tuple(step.plugin for step in self._built)

    def sense(self, shape: Shape, rng: np.random.Generator) -> PointCloud | Views:
        """The output of the first step, degraded by the others."""
        streams = rng.spawn(len(self._built))
        (source, *effects) = (step.sensor for step in self._built)
        given = source.sense(shape, streams[0])
        for effect, stream in zip(effects, streams[1:], strict=True):
            given = effect.spoil(given, shape, stream)
        return given
