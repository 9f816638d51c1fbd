"""Checks of the arguments of coordinates."""

from __future__ import annotations

import numpy as np
from torch import Tensor


def check(queries: Tensor, vertices: Tensor, faces: Tensor | np.ndarray) -> None:
    """Refuse queries, cages and faces that do not match.

    Raises
    ------
    ValueError
        Naming the argument and what is expected.
    """
    for name, tensor in (("queries", queries), ("vertices", vertices)):
        if tensor.ndim not in (2, 3) or tensor.shape[-1] != 3:
            raise ValueError(f"{name}: expected shape (n, 3) or (b, n, 3), got {tuple(tensor.shape)}")
    if queries.ndim == vertices.ndim == 3 and len(queries) != len(vertices) and 1 not in (len(queries), len(vertices)):
        raise ValueError(f"expected as many cages as sets of queries, got {len(vertices)} and {len(queries)}")
    if faces.ndim != 2 or faces.shape[1] != 3 or not len(faces):
        raise ValueError(f"faces: expected shape (f, 3), got {tuple(faces.shape)}")
    if faces.min() < 0 or faces.max() >= vertices.shape[-2]:
        raise ValueError(
            f"faces: expected numbers from 0 to {vertices.shape[-2] - 1}, got {int(faces.min())}..{int(faces.max())}"
        )
