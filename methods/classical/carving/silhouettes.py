"""The visual hull as a field: the distance of points to the silhouettes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from bench import BadInput, InvalidOutput, Run, Views

if TYPE_CHECKING:
    from trimesh import Trimesh


class Silhouettes:
    """Signed distances to the silhouettes of a shape in the unit ball; their maximum over the views is the field.

    The value of a view is the distance in the image from the projected point to the border of the mask, times depth
    over focal length: about the distance in space to the cone of the silhouette. In pixels it is the Euclidean distance
    between the middles of pixels, less the half pixel from the border to the first of them, and bilinear in between.
    The unit ball counts as one more silhouette, so that the hull is bounded for any images.

    Parameters
    ----------
    views : Views
    run : Run
        A view with an empty mask (the shape may be outside of the image, or was not found) is left out, with a note.
    beyond : "auto", "keep" or "carve"
        Whether the shape may extend beyond the border of an image: with "auto", if the mask touches the border. So a
        mask that the border cuts off does not cut the shape, and any other mask shows all of it.

    Raises
    ------
    BadInput
        If all masks are empty.
    """

    def __init__(self, views: Views, run: Run, beyond: str = "auto"):
        used = views.masks.any(axis=(1, 2))
        if not used.any():
            raise BadInput("all masks are empty; expected masks that are true where the image shows the shape")
        if not used.all():
            empty = ", ".join(map(str, np.flatnonzero(~used)))
            run.note(f"views without a pixel in the mask are left out: {empty}")
        self.views = views if used.all() else Views.of({name: a[used] for name, a in views.arrays().items()})
        masks = self.views.masks
        cut_off = masks[:, [0, -1]].any(axis=(1, 2)) | masks[:, :, [0, -1]].any(axis=(1, 2))
        self.beyond = cut_off if beyond == "auto" else np.full(len(masks), beyond == "keep")
        self.distances = np.stack([mask_distances(mask) for mask in masks])
        self.matrices = np.ascontiguousarray(self.views.intrinsics @ self.views.extrinsics)
        self.focal = np.sqrt(self.views.intrinsics[:, 0, 0] * self.views.intrinsics[:, 1, 1])

    def values(self, points: np.ndarray) -> np.ndarray:
        """The field at points (n, 3): (n,) float64 array of lengths, negative within the hull."""
        points = np.ascontiguousarray(points, dtype=np.float64)
        return hull_values(points, self.matrices, self.focal, self.distances, self.beyond)

    def mesh(self, resolution: int, run: Run) -> Trimesh:
        """The hull, closed, by marching cubes in a narrow band.

        Parameters
        ----------
        resolution : int
            Samples along the shortest side of its box.
        run : Run
            Receives a note if the time was too short for the resolution.

        Raises
        ------
        BadInput
            If nothing lies within all silhouettes.
        """
        from ...learned.meshing.marching import extract

        try:
            mesh = extract(
                self.values,
                resolution=resolution,
                domain=(-1.05, 1.05),
                lipschitz=1.5,  # of the bilinear distances it is 1.42
                seconds=run.seconds_left(),
                on_progress=run.progress,
            )
        except InvalidOutput as error:  # the field is finite, so this can only be a missing zero
            raise disagree() from error
        if (coarser := mesh.metadata["coarser"]) > 1:
            run.note(
                f"the hull has 1/{coarser} of the requested resolution: limit.seconds={run.seconds:g} is too short"
            )
        return mesh


def disagree() -> BadInput:
    """The error of an empty hull."""
    return BadInput(
        "the masks disagree: no point of the unit ball lies within all silhouettes; expected masks of one shape in the "
        "unit ball around the origin, and the cameras that belong to them"
    )


def mask_distances(mask: np.ndarray) -> np.ndarray:
    """The signed distance of the middle of each pixel to the border of a mask, in pixels: (h, w) float32 array.

    Negative inside the mask. A mask that fills the image has no border: then it is minus the image's diagonal.
    """
    from scipy.ndimage import distance_transform_edt

    if mask.all():
        return np.full(mask.shape, -math.hypot(*mask.shape), dtype=np.float32)
    signed = np.where(mask, 0.5 - distance_transform_edt(mask), distance_transform_edt(~mask) - 0.5)
    return signed.astype(np.float32)


@njit(cache=True, nogil=True)
def hull_values(points, matrices, focal, distances, beyond):
    """The field of :class:`Silhouettes`.

    Parameters
    ----------
    points : (n, 3) float64 array
    matrices : (v, 3, 4) float64 array
        From the world to pixels, times the depth.
    focal : (v,) float64 array
    distances : (v, h, w) float32 array
    beyond : (v,) bool array
        Whether the shape may extend beyond the border of an image.
    """
    count, height, width = distances.shape
    values = np.empty(len(points))
    for k in range(len(points)):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        value = math.sqrt(x * x + y * y + z * z) - 1.0
        for v in range(count):
            m = matrices[v]
            depth = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3]
            if depth <= 1e-9:
                found = -1.0 if beyond[v] else 1.0
            else:
                column = (m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]) / depth
                row = (m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]) / depth
                within = min(column, row, width - column, height - row)  # from the border of the image
                found = bilinear(distances[v], column - 0.5, row - 0.5)
                found = min(found, within) if beyond[v] else max(found, -within)
                found *= depth / focal[v]
            value = max(value, found)
        values[k] = value
    return values


@njit(cache=True, nogil=True, inline="always")
def bilinear(image, column, row):
    """Bilinear interpolation of the four nearest entries; beyond the border the value at the border."""
    height, width = image.shape
    column, row = min(max(column, 0.0), width - 1.0), min(max(row, 0.0), height - 1.0)
    j, i = min(int(column), max(width - 2, 0)), min(int(row), max(height - 2, 0))
    right, down = min(j + 1, width - 1), min(i + 1, height - 1)
    s, t = column - j, row - i
    above = (1 - s) * image[i, j] + s * image[i, right]
    below = (1 - s) * image[down, j] + s * image[down, right]
    return (1 - t) * above + t * below


def load_compiled() -> None:
    """Load the compiled loops, or compile them."""
    image, yes = np.zeros((1, 2, 2), dtype=np.float32), np.ones(1, dtype=bool)
    hull_values(np.zeros((1, 3)), np.ones((1, 3, 4)), np.ones(1), image, yes)
