"""Visibility of surface points in a camera: discs in their tangent planes, and the nearest one of each pixel."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F

from .scene import Scene

REACH = 1.0  # pixels from the middle of a disc to its rim: determines the resolution of depth images


class Depths(NamedTuple):
    """Depth images of discs, one for each of some views."""

    scene: Scene
    views: Tensor  # (m,)
    nearest: Tensor  # (m, h, w): depth along the optical axis; infinite for the background
    scale: float  # pixels of these images per pixel of the views
    radius: float  # of the discs

    def hidden(self, row: Tensor, points: Tensor, normals: Tensor) -> Tensor:
        """Whether points (n, 3) are behind a disc in the views of rows (n,): (n,) bool.

        Behind it by more than a disc's radius plus the change in depth of a slanted surface within a pixel.
        """
        view = self.views[row]
        place, depth = self.scene.project(view, points)
        height, width = self.nearest.shape[1:]
        column, line = (place * self.scale).floor().long().unbind(1)
        known = (column >= 0) & (column < width) & (line >= 0) & (line < height)
        front = self.nearest[row, line.clamp(0, height - 1), column.clamp(0, width - 1)]
        towards = F.normalize(self.scene.centers[view] - points, dim=1)
        cosine = (towards * normals).sum(1).abs().clamp(min=0.1)
        pixel = depth / (self.scene.focal[view] * self.scale)
        return known & (depth > front + self.radius + pixel * (1 - cosine**2).sqrt() / cosine)

    def seen(self, points: Tensor, normals: Tensor) -> Visible:
        """Those of points (n, 3) that the views see: they face a camera, and are not hidden."""
        row, point, place = _facing(self.scene, self.views, points, normals)
        kept = ~self.hidden(row, points[point], normals[point])
        return Visible(row[kept], point[kept], place[kept], self)


class Visible(NamedTuple):
    """Pairs of a view and a point that it sees."""

    row: Tensor  # (n,) of the requested views
    point: Tensor  # (n,)
    place: Tensor  # (n, 2) in the view
    depths: Depths


@torch.no_grad()
def visible(scene: Scene, views: Tensor, points: Tensor, normals: Tensor, radius: float) -> Visible:
    """The points that views (m,) see: those that face a camera, with no disc in front of them.

    A point represents a disc of its tangent plane; discs as wide as the spacing of the points cover the surface.

    Parameters
    ----------
    points, normals : (n, 3) tensors
        Of the world; unit normals outwards.
    radius : float
        Of the discs.
    """
    row, point, place = _facing(scene, views, points, normals)
    _, depth = scene.project(views[row], points[point])
    wide = scene.focal[views[row]] * radius / depth
    scale = min(1.0, REACH / max(float(wide.median()), 1e-6)) if len(wide) else 1.0
    shape = (len(views), *(max(1, math.ceil(float(size) * scale)) for size in scene.size.flip(0)))
    nearest = torch.full(shape, torch.inf, device=points.device)
    if len(point):
        _draw(nearest, scene, views[row], row, points[point], normals[point], place * scale, scale, radius)
    return Depths(scene, views, nearest, scale, radius).seen(points, normals)


def _facing(scene: Scene, views: Tensor, points: Tensor, normals: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Pairs of a view and a point that faces it, within the image: the view's row, the point, its place."""
    point = torch.arange(len(points), device=points.device).repeat(len(views))
    row = torch.arange(len(views), device=points.device).repeat_interleave(len(points))
    place, _ = scene.project(views[row], points[point])
    facing = ((scene.centers[views[row]] - points[point]) * normals[point]).sum(1) > 0
    kept = torch.nonzero(facing & scene.shown(place))[:, 0]
    return row[kept], point[kept], place[kept]


def _draw(
    nearest: Tensor,
    scene: Scene,
    view: Tensor,
    row: Tensor,
    points: Tensor,
    normals: Tensor,
    place: Tensor,
    scale: float,
    radius: float,
) -> None:
    """Draw the discs at places (n, 2) of the depth images, within two pixels around."""
    height, width = nearest.shape[1:]
    line = torch.arange(-math.ceil(REACH), math.ceil(REACH) + 1, device=place.device)
    offsets = torch.cartesian_prod(line, line)
    pixel = place.floor()[:, None] + offsets
    which, _ = torch.nonzero((pixel >= 0).all(2) & (pixel[..., 0] < width) & (pixel[..., 1] < height), as_tuple=True)
    pixel = pixel[(pixel >= 0).all(2) & (pixel[..., 0] < width) & (pixel[..., 1] < height)]
    origins, directions = scene.rays(view[which], (pixel + 0.5) / scale)
    points, normals, row = points[which], normals[which], row[which]
    along = ((points - origins) * normals).sum(1) / (directions * normals).sum(1)
    hit = origins + along[:, None] * directions
    drawn = torch.nonzero((along > 0) & ((hit - points).square().sum(1) <= radius**2))[:, 0]
    _, depth = scene.project(view[which[drawn]], hit[drawn])
    at = (row * height + pixel[:, 1].long()) * width + pixel[:, 0].long()
    nearest.view(-1).scatter_reduce_(0, at[drawn], depth, "amin")
