"""One image of a cloud, and its gradients."""

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
    """The result of :func:`draw`.

    Parameters
    ----------
    image : (h, w, c) float64 array
        0 in the background.
    total : (h, w) float64 array
        Sums of the visible weights.
    ellipses : Ellipses
    lists : Lists
    attributes, sigma, camera, how
        The inputs.
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
        """Whether any splat is visible: (h, w) bool array."""
        return self.lists.front > 0

    def occlusions(self) -> np.ndarray:
        """The number of pixels at which each point is hidden: (n,) int array. Summed over views, o_k of Eq. 3.16."""
        index = self.lists.index
        hidden = (index >= 0) & (np.arange(index.shape[2]) >= self.lists.front[..., None])
        return np.bincount(index[hidden], minlength=len(self.attributes))

    def attribute_gradient(self, gradient: np.ndarray) -> np.ndarray:
        """The derivative of the loss by the attributes (n, c), from that by the image (h, w, c)."""
        gradient = np.ascontiguousarray(gradient, dtype=np.float64)
        return blend_back(self.lists, self.total, gradient, len(self.attributes))

    def position_gradient(self, gradient: np.ndarray) -> np.ndarray:
        """The derivative by the positions (n, 3), through changes of visibility (Eq. 3.12)."""
        gradient = np.ascontiguousarray(gradient, dtype=np.float64)
        known = (self.ellipses, self.lists, self.total, self.image, self.attributes)
        return visibility_gradient(*known, gradient, self.camera, self.how)

    def weight_gradients(self, gradient: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The derivatives by positions and drawn normals (n, 3), through the weights of visible splats."""
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
        Colours, or other values to draw.
    sigma : (n,) array or float
        Standard deviation of each point's Gaussian in its tangent plane, in the unit of the points.
    camera : Camera
    how : Drawing, optional
    threads : int
        For drawing, and for the gradients until the next call; the result does not depend on it.
    """
    how = how or Drawing()
    use(threads)
    points, normals, attributes = (np.ascontiguousarray(a, dtype=np.float64) for a in (points, normals, attributes))
    sigma = np.broadcast_to(np.asarray(sigma, dtype=np.float64), (len(points),)).copy()
    ellipses = project(points, normals, sigma, camera, how)
    lists = rasterise(ellipses, camera, how)
    image, total = blend(lists, attributes)
    return Drawn(image, total, ellipses, lists, attributes, sigma, camera, how)
