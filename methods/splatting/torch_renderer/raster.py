"""The splats of each pixel: lists of the nearest ones, from all pairs of a splat and a pixel in its box."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ..renderer.camera import Camera
from ..renderer.settings import Drawing
from .ellipses import Ellipses
from .ragged import parts, pick, spread


class Lists(NamedTuple):
    """For each pixel the nearest splats that cover it, the nearest first."""

    index: Tensor  # type: ignore[assignment]  # tuples have a method of this name, not needed here
    """(h, w, K) int64 tensor: numbers of points, -1 for none"""
    depth: Tensor
    """(h, w, K) tensor: depths at which the ray meets the tangent planes, inf for none"""
    rho: Tensor
    """(h, w, K) tensor: weights of Eq. 3.6"""
    front: Tensor
    """(h, w) int64 tensor: the number of visible ones; the others are hidden"""


class Boxes(NamedTuple):
    """The pixels whose middles lie in boxes around splats; empty boxes are left out."""

    splat: Tensor
    """(m,) int64 tensor: numbers of points, in order"""
    corner: Tensor
    """(m, 2) int64 tensor: first column and row"""
    size: Tensor
    """(m, 2) int64 tensor: columns and rows"""

    @property
    def counts(self) -> Tensor:
        """Pixels of each box: (m,) int64 tensor."""
        return self.size[:, 0] * self.size[:, 1]

    def pixels(self, some: slice) -> tuple[Tensor, Tensor, Tensor]:
        """Number of the point, column and row of all pixels of some boxes: three int64 tensors."""
        which, offset = spread(self.counts[some])
        splat, corner, across = pick(which, self.splat[some], self.corner[some], self.size[some, 0])
        down = torch.div(offset, across, rounding_mode="floor")
        return splat, corner[:, 0] + offset - down * across, corner[:, 1] + down


def boxes(ellipses: Ellipses, scale: float, camera: Camera) -> Boxes:
    """The pixels within ``scale`` times the half extents of the splats that are shown."""
    splat = torch.nonzero(ellipses.shown)[:, 0]
    place, half = ellipses.place[splat], scale * ellipses.half[splat]
    end = torch.tensor([camera.width, camera.height], dtype=place.dtype, device=place.device)
    first = torch.minimum((place - half - 0.5).ceil().clamp_min(0), end)
    last = torch.maximum(torch.minimum((place + half - 0.5).floor(), end - 1), first - 1)
    size = (last - first + 1).long()
    some = torch.nonzero(size.prod(1) > 0)[:, 0]
    return Boxes(splat[some], first[some].long(), size[some])


def rasterise(ellipses: Ellipses, camera: Camera, how: Drawing, pairs: int) -> Lists:
    """The lists of all pixels; about ``pairs`` pairs of a splat and a pixel are in memory at a time."""
    count, device, dtype = camera.width * camera.height, ellipses.place.device, ellipses.place.dtype
    index = torch.full((count, how.layers), -1, dtype=torch.int64, device=device)
    depth = torch.full((count, how.layers), torch.inf, dtype=dtype, device=device)
    rho = torch.zeros((count, how.layers), dtype=dtype, device=device)
    around = boxes(ellipses, 1.0, camera)
    for some in parts(around.counts, pairs):
        _merge(index, depth, rho, ellipses, around.pixels(some), camera, how)
    front = (depth - depth[:, :1] <= how.depth_limit).sum(1)  # inf - inf is NaN, which is not below
    shape = (camera.height, camera.width)
    index, depth, rho = (each.reshape(*shape, how.layers) for each in (index, depth, rho))
    return Lists(index, depth, rho, front.reshape(shape))


def _merge(
    index: Tensor,
    depth: Tensor,
    rho: Tensor,
    ellipses: Ellipses,
    pixels: tuple[Tensor, Tensor, Tensor],
    camera: Camera,
    how: Drawing,
) -> None:
    """Insert splats into the lists (h w, K) of the pixels that they cover; equally deep ones stay in order."""
    splat, column, row = pixels
    beta = half_square(ellipses, splat, column, row)
    covers = torch.nonzero(beta <= how.cutoff)[:, 0]
    splat, column, row, beta = pick(covers, splat, column, row, beta)
    pixel, z = row * camera.width + column, depth_at(ellipses, splat, column, row, camera)
    nearer = torch.nonzero(z < depth[:, -1].index_select(0, pixel))[:, 0]
    splat, pixel, beta, z = pick(nearer, splat, pixel, beta, z)
    if not len(pixel):
        return
    order = _by_pixel_and_depth(pixel, z)
    splat, pixel, beta, z = pick(order, splat, pixel, beta, z)
    begins = torch.ones_like(pixel, dtype=torch.bool)
    begins[1:] = pixel[1:] != pixel[:-1]
    numbers = torch.arange(len(pixel), device=pixel.device)
    rank = numbers - torch.where(begins, numbers, 0).cummax(0).values
    list_of, touched = begins.cumsum(0) - 1, pixel[begins]
    first = torch.nonzero(rank < how.layers)[:, 0]
    splat, beta, z, *at = pick(first, splat, beta, z, list_of, how.layers + rank)
    weight = ellipses.peak.index_select(0, splat) * torch.exp(-beta)
    joined = []  # the old entries of the lists, and the new ones
    for old, new, nothing in ((index, splat, -1), (depth, z, torch.inf), (rho, weight, 0)):
        known = old.index_select(0, touched)
        both = torch.cat([known, torch.full_like(known, nothing)], dim=1)
        both[tuple(at)] = new
        joined.append(both)
    kept = joined[1].sort(dim=1, stable=True).indices[:, : how.layers]
    for old, both in zip((index, depth, rho), joined, strict=True):
        old[touched] = both.gather(1, kept)


def _by_pixel_and_depth(pixel: Tensor, depth: Tensor) -> Tensor:
    """The order of pairs by pixel, then depth, then input order."""
    if depth.dtype == torch.float32:  # both fit one number: the bits of floats are in order except for the sign
        bits = (depth + 0.0).view(torch.int32).long()
        bits = torch.where(bits < 0, -(bits & 0x7FFFFFFF), bits)
        return ((pixel << 32) + bits).sort(stable=True).indices
    order = depth.sort(stable=True).indices
    return order[pixel[order].sort(stable=True).indices]


def half_square(ellipses: Ellipses, splat: Tensor, column: Tensor, row: Tensor) -> Tensor:
    """Half the squared distance of pixels from splats, in standard deviations: beta of Eq. 3.6, (m,)."""
    place, form = pick(splat, ellipses.place, ellipses.form)
    dx, dy = column.to(place) + 0.5 - place[:, 0], row.to(place) + 0.5 - place[:, 1]
    return 0.5 * (form[:, 0] * dx * dx + form[:, 2] * dy * dy) + form[:, 1] * dx * dy


def depth_at(ellipses: Ellipses, splat: Tensor, column: Tensor, row: Tensor, camera: Camera) -> Tensor:
    """The depths (m,) at which rays of pixels meet the planes of splats, at most ``reach`` from their centres."""
    fx, fy, skew, cx, cy = camera.lens()
    ry = (row.to(ellipses.place) + 0.5 - cy) / fy
    rx = (column.to(ellipses.place) + 0.5 - cx - skew * ry) / fx
    plane = (ellipses.normal * ellipses.position).sum(1)
    known = (ellipses.normal, ellipses.position[:, 2], ellipses.reach, plane)
    normal, z, reach, plane = pick(splat, *known)
    slope = normal[:, 0] * rx + normal[:, 1] * ry + normal[:, 2]
    meets = torch.minimum(torch.maximum(plane / slope, z - reach), z + reach)
    return torch.where(plane * slope > 0, meets, z + reach)  # elsewhere the ray passes beyond the plane's horizon
