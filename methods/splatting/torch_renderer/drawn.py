"""One image of a cloud, and its gradients, on the device of choice.

:func:`draw` takes and returns tensors; :func:`draw_arrays` is the same for numpy, as :func:`..renderer.drawn.draw`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from ..renderer.camera import Camera
from ..renderer.ellipses import Ellipses as ArrayEllipses
from ..renderer.raster import Lists as ArrayLists
from ..renderer.settings import Drawing
from .blending import blend, blend_back
from .ellipses import Ellipses, project
from .raster import Lists, rasterise
from .visibility import visibility_gradient
from .weights import weight_gradients

PAIRS = {"cpu": 1 << 17, "cuda": 1 << 21}  # 200 bytes each: a cache, 400 MB


@dataclass(frozen=True, eq=False)
class TorchDrawn:
    """The result of :func:`draw`.

    Parameters
    ----------
    image : (h, w, c) tensor
        0 in the background.
    total : (h, w) tensor
        Sums of the visible weights.
    ellipses : Ellipses
    lists : Lists
    attributes, sigma, camera, how
        The inputs.
    pairs : int
        Approximate number of pairs of a splat and a pixel in memory at a time.
    """

    image: Tensor
    total: Tensor
    ellipses: Ellipses
    lists: Lists
    attributes: Tensor
    sigma: Tensor
    camera: Camera
    how: Drawing
    pairs: int

    @property
    def covered(self) -> Tensor:
        """Whether any splat is visible: (h, w) bool tensor."""
        return self.lists.front > 0

    def occlusions(self) -> Tensor:
        """The number of pixels at which each point is hidden: (n,) int64 tensor. Summed over views, o_k of Eq. 3.16."""
        index = self.lists.index
        layers = torch.arange(index.shape[2], device=index.device)
        hidden = (index >= 0) & (layers >= self.lists.front[..., None])
        return torch.bincount(index[hidden], minlength=len(self.attributes))

    @torch.no_grad()
    def attribute_gradient(self, gradient: Tensor) -> Tensor:
        """The derivative of the loss by the attributes (n, c), from that by the image (h, w, c); float64."""
        return blend_back(self.lists, self.total, gradient.to(self.image), len(self.attributes))

    @torch.no_grad()
    def position_gradient(self, gradient: Tensor) -> Tensor:
        """The derivative by the positions (n, 3), through changes of visibility (Eq. 3.12); float64."""
        known = (self.ellipses, self.lists, self.total, self.image, self.attributes)
        return visibility_gradient(*known, gradient.to(self.image), self.camera, self.how, self.pairs)

    @torch.no_grad()
    def weight_gradients(self, gradient: Tensor) -> tuple[Tensor, Tensor]:
        """The derivatives by positions and drawn normals (n, 3), through the weights of visible splats; float64."""
        known = (self.ellipses, self.lists, self.total, self.image, self.attributes, self.sigma)
        return weight_gradients(*known, gradient.to(self.image), self.camera, self.how)


@torch.no_grad()
def draw(
    points: Tensor,
    normals: Tensor,
    attributes: Tensor,
    sigma: Tensor | float,
    camera: Camera,
    how: Drawing | None = None,
    dtype: torch.dtype | None = None,
    pairs: int | None = None,
) -> TorchDrawn:
    """An image of oriented points (Eq. 3.4 to 3.8), on the device of the points.

    Parameters
    ----------
    points, normals : (n, 3) tensors
        In the world; normals of unit length, outwards.
    attributes : (n, c) tensor
        Colours, or other values to draw.
    sigma : (n,) tensor or float
        Standard deviation of each point's Gaussian in its tangent plane, in the unit of the points.
    camera : Camera
    how : Drawing, optional
    dtype : torch.dtype, optional
        Of values for each pixel. By default float32 on CUDA, float64 elsewhere; sums over pixels are float64.
    pairs : int, optional
        Approximate number of pairs of a splat and a pixel in memory at a time; the images do not depend on it.
    """
    how, device = how or Drawing(), points.device
    dtype = dtype or (torch.float32 if device.type == "cuda" else torch.float64)
    pairs = pairs or PAIRS.get(device.type, PAIRS["cpu"])
    points, normals = points.double(), normals.to(device).double()
    sigma = torch.as_tensor(sigma, dtype=torch.float64, device=device).expand(len(points))
    attributes = attributes.to(device, dtype)
    ellipses = project(points, normals, sigma, camera, how, dtype)
    lists = rasterise(ellipses, camera, how, pairs)
    image, total = blend(lists, attributes)
    return TorchDrawn(image, total, ellipses, lists, attributes, sigma.to(dtype), camera, how, pairs)


class ArrayDrawn:
    """A :class:`TorchDrawn` for numpy: its inputs and outputs are arrays, converted on access.

    Parameters
    ----------
    drawn : TorchDrawn
    """

    def __init__(self, drawn: TorchDrawn):
        self.drawn, self.camera, self.how = drawn, drawn.camera, drawn.how

    @cached_property
    def image(self) -> np.ndarray:
        """(h, w, c) float64 array."""
        return _array(self.drawn.image)

    @cached_property
    def total(self) -> np.ndarray:
        """(h, w) float64 array."""
        return _array(self.drawn.total)

    @cached_property
    def covered(self) -> np.ndarray:
        """(h, w) bool array."""
        return _array(self.drawn.covered)

    @cached_property
    def ellipses(self) -> ArrayEllipses:
        """Of arrays."""
        return ArrayEllipses(*map(_array, self.drawn.ellipses))

    @cached_property
    def lists(self) -> ArrayLists:
        """Of arrays."""
        return ArrayLists(*map(_array, self.drawn.lists))

    def occlusions(self) -> np.ndarray:
        """(n,) int64 array."""
        return _array(self.drawn.occlusions())

    def attribute_gradient(self, gradient: np.ndarray) -> np.ndarray:
        """(n, c) float64 array, from the gradient of the image (h, w, c)."""
        return _array(self.drawn.attribute_gradient(self._slope(gradient)))

    def position_gradient(self, gradient: np.ndarray) -> np.ndarray:
        """(n, 3) float64 array, from the gradient of the image (h, w, c)."""
        return _array(self.drawn.position_gradient(self._slope(gradient)))

    def weight_gradients(self, gradient: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Two (n, 3) float64 arrays, from the gradient of the image (h, w, c)."""
        by_position, by_normal = self.drawn.weight_gradients(self._slope(gradient))
        return _array(by_position), _array(by_normal)

    def _slope(self, gradient: np.ndarray) -> Tensor:
        return torch.tensor(np.asarray(gradient)).to(self.drawn.image)


def _array(tensor: Tensor) -> np.ndarray:
    array = tensor.cpu().numpy()
    return array.astype(np.float64) if array.dtype == np.float32 else array


def draw_arrays(
    points: np.ndarray,
    normals: np.ndarray,
    attributes: np.ndarray,
    sigma: np.ndarray | float,
    camera: Camera,
    how: Drawing | None = None,
    device: str | torch.device = "cuda",
    dtype: torch.dtype | None = None,
    pairs: int | None = None,
) -> ArrayDrawn:
    """:func:`draw` for arrays, on a device."""
    places, planes, colors, width = (
        torch.tensor(np.asarray(each), dtype=torch.float64, device=device)
        for each in (points, normals, attributes, sigma)
    )
    return ArrayDrawn(draw(places, planes, colors, width, camera, how, dtype, pairs))
