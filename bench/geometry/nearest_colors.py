"""The colours of a point cloud on something else at the same place: each vertex or point takes the nearest one's."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .cloud import PointCloud
from .neighbours import OrderedPoints
from .plain_mesh import plain_mesh

if TYPE_CHECKING:
    from trimesh import Trimesh


def with_nearest_colors(geometry: PointCloud | Trimesh, cloud: PointCloud) -> Any:
    """A copy of a cloud or a mesh with the colours of the nearest points of ``cloud``, which has colours.

    The colours of a mesh are those of its vertices, of eight bits.
    """
    points = geometry.points if isinstance(geometry, PointCloud) else np.asarray(geometry.vertices)
    nearest = OrderedPoints(points).nearest_in(OrderedPoints(cloud.points)).index
    assert cloud.colors is not None
    colors = cloud.colors[nearest]
    if isinstance(geometry, PointCloud):
        return replace(geometry, colors=colors)
    colored: Any = plain_mesh(points, geometry.faces)
    colored.visual.vertex_colors = np.rint(np.clip(colors, 0, 1) * 255).astype(np.uint8)
    return colored
