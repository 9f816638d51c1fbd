"""An output as a PLY file that shows its errors: for MeshLab, CloudCompare and other viewers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import UsageError
from ..geometry.cloud import PointCloud
from .colors import colors
from .errors import positions

if TYPE_CHECKING:
    from trimesh import Trimesh

DISTANCE = "distance"  # the name of the property


def check_error_file(path: str | Path) -> None:
    """Raise :class:`UsageError` where :func:`save_errors` would, before anything is computed."""
    from ..geometry.io.files import check_target

    if Path(path).suffix.lower() != ".ply":
        raise UsageError(f"{path}: expected a name that ends in .ply, which keeps colours and distances")
    check_target(path, "cloud")


def save_errors(shape: Trimesh | PointCloud, distances: np.ndarray, limit: float, path: str | Path) -> None:
    """Write a shape with the distance of each vertex or point as the scalar ``distance``, and as colours.

    The file is written under a temporary name and renamed.

    Parameters
    ----------
    shape : Trimesh or PointCloud
        With n vertices or points. Its own colours are replaced; normals and other scalars of a cloud stay.
    distances : (n,) array
        In the unit of the shape.
    limit : float
        The distance at the dark end of the colours, and of all beyond.
    path : path
        Ends in ``.ply``.
    """
    from ..geometry.io.ply import write_ply
    from ..geometry.io.raw import NO_FACES, RawGeometry
    from ..results.files import write_atomically

    cloud = shape if isinstance(shape, PointCloud) else None
    others = {} if cloud is None else {name: values for name, values in cloud.scalars.items() if name != DISTANCE}
    raw = RawGeometry(
        np.asarray(positions(shape)),
        NO_FACES if isinstance(shape, PointCloud) else np.asarray(shape.faces),
        None if cloud is None else cloud.normals,
        colors(distances, limit) / 255,
        {DISTANCE: np.asarray(distances, dtype=np.float64), **others},
    )
    write_atomically(Path(path), write_ply(raw))
