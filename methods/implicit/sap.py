"""Shape as Points: oriented points whose Poisson surface is fitted to the input."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from bench import InvalidOutput, PointCloud, Run, register

from ..learned.fitting.fitted import oriented
from ..learned.fitting.trained import ENDLESS, at_least, positive

if TYPE_CHECKING:
    from torch import Tensor
    from trimesh import Trimesh


MOST = 500_000  # points to optimise: a lattice of 256 nodes cannot use more, and each takes 700 bytes


def seconds_for(resolution: int) -> float:
    """A generous estimate of the time for the last surface."""
    return 1 + 3e-7 * resolution**3


@register("method", cite="Peng et al. 2021", requires=("torch", "trimesh", "igl", "skimage", "scipy"))
@dataclass(frozen=True)
class Sap:
    """Shape as Points by optimisation: points and normals are moved until their Poisson surface fits the input.

    Each step solves Poisson's equation by Fourier transforms, takes the vertices of the surface, and back-propagates
    their Chamfer distance to the input to the points and normals. It starts like the paper's optimisation, with a
    sphere of points, on coarse lattices that become finer (``begin=sphere``), or, by default, with the input itself and
    its normals, given or estimated: then the first surface is right except for its detail, and only the finest lattice
    is used. With ``steps=0`` it is one Poisson reconstruction.
    """

    steps: int = 20  # of the optimisation, at most; 0 for the initial Poisson surface
    seconds: float = 0.0  # optimise for this time by the clock, with as many steps as it allows; 0 to count steps
    resolution: int = 256  # nodes of the finest lattice along each axis, 16 to 512 (some 8 GB)
    coarsest: int = 32  # nodes of the first lattice of begin=sphere; each has twice as many as the one before
    begin: Literal["normals", "sphere"] = "normals"  # the input and its normals, or a sphere of points
    points: int = 20_000  # of the sphere; they are sampled again for every level
    batch: int = 20_000  # points of the input whose distance to the surface counts; its distance to them uses all
    learning_rate: float = 0.0  # of Adam, in sides of the lattice's cube; 0 for 1e-3, or 1e-2 from a sphere
    fall: float = 0.7  # factor of the learning rate from a level to the next
    sigma: float = 2.0  # smoothing: a Gaussian of standard deviation sigma / pi nodes (paper: 2; from 256 on, 3)
    sphere: float = 0.5  # radius of the sphere
    traces: int = 0  # number of intermediate results, for error against time

    def __post_init__(self) -> None:
        if self.steps < (1 if self.begin == "sphere" else 0):
            raise ValueError(f"steps: expected at least 0 (1 from a sphere), got {self.steps}")
        if self.begin not in ("normals", "sphere"):
            raise ValueError(f"begin: expected normals or sphere, got {self.begin!r}")
        if not 16 <= self.resolution <= 512:
            raise ValueError(f"resolution: expected 16 to 512, got {self.resolution}")
        if self.begin == "sphere" and not 8 <= self.coarsest <= self.resolution:
            raise ValueError(f"coarsest: expected 8 to {self.resolution} (resolution), got {self.coarsest}")
        at_least(self, points=10, batch=10, learning_rate=0, seconds=0, traces=0)
        positive(self, "fall", "sigma", "sphere")

    def reconstruct(self, cloud: PointCloud, run: Run) -> Trimesh:
        """The Poisson surface of the fitted points."""
        import torch

        from .spectral import lattice_surface
        from .spectral.spectral_poisson import evenly, indicator

        torch.set_num_threads(run.threads)
        points, normals, frame = oriented(cloud, "sap", run, self.begin == "normals")
        resolution = self._in_time(run)

        def tensor(values: np.ndarray) -> Tensor:
            return torch.as_tensor(np.asarray(values, dtype=np.float32), device=run.device)

        def surface(x: Tensor, n: Tensor, resolution: int) -> Trimesh:
            with torch.no_grad():
                return lattice_surface.mesh(indicator(x, n, resolution, self.sigma))

        def in_input(mesh: Trimesh) -> Trimesh:
            mesh.vertices = frame.invert(mesh.vertices)
            return mesh

        if self.begin == "sphere":
            n = run.rng.standard_normal((self.points, 3))
            n = tensor(n / np.linalg.norm(n, axis=1, keepdims=True))
            x = self.sphere * n
        else:
            some = run.rng.permutation(len(points))[:MOST] if len(points) > MOST else slice(None)
            x, n = tensor(points[some]), tensor(normals[some])
            n = n * evenly(x)[:, None]
        run.parameters = x.numel() + n.numel()
        if self.steps or self.seconds:
            x, n = self._fit(x, n, points, resolution, run, surface, in_input)
        return in_input(surface(x, n, resolution))

    def levels(self, resolution: int) -> list[int]:
        """The resolutions of the lattices, one after the other, up to this one."""
        if self.begin == "normals":
            return [resolution]
        count = max(0, round(math.log2(resolution / self.coarsest)))
        return [min(resolution, max(self.coarsest, resolution >> (count - level))) for level in range(count + 1)]

    def _in_time(self, run: Run) -> int:
        """The resolution, or a half, a quarter, ... of it if the surface alone would take half of the time."""
        resolution = self.resolution
        while resolution >= 32 and seconds_for(resolution) > run.seconds_left() / 2:
            resolution //= 2
        if resolution < self.resolution:
            run.note(f"the lattice has {resolution} nodes along an axis: limit.seconds={run.seconds:g} is too short")
        return resolution

    def _fit(
        self, x: Tensor, n: Tensor, target: np.ndarray, resolution: int, run: Run, surface: Callable, in_input: Callable
    ) -> tuple[Tensor, Tensor]:
        """Points and normals with the least loss on the finest lattice."""
        import torch

        from ..learned.losses.chamfer import ChamferLoss
        from ..learned.training.loop import Progress
        from ..learned.training.stages import note_shortage
        from .spectral.lattice_surface import pull, vertices
        from .spectral.spectral_poisson import SIDE, from_lattice, indicator

        loss, levels = ChamferLoss(target, self.batch, run.rng), self.levels(resolution)
        base = self.learning_rate or (1e-2 if self.begin == "sphere" else 1e-3)
        limit = min(self.seconds or math.inf, max(0.1, run.seconds_left() - seconds_for(resolution)))
        progress = Progress(ENDLESS if self.seconds else self.steps, run.elapsed, limit)
        level, steps = -1, 0
        while progress.t < 1:
            if (now := min(len(levels) - 1, int(progress.t * len(levels)))) != level:
                if level >= 0:
                    x, n = self._sampled(surface(x, n, levels[level]), x, run)
                level, r, best = now, levels[now], (math.inf, x, n)
                x, n = x.detach().clone().requires_grad_(), n.detach().clone().requires_grad_()
                rate = base * self.fall**level
                optimizer = torch.optim.Adam([{"params": [x], "lr": rate * SIDE}, {"params": [n], "lr": rate}])
            try:
                places, gradient, values = vertices(indicator(x, n, r, self.sigma))
            except InvalidOutput as error:
                if best[0] == math.inf:
                    raise
                run.note(f"stopped after {steps} steps, with the best surface so far: {error}")
                return best[1:]
            value, by_place = loss(from_lattice(places, r))
            if value < best[0]:
                best = (value, x.detach().clone(), n.detach().clone())
            optimizer.zero_grad(set_to_none=True)
            pull(values, gradient, by_place * (SIDE / r)).backward()
            optimizer.step()
            before, steps = progress.t, steps + 1
            progress.step()
            run.progress(round(1000 * progress.t), 1000)
            if progress.t < 1 and int(before * (self.traces + 1)) < int(progress.t * (self.traces + 1)):
                run.trace(lambda x=x, n=n, r=r: in_input(surface(x, n, r)))
        note_shortage(run, steps, self.steps, limit, self.seconds)
        return best[1:]

    def _sampled(self, mesh: Trimesh, like: Tensor, run: Run) -> tuple[Tensor, Tensor]:
        """As many points of a surface, with its normals."""
        import torch

        from bench.geometry.mesh_surface import MeshSurface

        found = MeshSurface(mesh).sample(len(like), run.rng)
        points, normals = (torch.as_tensor(part).to(like) for part in found)
        return points, normals
