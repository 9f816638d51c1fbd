"""Points that follow a cage."""

from __future__ import annotations

from typing import Literal

import numpy as np
from torch import Tensor

from .mean_value import mean_value_coordinates

Coordinates = Literal["mean_value", "green"]


def deformed(
    points: Tensor, cage: Tensor, faces: np.ndarray, moved: Tensor, coordinates: Coordinates, threads: int
) -> tuple[Tensor, Tensor]:
    """Where points go when a cage becomes another (Eq. 5.1), and their coordinates of the cage's vertices.

    Parameters
    ----------
    points : (b, p, 3) tensor
    cage, moved : (b, n, 3) tensors
    faces : (f, 3) int array
    coordinates : ``mean_value``, or ``green`` (Lipman et al. 2008), by which local shapes turn and grow but do not
        shear; those need points inside of the cage
    threads : int
    """
    if coordinates == "green":
        from .green import deformed_by_green, green_coordinates

        return deformed_by_green(points, cage, faces, moved), green_coordinates(points, cage, faces)[0]
    weights = mean_value_coordinates(points, cage, faces, threads)
    return weights @ moved.to(weights), weights
