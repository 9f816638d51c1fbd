"""Denoising a mesh by images with sparse gradients, as in Paparazzi."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import PointCloud, Run, register
from bench.geometry.check import check_points


@register("method", cite="Liu et al. 2018; Xu et al. 2011", requires=("scipy", "numba", "open3d"))
@dataclass(frozen=True)
class PaparazziL0:
    """L0 smoothing of the images of a mesh through the points (thesis, figure 3.26): right for clean ones.

    The points become the vertices of a mesh, by ball pivoting. In each cycle images of the initial mesh are drawn
    from new sides and filtered, and the vertices descend until the shading of the faces matches them; silhouettes
    have no effect. If noise tilts a face, its colour carries little information on the surface.
    """

    cycles: int = 8  # each with other cameras
    steps: int = 40  # of a cycle
    views: int = 12  # images of a cycle
    pixels: int = 256  # along each side of an image
    smoothing: float = 0.05  # lambda: larger is smoother
    rate: float = 0.02  # about the longest step of a coordinate, in spacings of the points
    evenness: float = 0.0  # weight of the variance of the edges' lengths

    def __post_init__(self) -> None:
        for name in ("cycles", "steps", "views", "pixels"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: expected at least 1, got {getattr(self, name)}")
        for name in ("smoothing", "rate"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: expected a number above 0, got {getattr(self, name)}")
        if not self.evenness >= 0:
            raise ValueError(f"evenness: expected at least 0, got {self.evenness}")

    def prepare(self) -> None:
        """Load the compiled loops, or compile them."""
        from .fitting.warm import load_compiled
        from .raster.hard import HardDrawn

        load_compiled(HardDrawn.of)

    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        """As many points, in the same order, with the normals of the mesh."""
        from bench.geometry.normals import with_normals
        from bench.geometry.spacing import mean_spacing

        from ..learned.images.l0 import l0_smoothed
        from .fitting.descent import Adam
        from .fitting.filtered import filtered_views, mesh_through, rig
        from .fitting.gallery import Gallery
        from .fitting.regularity import Regularity
        from .raster.hard import HardDrawn

        check_points(cloud.points, "paparazzi_l0", at_least=10)
        oriented, spacing = with_normals(cloud), mean_spacing(cloud.points)
        normals = oriented.normals
        assert normals is not None
        first, faces = mesh_through(oriented, spacing)
        vertices, regularity = first, Regularity(first, faces, 0.0, self.evenness) if self.evenness else None
        for cycle in range(self.cycles):
            cameras = rig(first, self.views, self.pixels, run.rng)
            wanted = filtered_views(
                HardDrawn.of, first, faces, cameras, lambda image: l0_smoothed(image, self.smoothing)
            )
            gallery, adam = Gallery(wanted, faces, HardDrawn.of, 0.0), Adam()
            for step in range(self.steps):
                if not run.time_for_more():
                    return _cloud(vertices, faces, normals)
                gradient = gallery.look(vertices, np.arange(self.views))[1]
                if regularity is not None:
                    gradient = gradient + regularity.look(vertices)[1]
                vertices = adam.step(vertices, gradient, self.rate * spacing)
                run.progress(cycle * self.steps + step + 1, self.cycles * self.steps)
            run.trace(_cloud(vertices, faces, normals))
        return _cloud(vertices, faces, normals)


def _cloud(vertices: np.ndarray, faces: np.ndarray, otherwise: np.ndarray) -> PointCloud:
    """The vertices (n, 3), with the normals of their faces weighted by area; those without a face keep their own."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.zeros_like(vertices)
    np.add.at(normals, faces.T.reshape(-1), np.tile(np.cross(b - a, c - a), (3, 1)))
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return PointCloud(vertices, np.where(length > 1e-15, normals / np.maximum(length, 1e-15), otherwise))
