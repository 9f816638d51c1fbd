"""Views in a file."""

from __future__ import annotations

import numpy as np

from ..errors import UsageError
from .views import Views


def load_views(path: str) -> Views:
    """Views from an ``.npz`` file.

    Raises
    ------
    UsageError
        Naming the file and what was expected of it.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = dict(file)
    except (OSError, ValueError) as error:
        raise UsageError(
            f"{path}: expected an .npz file of views (images, masks, extrinsics, intrinsics): {error}"
        ) from None
    missing = [name for name in ("images", "masks", "extrinsics", "intrinsics") if name not in arrays]
    if missing:
        raise UsageError(f"{path}: has no array {missing[0]}; expected images, masks, extrinsics and intrinsics")
    return Views.of(arrays)
