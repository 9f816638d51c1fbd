"""Small scenes of triangles, and a soft rasteriser in plain tensor operations."""

from __future__ import annotations

import numpy as np
import torch

from bench import Views
from bench.methods.mesh_rendering.raster.scene import Scene

LEAST = 9.21


def random_scene(faces=12, width=20, height=16, seed=0):
    """Random triangles of many sizes and colours; some share corners."""
    rng = np.random.default_rng(seed)
    vertices = np.column_stack(
        [rng.uniform(-2, width + 2, 2 * faces), rng.uniform(-2, height + 2, 2 * faces), rng.uniform(2, 3, 2 * faces)]
    )
    indices = np.stack([rng.choice(2 * faces, 3, replace=False) for _ in range(faces)])
    return Scene(vertices, indices, rng.random((faces, 3)), width, height, 4.0)


def views_of_a_square(left, right, pixels=32):
    """One image of a white square at depth 1 that spans a range of columns, lit from the front."""
    image = np.zeros((1, pixels, pixels, 3), np.uint8)
    image[:, 8:24, left:right] = 255
    focal = float(pixels)
    lights = [np.array([[[0.0, 0, -1]]]), np.ones((1, 1, 3)), np.zeros((1, 3))]
    return Views(image, image[..., 0] > 0, np.eye(3, 4)[None], np.diag([focal, focal, 1.0]), *lights)


def square(left, right, pixels=32):
    """The vertices and faces of that square, facing the camera, with a vertex at its centre."""
    row, column = (8 + 24) / 2, (left + right) / 2
    corners = [[left, 8], [right, 8], [right, 24], [left, 24], [column, row]]
    vertices = np.column_stack([np.array(corners) / pixels, np.ones(5)])
    return vertices, np.array([[0, 4, 1], [1, 4, 2], [2, 4, 3], [3, 4, 0]])


def plain_soft_image(screen, faces, colors, width, height, far, sigma, gamma):
    """The soft image (h, w, 4) by tensors over all pixels and faces; sigma in square pixels."""
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    pixels = torch.tensor(np.stack([columns, rows], axis=-1).reshape(-1, 1, 2))
    corners = screen[torch.as_tensor(faces)]
    squared, along, sides = [], [], []
    for k in range(3):
        a, b = corners[:, k, :2], corners[:, (k + 1) % 3, :2]
        edge, off = b - a, pixels - a
        t = ((off * edge).sum(-1) / (edge * edge).sum(-1)).clamp(0, 1)
        squared.append(((off - t[..., None] * edge) ** 2).sum(-1))
        along.append((1 - t) / corners[:, k, 2] + t / corners[:, (k + 1) % 3, 2])
        sides.append(edge[:, 0] * off[..., 1] - edge[:, 1] * off[..., 0])
    area = sum(sides)
    weights = torch.stack([sides[1], sides[2], sides[0]], dim=-1) / area[..., None]
    inside = (weights >= 0).all(-1)
    nearest, which = torch.stack(squared).min(0)
    on_edge = torch.stack(along).gather(0, which[None])[0]
    inverse = torch.where(inside, (weights / corners[..., 2]).sum(-1), on_edge)
    score = torch.where(inside, nearest, -nearest) / sigma
    likely = torch.where(score > -LEAST, torch.sigmoid(score), torch.zeros(()))
    weight = likely * torch.exp((2.0 - 1 / inverse) / gamma)
    total = weight.sum(1) + np.exp((2.0 - far) / gamma)
    image = (weight[..., None] * colors).sum(1) / total[:, None]
    covered = 1 - (1 - likely).prod(1)
    return torch.cat([image, covered[:, None]], dim=1).reshape(height, width, 4)
