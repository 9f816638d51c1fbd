"""Sensors that are made of parts: a source of points, and effects that spoil them one after the other.

A *source* turns a shape into a cloud: ``sense(shape, rng) -> PointCloud``. An *effect* turns a cloud into a worse one:
``spoil(cloud, shape, rng) -> PointCloud``. Both are registered as sensors, so that each can be used alone, and the
sensor ``chain`` puts them together::

    sensor=chain 'sensor.steps=[{poisson_disk:{count:625}},{gaussian:{sigma:0.0025}}]'
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .shapes import PointCloud, Shape

if TYPE_CHECKING:
    from .registry import Plugin

COUNT = 5000  # points on which an effect that is used alone works


class Effect:
    """Base of the sensors that spoil a cloud; a subclass defines :meth:`spoil`."""

    def sense(self, shape: Shape, rng: np.random.Generator) -> PointCloud:
        """The effect alone: on 5,000 points of the shape, evenly spread, with their normals."""
        from .geometry.poisson_disk import sample_poisson_disk

        source, effect = rng.spawn(2)
        return self.spoil(PointCloud(*sample_poisson_disk(shape, COUNT, source)), shape, effect)

    def spoil(self, cloud: PointCloud, shape: Shape, rng: np.random.Generator) -> PointCloud:
        """A worse cloud of ``shape``, both in the frame of the case; the normals, where there are any, follow."""
        raise NotImplementedError


class Step(NamedTuple):
    """One part of a chain."""

    plugin: Plugin
    sensor: Any


def build_steps(steps: Sequence[str | Mapping[str, Any]]) -> tuple[Step, ...]:
    """The sensors that are named by ``steps``, with their parameters checked.

    Parameters
    ----------
    steps : sequence
        Each the name of a sensor, or a mapping of one name to its parameters: ``{"gaussian": {"sigma": 0.01}}``. From
        the second on each must be an effect.

    Raises
    ------
    ValueError
        Naming the step, what was expected and, for a wrong name, the nearest right one.
    """
    from .parts import build_parts
    from .registry import registry

    if not steps:
        raise ValueError("steps: expected at least one, for instance [poisson_disk, gaussian]")
    built = build_parts("sensor", steps, "steps")
    for number, (plugin, _) in enumerate(built[1:], 2):
        if not callable(getattr(plugin.cls, "spoil", None)):
            effects = [p.name for p in registry().all("sensor") if callable(getattr(p.cls, "spoil", None))]
            raise ValueError(
                f"steps: number {number}, {plugin.name}, makes a new cloud; only the first may. "
                f"Effects: {', '.join(effects)}"
            )
    return tuple(Step(*part) for part in built)
