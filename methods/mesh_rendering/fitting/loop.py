"""The descent that all mesh renderers share."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bench import Run

from ...learned.images.turns import views_in_turn
from .descent import Adam, Diffused
from .gallery import Gallery
from .regularity import Regularity

TRACES = 8  # number of intermediate results


@dataclass(frozen=True)
class Schedule:
    """Length and rates of the descent; the fields are those of the method."""

    steps: int
    views: int
    rate: float
    rate_end: float

    def rate_at(self, step: int) -> float:
        """The rate at a step: it falls by the same factor from step to step."""
        return self.rate * self.rate_end ** (step / max(self.steps - 1, 1))


def descend(
    gallery: Gallery,
    vertices: np.ndarray,
    regularity: Regularity | None,
    diffused: Diffused | None,
    schedule: Schedule,
    rng: np.random.Generator,
    run: Run,
) -> Iterator[np.ndarray]:
    """The fitted vertices (v, 3), also offered as intermediate results; fewer steps are taken if the time is over.

    Parameters
    ----------
    gallery : Gallery
    vertices : (v, 3) array
        The initial ones.
    regularity : Regularity or None
    diffused : Diffused or None
        Descend in these coordinates, with one step size for all vertices.
    schedule : Schedule
    rng : numpy Generator
        Draws the views of each step.
    run : Run
    """
    values = vertices if diffused is None else diffused.of(vertices)
    adam = Adam(uniform=diffused is not None)
    for step, chosen in enumerate(views_in_turn(len(gallery.views), schedule.views, schedule.steps, rng)):
        if not run.time_for_more():
            break
        _, gradient = gallery.look(vertices, chosen)
        if regularity is not None:
            gradient = gradient + regularity.look(vertices)[1]
        if diffused is None:
            values = vertices = adam.step(values, gradient, schedule.rate_at(step))
        else:
            values = adam.step(values, diffused.solve(gradient), schedule.rate_at(step))
            vertices = diffused.solve(values)
        run.progress(step + 1, schedule.steps)
        if (step + 1) % max(schedule.steps // TRACES, 1) == 0:
            yield vertices
    yield vertices
