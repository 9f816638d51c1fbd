"""The derivative of the splats' weights by positions and normals: d rho of Eq. 3.10 and 3.11.

The released code omits it. It is small compared with the gradient by visibility, and determines how a visible splat
tilts and shifts if neighbours of other colours overlap it.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from .camera import Camera
from .ellipses import Ellipses
from .raster import Lists
from .settings import Drawing


def weights_at(
    position: Tensor, normal: Tensor, sigma: Tensor, pixels: Tensor, lens: tuple[float, ...], blur: float
) -> Tensor:
    """Weights of Eq. 3.6, differentiable.

    Parameters
    ----------
    position, normal : (m, 3) tensors
        In the axes of the camera; normals of unit length, towards it.
    sigma : (m,) tensor
    pixels : (m, 2) tensor
        Column and row.
    lens : tuple
        See :meth:`.camera.Camera.lens`.
    blur : float

    Returns
    -------
    (m,) tensor
    """
    fx, fy, skew, cx, cy = lens
    x, y, z = position.unbind(1)
    zero = torch.zeros_like(z)
    a = torch.stack([fx / z, skew / z, -(fx * x + skew * y) / z**2], dim=1)
    b = torch.stack([zero, fy / z, -fy * y / z**2], dim=1)
    an, bn = (a * normal).sum(1), (b * normal).sum(1)
    s00 = sigma**2 * ((a * a).sum(1) - an * an) + blur**2
    s01 = sigma**2 * ((a * b).sum(1) - an * bn)
    s11 = sigma**2 * ((b * b).sum(1) - bn * bn) + blur**2
    determinant = s00 * s11 - s01 * s01
    du = pixels[:, 0] - ((fx * x + skew * y) / z + cx)
    dv = pixels[:, 1] - (fy * y / z + cy)
    beta = 0.5 * (s11 * du * du - 2 * s01 * du * dv + s00 * dv * dv) / determinant
    area = fx * fy * -(position * normal).sum(1) / z**3
    return area * torch.exp(-beta) / (2 * math.pi * determinant.sqrt())


def weight_gradients(
    ellipses: Ellipses,
    lists: Lists,
    total: np.ndarray,
    image: np.ndarray,
    attributes: np.ndarray,
    sigma: np.ndarray,
    gradient: np.ndarray,
    camera: Camera,
    how: Drawing,
) -> tuple[np.ndarray, np.ndarray]:
    """The gradients of positions and normals (n, 3) in the world, through the weights of visible splats.

    Normals are the drawn ones, towards the camera; parameters as for :func:`.visibility.visibility_gradient`.
    """
    seen = np.arange(lists.index.shape[2]) < lists.front[..., None]
    rows, columns, entries = np.nonzero(seen & (total > 0)[..., None])
    index = lists.index[rows, columns, entries]
    change = gradient[rows, columns] * (attributes[index] - image[rows, columns])
    factor = torch.from_numpy(change.sum(axis=1) / total[rows, columns])
    position = torch.from_numpy(ellipses.position).clone().requires_grad_()
    normal = torch.from_numpy(ellipses.normal).clone().requires_grad_()
    pixels = torch.from_numpy(np.column_stack([columns, rows]) + 0.5)
    chosen = torch.from_numpy(index.astype(np.int64))
    with torch.enable_grad():
        widths = torch.from_numpy(np.asarray(sigma, dtype=np.float64))[chosen]
        weights = weights_at(position[chosen], normal[chosen], widths, pixels, camera.lens(), how.blur)
        by_position, by_normal = torch.autograd.grad((weights * factor).sum(), (position, normal))
    return by_position.numpy() @ camera.rotation, by_normal.numpy() @ camera.rotation
