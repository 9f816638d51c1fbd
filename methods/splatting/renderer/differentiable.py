"""The renderer as a function of torch."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from .camera import Camera
from .drawn import Drawn, draw
from .settings import Drawing


def render(
    points: Tensor,
    normals: Tensor,
    attributes: Tensor,
    sigma: Tensor | float,
    camera: Camera,
    how: Drawing | None = None,
    threads: int = 1,
) -> tuple[Tensor, Drawn]:
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
    threads : int

    Returns
    -------
    image : (h, w, c) tensor
    drawn : Drawn
        The visible splats of each pixel.

    Examples
    --------
    >>> import torch
    >>> camera = Camera.looking_at(np.array([0.0, 0, -3]), np.zeros(3), np.array([0.0, -1, 0]), 20.0, 16, 16)
    >>> point = torch.zeros(1, 3, requires_grad=True)
    >>> image, _ = render(point, torch.tensor([[0.0, 0, -1]]), torch.ones(1, 1), 0.1, camera)
    >>> (image[8, 12, 0] - 1).square().backward()    # that pixel is to become 1
    >>> bool(point.grad[0, 0] < 0)                   # the column grows with x: the point is drawn there
    True
    """
    how = how or Drawing()
    unit = torch.nn.functional.normalize(normals, dim=1)
    holder: list[Drawn] = []
    image = _Render.apply(points, unit, attributes, sigma, camera, how, threads, holder)
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
        threads: int,
        holder: list[Drawn],
    ) -> Tensor:
        known = [tensor.detach().cpu().numpy() for tensor in (points, normals, attributes)]
        width = sigma.detach().cpu().numpy() if isinstance(sigma, Tensor) else sigma
        ctx.drawn = draw(known[0], known[1], known[2], width, camera, how, threads)
        # Without culling, a normal may be drawn flipped.
        ctx.turned = (ctx.drawn.ellipses.normal * (known[1] @ camera.rotation.T)).sum(axis=1, keepdims=True) < 0
        holder.append(ctx.drawn)
        return torch.from_numpy(ctx.drawn.image).to(attributes)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Any, ...]:
        drawn, given = ctx.drawn, gradient.detach().cpu().double().numpy()
        wanted = ctx.needs_input_grad
        points = drawn.position_gradient(given) if wanted[0] else None
        normals = None
        if drawn.how.weights and (wanted[0] or wanted[1]):
            by_position, by_normal = drawn.weight_gradients(given)
            points = points + by_position if wanted[0] else None
            normals = np.where(ctx.turned, -by_normal, by_normal)
        attributes = drawn.attribute_gradient(given) if wanted[2] else None
        found = (
            None if array is None else torch.from_numpy(array).to(gradient) for array in (points, normals, attributes)
        )
        return *found, None, None, None, None, None
