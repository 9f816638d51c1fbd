"""Samples by iso-points: evenly spread over the surface, or denser at salient points (thesis, figure 4.18 right)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F

from bench import Run

from ..sampling.extraction import Extraction, IsoPoints, NoLevel, extract, in_ball
from ..sampling.neighbours import nearest
from ..sampling.projection import project
from ..sampling.resampling import Resampling
from .buried import buried
from .by_rays import RaySampler
from .field import ImageField
from .least import about, least
from .saliency import averaged, children, curvatures
from .samples import Samples, Surface, Wanted
from .scene import Pixels, Rays, Scene
from .tracing import Tracing, ball_span, trace
from .visibility import Visible, visible

TOLERANCE = 1e-4  # of iso-points (thesis: from 1e-4 to 1e-5)
GROWTH = 1.2  # of the number of iso-points at each extraction, up to the maximum (released: 2, less often)
NEWTON = 4  # steps back onto the surface
STARTS = 4  # random positions in the ball for each of the first iso-points (released)
MOST_MEASURED = 5000  # iso-points of which the saliency is computed (released)
OCCUPIED = 0.1  # samples within masks that should be inside, for each sample of the surface (released: at most that)
STRAYS = 4  # the starts of new iso-points include a quarter as many random positions in the ball
SOON = 10  # steps between the first two extractions of iso-points; later as many as since the first
SLANTED = 0.1  # cosine of normal and ray below which a point's pixel may show its surroundings: no colour is compared
FAST: dict[str, Any] = {"resampling": Resampling(iterations=1), "neighbours": 8}  # of an extraction
SAMPLED = Tracing(steps=0, secants=0, polish=0)  # whether a ray meets the surface at all
SOME = 4000  # iso-points around which rays are searched
INNER, OUTER = 16, 8  # samples there, on rays within masks (released: 64) and outside
Importance = Literal["uniform", "curvature", "loss"]


@dataclass(frozen=True)
class Plan:
    """Times and numbers of iso-points; the fields are parameters of the methods."""

    importance: Importance
    points: int
    most_points: int
    warm_up: int
    refresh: int
    surface: float  # share of the samples on the surface
    share: float  # the salient share of those
    inner: float  # weight of a sample within the surface that should stay inside
    lowest: int  # samples on a ray outside of a mask, besides those near iso-points
    rim: float  # share of the rays that are near the rim of a mask
    fill: bool  # sheets within the shape that no view sees should be inside


class PointSampler:
    """Draws iso-points that views see; before the first extraction, it traces rays.

    Parameters
    ----------
    field : ImageField
        The trained one.
    scene, views, samples, space, generator
        As of :class:`.by_rays.RaySampler`.
    plan : Plan
    run : Run
        Receives a note if no iso-points were found.
    """

    def __init__(
        self,
        field: ImageField,
        scene: Scene,
        views: int,
        samples: int,
        space: int,
        plan: Plan,
        run: Run,
        generator: torch.Generator,
    ):
        self._field, self._scene, self._plan, self._run, self._generator = field, scene, plan, run, generator
        self._rays = RaySampler(field.network, scene, views, samples, space, generator)
        self._pixels = Pixels(scene, generator, plan.rim)
        self._samples, self._space = samples, space
        self._step, self._next = 0, plan.warm_up
        self._count = plan.points
        self.iso: IsoPoints | None = None
        self.refreshed = 0

    def draw(self) -> Samples:
        """The next step's points."""
        plan, step = self._plan, self._step
        self._step += 1
        if step >= self._next:
            self._renew()
            # at first the surface moves fast
            self._next = step + min(plan.refresh, max(SOON, step - plan.warm_up))
        if self.iso is None:
            return self._rays.draw()
        views = self._pixels.views(self._rays.views)
        surface, free = self._moved(self._drawn(views))
        occupied = self._occupied(views, round(OCCUPIED * len(surface) / len(views)))
        occupied = occupied.and_also(self._filled(round(OCCUPIED * len(surface))))
        left = self._samples - len(surface) - len(free) - len(occupied)
        free = free.and_also(self._outside(views, left // len(views)))
        space = in_ball(self._space, 1.0, self._generator)
        return Samples(surface, occupied, free, space, self._samples)

    def _renew(self) -> None:
        """Extract new iso-points from the last ones; find the views that see them, and salient ones."""
        plan = self._plan
        if self.iso is None:
            starts = in_ball(STARTS * plan.points, 1.0, self._generator)
        else:
            # and some random ones: the surface may have grown elsewhere
            strays = in_ball(self._count // STRAYS, 1.0, self._generator)
            starts = torch.cat([self.iso.points, strays])
            if self._step > plan.warm_up + plan.refresh:  # at first the surface is coarse, and extractions are frequent
                self._count = min(plan.most_points, round(GROWTH * self._count))
        how = Extraction(self._count, tolerance=TOLERANCE, reach=1.0, **FAST)
        try:
            self.iso = extract(self._field.network, starts, how)
        except NoLevel as error:
            self._run.note(f"no iso-points after {self._step} steps: {error}")
            self.iso = None
            return
        self.refreshed += 1
        self._spacing = float(nearest(self.iso.points, 1).distances.median())
        all_views = torch.arange(len(self._scene), device=self._generator.device)
        seen = visible(self._scene, all_views, self.iso.points, self.iso.normals, 1.5 * self._spacing)
        self._base = _ByView(seen, self.iso.points, self.iso.normals, len(self._scene))
        self._buried = self.iso.points[:0]
        if plan.fill:
            self._buried = self.iso.points[buried(self._scene, self.iso.points, self.iso.normals, seen)]
        self._more = None if plan.importance == "uniform" else self._salient(seen)

    def _salient(self, seen: Visible) -> _ByView | None:
        """Points near those where the metric is high, and the views that see them."""
        assert self.iso is not None
        points, normals = self.iso.points, self.iso.normals
        metric = curvatures(points) if self._plan.importance == "curvature" else self._losses(seen)
        new = project(self._field.network, children(points, metric), tolerance=TOLERANCE)
        kept = (new.values.abs() <= TOLERANCE) & (new.points.norm(dim=1) <= 1)
        places, normals = new.points[kept], F.normalize(new.gradients[kept], dim=1)
        if not len(places):
            return None
        return _ByView(seen.depths.seen(places, normals), places, normals, len(self._scene))

    @torch.no_grad()
    def _losses(self, seen: Visible) -> Tensor:
        """The mean difference of colours of each iso-point, over the views that see it within their masks."""
        assert self.iso is not None
        points, normals = self.iso.points, self.iso.normals
        view, point, place = seen.row, seen.point, seen.place
        inside = self._scene.inside(view, place)
        view, point, place = view[inside], point[inside], place[inside]
        directions = F.normalize(points[point] - self._scene.centers[view], dim=1)
        colors = self._field.colors(view, points[point], normals[point], directions)
        off = (colors - self._scene.colors(view, place)).abs().sum(1)
        return averaged(off, point, len(points))

    def _drawn(self, views: Tensor) -> _Drawn:
        """Iso-points that views see, some of them at salient points."""
        count = round(self._plan.surface * self._samples / len(views))
        more = 0 if self._more is None else round(self._plan.share * count)
        base = self._base.drawn(views, count - more, self._spacing, self._generator)
        if self._more is None:
            return base
        salient = self._more.drawn(views, more, self._spacing / 2, self._generator)
        return _Drawn(*(torch.cat(parts) for parts in zip(base, salient, strict=True)))

    def _moved(self, drawn: _Drawn) -> tuple[Surface, Wanted]:
        """The drawn points, moved along the current surface, as samples; and those that lie outside of a mask."""
        scene, view = self._scene, drawn.view
        shift = torch.rand(drawn.points.shape, generator=self._generator, device=view.device) * 2 - 1
        shift = drawn.spacing[:, None] * (shift - (shift * drawn.normals).sum(1, keepdim=True) * drawn.normals)
        at = project(self._field.network, drawn.points + shift, tolerance=TOLERANCE, steps=NEWTON)
        directions, normals = F.normalize(at.points - scene.centers[view], dim=1), F.normalize(at.gradients, dim=1)
        place, depth = scene.project(view, at.points)
        cosine = -(directions * normals).sum(1)
        kept = (at.values.abs() <= TOLERANCE) & (at.points.norm(dim=1) <= 1) & scene.shown(place) & (cosine > 0)
        rows = torch.nonzero(kept & ~self._base.depths.hidden(view, at.points, normals))[:, 0]
        inside = scene.inside(view[rows], place[rows])
        outer, rows = rows[~inside], rows[inside & (cosine[rows] > SLANTED)]
        # a point counts as the pixels that it represents
        pixels = (drawn.area * cosine * (scene.focal[view] / depth).square())[outer]
        share = self._samples / (self._rays.views * int(scene.size.prod()))
        free = Wanted(at.points[outer], share * pixels)
        colors = scene.colors(view[rows], place[rows])
        return Surface(at.points[rows], at.gradients[rows], view[rows], directions[rows], colors), free

    def _outside(self, views: Tensor, count: int) -> Wanted:
        """Samples on rays outside of the masks."""
        view, place, weight = self._pixels.outside(views, max(2, count))
        rays = self._scene.rays(view, place)
        drawn = len(view)
        near, far, reaches = ball_span(rays, 1.0)
        rays, near, far = Rays(rays.origins[reaches], rays.directions[reaches]), near[reaches], far[reaches]
        share = torch.rand(len(near), self._plan.lowest, generator=self._generator, device=near.device)
        anywhere = near[:, None] + share * (far - near)[:, None]
        t = torch.cat([about(rays, self._some(SOME // 4), 2 * self._spacing, OUTER), anywhere], dim=1)
        points = least(self._field, rays, t, first=True).points
        weight = (1 - self._covered(views)) * self._samples / max(1, drawn) * weight[reaches]
        return Wanted(points, weight)

    def _occupied(self, views: Tensor, count: int) -> Wanted:
        """Samples on rays within the masks."""
        view, place, weight = self._pixels.inside(views, max(2, count))
        rays = self._scene.rays(view, place)
        t = about(rays, self._some(SOME), self._spacing, INNER)
        found = least(self._field, rays, t)
        # a ray that seems to miss the surface may meet a part that moved since the extraction: it is traced
        misses = torch.nonzero(found.values > 0)[:, 0]
        traced = trace(self._field, Rays(rays.origins[misses], rays.directions[misses]), SAMPLED)
        found.points[misses] = traced.points
        weights = torch.full_like(found.values, self._plan.inner)
        missed = self._covered(views) * self._samples / max(1, len(weights)) * weight[misses]
        weights[misses] = torch.where(traced.hit, 0.0, missed)
        return Wanted(found.points, weights)

    def _filled(self, count: int) -> Wanted:
        """Iso-points of voids."""
        count = min(count, len(self._buried))
        device = self._generator.device
        rows = torch.randint(max(1, len(self._buried)), (count,), generator=self._generator, device=device)
        return Wanted.alike(self._buried[rows])

    def _some(self, count: int) -> Tensor:
        """Some of the iso-points: enough to find the part of a ray that is near the surface."""
        assert self.iso is not None
        points = self.iso.points
        if len(points) <= count:
            return points
        return points[torch.randperm(len(points), generator=self._generator, device=points.device)[:count]]

    def _covered(self, views: Tensor) -> float:
        """The share of pixels within masks: each kind counts as if pixels were drawn from the whole images."""
        return float(self._scene.masks[views].float().mean())


class _Drawn(NamedTuple):
    """Iso-points of views."""

    view: Tensor  # (n,)
    points: Tensor  # (n, 3)
    normals: Tensor  # (n, 3)
    spacing: Tensor  # (n,), of the points around
    area: Tensor  # (n,), of the surface that a point represents


class _ByView:
    """Points, sorted by the views that see them."""

    def __init__(self, seen: Visible, points: Tensor, normals: Tensor, views: int):
        self.points, self.normals, self.depths = points, normals, seen.depths
        self._point = seen.point[torch.argsort(seen.row, stable=True)]
        self._count = torch.bincount(seen.row, minlength=views)
        self._begin = self._count.cumsum(0) - self._count

    def drawn(self, views: Tensor, count: int, spacing: float, generator: torch.Generator) -> _Drawn:
        """``count`` of the points of each of some views (with replacement), if it sees any."""
        views = views[self._count[views] > 0].repeat_interleave(count)
        seen = self._count[views]
        share = torch.rand(len(views), generator=generator, device=views.device)
        point = self._point[self._begin[views] + (share * seen).long()]
        apart = torch.full_like(share, spacing)
        return _Drawn(views, self.points[point], self.normals[point], apart, apart**2 * seen / max(1, count))
