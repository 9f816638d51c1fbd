"""Image files to arrays, by Pillow."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...errors import BadInput

if TYPE_CHECKING:
    from PIL.Image import Image

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
DEEP = ("I", "F")  # modes of more than 8 bits begin with one of these


def is_picture(path: Path) -> bool:
    """Whether the name of a file ends like an image."""
    return path.suffix.lower() in SUFFIXES


def is_file(path: Path) -> bool:
    """Whether there is such a file; also for an impossible file name."""
    try:
        return path.is_file()
    except OSError:  # too long, say
        return False


def pictures_in(folder: Path) -> list[Path]:
    """The images of a folder, sorted by name; hidden files are left out."""
    named = (path for path in folder.iterdir() if is_picture(path) and not path.name.startswith("."))
    return sorted(path for path in named if path.is_file())  # reading a pipe would block


def image_size(path: Path) -> tuple[int, int]:
    """Width and height of an image, of which only the head is read."""
    from PIL import Image

    try:
        with Image.open(path) as image:
            return image.size
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise _unreadable(path, error) from None


def read_image(path: Path) -> tuple[np.ndarray, np.ndarray | None]:
    """An image over black, (h, w, 3) uint8, and its alpha channel, (h, w) uint8 or None."""
    image = _open(path)
    if image.mode.startswith(DEEP):
        raise BadInput(f"{path}: expected an image of 8 bits per channel, got one of mode {image.mode}")
    if not image.has_transparency_data:
        return np.asarray(image.convert("RGB")), None
    pixels = np.asarray(image.convert("RGBA"))
    alpha = pixels[..., 3]
    return np.rint(pixels[..., :3] * (alpha[..., None] / 255)).astype(np.uint8), alpha


def read_mask(path: Path) -> np.ndarray:
    """A mask, (h, w) bool: pixels brighter than half of white, or above 0 if no pixel is above 1."""
    image = _open(path)
    values = np.asarray(image if image.mode.startswith(DEEP) else image.convert("L"))
    largest = values.max()
    if largest <= 1:
        return values > 0
    return values > (127 if largest <= 255 else 32767)


def _open(path: Path) -> Image:
    """An image with all its pixels."""
    from PIL import Image

    try:
        with Image.open(path) as image:
            image.load()
            return image
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise _unreadable(path, error) from None


def _unreadable(path: Path, error: Exception) -> BadInput:
    if not path.exists():
        return BadInput(f"{path}: no such image")
    return BadInput(f"{path}: cannot be read as an image ({', '.join(s[1:] for s in SUFFIXES)}): {error}")
