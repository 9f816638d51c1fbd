"""The training surfaces of EC-Net: triangles, and the segments of sharp edges."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch
from torch import Tensor

from ..losses.nearest_surface import to_all_segments, to_all_triangles
from ..networks.neighbours import gather
from .pairs import Patches

if TYPE_CHECKING:
    from bench import Shape

FAR = 1e3  # position of the ends of padding segments
THIN = 1e-6  # smallest height of a triangle that counts, relative to its longest side


class Edged(NamedTuple):
    """A surface as arrays."""

    triangles: np.ndarray
    """(t, 3, 3) float32 array: corners"""
    segments: np.ndarray
    """(s, 2, 3) float32 array: ends; s may be 0"""


def edged(shape: Shape, faces: int, angle: float) -> Edged:
    """The triangles of a shape's mesh, and its edges between faces whose normals differ by more than ``angle`` degrees.

    Only shapes whose mesh is exact have sharp edges: on others, an angle reflects the resolution of the mesh. A mesh of
    more than ``faces`` faces is simplified to that number (Garland and Heckbert 1997): a patch uses few triangles.
    Edges are those of the original mesh.

    Raises
    ------
    ValueError
        If all triangles are thinner than a millionth of their sides.
    """
    mesh = shape.mesh
    segments = np.empty((0, 2, 3), dtype=np.float32)
    if shape.exactness == "polyhedron":
        sharp = mesh.face_adjacency_angles > np.radians(angle)
        segments = mesh.vertices[mesh.face_adjacency_edges[sharp]].astype(np.float32)
    corners = np.asarray(mesh.triangles, dtype=np.float64)
    if len(corners) > faces:
        corners = _simplified(mesh.vertices, mesh.faces, faces)
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    doubled = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    corners = corners[doubled > THIN * sides**2]
    if not len(corners):
        raise ValueError(f"{shape.id}: none of the triangles has an area")
    return Edged(corners.astype(np.float32), segments)


def _simplified(vertices: np.ndarray, faces: np.ndarray, count: int) -> np.ndarray:
    from open3d.geometry import TriangleMesh
    from open3d.utility import Vector3dVector, Vector3iVector

    mesh = TriangleMesh(Vector3dVector(vertices), Vector3iVector(faces)).simplify_quadric_decimation(count)
    return np.asarray(mesh.vertices)[np.asarray(mesh.triangles)]


def pack_edged(surfaces: Iterable[Edged]) -> dict[str, np.ndarray]:
    """Surfaces one after the other: ``triangles`` and ``segments``, and their numbers for each surface."""
    surfaces = list(surfaces)
    return {
        "triangles": np.concatenate([surface.triangles for surface in surfaces]),
        "triangle_counts": np.array([len(surface.triangles) for surface in surfaces], dtype=np.int64),
        "segments": np.concatenate([surface.segments for surface in surfaces]),
        "segment_counts": np.array([len(surface.segments) for surface in surfaces], dtype=np.int64),
    }


class EdgedSurfaces:
    """The surfaces of :func:`pack_edged`, on a device.

    Parameters
    ----------
    examples : mapping
        Also with ``shapes``, the number of the surface of each pyramid.
    device : str
    """

    def __init__(self, examples: Mapping[str, np.ndarray], device: str):
        numbers = {int(shape): number for number, shape in enumerate(np.unique(examples["shapes"]))}
        self._of_pyramid = np.array([numbers[int(shape)] for shape in examples["shapes"]])
        self._triangles = _Parts(examples["triangles"], examples["triangle_counts"], device)
        self._segments = _Parts(examples["segments"], examples["segment_counts"], device)

    def around(self, patches: Patches, triangles: int, segments: int) -> tuple[Tensor, Tensor]:
        """The triangles and segments nearest the seeds of patches, in the frames of the patches.

        If a surface has fewer, triangles are repeated, and segments are padded far away.

        Returns
        -------
        (3, b, triangles, 3) tensor, (3, b, segments, 2) tensor
        """
        surfaces = self._of_pyramid[patches.pyramids]
        corners, counts = self._triangles.stack(surfaces, least=1)
        near = to_all_triangles(patches.seeds, corners)[:, :, 0].argsort(dim=1, stable=True)
        # The padding of a smaller surface is the farthest.
        near = near.gather(1, torch.arange(triangles, device=near.device) % counts.clamp_max(triangles))
        ends, _ = self._segments.stack(surfaces, least=segments)
        close = to_all_segments(patches.seeds, ends)[:, :, 0].argsort(dim=1, stable=True)[:, :segments]
        return _moved(patches, _chosen(corners, near)), _moved(patches, _chosen(ends, close))


class _Parts:
    """The triangles, or the segments, of all surfaces, on a device.

    Parameters
    ----------
    corners : (total, c, 3) array
    counts : (surfaces,) int array
    device : str
    """

    def __init__(self, corners: np.ndarray, counts: np.ndarray, device: str):
        # (3, total, c), as everywhere: components first; the last one is the padding, a segment without length
        far = np.full_like(corners, FAR, shape=(1, *corners.shape[1:]))
        if corners.shape[1] > 2:
            far += np.eye(3, dtype=far.dtype)
        self._corners = torch.from_numpy(np.concatenate([corners, far])).to(device).permute(2, 0, 1).contiguous()
        self._counts, self._starts = counts, np.concatenate([[0], counts.cumsum()])[:-1]

    def stack(self, surfaces: np.ndarray, least: int) -> tuple[Tensor, Tensor]:
        """Those of some surfaces, stacked, (3, b, n, c) with n >= ``least``, and their number for each, (b, 1)."""
        counts = self._counts[surfaces]
        along = np.arange(max(counts.max(), least))
        rows = np.where(along < counts[:, None], self._starts[surfaces][:, None] + along, self._corners.shape[1] - 1)
        stacked = self._corners[:, torch.from_numpy(rows).to(self._corners.device)]
        return stacked, torch.from_numpy(counts).to(stacked.device)[:, None]


def _chosen(corners: Tensor, index: Tensor) -> Tensor:
    """The triangles or segments (3, b, n, c) at an index (b, k)."""
    return torch.stack([gather(part, index[:, None])[:, :, 0] for part in corners.unbind(3)], dim=-1)


def _moved(patches: Patches, corners: Tensor) -> Tensor:
    return patches.move(corners.flatten(2)).reshape(corners.shape)
