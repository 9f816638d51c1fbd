"""One image of a cloud, and the way back from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...learned.compiled.threads import use
from .blending import blend, blend_back
from .camera import Camera
from .ellipses import Ellipses, project
from .raster import Lists, rasterise
from .settings import Drawing
from .visibility import visibility_gradient
from .weights import weight_gradients


@dataclass(frozen=True, eq=False)
class Drawn:
    """What :func:`draw` made.

    Parameters
    ----------
    image : (h, w, c) float64 array
        0 where nothing is.
    total : (h, w) float64 array
        Sums of the weights that are seen.
    ellipses : Ellipses
    lists : Lists
    attributes, sigma, camera, how
        What was drawn.
    """

    image: np.ndarray
    total: np.ndarray
    ellipses: Ellipses
    lists: Lists
    attributes: np.ndarray
    sigma: np.ndarray
    camera: Camera
    how: Drawing

    @property
    def covered(self) -> np.ndarray:
        """Whether anything is seen: (h, w) bool array."""
        return self.lists.front > 0

    def occlusions(self) -> np.ndarray:
        """At how many pixels each point is hidden: (n,) int array. Summed over views, this is o_k of Eq. 3.16."""
        index = self.lists.index
        hidden = (index >= 0) & (np.arange(index.shape[2]) >= self.lists.front[..., None])
        return np.bincount(index[hidden], minlength=len(self.attributes))

    def attribute_gradient(self, gradient: np.ndarray) -> np.ndarray:
        """The derivative of the loss by the attributes (n, c), from that by the image (h, w, c)."""
        gradient = np.ascontiguousarray(gradient, dtype=np.float64)
        return blend_back(self.lists, self.total, gradient, len(self.attributes))

    def position_gradient(self, gradient: np.ndarray) -> np.ndarray:
        """The derivative by the positions (n, 3), by what becomes visible and what hides (Eq. 3.12)."""
        gradient = np.ascontiguousarray(gradient, dtype=np.float64)
        known = (self.ellipses, self.lists, self.total, self.image, self.attributes)
        return visibility_gradient(*known, gradient, self.camera, self.how)

    def weight_gradients(self, gradient: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The derivatives by positions and drawn normals (n, 3), through the weights of what is seen."""
        known = (self.ellipses, self.lists, self.total, self.image, self.attributes, self.sigma)
        return weight_gradients(*known, gradient, self.camera, self.how)


def draw(
    points: np.ndarray,
    normals: np.ndarray,
    attributes: np.ndarray,
    sigma: np.ndarray | float,
    camera: Camera,
    how: Drawing | None = None,
    threads: int = 1,
) -> Drawn:
    """An image of oriented points (Eq. 3.4 to 3.8).

    Parameters
    ----------
    points, normals : (n, 3) arrays
        In the world; normals of unit length, outwards.
    attributes : (n, c) array
        Colours, or whatever is to be drawn.
    sigma : (n,) array or float
        Standard deviation of each point's Gaussian in its tangent plane, in the unit of the points.
    camera : Camera
    how : Drawing, optional
    threads : int
        So many threads draw, and so many make the gradients until the next call; the result does not depend on it.
    """
    how = how or Drawing()
    use(threads)
    points, normals, attributes = (np.ascontiguousarray(a, dtype=np.float64) for a in (points, normals, attributes))
    sigma = np.broadcast_to(np.asarray(sigma, dtype=np.float64), (len(points),)).copy()
    ellipses = project(points, normals, sigma, camera, how)
    lists = rasterise(ellipses, camera, how)
    image, total = blend(lists, attributes)
    return Drawn(image, total, ellipses, lists, attributes, sigma, camera, how)
