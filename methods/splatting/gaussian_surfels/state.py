"""The fitted surfels: their parameters, steps by Adam, and the surfels from the parameters."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from .adam import Adam
from .footprints import Surfels
from .rendering import Slopes

MOST = 0.99  # an opacity is at most this


class State:
    """Surfels by parameters: positions, rotations (quaternions), logarithms of scales, logits of opacities.

    Parameters
    ----------
    points, normals : (n, 3) arrays
    scale : float
        Initial standard deviation of all.
    opacity : float
        Initial opacity of all, below :data:`MOST`.
    """

    def __init__(self, points: np.ndarray, normals: np.ndarray, scale: float, opacity: float):
        count = len(points)
        self.positions = np.array(points, dtype=np.float64)
        self.quaternions = Rotation.from_matrix(frames_of(normals)).as_quat()
        self.logs = np.full((count, 2), np.log(scale))
        self.logits = np.full(count, _logit(opacity))
        shapes: dict[str, tuple[int, ...]] = {"positions": (3,), "turns": (3,), "logs": (2,), "logits": ()}
        self._descents = {name: Adam((count, *shape)) for name, shape in shapes.items()}

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def normals(self) -> np.ndarray:
        """(n, 3) array of unit length."""
        return self.frames[:, :, 2]

    @property
    def frames(self) -> np.ndarray:
        """(n, 3, 3) array: tangents and normals as columns."""
        return Rotation.from_quat(self.quaternions).as_matrix()

    @property
    def opacities(self) -> np.ndarray:
        """(n,) array."""
        return MOST / (1 + np.exp(-self.logits))

    def surfels(self) -> Surfels:
        """The surfels to draw."""
        return Surfels(self.positions, self.frames, np.exp(self.logs), self.opacities)

    def gradients(self, surfels: Surfels, slopes: Slopes) -> dict[str, np.ndarray]:
        """The gradients by the parameters, from those by the surfels.

        A rotation is a rotation vector in the surfel's own axes: the gradient by it is the sum of a x (slope by a) over
        the columns a of the frame.
        """
        turn = np.cross(surfels.frames.transpose(0, 2, 1), slopes.frames.transpose(0, 2, 1)).sum(axis=1)
        share = surfels.opacities / MOST
        return {
            "positions": slopes.positions,
            "turns": np.einsum("nij,ni->nj", surfels.frames, turn),
            "logs": slopes.scales * surfels.scales,
            "logits": slopes.opacities * surfels.opacities * (1 - share),
        }

    def step(self, gradients: Mapping[str, np.ndarray], rates: Mapping[str, float]) -> None:
        """One step of Adam."""
        steps = {name: self._descents[name].step(gradient, rates[name]) for name, gradient in gradients.items()}
        self.positions = self.positions + steps["positions"]
        turns = Rotation.from_quat(self.quaternions) * Rotation.from_rotvec(steps["turns"])
        self.quaternions = turns.as_quat()
        self.logs, self.logits = self.logs + steps["logs"], self.logits + steps["logits"]

    def split(self, parents: np.ndarray, places: np.ndarray, shrink: float = 1.6) -> None:
        """Split each parent in two: itself and one that replaces another surfel, which is lost.

        Both lie one standard deviation apart along the longer tangent, smaller by the factor of 3DGS, with their
        moments reset.

        Parameters
        ----------
        parents, places : (m,) int arrays
            All different.
        shrink : float
        """
        long = self.logs[parents].argmax(axis=1)
        axis = self.frames[parents, :, long]
        half = 0.5 * np.exp(self.logs[parents, long])[:, None] * axis
        self.logs[parents] -= np.log(shrink)
        for array in (self.positions, self.quaternions, self.logs, self.logits):
            array[places] = array[parents]
        self.positions[parents] += half
        self.positions[places] -= half
        for descent in self._descents.values():
            descent.forget(np.concatenate([parents, places]))


def frames_of(normals: np.ndarray) -> np.ndarray:
    """Frames (n, 3, 3) whose last columns are unit normals (n, 3)."""
    away = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = np.cross(away, normals)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(normals, first), normals], axis=2)


def _logit(opacity: float) -> float:
    return float(-np.log(MOST / opacity - 1))
