"""Fitting surfels to images by gradient descent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import distance_transform_edt

from bench import PointCloud, Run, Views

from ..renderer.camera import Camera
from .footprints import Surfels
from .losses import Weighting, loss_of
from .rendering import Slopes, render
from .state import State


@dataclass(frozen=True)
class Schedule:
    """Length and rates of the descent; the fields are those of the method."""

    steps: int
    position_rate: float
    rate_decay: float
    turn_rate: float
    scale_rate: float
    opacity_rate: float
    relocate_every: int
    relocate_until: float
    relocated: float
    transparent: float
    carve: float

    def rates(self, step: int, spacing: float) -> dict[str, float]:
        """The rates of the parameters: that of positions falls exponentially, in spacings."""
        slower = self.rate_decay ** (step / self.steps)
        return {
            "positions": self.position_rate * spacing * slower,
            "turns": self.turn_rate * slower,
            "logs": self.scale_rate * slower,
            "logits": self.opacity_rate * slower,
        }


class Scene:
    """The images to be matched, with cameras and lights.

    Parameters
    ----------
    views : Views
        With lights.
    weighting : Weighting
    threads : int
    """

    def __init__(self, views: Views, weighting: Weighting, threads: int):
        self.views, self.weighting, self.threads = views, weighting, threads
        self.cameras: Sequence[Camera] = [Camera.of(views, number) for number in range(len(views))]
        self.ambient = np.zeros((len(views), 3)) if views.ambient is None else views.ambient

    def outside(self, points: np.ndarray) -> np.ndarray:
        """The largest distance of points (n, 3) outside a mask over the views, in pixels: (n,) array, 0 inside all.

        Points outside of an image count as inside.
        """
        rows, columns, shown = self.views.pixels_at(points)
        farthest = np.zeros(len(points))
        for away, row, column, known in zip(self._away, rows, columns, shown, strict=True):
            farthest = np.maximum(farthest, np.where(known, away[row, column], 0))
        return farthest

    @cached_property
    def _away(self) -> list[np.ndarray]:
        return [distance_transform_edt(~mask) if mask.any() else np.zeros(mask.shape) for mask in self.views.masks]

    def shaded(self, normals: np.ndarray, view: int) -> tuple[np.ndarray, np.ndarray]:
        """The colours (n, 3) of normals under the lights of a view, and which lights (n, k) reach them."""
        directions, colors = self._lights(view)
        facing = normals @ directions.T
        return np.maximum(facing, 0) @ colors + self.ambient[view], facing > 0

    def _lights(self, view: int) -> tuple[np.ndarray, np.ndarray]:
        assert self.views.light_directions is not None and self.views.light_colors is not None
        return self.views.light_directions[view], self.views.light_colors[view]

    def look(self, surfels: Surfels, view: int) -> tuple[float, Slopes]:
        """The loss of one view, and its gradients; colours contribute through their normals."""
        colors, lit = self.shaded(surfels.frames[:, :, 2], view)
        rendered = render(surfels, colors, self.cameras[view], self.threads)
        wanted = self.views.images[view] / 255
        loss, slopes = loss_of(rendered.maps, wanted, self.views.masks[view], self.cameras[view], self.weighting)
        back = rendered.back(slopes)
        directions, light_colors = self._lights(view)
        by_light = back.colors @ light_colors.T * lit
        back.frames[:, :, 2] += by_light @ directions
        return loss, back

    def weights(self, surfels: Surfels) -> np.ndarray:
        """The share of each surfel in all images: (n,) array, in pixels."""
        total = np.zeros(len(surfels.positions))
        for view, camera in enumerate(self.cameras):
            rendered = render(surfels, self.shaded(surfels.frames[:, :, 2], view)[0], camera, self.threads)
            total += rendered.back(np.zeros(rendered.maps.shape)).weights
        return total


def fit(scene: Scene, state: State, spacing: float, schedule: Schedule, run: Run, spare: float = 0.0) -> PointCloud:
    """The centres of the visible and opaque surfels, with normals.

    Parameters
    ----------
    scene : Scene
    state : State
        Is changed.
    spacing : float
        Of the initial points.
    schedule : Schedule
    run : Run
        Draws the order of the views, one a step.
    spare : float
        Seconds to leave at the end.
    """
    order: list[int] = []
    tally = Tally(len(state))
    for step in range(schedule.steps):
        if not run.time_for_more() or run.seconds_left() < spare:
            break
        if not order:
            order = run.rng.permutation(len(scene.cameras)).tolist()
        surfels = state.surfels()
        _, slopes = scene.look(surfels, order.pop())
        tally.add(slopes)
        state.step(state.gradients(surfels, slopes), schedule.rates(step, spacing))
        run.progress(step + 1, schedule.steps)
        if (step + 1) % schedule.relocate_every == 0:
            if step < schedule.relocate_until * schedule.steps:
                relocate(state, tally, schedule, carved(scene, state, schedule))
            tally = Tally(len(state))
            run.trace(lambda: cloud_of(scene, state, schedule))
    return cloud_of(scene, state, schedule)


class Tally:
    """Statistics of each surfel over some steps."""

    def __init__(self, count: int):
        self.pull, self.weight, self.shown = np.zeros(count), np.zeros(count), np.zeros(count)

    def add(self, slopes: Slopes) -> None:
        """Count one view."""
        self.pull += slopes.screen
        self.weight += slopes.weights
        self.shown += slopes.weights > 0


def relocate(state: State, tally: Tally, schedule: Schedule, carved: np.ndarray) -> None:
    """Move surfels that are transparent, unseen or carved to those with the largest gradients, by splitting these."""
    dead = (state.opacities < schedule.transparent) | (tally.weight < 1e-2 * np.maximum(tally.shown, 1)) | carved
    places = np.flatnonzero(dead)
    pull = np.where(dead, -1.0, tally.pull / np.maximum(tally.shown, 1))
    count = min(len(places), int((~dead).sum()), int(schedule.relocated * len(state)))
    if count:
        state.split(np.argsort(-pull, kind="stable")[:count], places[:count])


def carved(scene: Scene, state: State, schedule: Schedule) -> np.ndarray:
    """Which surfels lie outside a mask, and so cannot belong to the shape: (n,) bool array."""
    if not schedule.carve:
        return np.zeros(len(state), dtype=bool)
    return scene.outside(state.positions) > schedule.carve


def cloud_of(scene: Scene, state: State, schedule: Schedule) -> PointCloud:
    """The centres of surfels that are opaque, visible and not carved, with normals; all, if there are none."""
    kept = (state.opacities >= schedule.transparent) & (scene.weights(state.surfels()) > 1e-2)
    kept &= ~carved(scene, state, schedule)
    kept |= not kept.any()
    return PointCloud(state.positions[kept], state.normals[kept])
