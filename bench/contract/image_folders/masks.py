"""The search for the mask of an image."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ...errors import BadInput
from .pictures import SUFFIXES, image_size, read_mask

FOLDERS = ("masks", "mask")


def mask_of(image: Path, mask: Path | None, alpha: np.ndarray | None, root: Path) -> np.ndarray:
    """The mask (h, w) of an image: from its file, else its alpha channel, else a file that has its name.

    Parameters
    ----------
    image : Path
    mask : Path or None
        The file, where the cameras name one.
    alpha : (h, w) uint8 array or None
        A channel that is opaque everywhere is no mask.
    root : Path
        The user's folder.

    Raises
    ------
    BadInput
        If there is no mask, with the places that were searched, or if it has another size.
    """
    if mask is None and alpha is not None and alpha.min() < 255:
        return alpha > 127
    mask = mask or next((path for path in candidates(image, root) if path.is_file()), None)
    if mask is None:
        looked = dict.fromkeys(str(path.parent) for path in candidates(image, root) if path.parent != image.parent)
        raise BadInput(
            f"{image}: has no mask. Expected a transparent background, or a file {image.stem}.png or {image.name}.png "
            f"in one of {', '.join(looked)}, or mask_path in transforms.json. Masks are white where the shape is"
        )
    pixels = read_mask(mask)
    width, height = image_size(image)
    if pixels.shape != (height, width):
        raise BadInput(
            f"{mask}: has {pixels.shape[1]} x {pixels.shape[0]} pixels, its image {image} has {width} x {height}; "
            "expected masks of the size of their images"
        )
    return pixels


def candidates(image: Path, root: Path) -> Iterator[Path]:
    """Where the mask of an image may be, the likeliest first."""
    below = image.relative_to(root).parts[1:-1] if image.is_relative_to(root) else ()
    tops = dict.fromkeys((root, image.parent.parent, image.parent))
    folders = [top / name / Path(*deep) for deep in dict.fromkeys((below, ())) for top in tops for name in FOLDERS]
    endings = [*SUFFIXES, *(suffix.upper() for suffix in SUFFIXES)]
    names = [f"{name}{ending}" for name in (image.stem, image.name) for ending in endings]
    marked = [f"{image.name}.mask", f"{image.stem}_mask.png", f"{image.stem}.mask.png", f"{image.name}.mask.png"]
    for folder in folders:
        yield from (folder / name for name in (*names, *marked))
    yield from (image.parent / name for name in marked)
