"""The images of a mesh in some views, their loss, and its gradient by the vertices."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bench import Views

from ..raster.scene import Drawn, Scene, project, project_back
from ..raster.shading import Lights, Normals, normals_back, normals_of
from .loss import image_loss

BEHIND = 2.0  # radii of the mesh: distance of the background behind its middle


class Gallery:
    """Images to be matched by a mesh with fixed faces.

    Parameters
    ----------
    views : Views
        With lights.
    faces : (f, 3) int array
    draw : function of a Scene that returns a Drawn
    silhouette : float
        Weight of the masks in the loss.
    """

    def __init__(self, views: Views, faces: np.ndarray, draw: Callable[[Scene], Drawn], silhouette: float):
        self.views, self.faces, self._draw, self._silhouette = views, faces, draw, silhouette
        assert views.light_directions is not None and views.light_colors is not None
        ambient = np.zeros((len(views), 3)) if views.ambient is None else views.ambient
        self.lights = [
            Lights(*of_view) for of_view in zip(views.light_directions, views.light_colors, ambient, strict=True)
        ]

    def wanted(self, view: int) -> np.ndarray:
        """The image of a view (h, w, 4): colours and mask."""
        return np.concatenate([self.views.images[view] / 255, self.views.masks[view][..., None]], axis=2)

    def draw(self, vertices: np.ndarray, normals: Normals, view: int) -> Drawn:
        """The image of a mesh in a view."""
        screen = project(vertices, self.views.extrinsics[view], self.views.intrinsics[view])
        depth = screen[:, 2]
        far = float(depth.mean() + BEHIND * np.abs(depth - depth.mean()).max())
        colors = self.lights[view].shade(normals.unit)
        return self._draw(Scene(screen, self.faces, colors, self.views.width, self.views.height, far))

    def look(self, vertices: np.ndarray, chosen: np.ndarray) -> tuple[float, np.ndarray]:
        """The mean loss over some views, and its gradient (v, 3) by the vertices.

        Parameters
        ----------
        vertices : (v, 3) array
        chosen : (m,) int array
            The views.
        """
        normals = normals_of(vertices, self.faces)
        loss, gradient, of_normals = 0.0, np.zeros_like(vertices), np.zeros_like(normals.unit)
        for view in chosen:
            drawn = self.draw(vertices, normals, view)
            of_view, slope = image_loss(drawn.image, self.wanted(view), self._silhouette)
            of_screen, of_colors = drawn.backward(slope)
            loss += of_view
            of_normals += self.lights[view].shade_back(of_colors, normals.unit)
            extrinsics, intrinsics = self.views.extrinsics[view], self.views.intrinsics[view]
            gradient += project_back(of_screen, project(vertices, extrinsics, intrinsics), extrinsics, intrinsics)
        gradient += normals_back(of_normals, normals, vertices, self.faces)
        return loss / len(chosen), gradient / len(chosen)
