"""Points moved along the score of a cloud."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from bench import Run

from ..networks.score_network import ScoreNetwork, planes_of
from .cover import covering, most_central
from .frames import principal_frames

PATCHES = 16  # that are encoded at once
ROWS = 1 << 14  # positions whose score is computed at once


class Score:
    """The score around the points of one cloud.

    The features of a point are those of the patch in which it is most central; its unit and its axes are
    the radius and the principal axes of that patch.

    Parameters
    ----------
    network : ScoreNetwork
    points : (m, 3) array
    size : int
        Points of a patch.
    overlap : float
        Patches that a point is in, on average.
    device : str
    """

    def __init__(self, network: ScoreNetwork, points: np.ndarray, size: int, overlap: float, device: str):
        from scipy.spatial import cKDTree

        self.network, self.device, self.points, self._tree = network, device, points, cKDTree(points)
        patches = covering(points, size, overlap)
        local = points[patches] - points[patches[:, :1]]
        radii = np.sqrt((local**2).sum(axis=2).max(axis=1))
        radii = np.where(radii > 1e-12 * np.abs(points).max(), radii, 1.0)
        local /= radii[:, None, None]
        frames = principal_frames(local)
        local = local @ frames.transpose(0, 2, 1)
        own = most_central(patches, len(points))
        of = own // patches.shape[1]
        self.units, self.frames = radii[of], frames[of]
        with torch.no_grad():
            parts = np.array_split(local, -(-len(local) // PATCHES))
            known = torch.cat([self._known(self._tensor(part)) for part in parts])
        self._of_points = known.flatten(0, 1)[torch.from_numpy(own).to(device)]

    @torch.no_grad()
    def at(self, places: np.ndarray, around: int) -> np.ndarray:
        """The mean score of the nearest ``around`` points at positions (n, 3): (n, 3) float64 array."""
        index = self._tree.query(places, np.arange(1, min(around, len(self.points)) + 1))[1]
        units = self.units[index][..., None]
        frames = self.frames[index]
        relative = np.einsum("nkij,nkj->nki", frames, places[:, None] - self.points[index]) / units
        rows = np.array_split(np.arange(index.size), -(-index.size // ROWS))
        flat, chosen = relative.reshape(-1, 3), index.ravel()
        found = [self._scores(self._tensor(flat[r]), torch.from_numpy(chosen[r]).to(self.device)) for r in rows]
        scores = torch.cat(found).double().cpu().numpy().reshape(relative.shape)
        return np.einsum("nkij,nki->nj", frames, scores * units) / index.shape[1]

    def _known(self, patches: Tensor) -> Tensor:
        return torch.cat([self.network.encode(patches), planes_of(patches)], dim=2)

    def _scores(self, places: Tensor, index: Tensor) -> Tensor:
        known = self._of_points[index]
        return self.network(places, known[:, :-6], known[:, -6:])

    def _tensor(self, array: np.ndarray) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(array, dtype=np.float32)).to(self.device)


def ascend(score: Score, around: int, steps: int, step: float, decay: float, run: Run, begin: int, total: int):
    """The points of a score after ``steps`` steps of ``step * decay**t`` times the score: (m, 3) array.

    ``begin`` steps of ``total`` were done before. It stops when the time of the run is over.
    """
    points = score.points
    for t in range(steps):
        if not run.time_for_more():
            break
        points = points + step * decay**t * score.at(points, around)
        run.progress(begin + t + 1, total)
    return points
