"""The iso-points of a training: extracted after a warm-up, and again at intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from bench import Run

from ..sampling.extraction import Extraction, IsoPoints, NoLevel, extract
from ..sampling.fields import Differentiable
from ..sampling.neighbours import nearest
from ..sampling.wlop import wlop
from .batch import RegularisedBatch
from .sheets import Sheets, split

JITTER = 0.05  # of the last iso-points, before they are projected again
RADIUS = 0.1  # a point of the cloud farther than this from all iso-points has weight 0
THINNING = 4  # the first iso-points start from a quarter of their number, at points moved by WLOP
SPREAD = 0.1  # of the points near the cloud
CORNER = 1.8  # a little farther than the corners of the box of the space's points
WIDTH = 2.0  # ratio of the standard deviation of the outlier weight to that of the cloud's noise
MAD = 1.4826  # ratio of the standard deviation of a Gaussian to its median absolute value

Bandwidth = Literal["noise", "spacing"]


@dataclass(frozen=True)
class Plan:
    """Times, number and use of iso-points."""

    batch: int
    iso: bool
    count: int
    warm_up: int  # steps before the first iso-points
    refresh: int  # steps between new ones
    per_step: int  # iso-points of a step, at most
    pca: int  # neighbours of an iso-point's normal
    outliers: bool  # the cloud's points are weighted
    sigma: float  # degrees: sigma_n of Eq. 4.16
    bandwidth: Bandwidth  # the source of sigma_p of Eq. 4.15
    sheets: bool  # iso-points of sheets that the cloud does not confirm are pushed away from the level
    lobes_after: int  # steps before lobes are pushed away as well; 0: never
    near: float  # share of the points of space that are near the cloud
    facing: float  # weight of the normals of the points nearest to those of space; 0: they are not searched


class GuidedSampler:
    """Draws the steps of a field, and maintains its iso-points.

    Parameters
    ----------
    field : Differentiable
        The trained one.
    points, normals : (n, 3) arrays
        The cloud, in the frame of radius 1.
    plan : Plan
    run : Run
        Receives a note if no iso-points were found.
    generator : torch.Generator
        On the device of the field.
    """

    def __init__(
        self,
        field: Differentiable,
        points: np.ndarray,
        normals: np.ndarray,
        plan: Plan,
        run: Run,
        generator: torch.Generator,
    ):
        self._field, self._plan, self._run, self._generator = field, plan, run, generator
        device = generator.device
        self._points = torch.as_tensor(np.asarray(points, dtype=np.float32), device=device)
        unit = torch.as_tensor(np.asarray(normals, dtype=np.float32), device=device)
        self._normals = torch.nn.functional.normalize(unit, dim=1)
        self._weights = torch.ones(len(points), device=device)
        self._tree = cKDTree(np.asarray(points, dtype=float))
        self._iso_normals = torch.zeros(0, 3, device=device)
        self._extraction = Extraction(plan.count, reach=CORNER) if plan.sheets else Extraction(plan.count)
        self._step = -1  # the first batch may be for validation
        self._false = Sheets(torch.zeros(0, 3, device=device), torch.zeros(0, device=device))
        self.iso: IsoPoints | None = None
        self.refreshed = 0

    def draw(self) -> RegularisedBatch:
        """The next step's points."""
        plan, step = self._plan, self._step
        self._step += 1
        if plan.iso and step >= plan.warm_up and (step - plan.warm_up) % plan.refresh == 0:
            self._renew()
        rows = self._rows(len(self._points), plan.batch)
        x = [self._points[rows], torch.zeros(0, 3, device=rows.device), self._space()]
        iso_normals = x[1]
        if self.iso is not None:
            chosen = self._rows(len(self.iso.points), min(plan.per_step, len(self.iso.points)))
            x[1], iso_normals = self.iso.points[chosen], self._iso_normals[chosen]
        counts = (len(x[0]), len(x[1]), len(x[2]), min(len(self._false.points), plan.per_step // 4))
        false = self._rows(max(1, len(self._false.points)), counts[3])
        x.append(self._false.points[false])
        return RegularisedBatch(
            x=torch.cat(x),
            on=counts[0],
            normals=self._normals[rows],
            distances=None,
            total=sum(counts),
            weights=self._weights[rows],
            iso=counts[1],
            iso_normals=iso_normals,
            counts=counts,
            bounds=self._false.bounds[false],
            facing=self._facing(x[2]),
        )

    def _rows(self, below: int, count: int) -> Tensor:
        return torch.randint(below, (count,), generator=self._generator, device=self._generator.device)

    def _space(self) -> Tensor:
        plan, device = self._plan, self._generator.device
        near = round(plan.near * plan.batch)
        uniform = torch.rand(plan.batch - near, 3, generator=self._generator, device=device) * 2 - 1
        noise = SPREAD * torch.randn(near, 3, generator=self._generator, device=device)
        return torch.cat([uniform, self._points[self._rows(len(self._points), near)] + noise])

    def _facing(self, space: Tensor) -> Tensor:
        """The normals of the nearest points; farther ones count less."""
        if not self._plan.facing:
            return torch.zeros_like(space)
        distances, rows = self._tree.query(space.double().cpu().numpy())
        device = space.device
        shares = torch.exp(-2 * torch.from_numpy(distances).to(device, space.dtype).square())
        return shares[:, None] * self._normals[torch.from_numpy(rows).to(device)]

    def _renew(self) -> None:
        """Extract new iso-points, from the last ones or from the cloud."""
        device = self._generator.device
        if self.iso is None:
            some = torch.randperm(len(self._points), generator=self._generator, device=device)[: self._plan.count]
            starts = wlop(self._points[some], max(2, len(some) // THINNING))
        else:
            shift = torch.rand(len(self.iso.points), 3, generator=self._generator, device=device) * 2 - 1
            starts = self.iso.points + JITTER * shift
        if self._plan.sheets:  # sheets far from the cloud are found from random starts
            anywhere = torch.rand(self._plan.count, 3, generator=self._generator, device=device) * 2 - 1
            starts = torch.cat([starts, anywhere])
        try:
            found = extract(self._field, starts, self._extraction)
        except NoLevel as error:
            self._run.note(f"no iso-points after {self._step} steps: {error}")
            return
        self.refreshed += 1
        self.iso = found
        if self._plan.sheets:
            self.iso, self._false = split(found, self._points, with_lobes=0 < self._plan.lobes_after <= self._step)
        self._iso_normals = pca_normals(self.iso.points, self._plan.pca)
        if self._plan.outliers:
            plan = self._plan
            self._weights = outlier_weights(self._points, self._normals, self.iso, plan.sigma, plan.bandwidth)


def pca_normals(points: Tensor, neighbours: int) -> Tensor:
    """Unit normals (n, 3) of the planes that fit each point and its neighbours best; their sign is arbitrary."""
    near = nearest(points, neighbours)
    around = torch.cat([points[:, None], points[near.rows]], dim=1)
    around = around - around.mean(1, keepdim=True)
    _, axes = torch.linalg.eigh(around.transpose(1, 2).double() @ around.double())
    return axes[:, :, 0].to(points.dtype)


def outlier_weights(
    points: Tensor, normals: Tensor, iso: IsoPoints, sigma: float = 60.0, bandwidth: Bandwidth = "spacing"
) -> Tensor:
    """The weight of each point of a cloud: (n,), from 0 to 1 (Eq. 4.15 and 4.16).

    The product of two weights at the nearest iso-point p: ``exp(-(n_p . (p - q))^2 / sigma_p)``, and
    ``exp(-((1 - n_p . n_q) / (1 - cos(sigma)))^2)``. The text takes the minimum over all iso-points, which is 0 due to
    those of the other side; and it prints the last exponent as ``(1 - ...)^2``, which is largest for normals that
    differ by 60 degrees. Both are as in the released code here. A point farther than 0.1 from all iso-points has weight
    0.

    With ``bandwidth="spacing"``, ``sigma_p = 16 D / |P|`` as published: the squared spacing, independent of the noise.
    With ``"noise"``, ``sigma_p = 2 (2 s)^2``, s the robust standard deviation of ``n_p . (p - q)`` over the cloud: a
    point at s has the weight 0.88, at 4 s 0.14, at 6 s 0.01; and the 0.1 grows to 6 s if that is more.
    """
    near = nearest(points, 1, iso.points)
    rows, distance = near.rows[:, 0], near.distances[:, 0]
    across = ((iso.points[rows] - points) * iso.normals[rows]).sum(1)
    reach = RADIUS
    if bandwidth == "noise":
        scale = max(MAD * float(across.abs().median()), 1e-6)
        width, reach = 2 * (WIDTH * scale) ** 2, max(RADIUS, 6 * scale)
    else:
        width = 32 * float(torch.linalg.vector_norm(iso.points, dim=1).max()) / len(iso.points)
    turned = 1 - (iso.normals[rows] * normals).sum(1)
    weight = torch.exp(-across.square() / width - (turned / (1 - math.cos(math.radians(sigma)))).square())
    return torch.where(distance <= reach, weight, 0.0)
