"""Colours along rays as sums over samples whose weights come from the field (Wang et al. 2021, NeuS)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ..sampling.fields import values_at
from .field import ImageField, Terms
from .scene import Pixels, Rays, Scene
from .tracing import ball_span

if TYPE_CHECKING:
    from .appearance import Appearance


@dataclass(frozen=True, eq=False)
class RayBatch:
    """Rays of a step, or of a part of it, with the places of their samples."""

    rays: Rays
    t: Tensor  # (n, k + 1), increasing: the borders of k parts of each ray
    views: Tensor  # (n,)
    colors: Tensor  # (n, 3)
    inside: Tensor  # (n,) bool, by the mask
    total: int  # rays of the whole step

    @property
    def x(self) -> Tensor:
        """The origins of the rays."""
        return self.rays.origins

    def chunks(self, size: int) -> Iterator[RayBatch]:
        """Parts of about ``size`` samples."""
        n, k = self.t.shape
        parts = max(1, -(-n * k // size))
        for i in range(parts):
            rows = slice(n * i // parts, n * (i + 1) // parts)
            rays = Rays(self.rays.origins[rows], self.rays.directions[rows])
            yield RayBatch(rays, self.t[rows], self.views[rows], self.colors[rows], self.inside[rows], self.total)


def opacities(before: Tensor, after: Tensor, sharpness: Tensor | float) -> Tensor:
    """The opacities of parts of rays, from the field's values at their two ends: ``max(0, 1 - s(after) / s(before))``.

    s is the logistic function of ``sharpness`` times the value. If the field falls along the ray from above 0 to
    below, the weights of the parts are those of the logistic density about its zero: unbiased, and independent of what
    is behind (equation 13 of the paper).
    """
    first, last = F.logsigmoid(sharpness * before), F.logsigmoid(sharpness * after)
    return -torch.expm1((last - first).clamp(max=0))


def weights_of(opacity: Tensor) -> Tensor:
    """The weight of each part of a ray: its opacity times the transparency of those before it, (n, k)."""
    clear = torch.cumprod(torch.cat([torch.ones_like(opacity[:, :1]), 1 - opacity + 1e-7], dim=1), dim=1)
    return opacity * clear[:, :-1]


class VolumeSampler:
    """Draws rays through random pixels, and samples on them: even ones, and more where the weights are large.

    Parameters
    ----------
    values : function of points (n, 3) to values (n,)
    sharpness : function without arguments
        Returns the current one.
    scene : Scene
    views, count : int
        Images and rays of a step.
    coarse, fine : int
        Numbers of even parts of a ray, and of parts added by the weights, in two halves.
    generator : torch.Generator
    """

    def __init__(
        self,
        values: Callable[[Tensor], Tensor],
        sharpness: Callable[[], float],
        scene: Scene,
        views: int,
        count: int,
        coarse: int,
        fine: int,
        generator: torch.Generator,
    ):
        self._values, self._sharpness, self._scene, self._generator = values, sharpness, scene, generator
        self._pixels = Pixels(scene, generator)
        self._views, self._count, self._coarse, self._fine = views, count, coarse, fine

    def draw(self) -> RayBatch:
        """The next step's rays; those that miss the ball are left out, but count in the total."""
        views = self._pixels.views(self._views)
        view, place, _ = self._pixels.any(views, max(1, self._count // len(views)))
        rays = self._scene.rays(view, place)
        near, far, reaches = ball_span(rays, 1.0)
        total = len(view)
        rays, view, place = Rays(rays.origins[reaches], rays.directions[reaches]), view[reaches], place[reaches]
        t = self._places(rays, near[reaches, None], far[reaches, None])
        inside = self._scene.inside(view, place)
        colors = torch.where(inside[:, None], self._scene.colors(view, place), 0.0)
        return RayBatch(rays, t, view, colors, inside, total)

    @torch.no_grad()
    def _places(self, rays: Rays, near: Tensor, far: Tensor) -> Tensor:
        even = torch.linspace(0, 1, self._coarse + 1, device=near.device)
        jitter = torch.rand(near.shape, generator=self._generator, device=near.device) / self._coarse
        t = near + (even + jitter).clamp(max=1) * (far - near)
        f = self._f(rays, t)
        for sharper in (1, 2):
            weights = weights_of(opacities(f[:, :-1], f[:, 1:], max(64.0, self._sharpness()) * sharper)) + 1e-5
            more = self._by_weight(t, weights, self._fine // 2)
            t, order = torch.cat([t, more], dim=1).sort(dim=1)
            f = torch.cat([f, self._f(rays, more)], dim=1).gather(1, order)
        return t

    def _by_weight(self, t: Tensor, weights: Tensor, count: int) -> Tensor:
        """Samples (n, count) at even steps of the accumulated weights of parts between ``t`` (n, k + 1)."""
        sums = torch.cat([torch.zeros_like(weights[:, :1]), weights.cumsum(1)], dim=1)
        sums = sums / sums[:, -1:]
        shift = torch.rand(len(t), 1, generator=self._generator, device=t.device)
        wanted = (torch.arange(count, device=t.device) + shift) / count
        right = torch.searchsorted(sums, wanted.contiguous(), right=True).clamp(1, t.shape[1] - 1)
        low, high = sums.gather(1, right - 1), sums.gather(1, right)
        share = (wanted - low) / (high - low).clamp(min=1e-12)
        begin = t.gather(1, right - 1)
        return begin + share.clamp(0, 1) * (t.gather(1, right) - begin)

    def _f(self, rays: Rays, t: Tensor) -> Tensor:
        x = rays.origins[:, None] + t[..., None] * rays.directions[:, None]
        return values_at(self._values, x.reshape(-1, 3)).reshape(t.shape)


class VolumeField(ImageField):
    """A sine network fitted to images by sums along rays, with a learned sharpness.

    The sharpness is ``exp(10 s)``, initially s = 0.3 (published).
    """

    FASTER = 5.0  # times the learning rate of the network, for the sharpness

    def __init__(self, scene: Scene, terms: Terms, appearance: Appearance | None, omega: float, **form: object):
        super().__init__(scene, terms, appearance, omega, **form)
        self.sharp = nn.Parameter(torch.tensor(0.3))

    def sharpness(self) -> Tensor:
        """The sharpness of the logistic density about the surface."""
        return torch.exp(10 * self.sharp).clamp(max=1e4)

    def groups(self) -> list[list[nn.Parameter]]:
        """The network, the appearance, the sharpness."""
        return [*super().groups(), [self.sharp]]

    def rates(self, t: float) -> list[float]:
        """As in the other methods."""
        rates = super().rates(t)
        return [*rates, self.FASTER * rates[0]]

    def loss(self, batch: RayBatch, t: float) -> Tensor:  # type: ignore[override]
        """Colours within the masks, the masks themselves, and the gradient's length."""
        terms, share = self._terms, 1 / max(1, batch.total)
        middle = (batch.t[:, :-1] + batch.t[:, 1:]) / 2
        length = batch.t[:, 1:] - batch.t[:, :-1]
        n, k = middle.shape
        points = (batch.rays.origins[:, None] + middle[..., None] * batch.rays.directions[:, None]).reshape(-1, 3)
        directions = batch.rays.directions[:, None].expand(n, k, 3).reshape(-1, 3)
        f, gradients = self.network.value_and_gradient(points)
        # values at both ends, by the slope along the ray; a surface that faces away occludes nothing
        slope = -F.relu(-(gradients * directions).sum(1)).reshape(n, k)
        half = slope * length / 2
        weights = weights_of(opacities(f.reshape(n, k) - half, f.reshape(n, k) + half, self.sharpness()))
        colors = self.colors(
            batch.views.repeat_interleave(k), points, F.normalize(gradients, dim=1), directions
        ).reshape(n, k, 3)
        seen = (weights[..., None] * colors).sum(1)
        whole = weights.sum(1).clamp(1e-4, 1 - 1e-4)
        off = (seen - batch.colors).abs().sum(1)
        loss = terms.color * share * off[batch.inside].sum()
        loss = loss + terms.mask * share * F.binary_cross_entropy(whole, batch.inside.to(whole), reduction="sum")
        stretch = (gradients.norm(dim=1) - 1).square().reshape(n, k).mean(1)
        return loss + terms.eikonal * share * stretch.sum()
