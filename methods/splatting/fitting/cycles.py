"""Cycles of descents, of normals first and of positions then (thesis 3.2.1; Yifan et al. 2019)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from bench import PointCloud, Run

from ..regularisers.settings import Regularity
from ..regularisers.terms import Neighbours
from .descent import Descent, unit
from .views import Gallery


@dataclass(frozen=True)
class Schedule:
    """How long, and how fast; the fields are those of the method."""

    cycles: int
    normal_steps: int
    point_steps: int
    views: int
    normal_rate: float
    point_rate: float
    largest: float
    momentum: float
    project_every: int
    rate_decay: float
    window: float
    window_decay: float
    window_least: float
    silhouettes: float

    def window_at(self, cycle: int, width: int) -> float:
        """How far pixels pull in a cycle, in pixels of an image so wide."""
        return width * max(self.window * self.window_decay**cycle, min(self.window, self.window_least))


def fit(
    gallery: Gallery,
    cloud: PointCloud,
    sigma: float,
    schedule: Schedule,
    regular: Regularity,
    run: Run,
) -> PointCloud:
    """The cloud, after it was fitted to the images, or as far as it came in time.

    Parameters
    ----------
    gallery : Gallery
    cloud : PointCloud
        With normals.
    sigma : float
        Of the points.
    schedule : Schedule
    regular : Regularity
    run : Run
        Draws the views of each cycle, and is offered the cloud after it.
    """
    points, normals = np.array(cloud.points), np.array(cloud.normals)
    steps = schedule.normal_steps + schedule.point_steps
    hidden = np.zeros(len(points))
    turns = [
        (of_normals, count, Descent(rate, schedule.largest, schedule.momentum, int(0.6 * count)))
        for of_normals, count, rate in (
            (True, schedule.normal_steps, schedule.normal_rate),
            (False, schedule.point_steps, schedule.point_rate),
        )
    ]
    step = 0
    for cycle, chosen in enumerate(_views_of_cycles(len(gallery.cameras), schedule, run.rng)):
        regular = replace(regular, projection=regular.projection * (schedule.rate_decay if cycle else 1.0))
        gallery.how = replace(gallery.how, window=schedule.window_at(cycle, gallery.cameras[0].width))
        for of_normals, count, descent in turns:
            descent.begin(schedule.rate_decay if cycle else 1.0)
            for _ in range(count):
                if run.seconds_left() <= 0:
                    return PointCloud(points, normals)
                now = gallery.look(points, normals, sigma, chosen, of_normals)
                hidden = now.hidden
                descent.look(now.loss)
                if of_normals:
                    normals = unit(descent.step(normals, now.gradient), normals)
                else:
                    gradient = now.gradient
                    if regular.repulsion:
                        gradient = (
                            gradient + Neighbours(points, regular, run.threads).repulsion(points, normals, hidden)[1]
                        )
                    points = descent.step(points, gradient)
                    if schedule.silhouettes and gallery.silhouettes:
                        points = points + schedule.silhouettes * gallery.silhouettes.offsets(points, chosen)
                step += 1
                if regular.projection and step % schedule.project_every == 0:
                    points = Neighbours(points, regular, run.threads).projected(points, normals, hidden)
                run.progress(step, schedule.cycles * steps)
        run.trace(PointCloud(points, normals))
    return PointCloud(points, normals)


def _views_of_cycles(total: int, schedule: Schedule, rng: np.random.Generator) -> Iterator[np.ndarray]:
    """Which views each cycle looks at: all in turn, in random order."""
    order: list[int] = []
    count = min(schedule.views, total)
    for _ in range(schedule.cycles):
        while len(order) < count:
            order += rng.permutation(total).tolist()
        yield np.array(order[:count])
        order = order[count:]
