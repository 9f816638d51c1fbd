"""Green coordinates of points in closed triangle meshes: weights of vertices and of normals.

Green's third identity gives the values of a harmonic function inside a cage from its values on the cage and its normal
derivatives there. For the three coordinates themselves, which are linear on each face with its unit normal n as the
derivative, it reads ``x = sum_i phi_i v_i + sum_f psi_f n_f`` (Lipman, Levin and Cohen-Or 2008) with

    phi_i = 1 / (4 pi) sum over the faces f of i: h integral of hat_i(y) / |y - x|^3 dy
    psi_f = 1 / (4 pi) integral over f of 1 / |y - x| dy

where hat_i is 1 at vertex i and 0 at all others, and h is the distance of x from the plane of f, positive behind it.
Both have closed forms. In a face's plane, let m_k be the outward unit normal of the side opposite corner k, l_k its
length, t_k the distance of x from it, positive inside, and A the face's area. With the solid angle W, and the potential
of a side ``L_k = integral of 1 / |y - x| along it``, Gauss's theorem in the plane gives

    integral of 1 / |y - x| dy = sum_k t_k L_k - h W
    h integral of hat_i(y) / |y - x|^3 dy = l_i / (2 A) (t_i W + h sum_k m_i . m_k L_k)

because ``hat_i = t_i l_i / (2 A)`` at the projection of x, with the gradient ``-m_i l_i / (2 A)``.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from .arguments import check
from .mean_value_torch import in_chunks

ON_CAGE = 1e-9  # of the largest distance to a vertex
ON_SIDE = 1e-15  # the same: as near as rounding allows
THIN = 1e-12  # height over length of a face that has no direction


def green_coordinates(queries: Tensor, vertices: Tensor, faces: Tensor | np.ndarray) -> tuple[Tensor, Tensor]:
    """The weights of a cage's vertices and of its faces' normals at each query (Lipman, Levin and Cohen-Or 2008).

    Inside, ``phi`` sums to 1 and ``phi @ vertices + psi @ normals == queries`` with the outward unit normals. On the
    cage (to 1e-9 of its size) they are the limits from inside, and so are the derivatives, except on edges and
    vertices, where none exist: there they are finite but meaningless. Outside, ``phi`` sums to 0 and
    ``phi @ vertices + psi @ normals`` is 0: the coordinates are useless there. They are computed in float64 for any
    type of the arguments.

    Parameters
    ----------
    queries : (p, 3) or (b, p, 3) tensor
    vertices : (n, 3) or (b, n, 3) tensor
        Of one cage for all, or of a cage for each of the batch.
    faces : (f, 3) ints
        A closed mesh, counter-clockwise as seen from outside.

    Returns
    -------
    phi : (p, n) or (b, p, n) tensor
    psi : (p, f) or (b, p, f) tensor
        In the unit of length of the cage. Both of the type and on the device of ``queries``, and differentiable in
        queries and vertices.

    Raises
    ------
    ValueError
        For arguments of other shapes, faces with indices of missing vertices, or faces oriented inward.

    Examples
    --------
    >>> import torch
    >>> corners = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    >>> faces = torch.tensor([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    >>> phi, psi = green_coordinates(torch.tensor([[0.25, 0.25, 0.25]]), corners, faces)
    >>> phi, psi
    (tensor([[0.2764, 0.2412, 0.2412, 0.2412]]), tensor([[0.1037, 0.1037, 0.1037, 0.1949]]))
    """
    faces = _numbers(faces).to(queries.device)
    check(queries, vertices, faces)
    batched = queries.ndim == 3 or vertices.ndim == 3
    x = (queries if queries.ndim == 3 else queries[None]).double()
    v = (vertices if vertices.ndim == 3 else vertices[None]).to(x)
    count = max(len(x), len(v))
    _check_outward(v, faces)

    def of_chunk(x: Tensor, v: Tensor) -> Tensor:
        return _coordinates(x, v, faces)

    # Numbers in memory for each query, including those stored for the derivative; measured, and rounded up.
    numbers = 12 * v.shape[1] + 110 * len(faces)
    both = in_chunks(of_chunk, 8 * numbers, x.expand(count, -1, -1), v.expand(count, -1, -1)).to(queries.dtype)
    phi, psi = (both if batched else both[0]).split([v.shape[1], len(faces)], dim=-1)
    return phi, psi


def deformed_by_green(queries: Tensor, vertices: Tensor, faces: Tensor | np.ndarray, new_vertices: Tensor) -> Tensor:
    """The positions of the queries after the cage is deformed: ``phi @ new_vertices + psi @ (s new_normals)``.

    ``s = sqrt(|u'|^2 |v|^2 - 2 (u' . v') (u . v) + |v'|^2 |u|^2) / (sqrt(8) A)`` stretches a face of area A, with
    sides u and v that become u' and v'. With it the map is a similarity if the cage's is one, and otherwise
    quasi-conformal: details rotate with the cage, and are not sheared. Points on the cage do not stay on it. Queries
    outside the cage have no image: see :func:`green_coordinates`.

    Parameters
    ----------
    queries, vertices, faces
        As :func:`green_coordinates` takes them.
    new_vertices : (n, 3) or (b, n, 3) tensor

    Returns
    -------
    moved : (p, 3) or (b, p, 3) tensor
        Of the type and on the device of ``queries``; differentiable in all three.

    Raises
    ------
    ValueError
        As :func:`green_coordinates`, and for new vertices of another shape.
    """
    if new_vertices.ndim not in (2, 3) or new_vertices.shape[-2:] != vertices.shape[-2:]:
        expected = tuple(vertices.shape[-2:])
        raise ValueError(f"new_vertices: expected shape {expected}, or several, got {tuple(new_vertices.shape)}")
    phi, psi = green_coordinates(queries.double(), vertices, faces)
    corners = _numbers(faces).to(queries.device)
    before, after = (t.to(queries.device).double() for t in (vertices, new_vertices))
    (u, v), (new_u, new_v) = _two_sides(before, corners), _two_sides(after, corners)
    area, normal = _length(torch.linalg.cross(u, v)) / 2, torch.linalg.cross(new_u, new_v)
    square = _dot(new_u, new_u) * _dot(v, v) - 2 * _dot(new_u, new_v) * _dot(u, v) + _dot(new_v, new_v) * _dot(u, u)
    stretch = _root(square) / (math.sqrt(8) * torch.where(area > 0, area, 1.0))
    pull = stretch[..., None] * normal / _length(normal, instead_of_0=1.0)[..., None]
    return (phi @ after + psi @ pull).to(queries.dtype)


def _coordinates(x: Tensor, v: Tensor, faces: Tensor) -> Tensor:
    """Both kinds concatenated, (b, p, n + f)."""
    corner = v[:, faces]
    side = corner[:, :, [2, 0, 1]] - corner[:, :, [1, 2, 0]]  # opposite each corner
    normal, length = torch.linalg.cross(side[:, :, 0], side[:, :, 1]), _length(side)
    twice_area = _length(normal)
    thin = twice_area <= THIN * length.detach().square().amax(dim=-1)  # they are left out
    twice_area = torch.where(thin, 1.0, twice_area)
    normal = torch.where(thin[..., None], 0.0, normal / twice_area[..., None])
    out = torch.linalg.cross(side / torch.where(length > 0, length, 1.0)[..., None], normal[:, :, None])

    e = v[:, None] - x[:, :, None]
    d = _length(e)
    farthest = d.detach().amax(dim=-1)[..., None]
    tiny = ON_CAGE * farthest
    e, d = e[:, :, faces], d[:, :, faces]
    height = _dot(e[:, :, :, 0], normal[:, None])
    inward = _dot(e[:, :, :, [1, 2, 0]], out[:, None])
    on = (height.abs() <= tiny) & (inward >= -tiny[..., None]).all(dim=-1)
    on = on & ~thin[:, None]

    dots = _dot(e[:, :, :, [1, 2, 0]], e[:, :, :, [2, 0, 1]])
    ends = d[..., [1, 2, 0]], d[..., [2, 0, 1]]
    square = inward.square() + height.square()[..., None]
    potential = _of_side(length[:, None], *ends, dots, square, ON_SIDE * farthest[..., None])
    angle = _solid_angle(height * twice_area[:, None], d.prod(dim=-1) + (dots * d).sum(dim=-1), on)
    angle = torch.where(thin[:, None], 0.0, angle)
    # The solid angle of a face on which the query lies is the rest of the full one: half of it inside of the face. So
    # slightly beyond the cage the coordinates continue those inside; close to an edge, the angles of its two faces
    # suffer from rounding, but their sum does not.
    first = on & (on.cumsum(dim=-1) == 1)
    angle = torch.where(first, angle + 4 * math.pi - angle.sum(dim=-1, keepdim=True), angle)

    psi = (inward * potential).sum(dim=-1) - height * angle
    across = (out @ out.transpose(-1, -2))[:, None] @ potential[..., None]
    share = (length / twice_area[..., None])[:, None] * (inward * angle[..., None] + height[..., None] * across[..., 0])
    phi = x.new_zeros((*x.shape[:2], v.shape[1])).index_add(2, faces.reshape(-1), share.flatten(2))
    return torch.cat([phi, psi], dim=-1) / (4 * math.pi)


def _of_side(length: Tensor, first: Tensor, last: Tensor, dot: Tensor, square: Tensor, least: Tensor) -> Tensor:
    """The integral of 1 / |y - x| along sides, from the distances of x to their ends and, squared, to their lines.

    ``log((first + last + length) / (first + last - length))``, without loss of digits near to sides and far from them.
    0 on a side, where it is unbounded, because all its factors are 0 there.
    """
    gap = first * last - dot
    gap = torch.where(dot < 0, length.square() * square / torch.where(dot < 0, gap, 1.0), first * last + dot)
    on = (dot <= 0) & (square <= least.square()) | (gap == 0)
    rise = length * (first + last + length) / torch.where(on, 1.0, gap)
    return torch.where(on, 0.0, torch.log1p(rise))


def _solid_angle(volume: Tensor, rest: Tensor, on: Tensor) -> Tensor:
    """Signed solid angles of triangles (Van Oosterom and Strackee 1983), less half a turn if the query is ``on``."""
    turned = on & (rest < 0)
    nowhere = (volume == 0) & (rest == 0)
    volume, rest = torch.where(turned, -volume, volume), torch.where(turned, -rest, rest)
    return 2 * torch.atan2(volume, torch.where(nowhere, 1.0, rest))


def _numbers(faces: Tensor | np.ndarray) -> Tensor:
    return faces.long() if isinstance(faces, Tensor) else torch.from_numpy(np.ascontiguousarray(faces, dtype=np.int64))


def _two_sides(v: Tensor, faces: Tensor) -> tuple[Tensor, Tensor]:
    a, b, c = (v[..., faces[:, k], :] for k in range(3))
    return b - a, c - a


def _dot(a: Tensor, b: Tensor) -> Tensor:
    return (a * b).sum(dim=-1)


def _root(square: Tensor) -> Tensor:
    """The square root, with the derivative 0 at 0."""
    nothing = square <= 0
    return torch.where(nothing, 0.0, torch.where(nothing, 1.0, square).sqrt())


def _length(vector: Tensor, instead_of_0: float = 0.0) -> Tensor:
    length = _root(_dot(vector, vector))
    return torch.where(length > 0, length, instead_of_0)


def _check_outward(v: Tensor, faces: Tensor) -> None:
    a, b, c = v.detach()[:, faces].unbind(dim=2)
    volume = _dot(a, torch.linalg.cross(b, c)).sum(dim=-1) / 6
    if (volume <= 0).any():
        raise ValueError(
            f"faces: expected to be counter-clockwise as seen from outside, got a cage of volume {volume.min():.3g}"
        )
