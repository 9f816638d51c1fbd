"""The common part of the methods of this family; a subclass defines how a mesh is drawn."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import BadInput, PointCloud, Run, Views

if TYPE_CHECKING:
    from ..raster.scene import Drawn, Scene
    from .descent import Diffused


@dataclass(frozen=True)
class MeshFitting:
    """A method that deforms a mesh until its images match the given ones."""

    steps: int = 400  # of the descent
    views: int = 6  # images of a step
    rate: float = 0.01  # of the descent: about the longest step of a coordinate
    rate_end: float = 0.1  # the final rate, relative to the initial one
    silhouette: float = 1.0  # weight of the masks in the loss; colours have 1
    smoothness: float = 0.05  # weight of the Laplacian
    evenness: float = 0.02  # weight of the variance of the edges' lengths

    def __post_init__(self) -> None:
        for name in ("steps", "views"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: expected at least 1, got {getattr(self, name)}")
        for name in ("silhouette", "smoothness", "evenness"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name}: expected at least 0, got {getattr(self, name)}")
        for name in ("rate", "rate_end"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: expected a number above 0, got {getattr(self, name)}")

    def prepare(self) -> None:
        """Load the compiled loops, or compile them."""
        from .warm import load_compiled

        load_compiled(self.draw)

    def draw(self, scene: Scene) -> Drawn:
        """The image of a scene, and its gradient."""
        raise NotImplementedError

    def coordinates(self, faces: np.ndarray, count: int) -> Diffused | None:
        """The coordinates of the descent, if other than the vertices' own."""
        return None

    def fit_shape(self, views: Views, cloud: PointCloud, run: Run) -> PointCloud:
        """As many points as the initial cloud, spread evenly over the deformed mesh, with face normals."""
        from trimesh import Trimesh

        from .gallery import Gallery
        from .loop import Schedule, descend
        from .regularity import Regularity
        from .start import mesh_of, spread_over

        if views.light_directions is None:
            raise BadInput("the views have no lights; this method matches diffuse shading under known lights")
        if cloud.normals is None:
            raise BadInput("the initial cloud has no normals; this method needs them")
        vertices, faces = mesh_of(cloud)
        gallery = Gallery(views, faces, self.draw, self.silhouette)
        regularity = None
        if self.smoothness or self.evenness:
            regularity = Regularity(vertices, faces, self.smoothness, self.evenness)
        schedule = Schedule(self.steps, self.views, self.rate, self.rate_end)
        choosing, sampling = run.rng.spawn(2)
        diffused = self.coordinates(faces, len(vertices))
        mesh = Trimesh(vertices, faces, process=False)
        for moved in descend(gallery, vertices, regularity, diffused, schedule, choosing, run):
            mesh = Trimesh(moved, faces, process=False)
            # A copy of the generator: the result is the same with and without intermediate results.
            run.trace(lambda mesh=mesh: spread_over(mesh, len(cloud), copy.deepcopy(sampling)))
        run.keep("mesh", mesh)
        return spread_over(mesh, len(cloud), sampling)
