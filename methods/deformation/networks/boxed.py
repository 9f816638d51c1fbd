"""The input of a network: a source and a target, each in its own box, the longest side of which is 2."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch

from bench import BadInput, PointCloud, Run
from bench.geometry.check import check_mesh, check_points
from bench.geometry.mesh_surface import MeshSurface
from bench.geometry.used import used_vertices

from ...learned.networks.loading import loaded

if TYPE_CHECKING:
    from trimesh import Trimesh

    from .adaptive_network import AdaptiveNetwork
    from .grid_network import GridNetwork
    from .offset_network import OffsetNetwork


def deform_by(
    network: AdaptiveNetwork | GridNetwork | OffsetNetwork,
    source: Trimesh,
    target: Trimesh | PointCloud,
    count: int,
    run: Run,
) -> Trimesh:
    """The source with its vertices deformed by a network with the run's weights.

    Parameters
    ----------
    network : with ``encode(source, target)`` of point sets, and ``forward(points, code)``
    source, target : in any frame
        The network sees both with the box's centre at 0 and a longest side of 2; its output is transformed back into
        the target's frame.
    count : int
        Points of each that are encoded: random ones of a mesh, and of a cloud that has more.
    run : Run

    Returns
    -------
    Trimesh
        With the faces of ``source``; vertices that no face uses move along.

    Raises
    ------
    BadInput
        For a source or a target without an extent, or with vertices that are not finite.
    """
    torch.set_num_threads(run.threads)
    network = loaded(network, run)
    check_mesh(source, "source")
    center, half = box_of(used_vertices(source))
    goal, size = box_of(_outline(target))
    given = [(_samples(source, count, run) - center) / half, (_samples(target, count, run) - goal) / size]
    code = network.encode(*(_tensor(points, run)[None] for points in given))
    moved = network(_tensor((np.asarray(source.vertices) - center) / half, run)[None], code)[0]
    output = source.copy()
    output.vertices = goal + size * moved.cpu().numpy().astype(np.float64)
    return output


def box_of(points: np.ndarray) -> tuple[np.ndarray, float]:
    """The centre (3,) of the box of points (n, 3), and half of its longest side."""
    low, high = points.min(axis=0), points.max(axis=0)
    half = float((high - low).max() / 2)
    if not half > 0:
        raise BadInput(f"expected points with an extent; got {len(points)} that coincide")
    return (low + high) / 2, half


def _outline(target: Trimesh | PointCloud) -> np.ndarray:
    if isinstance(target, PointCloud):
        check_points(target.points, "target", at_least=4)
        return np.asarray(target.points)
    check_mesh(target, "target")
    return used_vertices(target)


def _samples(shape: Trimesh | PointCloud, count: int, run: Run) -> np.ndarray:
    if not isinstance(shape, PointCloud):
        return MeshSurface(shape).sample(count, run.rng)[0]
    points = np.asarray(shape.points)
    return points if len(points) <= count else points[run.rng.choice(len(points), count, replace=False)]


def _tensor(array: np.ndarray, run: Run) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(array, dtype=np.float32)).to(run.device)
