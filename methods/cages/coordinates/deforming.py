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
    """The positions of points after a cage is deformed (Eq. 5.1), and their coordinates in the cage.

    Parameters
    ----------
    points : (b, p, 3) tensor
    cage, moved : (b, n, 3) tensors
    faces : (f, 3) int array
    coordinates : ``mean_value``, or ``green`` (Lipman et al. 2008), which rotate and scale local shapes but do not
        shear them; those need points inside of the cage
    threads : int
    """
    if coordinates == "green":
        from .green import deformed_by_green, green_coordinates

        return deformed_by_green(points, cage, faces, moved), green_coordinates(points, cage, faces)[0]
    weights = mean_value_coordinates(points, cage, faces, threads)
    return weights @ moved.to(weights), weights
