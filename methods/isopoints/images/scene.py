"""The images with their cameras and lights, as tensors."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from bench import Views


class Rays(NamedTuple):
    """Half-lines of the world through pixels."""

    origins: Tensor  # (n, 3)
    directions: Tensor  # (n, 3), of unit length


class Scene:
    """Views on a device, for many pixels of many views at once; a pixel is a view and a place (column, row) in it.

    Parameters
    ----------
    views : Views
    device : str or torch.device
    dtype : torch.dtype
        Of everything but masks.
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
        if self.lit:
            self.light_directions, self.light_colors = tensor(views.light_directions), tensor(views.light_colors)
        self.ambient = tensor(np.zeros((len(views), 3)) if views.ambient is None else views.ambient)

    def __len__(self) -> int:
        return len(self.images)

    @property
    def focal(self) -> Tensor:
        """Of each view, in pixels: (v,)."""
        return (self._intrinsics[:, 0, 0] * self._intrinsics[:, 1, 1]).sqrt()

    def rays(self, view: Tensor, place: Tensor) -> Rays:
        """The rays through places (n, 2) of views (n,)."""
        homogeneous = torch.cat([place, torch.ones_like(place[:, :1])], dim=1)
        camera = torch.einsum("nij,nj->ni", self._inverse[view], homogeneous)
        directions = torch.einsum("nji,nj->ni", self._rotation[view], camera)
        return Rays(self.centers[view], F.normalize(directions, dim=1))

    def project(self, view: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
        """Places (n, 2) and depths (n,) along the optical axis, of points (n, 3) in views (n,).

        A point that is not in front of its camera has a place far outside of the image.
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
        """Whether the mask holds places (n, 2), which are shown: (n,) bool."""
        column, row = place.floor().long().unbind(1)
        return self.masks[view, row, column]

    def colors(self, view: Tensor, place: Tensor) -> Tensor:
        """The colours (n, 3) of places (n, 2): bilinear between those pixels around that the mask holds.

        Pixels beyond the silhouette would mix the background into what the surface looks like at its rim.
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
        """What a white diffuse surface looks like: colours (n, 3), 0..1, of unit normals (n, 3) in views (n,)."""
        facing = torch.einsum("nki,ni->nk", self.light_directions[view], normals).clamp(min=0)
        colors = torch.einsum("nk,nkc->nc", facing, self.light_colors[view]) + self.ambient[view]
        return colors.clamp(max=1)


class Pixels:
    """Draws random pixels of one kind: of a mask, outside of it, or any."""

    def __init__(self, scene: Scene, generator: torch.Generator):
        self._scene, self._generator = scene, generator
        self._inside = [torch.nonzero(mask.reshape(-1))[:, 0] for mask in scene.masks]
        self._outside = [torch.nonzero(~mask.reshape(-1))[:, 0] for mask in scene.masks]

    def views(self, count: int) -> Tensor:
        """So many different views, or all."""
        device = self._generator.device
        return torch.randperm(len(self._scene), generator=self._generator, device=device)[:count]

    def any(self, views: Tensor, count: int) -> tuple[Tensor, Tensor]:
        """``count`` pixels of each of some views (m,): their views and the places of their middles."""
        total = int(self._scene.size.prod())
        return self._placed(views, [self._rows(total, count) for _ in range(len(views))])

    def inside(self, views: Tensor, count: int) -> tuple[Tensor, Tensor]:
        """The same, of the masks; nothing of a view whose mask is empty."""
        return self._of(self._inside, views, count)

    def outside(self, views: Tensor, count: int) -> tuple[Tensor, Tensor]:
        """The same, outside of the masks."""
        return self._of(self._outside, views, count)

    def _of(self, kinds: list[Tensor], views: Tensor, count: int) -> tuple[Tensor, Tensor]:
        chosen = [kinds[view] for view in views.tolist()]
        return self._placed(views, [kind[self._rows(len(kind), count if len(kind) else 0)] for kind in chosen])

    def _rows(self, below: int, count: int) -> Tensor:
        return torch.randint(max(1, below), (count,), generator=self._generator, device=self._generator.device)

    def _placed(self, views: Tensor, numbers: list[Tensor]) -> tuple[Tensor, Tensor]:
        width = int(self._scene.size[0])
        number = torch.cat(numbers)
        counts = torch.tensor([len(some) for some in numbers], device=number.device)
        row = torch.div(number, width, rounding_mode="floor")
        return views.repeat_interleave(counts), torch.stack([number - row * width, row], dim=1) + 0.5
