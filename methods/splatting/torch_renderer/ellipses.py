"""Oriented points as ellipses of the image, as :mod:`..renderer.ellipses` makes them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ..renderer.camera import Camera
from ..renderer.ellipses import TINY
from ..renderer.settings import Drawing


class Ellipses(NamedTuple):
    """The ellipses of points in an image; entries of points that are not drawn are meaningless."""

    shown: Tensor
    """(n,) bool tensor"""
    place: Tensor
    """(n, 2) tensor: column and row of the centre, continuous"""
    position: Tensor
    """(n, 3) tensor: in the axes of the camera"""
    normal: Tensor
    """(n, 3) tensor: the same, towards the camera"""
    form: Tensor
    """(n, 3) tensor: M_00, M_01, M_11 of the inverse variance"""
    half: Tensor
    """(n, 2) tensor: half the extent of the covered pixels, in columns and rows"""
    peak: Tensor
    """(n,) tensor: its weight at the centre"""
    reach: Tensor
    """(n,) tensor: no part of it is farther from the centre in depth"""


def rotation_of(camera: Camera, device: torch.device) -> Tensor:
    """World to camera: (3, 3) float64 tensor."""
    return torch.tensor(np.asarray(camera.rotation), dtype=torch.float64, device=device)


def project(
    points: Tensor, normals: Tensor, sigma: Tensor, camera: Camera, how: Drawing, dtype: torch.dtype
) -> Ellipses:
    """The ellipses of points, computed in float64 and rounded to ``dtype``: there are few points compared with pixels.

    Parameters
    ----------
    points, normals : (n, 3) float64 tensors
        In the world; normals of unit length.
    sigma : (n,) float64 tensor
        Standard deviation of each point's Gaussian in its tangent plane.
    camera : Camera
    how : Drawing
    dtype : torch.dtype
        Of the ellipses.
    """
    fx, fy, skew, cx, cy = camera.lens()
    rotation = rotation_of(camera, points.device)
    translation = torch.tensor(np.asarray(camera.extrinsics)[:, 3], dtype=torch.float64, device=points.device)
    position, normal = points @ rotation.T + translation, normals @ rotation.T
    x, y, z = position.unbind(1)
    towards = -(position * normal).sum(1)
    if not how.cull:
        normal = torch.where((towards < 0)[:, None], -normal, normal)
        towards = towards.abs()
    u, v = (fx * x + skew * y) / z + cx, fy * y / z + cy
    width, height = camera.width, camera.height
    shown = (z > how.near) & (towards >= how.grazing * position.norm(dim=1))
    shown &= (-0.5 * width <= u) & (u <= 1.5 * width) & (-0.5 * height <= v) & (v <= 1.5 * height)
    # Rows of the Jacobian of the projection, and of it times the normal: A (1 - n n^T) A^T
    ax, ay, az = fx / z, skew / z, -(fx * x + skew * y) / (z * z)
    by, bz = fy / z, -fy * y / (z * z)
    an = ax * normal[:, 0] + ay * normal[:, 1] + az * normal[:, 2]
    bn = by * normal[:, 1] + bz * normal[:, 2]
    variance = sigma * sigma
    s00 = variance * (ax * ax + ay * ay + az * az - an * an).clamp_min(0) + how.blur**2
    s01 = variance * (ay * by + az * bz - an * bn)
    s11 = variance * (by * by + bz * bz - bn * bn).clamp_min(0) + how.blur**2
    determinant = s00 * s11 - s01 * s01
    shown &= determinant > TINY
    form = torch.stack([s11 / determinant, -s01 / determinant, s00 / determinant], dim=1)
    half = (2 * how.cutoff * torch.stack([s00, s11], dim=1)).sqrt()
    peak = fx * fy * towards / (z * z * z) / (2 * math.pi * determinant.sqrt())
    reach = sigma * math.sqrt(2 * how.cutoff)
    found = (torch.stack([u, v], dim=1), position, normal, form, half, peak, reach)
    return Ellipses(shown, *(each.to(dtype) for each in found))
