"""Mean value coordinates in torch only, for devices on which the compiled loops do not run.

The formulas and the thresholds are those of :mod:`.mean_value_loops`. All branches are computed for all queries of a
chunk, and a mask selects the right one; divisors are 1 in the others, so that none sends NaN into a derivative.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from .edges import edges_of
from .mean_value_loops import AT_VERTEX, ON_EDGE, ON_PLANE

NEAR_EDGE = 1e-3  # angle between the plane of a face and that through one of its edges, about
CHUNK_BYTES = 2**26  # for the temporaries of a chunk, including derivatives


class Edges(NamedTuple):
    """As :class:`.edges.Edges`, of tensors."""

    ends: Tensor
    of_face: Tensor
    sign: Tensor


def coordinates_in_torch(x: Tensor, v: Tensor, faces: np.ndarray) -> Tensor:
    """The coordinates of :func:`.mean_value.mean_value_coordinates`, by torch's operations.

    Parameters
    ----------
    x : (b, p, 3) tensor
    v : (b, n, 3) tensor
    faces : (f, 3) int array
        A closed mesh, consistently oriented, either way round.

    Returns
    -------
    weights : (b, p, n) tensor
        Computed in float64, of the type of ``x``; differentiable in ``x`` and ``v``.
    """
    faces = np.ascontiguousarray(faces, dtype=np.int64)
    edges = edges_of(faces)
    # Numbers in memory for each query, including those stored for the derivative; measured, and rounded up.
    numbers = 6 * v.shape[1] + 20 * len(edges.ends) + 40 * len(faces)
    corners = torch.from_numpy(faces).to(x.device)
    seen = Edges(*(torch.from_numpy(array).to(x.device) for array in edges))

    def of_chunk(x: Tensor, v: Tensor) -> Tensor:
        return _coordinates(x, v, corners, seen)

    return in_chunks(of_chunk, 8 * numbers, x.double(), v.double()).to(x.dtype)


def in_chunks(function: Callable[..., Tensor], size: int, x: Tensor, *others: Tensor) -> Tensor:
    """``function(x, *others)``, by parts of the queries ``x`` (b, p, 3) and of the batch, in all arguments.

    If a derivative is needed and there are several parts, each is computed again in the backward pass, so that the
    stored values of only one part are in memory. Then there is no second derivative.

    Parameters
    ----------
    function : of (b, p, 3) and (b, ...) tensors, to a (b, p, k) tensor
    size : int
        Bytes that it needs for a query.
    """
    most = max(1, CHUNK_BYTES // size)  # queries
    batch, count = x.shape[:2]
    queries = max(1, min(count, most))
    batches = max(1, min(batch, most // queries))
    several = batch > batches or count > queries
    rows = []
    for first in range(0, max(1, batch), batches):
        own = [tensor[first : first + batches] for tensor in others]
        parts = x[first : first + batches].split(queries, dim=1)
        rows.append(torch.cat([_Part.apply(function, p, *own) if several else function(p, *own) for p in parts], dim=1))
    return torch.cat(rows)


class _Part(torch.autograd.Function):
    """A function that stores only its arguments; torch's own checkpoints load its compiler, which takes seconds."""

    @staticmethod
    def forward(ctx: Any, function: Callable[..., Tensor], *given: Tensor) -> Tensor:
        ctx.function = function
        ctx.save_for_backward(*given)
        return function(*given)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, slope: Tensor) -> tuple[Tensor | None, ...]:
        wanted = ctx.needs_input_grad[1:]
        with torch.enable_grad():
            given = [t.detach().requires_grad_(w) for t, w in zip(ctx.saved_tensors, wanted, strict=True)]
            value = ctx.function(*given)
        slopes = iter(torch.autograd.grad(value, [t for t in given if t.requires_grad], slope))
        return None, *(next(slopes) if w else None for w in wanted)


def _coordinates(x: Tensor, v: Tensor, faces: Tensor, edges: Edges) -> Tensor:
    i, j = edges.ends.T
    e = v[:, None] - x[:, :, None]
    square = (e * e).sum(dim=-1)
    with torch.no_grad():
        at = square <= AT_VERTEX**2 * square.amax(dim=-1, keepdim=True)
        at_vertex = at.any(dim=-1)
        one_hot = torch.nn.functional.one_hot(at.byte().argmax(dim=-1), v.shape[1]).to(e)
    d = torch.where(at, 1.0, square).sqrt()

    a, b = e[:, :, i], e[:, :, j]
    c, p = torch.linalg.cross(a, b), (a * b).sum(dim=-1)
    square = (c * c).sum(dim=-1)
    with torch.no_grad():
        straight = square.sqrt() <= ON_EDGE * d[:, :, i] * d[:, :, j]
        between = straight & (p < 0)
        on_edge = between.any(dim=-1) & ~at_vertex
        edge = between.byte().argmax(dim=-1)
    s = torch.where(straight, 1.0, square).sqrt()
    theta = torch.where(straight, 0.0, torch.atan2(s, torch.where(straight, 1.0, p)))

    w = _weights(faces, edges, e, d.detach(), c, theta / s, at_vertex | on_edge)
    total = w.sum(dim=-1, keepdim=True)
    w = w / torch.where(total == 0, 1.0, total)
    w = torch.where(on_edge[..., None], _along(edges.ends[edge], d), w)
    return torch.where(at_vertex[..., None], one_hot, w)


def _weights(faces: Tensor, edges: Edges, e: Tensor, d: Tensor, c: Tensor, turn: Tensor, elsewhere: Tensor) -> Tensor:
    """The weights of all vertices (b, p, n), not normalised; those of a single face if a query lies on it.

    ``turn`` is angle over sine, and ``elsewhere`` (b, p) marks queries that do not use these weights.
    """
    of_face, sign = edges.of_face, edges.sign
    c = c[:, :, of_face] * sign[:, :, None]
    m = 0.5 * (turn[:, :, of_face, None] * c).sum(dim=-2)
    volume = (e[:, :, faces[:, 0]] * c[:, :, :, 0]).sum(dim=-1)
    with torch.no_grad():
        # In the plane of a face, the mean vector has length pi inside of it, that of a hemisphere, and 0 elsewhere. A
        # length between means that an edge is nearer than the plane: then the face is treated like any other.
        length = m.square().sum(dim=-1).sqrt()
        flat = volume.abs() <= ON_PLANE * d[:, :, faces].prod(dim=-1)
        flat &= torch.minimum(length, math.pi - length) <= NEAR_EDGE
        flat |= elsewhere[..., None]
        on = flat & (length > 1)
        on &= on.cumsum(dim=-1) == 1  # the first
        alone = on.any(dim=-1, keepdim=True)
        left_out = torch.where(alone, ~on, flat)
    volume = torch.where(flat, 1.0, volume)  # a common factor of all corners of a face on which the query lies
    part = (c * m[:, :, :, None]).sum(dim=-1) / volume[..., None]
    part = torch.where(left_out[..., None], 0.0, part)
    return e.new_zeros(e.shape[:3]).index_add(2, faces.reshape(-1), part.flatten(2))


def _along(ends: Tensor, d: Tensor) -> Tensor:
    """The coordinates (b, p, n) of queries on edges whose ``ends`` are given (b, p, 2)."""
    both = d.gather(2, ends)
    return torch.zeros_like(d).scatter(2, ends, both.flip(-1) / both.sum(dim=-1, keepdim=True))
