"""Rays against a field: sphere tracing from both ends, and a search if that does not converge (Yariv et al. 2020)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from ..sampling.fields import values_at
from .scene import Rays

Values = Callable[[Tensor], Tensor]  # points (n, 3) to values (n,), negative inside


@dataclass(frozen=True)
class Tracing:
    """The settings of ray tracing; the numbers are those of the released code."""

    radius: float = 1.0  # of the ball around the origin that contains the shape
    steps: int = 10  # of sphere tracing, from either end
    tolerance: float = 5e-5  # a value below counts as 0
    halvings: int = 3  # of a step that went through the surface
    samples: int = 100  # of a ray on which sphere tracing does not converge
    secants: int = 8  # steps of regula falsi between two of them
    polish: int = 2  # secant steps after sphere tracing has converged


class Traced(NamedTuple):
    """The results of rays."""

    points: Tensor  # (n, 3): the hit; else the point of least value; else the point nearest to the origin
    hit: Tensor  # (n,) bool
    reaches: Tensor  # (n,) bool: whether the ray meets the ball
    evaluations: int  # of the field


def ball_span(rays: Rays, radius: float) -> tuple[Tensor, Tensor, Tensor]:
    """Where rays enter and leave a ball around the origin: (n,) each, and whether they do, in front of the origin."""
    middle = -(rays.origins * rays.directions).sum(1)
    squared = radius**2 - (rays.origins + middle[:, None] * rays.directions).square().sum(1)
    half = squared.clamp(min=0).sqrt()
    near, far = (middle - half).clamp(min=0), middle + half
    return near, far, (squared > 0) & (far > 0)


@torch.no_grad()
def trace(values: Values, rays: Rays, how: Tracing = Tracing(), search: Tensor | None = None) -> Traced:
    """The first places at which rays meet the zero level of a field.

    Sphere tracing runs from the near and from the far end of a ray's part in the ball, at the same time. A step that
    ends inside is taken back by halves. If the near end does not converge, equidistant samples between both ends
    show the first sign change, and regula falsi refines it. A ray without a hit gets the sample with the least value.

    Parameters
    ----------
    values : function
    rays : Rays
    search : (n,) bool tensor, optional
        The rays on which samples with a sign change may become hits; all by default. (IDR: in training those
        within the mask.)
    """
    tracer = _Tracer(values, rays, how)
    tracer.march()
    tracer.polish()
    tracer.sample(torch.ones_like(tracer.hit) if search is None else search)
    middle = -(rays.origins * rays.directions).sum(1).clamp(max=0)
    t = torch.where(tracer.reaches, tracer.t, middle)
    return Traced(tracer.at(t), tracer.hit, tracer.reaches, tracer.evaluations)


class _Tracer:
    def __init__(self, values: Values, rays: Rays, how: Tracing):
        self._values, self._rays, self._how = values, rays, how
        self.evaluations = 0
        self.near, self.far, self.reaches = ball_span(rays, how.radius)
        self.t = self.near.clone()
        self.hit = torch.zeros_like(self.reaches)
        self._passed = torch.zeros_like(self.reaches)  # both ends have met, outside

    def at(self, t: Tensor, rows: Tensor | None = None) -> Tensor:
        """Points (m, 3) at distances (m,) along rays."""
        origins, directions = self._rays
        if rows is not None:
            origins, directions = origins[rows], directions[rows]
        return origins + t[:, None] * directions

    def f(self, t: Tensor, rows: Tensor) -> Tensor:
        """Values (m,) there."""
        self.evaluations += len(rows)
        return values_at(self._values, self.at(t, rows)) if len(rows) else t

    def march(self) -> None:
        """Sphere tracing from both ends."""
        rows = torch.nonzero(self.reaches)[:, 0]
        near, far = self.near[rows], self.far[rows]
        f_near, f_far = self.f(near, rows), self.f(far, rows)
        how, open_near = self._how, torch.ones_like(rows, dtype=torch.bool)
        open_far = open_near.clone()
        for _ in range(how.steps):
            open_near &= (f_near > how.tolerance) & (near < far)
            open_far &= (f_far > how.tolerance) & (near < far)
            if not (open_near.any() or open_far.any()):
                break
            near, f_near = self._stepped(near, f_near, rows, open_near, 1)
            far, f_far = self._stepped(far, f_far, rows, open_far, -1)
        arrived = (f_near.abs() <= how.tolerance) & (near < far)
        self.t[rows], self.near[rows], self.far[rows] = near, near, torch.maximum(far, near)
        self.hit[rows] = arrived
        self._passed[rows] = near >= far

    def _stepped(self, t: Tensor, f: Tensor, rows: Tensor, moving: Tensor, sign: int) -> tuple[Tensor, Tensor]:
        """One step of the moving rays, taken back by halves if it ends inside."""
        moves = torch.nonzero(moving)[:, 0]
        step, found = f[moves], t[moves] + sign * f[moves]
        value = self.f(found, rows[moves])
        for halving in range(self._how.halvings):
            inside = torch.nonzero(value < -self._how.tolerance)[:, 0]
            if not len(inside):
                break
            found[inside] -= sign * step[inside] * 0.5 / 2**halving
            value[inside] = self.f(found[inside], rows[moves[inside]])
        t, f = t.clone(), f.clone()
        t[moves], f[moves] = found, value
        return t, f

    def sample(self, search: Tensor) -> None:
        """Equidistant samples of the rays whose near end has not converged."""
        how = self._how
        rows = torch.nonzero(self.reaches & ~self.hit)[:, 0]
        if not len(rows):
            return
        share = torch.linspace(0, 1, how.samples, device=rows.device)
        begin, end = self.near[rows], self.far[rows]
        whole = self._passed[rows]  # the least value may be anywhere on the ray
        span = ball_span(Rays(*(part[rows] for part in self._rays)), how.radius)
        begin, end = torch.where(whole, span[0], begin), torch.where(whole, span[1], end)
        t = begin[:, None] + share * (end - begin)[:, None]
        f = self.f(t.reshape(-1), rows.repeat_interleave(how.samples)).reshape(t.shape)
        least = f.argmin(1)
        self.t[rows] = t.gather(1, least[:, None])[:, 0]
        first = (f < 0).float().argmax(1)
        change = (f < 0).any(1) & (first > 0) & search[rows]
        some = torch.nonzero(change)[:, 0]
        if len(some):
            high, low = first[some, None], first[some, None] - 1
            ends = (array[some].gather(1, at)[:, 0] for at in (low, high) for array in (t, f))
            found = self._between(rows[some], *ends)
            self.t[rows[some]], self.hit[rows[some]] = found, True

    def _between(self, rows: Tensor, low: Tensor, f_low: Tensor, high: Tensor, f_high: Tensor) -> Tensor:
        """Regula falsi between a value above 0 and one below."""
        t = high
        for _ in range(self._how.secants):
            t = low - f_low * (high - low) / (f_high - f_low).clamp(max=-1e-12)
            value = self.f(t, rows)
            outside = value > 0
            low, f_low = torch.where(outside, t, low), torch.where(outside, value, f_low)
            high, f_high = torch.where(outside, high, t), torch.where(outside, f_high, value)
        return t

    def polish(self) -> None:
        """Secant steps along the ray: on a grazing ray a value below the tolerance may be far from the surface."""
        rows = torch.nonzero(self.hit)[:, 0]
        reach = 100 * self._how.tolerance
        best, f_best = self.t[rows], self.f(self.t[rows], rows)
        last = best - self._how.tolerance
        f_last = self.f(last, rows)
        for _ in range(self._how.polish):
            step = (best - last) * f_best / torch.where(f_best == f_last, torch.inf, f_best - f_last)
            t = best - step.clamp(-reach, reach)
            f = self.f(t, rows)
            better = f.abs() < f_best.abs()
            last, f_last = torch.where(better, best, last), torch.where(better, f_best, f_last)
            best, f_best = torch.where(better, t, best), torch.where(better, f, f_best)
        self.t[rows] = best
