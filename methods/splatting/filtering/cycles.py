"""Cycles of filtered images: normals follow them, and points follow the normals (thesis 3.2.2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bench import PointCloud, Run

from ..fitting.descent import Descent
from ..fitting.views import Gallery
from ..regularisers.settings import Regularity
from ..regularisers.terms import Neighbours
from ..renderer.drawn import draw
from ..renderer.settings import Drawing
from .close_ups import close_ups

Filter = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Filtering:
    """How long, and how; the fields are those of the methods."""

    cycles: int
    views: int
    pixels: int
    span: float
    width: float
    normal_steps: int
    point_steps: int
    normal_rate: float
    largest: float
    momentum: float
    recursive: bool


def filtered(
    cloud: PointCloud,
    spacing: float,
    image_filter: Filter,
    how: Filtering,
    drawing: Drawing,
    regular: Regularity,
    run: Run,
) -> PointCloud:
    """The cloud after its images were filtered, or as far as it came in time.

    In each cycle the cloud as it was given (with ``recursive``, as it is) is drawn from new cameras, the images are
    filtered but for their background, the normals descend to look like them, and the points move by repulsion and
    projection alone.

    Parameters
    ----------
    cloud : PointCloud
        With normals.
    spacing : float
        Of the points.
    image_filter : function of an image (h, w, 3)
    how : Filtering
    drawing : Drawing
    regular : Regularity
    run : Run
    """
    points, normals = np.array(cloud.points), np.array(cloud.normals)
    first = points, normals
    rate, sigma = how.normal_rate * len(points), how.width * spacing
    steps = how.normal_steps + how.point_steps
    for cycle in range(how.cycles):
        from_points, from_normals = (points, normals) if how.recursive else first
        cameras, lights = close_ups(from_points, from_normals, how.views, how.pixels, how.span, run.rng)
        gallery = Gallery(cameras, np.empty(0), lights, drawing, run.threads)
        wanted = []
        for view, camera in enumerate(cameras):
            if run.seconds_left() <= 0:
                return PointCloud(points, normals)
            colors, _ = gallery.shaded(from_normals, view)
            drawn = draw(from_points, from_normals, colors, sigma, camera, drawing, run.threads)
            wanted.append(np.where(drawn.covered[..., None], image_filter(drawn.image), 0.0))
        gallery.wanted = np.array(wanted)
        descent = Descent(rate, how.largest, how.momentum, int(0.6 * how.normal_steps))
        hidden = np.zeros(len(points))
        for step in range(steps):
            if run.seconds_left() <= 0:
                return PointCloud(points, normals)
            if step < how.normal_steps:
                look = gallery.look(points, normals, sigma, np.arange(len(cameras)), True)
                descent.look(look.loss)
                moved = descent.step(normals, look.gradient)
                length = np.linalg.norm(moved, axis=1, keepdims=True)
                normals = np.where(length > 1e-9, moved / np.maximum(length, 1e-9), normals)
            else:
                around = Neighbours(points, regular, run.threads)
                if regular.repulsion:
                    # 1 / d^2 in spacings: a step is a part of the spacing, whatever the number of points.
                    points = points - around.repulsion(points, normals, hidden)[1] * len(points) * spacing**3
                points = around.projected(points, normals, hidden)
            run.progress(cycle * steps + step + 1, how.cycles * steps)
        run.trace(PointCloud(points, normals))
    return PointCloud(points, normals)
