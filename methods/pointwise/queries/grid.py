"""The grid around a cloud: the nodes at which the network is evaluated, and the signs of all others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import InvalidOutput

if TYPE_CHECKING:
    from trimesh import Trimesh

MARGIN = 3  # nodes around the points' box; those of the border are outside
CERTAIN = 13  # least absolute sum of the signs of the 125 nodes around one to decide its sign (Erler et al. 2020)


@dataclass(frozen=True, eq=False)
class Grid:
    """A cubical grid of nodes; ``asked`` are those at which the network is evaluated."""

    origin: np.ndarray  # (3,)
    spacing: float
    asked: np.ndarray  # bool array of the shape of the grid

    @classmethod
    def around(cls, points: np.ndarray, resolution: int) -> Grid:
        """The grid of points (n, 3) with ``resolution`` nodes along their longest side.

        The network is evaluated at the nodes nearest to points, and the 26 around each of these.
        """
        from scipy import ndimage

        low, high = points.min(axis=0), points.max(axis=0)
        spacing = float((high - low).max()) / (resolution - 1)
        shape = np.ceil((high - low) / spacing - 1e-9).astype(int) + 1 + 2 * MARGIN
        origin = (low + high - (shape - 1) * spacing) / 2
        occupied = np.zeros(shape, dtype=bool)
        occupied[tuple(np.rint((points - origin) / spacing).astype(int).T)] = True
        return cls(origin, spacing, ndimage.binary_dilation(occupied, np.ones((3, 3, 3), bool)))

    @property
    def places(self) -> np.ndarray:
        """The positions of the asked nodes: (m, 3)."""
        return self.origin + self.spacing * np.argwhere(self.asked)

    def mesh(self, distances: np.ndarray) -> Trimesh:
        """The surface of signed distances (m,) at :attr:`places`, negative inside, by marching cubes.

        Raises
        ------
        InvalidOutput
            If all have one sign.
        """
        from skimage.measure import marching_cubes
        from trimesh import Trimesh

        values = np.zeros(self.asked.shape)
        values[self.asked] = distances
        signs = spread_signs(np.sign(values), self.asked)
        values = np.where(self.asked, values, signs * self.spacing)
        if values.min() >= 0:
            raise InvalidOutput("points2surf: the network predicts no point to be inside; is it trained?")
        vertices, faces, _, _ = marching_cubes(values, 0.0, spacing=(self.spacing,) * 3, gradient_direction="descent")
        return Trimesh(vertices + self.origin, faces, process=False)


def spread_signs(signs: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Signs for all nodes of a grid, 1 or -1, from known ones; the border is outside, 1.

    Round after round, a node without a sign takes that of the 125 nodes around it, including itself, if it is clear:
    if the sum of their signs is at least :data:`CERTAIN`. When no such node is left, a smaller sum suffices.
    """
    from scipy import ndimage

    signs = np.where(known, np.where(signs < 0, -1.0, 1.0), 0.0)
    for axis in range(3):
        faces = np.moveaxis(signs, axis, 0)
        faces[0] = faces[-1] = 1.0
    least = CERTAIN
    while (open_ := signs == 0).any():
        sums = np.rint(125 * ndimage.uniform_filter(signs, 5, mode="nearest"))
        new = open_ & (np.abs(sums) >= least)
        if new.any():
            signs[new] = np.sign(sums[new])
            least = CERTAIN
        elif least > 1:
            least = 1
        else:
            signs[open_] = 1.0
    return signs
