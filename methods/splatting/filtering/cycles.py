"""Cycles of filtered images: normals follow them, and points follow the normals (thesis 3.2.2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bench import PointCloud, Run

from ..fitting.descent import Descent, unit
from ..fitting.views import Gallery
from ..regularisers.settings import Regularity
from ..regularisers.terms import Neighbours
from ..renderer.settings import Drawing
from .close_ups import close_ups

Filter = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Filtering:
    """The settings of the cycles; the fields are those of the methods."""

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
    average: float


def filtered(
    cloud: PointCloud,
    pictured: PointCloud,
    spacing: float,
    image_filter: Filter,
    how: Filtering,
    drawing: Drawing,
    regular: Regularity,
    run: Run,
) -> PointCloud:
    """The cloud after filtering its images, in all cycles or as many as the time allows.

    In each cycle the input cloud (with ``recursive``, the current one) is rendered from new cameras, the images are
    filtered except for their background, the normals descend to match them, and the points move only by repulsion and
    projection.

    Parameters
    ----------
    cloud : PointCloud
        With normals.
    pictured : PointCloud
        The rendered and filtered cloud, with normals; with ``recursive`` only in the first cycle.
    spacing : float
        Of the points.
    image_filter : function of an image (h, w, 3)
    how : Filtering
    drawing : Drawing
    regular : Regularity
    run : Run
    """
    points, normals = np.array(cloud.points), np.array(cloud.normals)
    first = points
    rate, sigma = how.normal_rate * len(points), how.width * spacing
    steps = how.normal_steps + how.point_steps
    for cycle in range(how.cycles):
        if cycle and how.recursive:
            from_points, from_normals = points, normals
        else:
            assert pictured.normals is not None
            from_points, from_normals = pictured.points, pictured.normals
        cameras, lights = close_ups(from_points, from_normals, how.views, how.pixels, how.span, run.rng)
        gallery = Gallery(cameras, np.empty(0), lights, drawing, run.threads, device=run.device)
        wanted = []
        for view in range(len(cameras)):
            if not run.time_for_more():
                return PointCloud(points, normals)
            drawn = gallery.draw(from_points, from_normals, sigma, view)
            wanted.append(np.where(drawn.covered[..., None], image_filter(drawn.image), 0.0))
        gallery.wanted = np.array(wanted)
        descent = Descent(rate, how.largest, how.momentum, int(0.6 * how.normal_steps))
        hidden = np.zeros(len(points))
        for step in range(steps):
            if not run.time_for_more():
                return PointCloud(points, normals)
            if step < how.normal_steps:
                look = gallery.look(points, normals, sigma, np.arange(len(cameras)), True)
                descent.look(look.loss)
                normals = unit(descent.step(normals, look.gradient), normals)
            else:
                around = Neighbours(points, regular, run.threads)
                if regular.repulsion:
                    # 1 / d^2 in spacings: a step is a share of the spacing, for any number of points.
                    apart = around.repulsion(points, normals, hidden)[1] * len(points) * spacing**3
                    points = points - np.clip(apart, -LEAP * spacing, LEAP * spacing)
                points = around.projected(points, normals, hidden)
                if how.average:
                    points = _averaged(points, normals, first, spacing, how.average)
            run.progress(cycle * steps + step + 1, how.cycles * steps)
        run.trace(PointCloud(points, normals))
    return PointCloud(points, normals)


LEAP = 0.1  # spacings that a point moves by repulsion at most, along each axis
AVERAGED = 16  # nearest input points, to whose mean a point is attracted


def _averaged(points: np.ndarray, normals: np.ndarray, given: np.ndarray, spacing: float, weight: float) -> np.ndarray:
    """Points, moved along their normals towards the mean of the input points near them.

    As in the released code (there with the weight 0.01): without it, projection moves convex parts outwards step by
    step. Weights of the mean are exp(-d^2 / 4 D^2), with D twice the spacing.
    """
    from scipy.spatial import cKDTree

    distance, index = cKDTree(given).query(points, min(AVERAGED, len(given)))
    near = np.exp(-(distance.reshape(len(points), -1) ** 2) / (16 * spacing**2))
    mean = (near[..., None] * given[index.reshape(near.shape)]).sum(axis=1) / near.sum(axis=1, keepdims=True)
    return points + weight * ((mean - points) * normals).sum(axis=1, keepdims=True) * normals
