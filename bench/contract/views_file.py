"""Views in a file."""

from __future__ import annotations

import tokenize
import zipfile
import zlib
from pathlib import Path

import numpy as np

from ..errors import UsageError
from ..text import shortened
from .artefacts import write
from .views import Views

# Errors of numpy for invalid or damaged files; a header may announce more than fits into memory.
DAMAGED = (OSError, ValueError, TypeError, EOFError, zipfile.BadZipFile, zlib.error, MemoryError, NotImplementedError,
           RecursionError, RuntimeError, SyntaxError, tokenize.TokenError)  # fmt: skip
MOST_MESSAGE = 300


def load_views(path: str | Path) -> Views:
    """Views from an ``.npz`` file.

    Raises
    ------
    UsageError
        Naming the file and what was expected of it.
    """
    arrays = npz_arrays(path, "an .npz file of views (images, masks, extrinsics, intrinsics)")
    missing = [name for name in ("images", "masks", "extrinsics", "intrinsics") if name not in arrays]
    if missing:
        raise UsageError(f"{path}: has no array {missing[0]}; expected images, masks, extrinsics and intrinsics")
    return Views.of(arrays)


def save_views(views: Views, path: str | Path) -> None:
    """Write views to an ``.npz`` file, which :func:`load_views` reads.

    Raises
    ------
    UsageError
        If the suffix is another, or the file cannot be written.
    """
    path = Path(path)
    if path.suffix != ".npz":
        raise UsageError(f"{path}: expected a name that ends in .npz")
    try:
        write(views, path)
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error}") from None


def npz_arrays(path: str | Path, expected: str) -> dict[str, np.ndarray]:
    """All arrays of an ``.npz`` file by name.

    Raises
    ------
    UsageError
        Naming the file and what was ``expected``.
    """
    try:
        if Path(path).exists() and not Path(path).is_file():
            raise ValueError("is a folder, a pipe or a device")
        # numpy does not close files that it cannot read
        with open(path, "rb") as opened, np.load(opened, allow_pickle=False) as file:
            return dict(file)
    except DAMAGED as error:
        raise UsageError(f"{path}: expected {expected}: {shortened(str(error), MOST_MESSAGE)}") from None
