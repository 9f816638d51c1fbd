"""Mean value coordinates of points in closed triangle meshes, differentiable in points and mesh."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from ...learned.compiled.pool import in_parts
from .arguments import check
from .edges import Edges, edges_of
from .mean_value_loops import BLOCK, coordinates, derivatives


def mean_value_coordinates(queries: Tensor, vertices: Tensor, faces: Tensor | np.ndarray, threads: int = 1) -> Tensor:
    """The weights of each query as a mean of the vertices of a cage (Ju, Schaefer and Warren 2005).

    The weights sum to 1 and have linear precision, ``weights @ vertices == queries``, everywhere: inside, outside, and
    on vertices (one-hot), edges (linear) and faces (barycentric). They are computed in float64 for any type of the
    arguments. On a face the derivative is that along it, on a vertex it is 0: there the coordinates have a kink.

    Parameters
    ----------
    queries : (p, 3) or (b, p, 3) tensor
    vertices : (n, 3) or (b, n, 3) tensor
        Of one cage for all, or of a cage for each of the batch.
    faces : (f, 3) ints
        A closed mesh, consistently oriented, either way round.
    threads : int
        On the CPU; the result does not depend on it.

    Returns
    -------
    weights : (p, n) or (b, p, n) tensor
        Of the type and on the device of ``queries``; differentiable in queries and vertices.

    Raises
    ------
    ValueError
        For arguments of other shapes, or faces with indices of missing vertices.

    Examples
    --------
    >>> import torch
    >>> corners = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    >>> faces = torch.tensor([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    >>> mean_value_coordinates(torch.tensor([[0.25, 0.25, 0.25], [0.5, 0.5, 0.0]]), corners, faces)
    tensor([[0.2500, 0.2500, 0.2500, 0.2500],
            [0.0000, 0.5000, 0.5000, 0.0000]])
    """
    faces = faces.cpu().numpy() if isinstance(faces, Tensor) else faces
    faces = np.ascontiguousarray(faces, dtype=np.int64)
    check(queries, vertices, faces)
    batched = queries.ndim == 3 or vertices.ndim == 3
    x = queries if queries.ndim == 3 else queries[None]
    v = vertices if vertices.ndim == 3 else vertices[None]
    count = max(len(x), len(v))
    x, v = x.expand(count, -1, -1), v.expand(count, -1, -1).to(queries)
    if x.is_cuda:
        from .mean_value_torch import coordinates_in_torch

        weights = coordinates_in_torch(x, v, faces)
    else:
        weights = _MeanValue.apply(x, v, faces, edges_of(faces), threads)
    return weights if batched else weights[0]


def load_compiled() -> None:
    """Load the compiled loops from the cache, or compile them."""
    corners = torch.eye(4, 3, requires_grad=True)
    faces = np.array([[3, 1, 0], [3, 0, 2], [3, 2, 1], [0, 1, 2]])
    mean_value_coordinates(torch.full((1, 3), 0.2), corners, faces).square().sum().backward()


class _MeanValue(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, v: Tensor, faces: np.ndarray, edges: Edges, threads: int) -> Tensor:
        ctx.arrays = _doubles(x), _doubles(v), faces, edges, threads
        ctx.dtypes = x.dtype, v.dtype
        out = np.empty((*x.shape[:2], v.shape[1]))
        in_parts(coordinates, len(x) * _blocks(x), threads, *ctx.arrays[:2], faces, *edges, out)
        return torch.from_numpy(out).to(x.dtype)

    @staticmethod
    def backward(ctx: Any, slope: Tensor) -> tuple[Tensor | None, ...]:
        x, v, faces, edges, threads = ctx.arrays
        by_x = np.empty_like(x)
        by_v = np.empty((len(x), _blocks(x), *v.shape[1:]))
        in_parts(derivatives, len(x) * _blocks(x), threads, x, v, faces, *edges, _doubles(slope), by_x, by_v)
        by_queries, by_cages = (
            torch.from_numpy(a).to(t) for a, t in zip((by_x, by_v.sum(axis=1)), ctx.dtypes, strict=True)
        )
        return by_queries, by_cages, None, None, None


def _doubles(tensor: Tensor) -> np.ndarray:
    return np.ascontiguousarray(tensor.detach().numpy(), dtype=np.float64)


def _blocks(x: Tensor | np.ndarray) -> int:
    return -(-x.shape[1] // BLOCK)
