"""The images of the points in some views, their loss, and its gradient."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bench import Views

from ..renderer.camera import Camera
from ..renderer.drawn import Drawn, draw
from ..renderer.settings import Drawing
from .silhouettes import Silhouettes
from .smape import smape

if TYPE_CHECKING:
    from ..torch_renderer.drawn import ArrayDrawn


class Lights(NamedTuple):
    """The k lights of each view, infinitely far."""

    directions: np.ndarray
    """(v, k, 3) array of unit length, towards the lights"""
    colors: np.ndarray
    """(v, k, 3) array"""
    ambient: np.ndarray
    """(v, 3) array: ambient light"""


class Window(NamedTuple):
    """A part of an image."""

    view: int
    left: int
    top: int
    width: int
    height: int


class Look(NamedTuple):
    """The sums over the views of one step."""

    loss: float
    """The sum over the views"""
    gradient: np.ndarray
    """(n, 3) array: of positions or normals, the mean over the views that show a point"""
    shown: np.ndarray
    """(n,) array: the number of views that show a point"""
    hidden: np.ndarray
    """(n,) array: o_k of Eq. 3.16, how often a point is hidden, for each view that shows it"""


class Gallery:
    """Images to be matched.

    Parameters
    ----------
    cameras : sequence of Camera
    wanted : (v, h, w, 3) float array
        The images, from 0 to 1.
    lights : Lights
        Colours are computed by diffuse shading, as for the images.
    how : Drawing
    threads : int
    epsilon : float
        Of the loss.
    silhouettes : Silhouettes, or None
        Those of the shape, if they are known.
    device : str
        "cpu", or a device of torch, on which the renderer in torch draws.
    """

    def __init__(
        self,
        cameras: Sequence[Camera],
        wanted: np.ndarray,
        lights: Lights,
        how: Drawing,
        threads: int,
        epsilon: float = 0.01,
        silhouettes: Silhouettes | None = None,
        device: str = "cpu",
    ):
        self.cameras, self.wanted, self.lights = cameras, wanted, lights
        self.how, self.threads, self.epsilon, self.silhouettes = how, threads, epsilon, silhouettes
        self.device = device

    @classmethod
    def of(cls, views: Views, how: Drawing, threads: int, epsilon: float = 0.01, device: str = "cpu") -> Gallery:
        """The images of views that have lights."""
        cameras = [Camera.of(views, number) for number in range(len(views))]
        ambient = np.zeros((len(views), 3)) if views.ambient is None else views.ambient
        assert views.light_directions is not None and views.light_colors is not None
        lights = Lights(views.light_directions, views.light_colors, ambient)
        silhouettes = Silhouettes(views.masks, cameras)
        return cls(cameras, views.images.astype(np.float64) / 255, lights, how, threads, epsilon, silhouettes, device)

    def cropped(self, windows: Sequence[Window]) -> Gallery:
        """Parts of the images, all of one size, as images with their own cameras."""
        cameras, wanted = [], []
        for view, left, top, width, height in windows:
            camera, place = self.cameras[view], np.s_[top : top + height, left : left + width]
            moved = np.asarray(camera.intrinsics) - np.array([[0, 0, left], [0, 0, top], [0, 0, 0]])
            cameras.append(Camera(camera.extrinsics, moved, width, height))
            wanted.append(self.wanted[view][place])
        lights = Lights(*(of[[window.view for window in windows]] for of in self.lights))
        return Gallery(cameras, np.array(wanted), lights, self.how, self.threads, self.epsilon, device=self.device)

    def shaded(self, normals: np.ndarray, view: int) -> tuple[np.ndarray, np.ndarray]:
        """The colours (n, 3) of points under the lights of a view, and which lights (n, k) reach them."""
        facing = normals @ self.lights.directions[view].T
        return np.maximum(facing, 0) @ self.lights.colors[view] + self.lights.ambient[view], facing > 0

    def draw(self, points: np.ndarray, normals: np.ndarray, sigma: np.ndarray | float, view: int) -> Drawn | ArrayDrawn:
        """The image of points in a view."""
        colors, _ = self.shaded(normals, view)
        if self.device != "cpu":
            from ..torch_renderer.drawn import draw_arrays

            return draw_arrays(points, normals, colors, sigma, self.cameras[view], self.how, self.device)
        return draw(points, normals, colors, sigma, self.cameras[view], self.how, self.threads)

    def look(
        self, points: np.ndarray, normals: np.ndarray, sigma: np.ndarray | float, chosen: np.ndarray, of_normals: bool
    ) -> Look:
        """The loss over some views, and its gradient.

        Parameters
        ----------
        points, normals : (n, 3) arrays
            Normals of unit length.
        sigma : (n,) array or float
        chosen : (m,) int array
            The views.
        of_normals : bool
            Of the normals, through the shading and, with ``how.weights``, the weights; otherwise of the positions.
        """
        loss, gradient = 0.0, np.zeros_like(points)
        shown, hidden = np.zeros(len(points)), np.zeros(len(points))
        for view in chosen:
            drawn = self.draw(points, normals, sigma, view)
            of_view, slope = smape(drawn.image, self.wanted[view], self.epsilon)
            loss += of_view
            shown += drawn.ellipses.shown
            hidden += drawn.occlusions()
            if of_normals:
                _, lit = self.shaded(normals, view)
                by_light = drawn.attribute_gradient(slope) @ self.lights.colors[view].T * lit
                gradient += by_light @ self.lights.directions[view]
                if self.how.weights:
                    gradient += drawn.weight_gradients(slope)[1]
            else:
                gradient += drawn.position_gradient(slope)
                if self.how.weights:
                    gradient += drawn.weight_gradients(slope)[0]
        return Look(loss, gradient / (shown + 0.01)[:, None], shown, hidden / (shown + 0.01))
