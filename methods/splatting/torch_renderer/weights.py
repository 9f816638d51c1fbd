"""The derivative of the splats' weights by positions and normals, as in :mod:`..renderer.weights`."""

from __future__ import annotations

import torch
from torch import Tensor

from ..renderer.camera import Camera
from ..renderer.settings import Drawing
from ..renderer.weights import weights_at
from .blending import seen_weights
from .ellipses import Ellipses, rotation_of
from .ragged import add_rows
from .raster import Lists


def weight_gradients(
    ellipses: Ellipses,
    lists: Lists,
    total: Tensor,
    image: Tensor,
    attributes: Tensor,
    sigma: Tensor,
    gradient: Tensor,
    camera: Camera,
    how: Drawing,
) -> tuple[Tensor, Tensor]:
    """The gradients of positions and normals in the world, (n, 3) float64 tensors, through weights of visible splats.

    Normals are the drawn ones, towards the camera; parameters as for :func:`.visibility.visibility_gradient`.
    """
    back = [torch.zeros(len(attributes), 3, dtype=torch.float64, device=image.device) for _ in range(2)]
    weights = seen_weights(lists)
    for layer in range(weights.shape[2]):
        rows, columns = torch.nonzero(weights[..., layer] > 0, as_tuple=True)
        index = lists.index[rows, columns, layer]
        change = gradient[rows, columns] * (attributes[index] - image[rows, columns])
        factor = change.sum(1) / total[rows, columns]
        position = ellipses.position[index].requires_grad_()
        normal = ellipses.normal[index].requires_grad_()
        pixels = torch.stack([columns, rows], dim=1).to(position) + 0.5
        with torch.enable_grad():
            found = weights_at(position, normal, sigma[index], pixels, camera.lens(), how.blur)
            slopes = torch.autograd.grad((found * factor).sum(), (position, normal))
        for into, slope in zip(back, slopes, strict=True):
            add_rows(into, index, slope)
    rotation = rotation_of(camera, image.device)
    return back[0] @ rotation, back[1] @ rotation
