"""The images with their cameras and lights, as tensors."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from scipy.ndimage import distance_transform_edt
from torch import Tensor
from torch.nn import functional as F

from bench import Views

RIM = 0.03  # of an image's longer side: a pixel within this distance of the other kind is at the rim of a mask


class Rays(NamedTuple):
    """Half-lines of the world through pixels."""

    origins: Tensor  # (n, 3)
    directions: Tensor  # (n, 3), of unit length


class Scene:
    """Views on a device, for many pixels of many views at once; a pixel is a view and a position (column, row) in it.

    Parameters
    ----------
    views : Views
    device : str or torch.device
    dtype : torch.dtype
        Of everything except masks.
    """

    def __init__(self, views: Views, device: str | torch.device, dtype: torch.dtype = torch.float32):
        def tensor(array: np.ndarray) -> Tensor:
            return torch.as_tensor(np.array(array), dtype=dtype, device=device)

        self.images = tensor(views.images) / 255
        self.masks = torch.as_tensor(np.array(views.masks), device=device)
        self.size = torch.tensor([views.width, views.height], device=device)
        self.centers = tensor(views.centers)
        self._rotation, self._shift = tensor(views.extrinsics[:, :, :3]), tensor(views.extrinsics[:, :, 3])
        self._intrinsics = tensor(views.intrinsics)
        self._inverse = tensor(np.linalg.inv(views.intrinsics))
        self.lit = views.light_directions is not None
        if views.light_directions is not None:
            assert views.light_colors is not None  # they come together
            self.light_directions, self.light_colors = tensor(views.light_directions), tensor(views.light_colors)
        self.ambient = tensor(np.zeros((len(views), 3)) if views.ambient is None else views.ambient)

    def __len__(self) -> int:
        return len(self.images)

    @property
    def focal(self) -> Tensor:
        """The focal length of each view, in pixels: (v,)."""
        return (self._intrinsics[:, 0, 0] * self._intrinsics[:, 1, 1]).sqrt()

    def rays(self, view: Tensor, place: Tensor) -> Rays:
        """The rays through places (n, 2) of views (n,)."""
        homogeneous = torch.cat([place, torch.ones_like(place[:, :1])], dim=1)
        camera = torch.einsum("nij,nj->ni", self._inverse[view], homogeneous)
        directions = torch.einsum("nji,nj->ni", self._rotation[view], camera)
        return Rays(self.centers[view], F.normalize(directions, dim=1))

    def project(self, view: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
        """Places (n, 2) and depths (n,) along the optical axis, of points (n, 3) in views (n,).

        A point that is not in front of its camera is placed far outside of the image.
        """
        camera = torch.einsum("nij,nj->ni", self._rotation[view], points) + self._shift[view]
        depth = camera[:, 2]
        front = depth > 1e-6
        pixel = torch.einsum("nij,nj->ni", self._intrinsics[view, :2], camera)
        place = pixel / torch.where(front, depth, 1.0)[:, None]
        return torch.where(front[:, None], place, -1e9), depth

    def shown(self, place: Tensor) -> Tensor:
        """Whether places (n, 2) lie within the image: (n,) bool."""
        return ((place >= 0) & (place < self.size)).all(1)

    def inside(self, view: Tensor, place: Tensor) -> Tensor:
        """Whether the mask contains places (n, 2) within the image: (n,) bool."""
        column, row = place.floor().long().unbind(1)
        return self.masks[view, row, column]

    def colors(self, view: Tensor, place: Tensor) -> Tensor:
        """The colours (n, 3) of places (n, 2): bilinear between the surrounding pixels within the mask.

        Pixels beyond the silhouette would mix the background into the colours at its rim.
        """
        corner = place - 0.5
        low = corner.floor()
        share = corner - low
        total, weights = place.new_zeros(len(place), 3), place.new_zeros(len(place), 1)
        for right in (0, 1):
            for down in (0, 1):
                column = (low[:, 0].long() + right).clamp(0, int(self.size[0]) - 1)
                row = (low[:, 1].long() + down).clamp(0, int(self.size[1]) - 1)
                across = share[:, 0] if right else 1 - share[:, 0]
                along = share[:, 1] if down else 1 - share[:, 1]
                weight = (across * along * self.masks[view, row, column])[:, None]
                total = total + weight * self.images[view, row, column]
                weights = weights + weight
        return total / weights.clamp(min=1e-9)

    def shaded(self, view: Tensor, normals: Tensor) -> Tensor:
        """The colours of a white diffuse surface: (n, 3), 0..1, of unit normals (n, 3) in views (n,)."""
        facing = torch.einsum("nki,ni->nk", self.light_directions[view], normals).clamp(min=0)
        colors = torch.einsum("nk,nkc->nc", facing, self.light_colors[view]) + self.ambient[view]
        return colors.clamp(max=1)


class Drawn(NamedTuple):
    """Pixels of views."""

    view: Tensor  # (n,)
    place: Tensor  # (n, 2), of their middles
    weight: Tensor  # (n,), the number of pixels that each represents, over the mean


class Pixels:
    """Draws random pixels of one kind: of a mask, outside of it, or any.

    For one kind, a share of ``rim`` is drawn near the rim of the mask, and these have accordingly less weight: pixels
    farther away carry little information, because they are clearly inside, or outside.
    """

    def __init__(self, scene: Scene, generator: torch.Generator, rim: float = 0.0):
        self._scene, self._generator, self._rim = scene, generator, rim

    @cached_property
    def _kinds(self) -> list[list[tuple[Tensor, Tensor]]]:
        """The kinds of each view, computed on first use: drawing any pixels does not need the distances to the rims."""
        return [_kinds(mask) for mask in self._scene.masks]

    def views(self, count: int) -> Tensor:
        """``count`` different views, or all."""
        device = self._generator.device
        return torch.randperm(len(self._scene), generator=self._generator, device=device)[:count]

    def any(self, views: Tensor, count: int) -> Drawn:
        """``count`` pixels of each of some views (m,)."""
        total = int(self._scene.size.prod())
        rows = [self._rows(total, count) for _ in range(len(views))]
        return self._placed(views, rows, torch.ones(count * len(views), device=views.device))

    def inside(self, views: Tensor, count: int) -> Drawn:
        """The same, within the masks (at least two); none of a view whose mask is empty."""
        return self._of(0, views, count)

    def outside(self, views: Tensor, count: int) -> Drawn:
        """The same, outside of the masks (at least two)."""
        return self._of(1, views, count)

    def _of(self, kind: int, views: Tensor, count: int) -> Drawn:
        rows, weights = [], []
        for view in views.tolist():
            near, far = self._kinds[view][kind]
            share = len(near) / max(1, len(near) + len(far))
            some = round(count * (self._rim + (1 - self._rim) * share))
            # at least one from each part with pixels, even if few are drawn
            some = count if not len(far) else 0 if not len(near) else min(max(1, some), count - 1)
            for pixels, drawn, part in ((near, some, share), (far, count - some, 1 - share)):
                number = drawn if len(pixels) else 0
                rows.append(pixels[self._rows(len(pixels), number)])
                weights.append(torch.full((number,), part * count / max(1, drawn), device=pixels.device))
        return self._placed(views.repeat_interleave(2), rows, torch.cat(weights))

    def _rows(self, below: int, count: int) -> Tensor:
        return torch.randint(max(1, below), (count,), generator=self._generator, device=self._generator.device)

    def _placed(self, views: Tensor, numbers: list[Tensor], weight: Tensor) -> Drawn:
        width = int(self._scene.size[0])
        number = torch.cat(numbers)
        counts = torch.tensor([len(some) for some in numbers], device=number.device)
        row = torch.div(number, width, rounding_mode="floor")
        view = views.repeat_interleave(counts)
        return Drawn(view, torch.stack([number - row * width, row], dim=1) + 0.5, weight)


def _kinds(mask: Tensor) -> list[tuple[Tensor, Tensor]]:
    """The numbers of a mask's pixels, of those near its rim and of the others; and of the pixels outside."""
    held = mask.cpu().numpy()
    kinds: list[tuple[Tensor, Tensor]] = []
    for kind in (held, ~held):
        # an image with only one kind has no rim; the function would measure to an arbitrary place
        distance = distance_transform_edt(kind) if not kind.all() else np.full(kind.shape, np.inf)
        near, far = kind & (distance <= RIM * max(kind.shape)), kind & (distance > RIM * max(kind.shape))
        numbers = [torch.as_tensor(np.flatnonzero(some), device=mask.device) for some in (near, far)]
        kinds.append((numbers[0], numbers[1]))
    return kinds
