"""Cycles of descents, first of normals, then of positions (thesis 3.2.1; Yifan et al. 2019)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bench import PointCloud, Run

from ...learned.images.turns import views_in_turn
from ..regularisers.settings import Regularity
from ..regularisers.terms import Neighbours
from .descent import Descent, unit
from .refinement import focus
from .silhouettes import Silhouettes
from .views import Gallery


@dataclass(frozen=True)
class Schedule:
    """Length and rates of the descents; the fields are those of the method."""

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
    refinements: int
    refined_part: float

    def window_at(self, cycle: int, width: int) -> float:
        """The range of a pixel's effect in a cycle, in pixels of an image of this width."""
        return width * max(self.window * self.window_decay**cycle, min(self.window, self.window_least))


def fit(
    gallery: Gallery,
    cloud: PointCloud,
    sigma: float,
    schedule: Schedule,
    regular: Regularity,
    run: Run,
) -> PointCloud:
    """The cloud fitted to the images, in all cycles or as many as the time allows.

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
        Draws the views of each cycle, and receives the cloud after it as an intermediate result.
    """
    fitting = Fitting(cloud, sigma, schedule, regular, run)
    chosen_views = views_in_turn(len(gallery.cameras), schedule.views, schedule.cycles, run.rng)
    for cycle, chosen in enumerate(chosen_views):
        if cycle:
            fitting.slow_down(schedule.rate_decay)
        gallery.how = replace(gallery.how, window=schedule.window_at(cycle, gallery.cameras[0].width))
        if not fitting.cycle(gallery, chosen, gallery.silhouettes, chosen):
            return fitting.cloud()
    before: list[np.ndarray] = []
    apart = schedule.refined_part / 2 * float(np.ptp(fitting.points, axis=0).max())
    for _ in range(schedule.refinements):
        found = focus(
            gallery, fitting.points, fitting.normals, sigma, schedule.refined_part, schedule.views, before, apart
        )
        if found is None:
            break
        before.append(found.place)
        if not fitting.cycle(found.gallery, np.arange(len(found.views)), gallery.silhouettes, found.views, part=True):
            break
    return fitting.cloud()


class Fitting:
    """Points and normals during the fit, and the descents that move them."""

    def __init__(self, cloud: PointCloud, sigma: float, schedule: Schedule, regular: Regularity, run: Run):
        self.points, self.normals = np.array(cloud.points), np.array(cloud.normals)
        self._hidden = np.zeros(len(cloud))
        self._sigma, self._schedule, self._regular, self._run = sigma, schedule, regular, run
        counts = schedule.normal_steps, schedule.point_steps
        self._descents = [
            Descent(rate, schedule.largest, schedule.momentum, int(0.6 * count))
            for count, rate in zip(counts, (schedule.normal_rate, schedule.point_rate), strict=True)
        ]
        self._turns = [(True, counts[0]), (False, counts[1])]
        self._step, self._steps = 0, (schedule.cycles + schedule.refinements) * sum(counts)

    def cloud(self) -> PointCloud:
        """The current cloud."""
        return PointCloud(self.points, self.normals)

    def slow_down(self, factor: float) -> None:
        """Multiply rates and projection by a factor, from now on."""
        self._regular = replace(self._regular, projection=self._regular.projection * factor)
        for descent in self._descents:
            descent.rate *= factor

    def cycle(
        self,
        gallery: Gallery,
        chosen: np.ndarray,
        silhouettes: Silhouettes | None,
        seen_by: np.ndarray,
        part: bool = False,
    ) -> bool:
        """One descent of the normals and one of the points; returns whether there was time for it.

        Parameters
        ----------
        gallery : Gallery
        chosen : (m,) int array
            The images to use.
        silhouettes : Silhouettes, or None
        seen_by : (m,) int array
            The silhouettes that points move to.
        part : bool
            The images show a part of the shape: points that are not visible in any of them do not move.
        """
        for (of_normals, count), descent in zip(self._turns, self._descents, strict=True):
            descent.begin()
            for _ in range(count):
                if not self._run.time_for_more():
                    return False
                now = gallery.look(self.points, self.normals, self._sigma, chosen, of_normals)
                before = self.points
                self._hidden = np.where(now.shown > 0, now.hidden, self._hidden)
                descent.look(now.loss)
                if of_normals:
                    self.normals = unit(descent.step(self.normals, now.gradient), self.normals)
                else:
                    gradient = now.gradient
                    if self._regular.repulsion:
                        gradient = gradient + self._around().repulsion(self.points, self.normals, self._hidden)[1]
                    self.points = descent.step(self.points, gradient)
                    if self._schedule.silhouettes and silhouettes:
                        self.points = self.points + self._schedule.silhouettes * silhouettes.offsets(
                            self.points, seen_by
                        )
                self._step += 1
                if self._regular.projection and self._step % self._schedule.project_every == 0:
                    self.points = self._around().projected(self.points, self.normals, self._hidden)
                if part:
                    self.points = np.where(now.shown[:, None] > 0, self.points, before)
                self._run.progress(self._step, self._steps)
        self._run.trace(self.cloud())
        return True

    def _around(self) -> Neighbours:
        return Neighbours(self.points, self._regular, self._run.threads)
