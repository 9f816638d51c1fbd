"""The renderer as a function of torch that stays on the device of its tensors."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from ..renderer.camera import Camera
from ..renderer.settings import Drawing
from .drawn import TorchDrawn, draw
from .ellipses import rotation_of


def render(
    points: Tensor,
    normals: Tensor,
    attributes: Tensor,
    sigma: Tensor | float,
    camera: Camera,
    how: Drawing | None = None,
    dtype: torch.dtype | None = None,
) -> tuple[Tensor, TorchDrawn]:
    """An image of oriented points, differentiable in points and attributes, and with ``how.weights`` in normals.

    Parameters
    ----------
    points, normals : (n, 3) tensors
        In the world; normals are normalised.
    attributes : (n, c) tensor
        If they depend on the normals (shading), these get gradients through them.
    sigma : (n,) tensor or float
        Standard deviation of each point's Gaussian in its tangent plane.
    camera : Camera
    how : Drawing, optional
    dtype : torch.dtype, optional
        See :func:`.drawn.draw`.

    Returns
    -------
    image : (h, w, c) tensor
        Of the type of the attributes.
    drawn : TorchDrawn
        The visible splats of each pixel.
    """
    unit = torch.nn.functional.normalize(normals, dim=1)
    holder: list[TorchDrawn] = []
    image = _Render.apply(points, unit, attributes, sigma, camera, how or Drawing(), dtype, holder)
    return image, holder[0]


class _Render(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        points: Tensor,
        normals: Tensor,
        attributes: Tensor,
        sigma: Tensor | float,
        camera: Camera,
        how: Drawing,
        dtype: torch.dtype | None,
        holder: list[TorchDrawn],
    ) -> Tensor:
        drawn = draw(points, normals, attributes, sigma, camera, how, dtype)
        # Without culling, a normal may be drawn flipped.
        given = normals.to(points.device).double() @ rotation_of(camera, points.device).T
        ctx.turned = (drawn.ellipses.normal * given).sum(1, keepdim=True) < 0
        ctx.drawn, ctx.like = drawn, (points, normals, attributes)
        holder.append(drawn)
        return drawn.image.to(attributes)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Any, ...]:
        drawn, wanted = ctx.drawn, ctx.needs_input_grad
        points = drawn.position_gradient(gradient) if wanted[0] else None
        normals = None
        if drawn.how.weights and (wanted[0] or wanted[1]):
            by_position, by_normal = drawn.weight_gradients(gradient)
            points = points + by_position if wanted[0] else None
            normals = torch.where(ctx.turned, -by_normal, by_normal)
        attributes = drawn.attribute_gradient(gradient) if wanted[2] else None
        found = zip((points, normals, attributes), ctx.like, strict=True)
        return *(None if slope is None else slope.to(given) for slope, given in found), None, None, None, None, None
