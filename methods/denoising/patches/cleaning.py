"""Points moved by the output of a network for the ball around each, with a correction of shrinking."""

from __future__ import annotations

import numpy as np
import torch
from torch import nn

from bench import Run

from .frames import principal_frames

TOGETHER = 32  # balls in one call of the network: its activations stay in the cache
GATHERED = 2048  # balls that are gathered at once


@torch.no_grad()
def displacements(network: nn.Module, points: np.ndarray, radius: float, size: int, run: Run) -> np.ndarray | None:
    """The displacement of each point by the network: (m, 3) float64 array; None if the time ended before.

    Parameters
    ----------
    network : Module
        (b, size, 3) balls, in principal frames, in radii and with the centre at 0, to displacements (b, 3) in radii.
    points : (m, 3) array
    radius : float
    size : int
        Points of a ball: a random part if there are more, copies of the centre if there are fewer.
    run : Run
    """
    from scipy.spatial import cKDTree

    tree, found = cKDTree(points), []
    for first in range(0, len(points), GATHERED):
        if not run.time_for_more():
            return None
        some = points[first : first + GATHERED]
        patches = np.zeros((len(some), size, 3), dtype=np.float32)
        for row, inside in enumerate(tree.query_ball_point(some, radius)):
            index = np.array(inside)
            if len(index) > size:
                index = run.rng.choice(index, size, replace=False)
            patches[row, : len(index)] = (points[index] - some[row]) / radius
        frames = principal_frames(patches)
        given = torch.from_numpy((patches @ frames.transpose(0, 2, 1)).astype(np.float32)).to(run.device)
        moved = torch.cat([network(part) for part in given.split(TOGETHER)]).double().cpu().numpy()
        found.append((moved[:, None] @ frames)[:, 0])
    return np.concatenate(found) * radius


def without_shrinking(points: np.ndarray, moves: np.ndarray, neighbours: int) -> np.ndarray:
    """Moves (m, 3) less the mean of the nearest ``neighbours`` points (m, 3), after Taubin: a common move is not
    noise but shrinking of the surface. 0 leaves them unchanged."""
    from scipy.spatial import cKDTree

    if not neighbours:
        return moves
    count = min(neighbours, len(points))
    parts = np.array_split(points, -(-len(points) // (1 << 13)))
    tree = cKDTree(points)
    return moves - np.concatenate([moves[tree.query(part, np.arange(1, count + 1))[1]].mean(axis=1) for part in parts])
