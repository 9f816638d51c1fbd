"""Samples by iso-points: evenly spread over the surface, or denser where it matters (thesis, figure 4.18 right)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor
from torch.nn import functional as F

from bench import Run

from ..sampling.extraction import Extraction, IsoPoints, NoLevel, extract
from ..sampling.neighbours import nearest
from ..sampling.projection import project
from ..sampling.resampling import Resampling
from .by_rays import RaySampler
from .field import ImageField
from .inner import inner_points, least
from .saliency import averaged, children, curvatures
from .samples import Samples, Surface, in_ball
from .scene import Pixels, Rays, Scene
from .tracing import ball_span
from .visibility import Visible, visible

TOLERANCE = 1e-4  # of iso-points (thesis: from 1e-4 to 1e-5)
GROWTH = 1.2  # of the number of iso-points, each time they are made anew, up to the most (released: 2, less often)
NEWTON = 4  # steps back onto the surface from beside it
STARTS = 4  # first iso-points begin at so many times as many places of the ball (released)
MOST_MEASURED = 5000  # iso-points of which the saliency is computed (released)
OCCUPIED = 0.2  # samples within masks that should be inside, for each sample of the surface (released: at most 0.1)
Importance = Literal["uniform", "curvature", "loss"]


@dataclass(frozen=True)
class Plan:
    """When there are iso-points, and how many; the fields are parameters of the methods."""

    importance: Importance
    points: int
    most_points: int
    warm_up: int
    refresh: int
    surface: float  # share of the samples that are of the surface
    share: float  # of those the share that is salient
    lowest: int  # places on a ray outside of a mask, the least of which counts


class PointSampler:
    """Draws iso-points that views see; before the first ones are there, it traces rays.

    Parameters
    ----------
    field : ImageField
        As it is trained.
    scene, views, samples, space, generator
        As of :class:`.by_rays.RaySampler`.
    plan : Plan
    run : Run
        A note says when no iso-points were found.
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
        self._pixels = Pixels(scene, generator)
        self._samples, self._space = samples, space
        self._step = 0
        self._count = plan.points
        self.iso: IsoPoints | None = None
        self.refreshed = 0

    def draw(self) -> Samples:
        """The next step's points."""
        plan, step = self._plan, self._step
        self._step += 1
        if step >= plan.warm_up and (step - plan.warm_up) % plan.refresh == 0:
            self._renew()
        if self.iso is None:
            return self._rays.draw()
        views = self._rays.chosen()
        view, points, normals, spacing = self._drawn(views)
        surface, free = self._moved(view, points, normals, spacing)
        inside = self._pixels.inside(views, max(1, round(OCCUPIED * len(surface) / len(views))))
        occupied = inner_points(self._field, self._scene.rays(*inside), self.iso.points, self._spacing)
        left = self._samples - len(surface) - len(free) - len(occupied)
        outside = self._outside(views, max(0, left // len(views)))
        space = in_ball(self._space, 1.0, self._generator)
        # as if rays were drawn all over the images
        covered = float(self._scene.masks[views].float().mean())
        weight = covered / max(1 - covered, 0.1) * len(outside) / max(1, len(occupied))
        return Samples(surface, occupied, torch.cat([free, outside]), space, self._samples, weight)

    def _renew(self) -> None:
        """New iso-points, from the last ones; which views see them, and which are salient."""
        plan = self._plan
        if self.iso is None:
            starts = in_ball(STARTS * plan.points, 1.0, self._generator)
        else:
            starts = self.iso.points
            self._count = min(plan.most_points, round(GROWTH * self._count))
        how = Extraction(self._count, resampling=Resampling(iterations=1), tolerance=TOLERANCE, reach=1.0)
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
        self._more = None if plan.importance == "uniform" else self._salient(seen)

    def _salient(self, seen: Visible) -> _ByView | None:
        """Points beside those where the metric is high, and which views see them."""
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

    def _drawn(self, views: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Iso-points that views see: the views, the points, their normals, and how far apart they are."""
        count = round(self._plan.surface * self._samples / len(views))
        more = 0 if self._more is None else round(self._plan.share * count)
        found = [self._base.drawn(views, count - more, self._generator)]
        spacing = [torch.full_like(found[0][1][:, 0], self._spacing)]
        if self._more is not None:
            found.append(self._more.drawn(views, more, self._generator))
            spacing.append(torch.full_like(found[1][1][:, 0], self._spacing / 2))
        return (*(torch.cat(parts) for parts in zip(*found, strict=True)), torch.cat(spacing))

    def _moved(self, view: Tensor, points: Tensor, normals: Tensor, spacing: Tensor) -> tuple[Surface, Tensor]:
        """Points beside those given, on the surface as it is now, as samples; and those that lie outside of a mask."""
        scene, base = self._scene, self._base
        shift = torch.rand(points.shape, generator=self._generator, device=points.device) * 2 - 1
        shift = shift - (shift * normals).sum(1, keepdim=True) * normals
        at = project(self._field.network, points + spacing[:, None] * shift, tolerance=TOLERANCE, steps=NEWTON)
        directions = F.normalize(at.points - scene.centers[view], dim=1)
        place, _ = scene.project(view, at.points)
        kept = (at.values.abs() <= TOLERANCE) & (at.points.norm(dim=1) <= 1) & scene.shown(place)
        kept &= (directions * at.gradients).sum(1) < 0
        kept &= ~base.depths.hidden(view, at.points, F.normalize(at.gradients, dim=1))
        rows = torch.nonzero(kept)[:, 0]
        view, place = view[rows], place[rows]
        inside = scene.inside(view, place)
        free = at.points[rows[~inside]]
        rows, view, place = rows[inside], view[inside], place[inside]
        return Surface(at.points[rows], at.gradients[rows], view, directions[rows], scene.colors(view, place)), free

    def _outside(self, views: Tensor, count: int) -> Tensor:
        """Places on rays outside of the masks, at random depths in the ball."""
        rays = self._scene.rays(*self._pixels.outside(views, count))
        near, far, reaches = ball_span(rays, 1.0)
        rays, near, far = Rays(rays.origins[reaches], rays.directions[reaches]), near[reaches], far[reaches]
        share = torch.rand(len(near), self._plan.lowest, generator=self._generator, device=near.device)
        return least(self._field, rays, near[:, None] + share * (far - near)[:, None])


class _ByView:
    """Points, sorted by the views that see them."""

    def __init__(self, seen: Visible, points: Tensor, normals: Tensor, views: int):
        self.points, self.normals, self.depths = points, normals, seen.depths
        self._point = seen.point[torch.argsort(seen.row, stable=True)]
        self._count = torch.bincount(seen.row, minlength=views)
        self._begin = self._count.cumsum(0) - self._count

    def drawn(self, views: Tensor, count: int, generator: torch.Generator) -> tuple[Tensor, Tensor, Tensor]:
        """``count`` of the points of each of some views (with replacement), where it sees any: view, point, normal."""
        views = views[self._count[views] > 0].repeat_interleave(count)
        share = torch.rand(len(views), generator=generator, device=views.device)
        point = self._point[self._begin[views] + (share * self._count[views]).long()]
        return views, self.points[point], self.normals[point]
