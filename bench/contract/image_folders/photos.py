"""One image with its camera, and the conversion of images of several sizes to :class:`bench.Views` of one size."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...errors import BadInput
from ..views import Views
from .lens import Lens, undistorted
from .masks import mask_of
from .pictures import image_size, read_image
from .resizing import area_resized, scaled_intrinsics

Size = tuple[int, int]  # width, height


@dataclass(frozen=True, eq=False)
class Photo:
    """An image on disk and its camera.

    Parameters
    ----------
    image : Path
    intrinsics : (3, 3) array
        For an image of ``size`` pixels, whose rectangle is from (0, 0) to (w, h).
    extrinsics : (3, 4) array
        World to camera, OpenCV axes.
    size : (int, int)
        Width and height that the intrinsics are for; the image may be a smaller copy.
    lens : Lens
        Distortion of the image.
    mask : Path or None
        Where its mask is; None: to be searched for.
    """

    image: Path
    intrinsics: np.ndarray
    extrinsics: np.ndarray
    size: Size
    lens: Lens = Lens()
    mask: Path | None = None


def load_photos(photos: Sequence[Photo], root: Path, max_pixels: int) -> Views:
    """Read all images and masks, remove distortion, and resize them to one size.

    Pixels are taken as they are stored: an EXIF orientation is not applied, because programs that find cameras do not
    apply it either, so the cameras are those of the stored pixels.

    Parameters
    ----------
    photos : sequence of Photo
    root : Path
        The user's folder; masks are searched below it.
    max_pixels : int
        Longest side of the images that are returned; 0: they are not shrunk.

    Raises
    ------
    BadInput
        Naming the file and what was expected of it.
    """
    sizes = [image_size(photo.image) for photo in photos]
    width, height = common_size(sizes, [photo.image for photo in photos], max_pixels)
    images = np.empty((len(photos), height, width, 3), dtype=np.uint8)
    masks = np.empty((len(photos), height, width), dtype=bool)
    intrinsics = np.empty((len(photos), 3, 3))
    for place, (photo, size) in enumerate(zip(photos, sizes, strict=True)):
        if not _same_aspect(photo.size, size):
            raise BadInput(
                f"{photo.image}: has {size[0]} x {size[1]} pixels, but its camera is for {photo.size[0]} x "
                f"{photo.size[1]}; expected an image of that size, or one scaled equally in width and height"
            )
        image, alpha = read_image(photo.image)
        mask = mask_of(photo.image, photo.mask, alpha, root)
        matrix = scaled_intrinsics(photo.intrinsics, photo.size, size)
        if any(photo.lens):
            image, mask = undistorted(image, mask, matrix, photo.lens)
        images[place] = area_resized(image, (width, height))
        masks[place] = area_resized(mask, (width, height))
        intrinsics[place] = scaled_intrinsics(matrix, size, (width, height))
    return Views(images, masks, np.stack([photo.extrinsics for photo in photos]), intrinsics)


def common_size(sizes: Sequence[Size], names: Sequence[Path], max_pixels: int) -> Size:
    """The size of all images: the most frequent one, shrunk until its longest side has ``max_pixels``.

    Raises
    ------
    BadInput
        If an image has another aspect ratio than the most frequent size.
    """
    counts = Counter(sizes)
    width, height = max(counts, key=lambda size: (counts[size], size))
    for name, size in zip(names, sizes, strict=True):
        if not _same_aspect(size, (width, height)):
            raise BadInput(
                f"{name}: has {size[0]} x {size[1]} pixels, while most images have {width} x {height}; expected images "
                "of one aspect ratio. Crop them with their cameras, or take this one out of the file of cameras"
            )
    longest = max(width, height)
    if not max_pixels or longest <= max_pixels:
        return width, height
    return max(1, round(width * max_pixels / longest)), max(1, round(height * max_pixels / longest))


def _same_aspect(size: Size, other: Size) -> bool:
    """Whether one is the other scaled equally in both directions, but for rounding to whole pixels."""
    small, large = sorted((size, other))
    return abs(large[1] * small[0] / large[0] - small[1]) < 1
