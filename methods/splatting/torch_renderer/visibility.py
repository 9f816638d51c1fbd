"""The gradient of positions through changes of visibility, as in :mod:`..renderer.visibility`.

All pairs of a splat and a block go down the pyramid together, level by level: some are dropped, some count as a whole,
the others become pairs with smaller blocks, or with pixels. If there are too many of them for the memory, they are
processed in parts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from ..renderer.blocks import LEAF
from ..renderer.camera import Camera
from ..renderer.settings import Drawing
from ..renderer.visibility import FAINT, RAGGED
from .blocks import Blocks, pyramid
from .changes import Pixels, change_with, entry_of, pixels_of
from .ellipses import Ellipses, rotation_of
from .ragged import add_rows, parts, pick, spread
from .raster import Lists, boxes, half_square

WIDER = 1.0001  # times half the extent of a splat, because of float32 rounding


@dataclass(frozen=True, eq=False)
class Pull:
    """The common data of all parts of the gradient.

    Parameters
    ----------
    ellipses : Ellipses
    attributes : (n, c) tensor
    pixels : Pixels
    unit : float
        Size of a pixel at the depth 1.
    how : Drawing
    pairs : int
        Approximate number of pairs in memory at a time.
    back : (n, 3) float64 tensor
        The gradient: columns, rows, depth. The functions add to it.
    """

    ellipses: Ellipses
    attributes: Tensor
    pixels: Pixels
    unit: float
    how: Drawing
    pairs: int
    back: Tensor

    def add(self, splat: Tensor, *slopes: Tensor) -> None:
        """Add to the gradients of splats (m,) in columns, rows and depth, (m,) each."""
        add_rows(self.back, splat, torch.stack(slopes, dim=1))

    def coming(self, splat: Tensor, pixel: Tensor) -> Tensor:
        """The changes (m,) of the loss if splats move onto pixels."""
        own = (self.pixels.pull.index_select(0, pixel) * self.attributes.index_select(0, splat)).sum(1)
        z, peak = pick(splat, self.ellipses.position[:, 2], self.ellipses.peak)
        return change_with(self.pixels, pixel, z, peak, own, self.how.depth_limit)

    def to_front(self, splat: Tensor, depth: Tensor, squared: Tensor, change: Tensor) -> Tensor:
        """The gradients by the depth (m,) of splats hidden by others in front, otherwise 0."""
        z = self.ellipses.position[:, 2].index_select(0, splat)
        hidden = z - depth > self.how.depth_limit
        if not self.how.occlusion:
            hidden = torch.zeros_like(hidden)
        dz = torch.where(hidden, depth - z, 1.0)
        return torch.where(hidden, change * dz / (squared * (z * self.unit) ** 2 + dz * dz), 0)

    def near(self, splat: Tensor, pixel: Tensor) -> None:
        """Pixels one by one; ``pixel`` (m,) are rows of the tables."""
        pixels, how = self.pixels, self.how
        place, half = pick(splat, self.ellipses.place, self.ellipses.half)
        middle, first = pick(pixel, pixels.middle, pixels.first)
        dx, dy = (middle - place).unbind(1)
        half = half * WIDER  # a splat can be in the list only there
        inside = torch.nonzero((dx.abs() <= half[:, 0]) & (dy.abs() <= half[:, 1]))[:, 0]
        entry = entry_of(pixels, pixel[inside], splat[inside])
        listed, entry = inside[entry >= 0], entry[entry >= 0]
        change = self.coming(splat, pixel)
        change[listed] = 0
        squared = dx * dx + dy * dy + how.epsilon
        factor = change / squared
        self.add(splat, factor * dx, factor * dy, self.to_front(splat, first, squared, change))

        splat, pixel, dx, dy, squared = pick(listed, splat, pixel, dx, dy, squared)
        seen = entry < pixels.front[pixel]
        change = torch.where(seen, pixels.leaving[pixel, entry].clamp_max(0), 0)
        away, radius = squared.sqrt(), self.ellipses.half[splat].amax(1)
        factor = 0  # it can leave on either side
        for other in (away + radius, away - radius):
            value = away * other
            factor = factor + change / torch.where(value >= 0, value + how.epsilon, value - how.epsilon)
        self.add(splat, factor * dx, factor * dy, torch.where(seen, 0, pixels.forward[pixel, entry]))

    def far(self, blocks: Blocks, typical: float, splat: Tensor, block: Tensor) -> None:
        """Add the gradients from blocks (m,) at which none of the splats (m,) is visible."""
        which, offset = spread(blocks.count[block])
        one = blocks.begin[block[which]] + offset
        splat = splat.index_select(0, which)
        pull, of_image = pick(one, blocks.pull, blocks.of_image)
        change = (pull * self.attributes.index_select(0, splat)).sum(1) - of_image
        helps = torch.nonzero(change < 0)[:, 0]
        splat, one, change = pick(helps, splat, one, change)
        place, z, peak = pick(splat, self.ellipses.place, self.ellipses.position[:, 2], self.ellipses.peak)
        middle, share, depth, seen = pick(one, blocks.middle, blocks.share, blocks.depth, blocks.seen)
        dx, dy = (middle - place).unbind(1)
        squared = dx * dx + dy * dy + self.how.epsilon
        hides = z + self.how.depth_limit < depth  # all splats that are visible there
        scale = torch.where(hides, 1 / share, peak / (typical * (1 - share) + peak * share))
        change = torch.where(seen, change * scale, change)
        factor = change / squared
        self.add(splat, factor * dx, factor * dy, self.to_front(splat, depth, squared, change))

    def down(self, blocks: Blocks, typical: float) -> None:
        """All pixels, or those of the window: near ones one by one, far ones in blocks."""
        splat, top = torch.nonzero(self.ellipses.shown)[:, 0], len(blocks.shapes) - 1
        size_of_leaf = torch.bincount(self.pixels.leaf, minlength=blocks.starts[1])
        begin_of_leaf = size_of_leaf.cumsum(0) - size_of_leaf
        waiting = [(top, some, torch.zeros_like(some)) for some in splat.split(self.pairs)]
        while waiting:
            level, splat, block = waiting.pop()
            as_whole, crossed = self.judged(level, blocks.shapes[level][1], splat, block)
            one, whole = pick(torch.nonzero(as_whole)[:, 0], splat, block + blocks.starts[level])
            for part in parts(blocks.count[whole], self.pairs):
                self.far(blocks, typical, one[part], whole[part])
            splat, block, crossed = pick(torch.nonzero(~as_whole & (crossed >= 0))[:, 0], splat, block, crossed)
            if level:
                splat, block = _children(blocks, level, splat, block)
                both = zip(splat.split(self.pairs), block.split(self.pairs), strict=True)
                waiting += [(level - 1, *some) for some in both]
                continue
            for part in parts(size_of_leaf[block], self.pairs):
                which, offset = spread(size_of_leaf[block[part]])
                one, begin, edge = pick(which, splat[part], begin_of_leaf[block[part]], crossed[part])
                self.near(*self.in_window(one, begin + offset, edge > 0))

    def judged(self, level: int, across: int, splat: Tensor, block: Tensor) -> tuple[Tensor, Tensor]:
        """Whether blocks (m,) of a level count as a whole for splats, and where they lie.

        The second is -1 for blocks beyond the window, 1 for those that its border crosses, otherwise 0.
        """
        size, window, opening = LEAF << level, self.how.window or math.inf, self.how.opening
        place, half = pick(splat, self.ellipses.place, self.ellipses.half)
        row = torch.div(block, across, rounding_mode="floor")
        middle = (torch.stack([block - row * across, row], dim=1).to(place) + 0.5) * size
        off = (middle - place).abs()
        far = off.amax(1)
        beyond, crossed = far > window + 0.5 * size, far > window - 0.5 * size
        if opening > 0 and RAGGED * size <= window:  # small blocks are within the window, or beyond
            beyond, crossed = far > window, torch.zeros_like(crossed)
        touches = (off <= 0.5 * size + half).all(1)
        as_whole = (far >= opening * size) & ~crossed & ~touches & ~beyond
        if not opening:
            as_whole = torch.zeros_like(as_whole)
        return as_whole, torch.where(beyond, -1, crossed.long())

    def in_window(self, splat: Tensor, pixel: Tensor, crossed: Tensor) -> tuple[Tensor, Tensor]:
        """The pairs without those whose pixel is beyond the border, in blocks that the border crosses."""
        if not self.how.window:
            return splat, pixel
        off = self.pixels.middle.index_select(0, pixel) - self.ellipses.place.index_select(0, splat)
        some = torch.nonzero(~crossed | (off.abs().amax(1) <= self.how.window))[:, 0]
        splat, pixel = pick(some, splat, pixel)
        return splat, pixel

    def by_gaussians(self, camera: Camera) -> None:
        """The derivative of the Gaussians instead, which are local: pixels beyond FAINT are ignored."""
        around = boxes(self.ellipses, math.sqrt(FAINT / self.how.cutoff), camera)
        for some in parts(around.counts, self.pairs):
            splat, column, row = around.pixels(some)
            pixel = self.pixels.number.index_select(0, row * camera.width + column)
            pulls = torch.nonzero(pixel >= 0)[:, 0]
            splat, column, row, pixel = pick(pulls, splat, column, row, pixel)
            change = self.coming(splat, pixel)
            entry = entry_of(self.pixels, pixel, splat)
            listed, entry = torch.nonzero(entry >= 0)[:, 0], entry[entry >= 0]
            leaving = -self.pixels.leaving[pixel[listed], entry].clamp_max(0)
            change[listed] = torch.where(entry < self.pixels.front[pixel[listed]], leaving, 0)
            change = change * torch.exp(-half_square(self.ellipses, splat, column, row))
            middle = self.pixels.middle.index_select(0, pixel)
            place, form = pick(splat, self.ellipses.place, self.ellipses.form)
            (dx, dy), (m00, m01, m11) = (middle - place).unbind(1), form.unbind(1)
            self.add(splat, change * (m00 * dx + m01 * dy), change * (m01 * dx + m11 * dy), torch.zeros_like(dx))


def _children(blocks: Blocks, level: int, splat: Tensor, block: Tensor) -> tuple[Tensor, Tensor]:
    """The pairs of splats with the four blocks of each block that have pixels, on the level below."""
    (_, across), (rows, columns) = blocks.shapes[level], blocks.shapes[level - 1]
    row = torch.div(block, across, rounding_mode="floor")
    corner = torch.tensor([[0, 0, 1, 1], [0, 1, 0, 1]], device=block.device)
    down, right = 2 * row[:, None] + corner[0], 2 * (block - row * across)[:, None] + corner[1]
    there = (down < rows) & (right < columns)
    below = torch.where(there, down * columns + right, 0)
    there &= blocks.count[blocks.starts[level - 1] + below] > 0
    return splat[:, None].expand(-1, 4)[there], below[there]


def visibility_gradient(
    ellipses: Ellipses,
    lists: Lists,
    total: Tensor,
    image: Tensor,
    attributes: Tensor,
    gradient: Tensor,
    camera: Camera,
    how: Drawing,
    pairs: int,
) -> Tensor:
    """The gradient of the positions in the world: (n, 3) float64 tensor.

    Parameters
    ----------
    ellipses : Ellipses
    lists : Lists
    total : (h, w) tensor
        The sum of the weights of each pixel.
    image, gradient : (h, w, c) tensors
        The image, and the derivative of the loss by it.
    attributes : (n, c) tensor
    camera : Camera
    how : Drawing
    pairs : int
        Approximate number of pairs of a splat and a pixel in memory at a time.
    """
    fx, fy, skew, _, _ = camera.lens()
    unit = 1 / math.sqrt(fx * fy)
    back = torch.zeros(len(attributes), 3, dtype=torch.float64, device=image.device)
    pixels = pixels_of(ellipses, lists, total, image, attributes, gradient, unit, how)
    pull = Pull(ellipses, attributes, pixels, unit, how, pairs, back)
    peaks = ellipses.peak[ellipses.shown].sort().values
    if not len(peaks) or not len(pixels.leaf):
        return back
    if how.gradient == "rbf":
        pull.by_gaussians(camera)
    else:
        typical = float((peaks[(len(peaks) - 1) // 2].double() + peaks[len(peaks) // 2].double()) / 2)
        pull.down(pyramid(pixels, (camera.height, camera.width), typical), typical)
    z = torch.where(ellipses.shown, ellipses.position[:, 2].double(), 1)
    found = torch.stack([back[:, 0] * fx / z, (back[:, 0] * skew + back[:, 1] * fy) / z, back[:, 2]], dim=1)
    return found @ rotation_of(camera, image.device)
