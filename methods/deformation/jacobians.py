"""Jacobians: a matrix for each face is optimised, and a Poisson equation turns them into a surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import PointCloud, Run, register

from .registration.registered import Registered, note_end

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("method", cite="Aigerman et al. 2022", requires=("scipy", "torch", "trimesh"))
@dataclass(frozen=True)
class Jacobians(Registered):
    """Adam on one 3 x 3 matrix for each face; the vertices are the solution of a Poisson equation.

    Neural Jacobian Fields (Aigerman et al. 2022) predict such matrices by a network; as in TextDeformer (Gao et al.
    2023), here the matrices themselves are optimised, for one pair of shapes. The loss is the Chamfer distance between
    points on the faces and points of the target, plus ``identity`` times the mean of ``|J - I|^2`` over the surface.
    The descent is smooth in space without a smoothness term, because the Poisson equation spreads each matrix far. It
    has as many free translations as the mesh has parts, so nearby parts are joined by weak springs with the mean of
    their matrices (see :class:`.registration.poisson.Poisson`), and one translation is optimised for all.

    Normals are ignored, and every point counts: parts that the source lacks grow out of its nearest parts.
    It runs on the CPU.
    """

    steps: int = 200  # of Adam
    rate: float = 0.01  # of Adam; falls to a tenth along a cosine
    identity: float = 0.03  # weight of |J - I|^2 relative to the Chamfer distance, in squared units of the frame

    def __post_init__(self) -> None:
        super().__post_init__()
        self.expect_steps("steps")
        self.expect_positive("rate")
        if not self.identity >= 0:
            raise ValueError(f"identity: expected at least 0, got {self.identity}")

    def deform(self, source: Trimesh, target: Trimesh | PointCloud, run: Run) -> Trimesh:
        """The source at the vertices of the step with the least loss.

        Raises
        ------
        BadInput
            For a source without area, or a target without extent.
        """
        import torch

        from ..learned.losses.chamfer import ChamferLoss
        from .registration.poisson import Poisson

        torch.set_num_threads(run.threads)
        welded, samples, cloud = self.begin(source, target, run)
        poisson, chamfer = Poisson(welded), ChamferLoss(cloud.points, len(cloud), run.rng)
        share = torch.as_tensor(welded.areas / welded.areas.sum())
        same = torch.eye(3, dtype=torch.float64)
        matrices = same.repeat(len(share), 1, 1).requires_grad_()
        center = torch.as_tensor(poisson.centroid(welded.vertices)).requires_grad_()
        adam = torch.optim.Adam([matrices, center], lr=self.rate)
        falling = torch.optim.lr_scheduler.CosineAnnealingLR(adam, self.steps, 0.1 * self.rate)
        best, least, done = welded.vertices, np.inf, 0
        while done < self.steps and run.time_for_more():
            vertices = poisson(matrices) + center
            distance, pull = chamfer(torch.as_tensor(samples.matrix @ vertices.detach().numpy()))
            strain = self.identity * (share * ((matrices - same) ** 2).sum(dim=(1, 2))).sum()
            if (loss := distance + float(strain.detach())) < least:
                best, least = vertices.detach().numpy(), loss
            adam.zero_grad()
            # ChamferLoss returns its derivative by the samples: the product with it has the same gradient.
            ((vertices * torch.as_tensor(samples.matrix.T @ pull.numpy())).sum() + strain).backward()
            adam.step()
            falling.step()
            done += 1
            run.progress(done, self.steps)
        note_end(run, done, self.steps, "steps")
        return welded.mesh(source, best)
