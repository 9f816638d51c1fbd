"""Planes through neighbourhoods of points, before and after a deformation (Eq. 5.5 and 5.6)."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

EXACT = "donot_use_mm_for_euclid_dist"  # the other mode has an error of 5e-4 in float32
GAP = 1e-4  # least gap between eigenvalues, of the largest one: it bounds the derivative of the normal


def neighbourhoods(points: Tensor, count: int) -> Tensor:
    """The ``count`` nearest points of each of ``points`` (b, p, 3), itself among them: (b, p, count) ints."""
    with torch.no_grad():
        distances = torch.cdist(points, points, compute_mode=EXACT)
        return distances.topk(min(count, points.shape[1]), dim=2, largest=False).indices


def planes(points: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
    """Centroids and unit normals (of either sign) of neighbourhoods, (b, p, 3) each, differentiable.

    Parameters
    ----------
    points : (b, p, 3) tensor
    index : (b, p, k) int tensor
    """
    batch = torch.arange(len(points), device=points.device)[:, None, None]
    members = points[batch, index]
    centroid = members.mean(dim=2)
    apart = members - centroid[:, :, None]
    return centroid, _LeastAxis.apply(apart.transpose(2, 3) @ apart)


class _LeastAxis(torch.autograd.Function):
    """The unit eigenvector of the least eigenvalue of symmetric matrices (..., 3, 3).

    dn = sum_k v_k (v_k . dC n) / (l_0 - l_k); if eigenvalues are nearly equal the gap is bounded from below.
    """

    @staticmethod
    def forward(ctx: Any, matrices: Tensor) -> Tensor:
        values, vectors = torch.linalg.eigh(matrices.double())
        ctx.save_for_backward(values, vectors)
        return vectors[..., 0].to(matrices.dtype)

    @staticmethod
    def backward(ctx: Any, slope: Tensor) -> Tensor:
        values, vectors = ctx.saved_tensors
        least, others = vectors[..., :1], vectors[..., 1:]
        gap = torch.maximum(values[..., 1:] - values[..., :1], GAP * values[..., 2:].clamp_min(1e-30))
        weights = -(others.transpose(-1, -2) @ slope.double()[..., None])[..., 0] / gap
        turned = (others * weights[..., None, :]).sum(dim=-1, keepdim=True) @ least.transpose(-1, -2)
        return ((turned + turned.transpose(-1, -2)) / 2).to(slope.dtype)
