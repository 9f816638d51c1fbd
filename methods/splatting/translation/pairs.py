"""Training pairs of images: a noisy and a clean cloud of one shape, from the same cameras."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bench import PointCloud, Run, Shape, generator
from bench.geometry.poisson_disk import sample_poisson_disk
from bench.geometry.spacing import mean_spacing

from ..filtering.close_ups import close_ups
from ..fitting.views import Gallery
from ..renderer.drawn import draw
from ..renderer.settings import Drawing
from .anew import with_rough_normals
from .stored import stored

if TYPE_CHECKING:
    from bench import TrainingData

SPANS = (0.6, 1.6)  # widths of the field of view; 0.93 in the filter
WIDTH = 0.5  # standard deviation of a point's Gaussian, in spacings, as in the filter
DEPTH_LIMIT = 0.025  # as in the filter


def pairs_of(data: TrainingData, run: Run, neighbours: int, views: int, pixels: int) -> dict[str, np.ndarray]:
    """Images of all cases.

    Parameters
    ----------
    data : TrainingData
    run : Run
        Receives the progress.
    neighbours : int
        The noisy normals are those of planes through this number of points; 0 for those of the sensor.
    views, pixels : int
        Of each cloud; see :func:`drawn_pairs`.

    Returns
    -------
    dict
        ``noisy`` and ``clean`` (n, h, w, 3) uint8, see :mod:`.stored`, and ``shapes`` (n,) int64, their numbers.
    """
    noisy, clean, shapes = [], [], []
    for number, case in enumerate(data.cases):
        cloud = with_rough_normals(case.input["cloud"], neighbours)
        rng = generator(data.seed, case.id, "images")
        for before, after in drawn_pairs(cloud, case.reference, views, pixels, rng, run.threads):
            noisy.append(stored(before))
            clean.append(stored(after))
            shapes.append(number)
        run.progress(number + 1, data.count)
    return {"noisy": np.array(noisy), "clean": np.array(clean), "shapes": np.array(shapes, dtype=np.int64)}


def drawn_pairs(
    cloud: PointCloud,
    shape: Shape,
    views: int,
    pixels: int,
    rng: np.random.Generator,
    threads: int,
    spans: tuple[float, float] = SPANS,
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Images of a noisy cloud, as drawn by the filter, and of as many points of the exact surface.

    Where the noisy cloud is visible and the clean one is not, at silhouettes, the clean image has the colour of the
    nearest pixel where it is.

    Parameters
    ----------
    cloud : PointCloud
        With normals.
    shape : Shape
        Its exact normals are those of the clean cloud.
    views : int
    pixels : int
        Along each side of an image.
    rng : numpy Generator
    threads : int
    spans : tuple of float
        Range of the width of the field of view, which is random for each image.

    Yields
    ------
    noisy, clean : (h, w, 3) float64 arrays
        0 where the noisy cloud is not visible.
    """
    clean = PointCloud(*sample_poisson_disk(shape, len(cloud), rng))
    assert cloud.normals is not None and clean.normals is not None
    both = ((cloud.points, cloud.normals), (clean.points, clean.normals))
    sigmas = [WIDTH * mean_spacing(points) for points, _ in both]
    cameras, lights = close_ups(cloud.points, cloud.normals, views, pixels, 1.0, rng)
    drawing = Drawing(depth_limit=DEPTH_LIMIT)
    gallery = Gallery(cameras, np.empty(0), lights, drawing, threads)
    low, high = np.log(spans)
    factors = np.exp(rng.uniform(low, high, size=len(cameras)))
    for view, (camera, factor) in enumerate(zip(cameras, factors, strict=True)):
        camera = replace(camera, intrinsics=camera.intrinsics / np.array([[factor, factor, 1]] * 2 + [[1, 1, 1]]))
        before, after = (
            draw(points, normals, gallery.shaded(normals, view)[0], sigma, camera, drawing, threads)
            for (points, normals), sigma in zip(both, sigmas, strict=True)
        )
        if before.covered.any() and after.covered.any():
            yield before.image, np.where(before.covered[..., None], _extended(after.image, after.covered), 0.0)


def _extended(image: np.ndarray, covered: np.ndarray) -> np.ndarray:
    """An image whose other pixels have the colour of the nearest covered one."""
    from scipy.ndimage import distance_transform_edt

    rows, columns = distance_transform_edt(~covered, return_distances=False, return_indices=True)
    return image[rows, columns]
