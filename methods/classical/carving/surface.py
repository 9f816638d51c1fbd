"""The surface after carving: that of the hull where nothing was carved, and of smoothed voxels elsewhere."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .voxels import Voxels

if TYPE_CHECKING:
    from trimesh import Trimesh

SMOOTH = 1.0  # standard deviation of the Gaussian, in cells


def surface(voxels: Voxels, filled: np.ndarray) -> Trimesh:
    """The closed surface of the filled voxels, with outward faces.

    It bounds the hull, by its field, without the carved part. The latter is bounded by the zero of a smoothed signed
    distance, to the carved voxels and to those outside the hull that are nearer to them than to filled ones: so
    smoothing changes only the carved part, and elsewhere the error stays below a pixel.
    """
    from scipy.ndimage import distance_transform_edt, gaussian_filter
    from skimage.measure import marching_cubes
    from trimesh import Trimesh

    field, inside = voxels.hull, voxels.hull < 0
    if (inside & ~filled).any():
        nearest = distance_transform_edt(~inside, return_distances=False, return_indices=True)
        solid = filled[tuple(nearest)]
        steps = distance_transform_edt(~solid).astype(np.float32) - distance_transform_edt(solid).astype(np.float32)
        steps -= 0.5 * np.sign(steps)
        field = np.maximum(field, voxels.cell * gaussian_filter(steps, SMOOTH))
    vertices, faces, _, _ = marching_cubes(field, 0.0, gradient_direction="descent", allow_degenerate=False)
    return Trimesh(voxels.middles(vertices), faces, process=False)
