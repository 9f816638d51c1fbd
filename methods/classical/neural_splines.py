"""Neural Splines: a kernel field through oriented points, and its surface by marching cubes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import BadInput, InvalidOutput, PointCloud, Run, register

from .inputs import distinct_oriented, note_flat
from .isolated import without_isolated

if TYPE_CHECKING:
    from trimesh import Trimesh

MARGIN = 0.1  # around the box of the points, in half its longest side: the surface is cut off there
THINNEST = 0.4  # of the box, halved: the samples along its shortest side determine the number along the others


@register("method", cite="after Williams et al. 2021", requires=("numba", "scipy", "skimage", "trimesh"))
@dataclass(frozen=True)
class NeuralSplines:
    """After Neural Splines (Williams et al. 2021): the ReLU network of infinite width and least norm through points.

    The network has one hidden layer, and only its last weights are fitted: a field in the space of the arc-cosine
    kernel of first order, fitted to vanish at the points with their normals as its gradient. It is restricted to
    the span of the functions of some of the points (Nystrom), the value and the derivative along the normal; these
    are farthest points. Needs normals; estimates them if there are none.

    Ours: the kernel of normally distributed weights and biases, one derivative for each centre (theirs: three), and a
    system small enough to be solved directly (theirs: by conjugate gradients with a preconditioner, over up to 15,000
    centres). The detail depends on ``centers``; the time grows with their square.
    """

    centers: int = 1000  # points whose functions span the field; all if a cloud has fewer
    regularisation: float = 1e-7  # weight of the squared norm, relative to that of the gradients
    reach: float = 0.3  # mean spacings that convert a gradient to a distance: larger removes noise
    resolution: int = 96  # samples of marching cubes along the shortest side

    def __post_init__(self) -> None:
        if not 4 <= self.centers <= 8000:
            raise ValueError(f"centers: expected 4 to 8000, which take 2 GB, got {self.centers}")
        if self.resolution < 8:
            raise ValueError(f"resolution: expected at least 8, got {self.resolution}")
        for name in ("regularisation", "reach"):
            if not 0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name}: expected a number above 0, got {getattr(self, name)}")

    def prepare(self) -> None:
        """Compile the kernel."""
        from bench.geometry.farthest import load_compiled

        from .kernels.nystrom import load_compiled as load_kernel

        load_compiled()
        load_kernel()

    def reconstruct(self, cloud: PointCloud, run: Run) -> Trimesh:
        """A surface that is closed except where it leaves the box around the points."""
        from bench.geometry.farthest import farthest_points
        from bench.geometry.spacing import mean_spacing

        from ..learned.meshing.marching import extract
        from .kernels.nystrom import fitted

        cloud, _ = without_isolated(cloud, "neural_splines", run)
        points, normals, _ = distinct_oriented(cloud, "neural_splines", at_least=10)
        note_flat(points, "neural_splines", run, "the surface continues beyond them, to the border of the box")
        order = run.rng.permutation(len(points))
        low, high = points.min(axis=0), points.max(axis=0)
        unit = float((high - low).max()) / 2
        points, normals = (points[order] - (low + high) / 2) / unit, normals[order]
        chosen = farthest_points(points, min(self.centers, len(points)))
        reach = self.reach * mean_spacing(points)
        field = fitted(points, normals, chosen, self.regularisation * reach**2, reach, "neural_splines", run)
        corner = np.maximum((high - low) / 2 / unit + MARGIN, THINNEST)
        try:
            mesh = extract(
                field,
                resolution=self.resolution,
                domain=(-corner, corner),
                align="axes",
                seconds=0.9 * run.seconds_left(),
                on_progress=run.progress,
            )
        except InvalidOutput as error:
            raise BadInput(
                f"neural_splines: {error}; {len(chosen)} centers do not resolve the surface, or its parts are smaller "
                f"than the lattice's cells: raise method.centers or method.resolution ({self.resolution})"
            ) from error
        if mesh.metadata["coarser"] > 1:
            run.note(f"neural_splines: the mesh is {mesh.metadata['coarser']} times coarser, for lack of time")
        mesh.vertices = unit * mesh.vertices + (low + high) / 2
        return mesh
