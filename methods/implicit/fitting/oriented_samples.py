"""Meshes as samples in one frame, and samples of a base as input of a descriptor."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch
from torch.nn import functional as F

from bench import Frame
from bench.geometry.mesh_surface import MeshSurface

from ...learned.networks.sine_network import SineNetwork
from ..fields.descriptor import Cloud

if TYPE_CHECKING:
    from trimesh import Trimesh

Samples = tuple[np.ndarray, np.ndarray]  # positions (n, 3) in the frame, and unit normals (n, 3)

SAMPLES = 200_000  # of each mesh (released: a million)
CLOUD = 30_000  # points of a base, from which those of the encoder are drawn
PROBES = 5000  # vertices at which the height of the details is measured
UNKNOWN_REACH = 0.1  # height of the details of a source without a base, relative to the source's radius
FILL = 0.98  # position of the farthest detail in the frame; the box ends at 1


def frame_of(source: Trimesh, source_base: Trimesh | None, target_base: Trimesh) -> Frame:
    """One frame for all, so that lengths carry over, in which the details on either base lie within the box."""
    meshes = [source, target_base, *([] if source_base is None else [source_base])]
    frame = Frame.of(np.concatenate([mesh.vertices for mesh in meshes]))
    if source_base is None:
        reach = UNKNOWN_REACH * Frame.of(source.vertices).radius
    else:
        some = np.asarray(source.vertices)[:: len(source.vertices) // PROBES + 1]
        reach = float(MeshSurface(source_base).project(some).distance.max())
    farthest = float(np.linalg.norm(target_base.vertices - np.array(frame.center), axis=1).max()) + reach
    return Frame(frame.center, max(farthest, frame.radius) / FILL)


def samples(mesh: Trimesh, frame: Frame, rng: np.random.Generator) -> Samples:
    """Uniform samples of a mesh in the frame."""
    points, normals = MeshSurface(mesh).sample(SAMPLES, rng)
    return frame.apply(points), normals


def cloud_of(known: Samples, device: str | torch.device) -> Cloud:
    """Some of the samples as a cloud."""
    return Cloud(*(torch.as_tensor(part[:CLOUD], dtype=torch.float32, device=device) for part in known))


@torch.no_grad()
def on_base(base: SineNetwork, cloud: Cloud) -> Cloud:
    """A cloud moved onto a fitted base, which may be smoother, with the base's normals."""
    x = cloud.points
    for _ in range(2):  # Newton's steps; a signed distance would need one
        f, gradient = base.value_and_gradient(x)
        x = x - f[:, None] * gradient / gradient.square().sum(1, keepdim=True).clamp(min=0.1)
    return Cloud(x, F.normalize(base.value_and_gradient(x)[1], dim=1))


@torch.no_grad()
def largest_distance(base: SineNetwork, known: Samples) -> float:
    """The largest distance of some of the samples to a fitted base."""
    return float(base(cloud_of(known, base.biases[0].device).points).abs().max())
