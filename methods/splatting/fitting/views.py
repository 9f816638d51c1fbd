"""What the points look like in some views, how far that is from the images, and what would help."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bench import Views

from ..renderer.camera import Camera
from ..renderer.drawn import Drawn, draw
from ..renderer.settings import Drawing
from .smape import smape


class Look(NamedTuple):
    """The views of one step, together."""

    loss: float
    """The sum over the views"""
    gradient: np.ndarray
    """(n, 3) array: of positions or normals, the mean over the views that show a point"""
    hidden: np.ndarray
    """(n,) array: o_k of Eq. 3.16, how often a point was hidden, for each view that shows it"""


class Gallery:
    """Images to be matched.

    Parameters
    ----------
    views : Views
        With lights: colours are made by diffuse shading, as the images were.
    how : Drawing
    threads : int
    epsilon : float
        Of the loss.
    """

    def __init__(self, views: Views, how: Drawing, threads: int, epsilon: float = 0.01):
        self.views, self.how, self.threads, self.epsilon = views, how, threads, epsilon
        self.wanted = views.images.astype(np.float64) / 255
        self._cameras = [Camera.of(views, number) for number in range(len(views))]

    def shaded(self, normals: np.ndarray, view: int) -> tuple[np.ndarray, np.ndarray]:
        """The colours (n, 3) of points under the lights of a view, and which lights (n, k) they see."""
        lights = normals @ self.views.light_directions[view].T
        ambient = 0.0 if self.views.ambient is None else self.views.ambient[view]
        return np.maximum(lights, 0) @ self.views.light_colors[view] + ambient, lights > 0

    def draw(self, points: np.ndarray, normals: np.ndarray, sigma: np.ndarray | float, view: int) -> Drawn:
        """What a view shows of points."""
        colors, _ = self.shaded(normals, view)
        return draw(points, normals, colors, sigma, self._cameras[view], self.how, self.threads)

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
            Which views.
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
                by_light = drawn.attribute_gradient(slope) @ self.views.light_colors[view].T * lit
                gradient += by_light @ self.views.light_directions[view]
                if self.how.weights:
                    gradient += drawn.weight_gradients(slope)[1]
            else:
                gradient += drawn.position_gradient(slope)
                if self.how.weights:
                    gradient += drawn.weight_gradients(slope)[0]
        return Look(loss, gradient / (shown + 0.01)[:, None], hidden / (shown + 0.01))
