"""The output of sensors, and sensors made of parts: a source, and effects that degrade its output.

A *source* turns a shape into a cloud: ``sense(shape, rng) -> PointCloud``. An *effect* turns a cloud into a worse one:
``spoil(cloud, shape, rng) -> PointCloud``. Both are registered as sensors, so that each can be used alone, and the
sensor ``chain`` puts them together::

    sensor=chain 'sensor.steps=[{poisson_disk:{count:625}},{gaussian:{sigma:0.0025}}]'

Most sensors give a cloud. One that gives something else says so, ``@register("sensor", gives="views")``, and goes
with the tasks that take it, ``takes = "views"``. A rig of cameras is a sensor that gives :class:`bench.Views`; an
effect with ``gives="views"`` degrades views.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

import numpy as np

from ..geometry.cloud import PointCloud
from .shape import Shape

if TYPE_CHECKING:
    from ..plugins.registry import Plugin

Given = TypeVar("Given")  # what an effect degrades, and gives again

COUNT = 5000  # points for an effect that is used alone


def given_by(plugin: Plugin, sensor: Any) -> str:
    """What a sensor gives, as named by ``takes`` of a task; a chain gives what its first step gives."""
    return getattr(sensor, "gives", None) or plugin.options.get("gives", "cloud")


def taken_by(task: Any) -> str:
    """What a task takes from its sensor: ``cloud``, ``views``, a custom name, or ``none``."""
    return getattr(task, "takes", "cloud") if getattr(task, "needs_sensor", True) else "none"


def noun_of(plugin: Plugin, sensor: Any) -> type | None:
    """The class of a sensor's output, with ``arrays()`` and ``of(arrays)``; None where it is not known.

    :class:`bench.PointCloud` and :class:`bench.Views` are known by name. A sensor that gives something else may
    declare its class: ``noun: ClassVar[type] = DepthMaps``. Outputs of a known class can be cached across cells.
    """
    gives = given_by(plugin, sensor)
    if gives == "cloud":
        return PointCloud
    if gives == "views":
        from .views import Views

        return Views
    return getattr(sensor, "noun", None)


def gives_scans(plugin: Plugin, sensor: Any) -> bool:
    """Whether a sensor, or the first step of a chain, gives the scan that came with a shape: ``sensor=scan``."""
    parts = (plugin, *getattr(sensor, "plugins", ()))
    return any(part.options.get("scans") for part in parts)


def needs_a_source(plugin: Plugin, sensor: Any) -> bool:
    """Whether a sensor is an effect that cannot be used alone: the base class makes only clouds for an effect."""
    alone = getattr(plugin.cls, "sense", None) is not Effect.sense
    return not alone and given_by(plugin, sensor) != "cloud"


class Effect(Generic[Given]):
    """Base of the sensors that degrade a cloud, or another output; a subclass defines :meth:`spoil`.

    ``Effect[Views]`` says to a checker of types what is degraded; it may be left out.
    """

    def sense(self: Effect[PointCloud], shape: Shape, rng: np.random.Generator) -> PointCloud:
        """The effect alone: on 5,000 points of the shape, evenly spread, with their normals."""
        from ..geometry.poisson_disk import sample_poisson_disk

        source, effect = rng.spawn(2)
        return self.spoil(PointCloud(*sample_poisson_disk(shape, COUNT, source)), shape, effect)

    def spoil(self, cloud: Given, shape: Shape, rng: np.random.Generator) -> Given:
        """A degraded cloud of ``shape``, both in the frame of the case; normals, if present, stay consistent."""
        raise NotImplementedError


class Step(NamedTuple):
    """One part of a chain."""

    plugin: Plugin
    sensor: Any


def build_steps(steps: Sequence[str | Mapping[str, Any]]) -> tuple[Step, ...]:
    """The sensors named by ``steps``, with their parameters checked.

    Parameters
    ----------
    steps : sequence
        Each the name of a sensor, or a mapping of one name to its parameters: ``{"gaussian": {"sigma": 0.01}}``. From
        the second on, each must be an effect.

    Raises
    ------
    ValueError
        Naming the step, what was expected and, for a wrong name, the nearest right one.
    """
    from ..plugins.parts import build_parts

    if not steps:
        raise ValueError("steps: expected at least one, for instance [poisson_disk, gaussian]")
    built = tuple(Step(*part) for part in build_parts("sensor", steps, "steps"))
    for number in range(1, len(built) + 1):
        _check_step(number, built[:number])
    return built


def _check_step(number: int, built: Sequence[Step]) -> None:
    """Raise :class:`ValueError` unless the last step can follow those before it."""
    from ..plugins.registry import registry

    (plugin, sensor), gives = built[-1], given_by(*built[0])
    if number == 1:
        if needs_a_source(plugin, sensor):
            sources = [p.name for p in registry().all("sensor") if not _is_effect(p) and _gives(p) == gives]
            raise ValueError(
                f"steps: number 1, {plugin.name}, only degrades {gives}; put a sensor before it that makes them: "
                f"{', '.join(sources) or 'none is known'}"
            )
        return
    effects = ", ".join(p.name for p in registry().all("sensor") if _is_effect(p) and _gives(p) == gives) or "none"
    where = f"steps: number {number}, {plugin.name}"
    if not _is_effect(plugin):
        what = "a new cloud" if _gives(plugin) == "cloud" else f"new {_gives(plugin)}"
        raise ValueError(f"{where}, makes {what}; only the first may. Effects: {effects}")
    if given_by(plugin, sensor) != gives:
        raise ValueError(
            f"{where}, works on {given_by(plugin, sensor)}, but the first step, {built[0].plugin.name}, gives {gives}. "
            f"Effects on {gives}: {effects}"
        )


def _is_effect(plugin: Plugin) -> bool:
    return callable(getattr(plugin.cls, "spoil", None))


def _gives(plugin: Plugin) -> str:
    """What a sensor gives with its default parameters."""
    return plugin.options.get("gives", "cloud")
