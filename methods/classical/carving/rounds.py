"""Carving, round by round: voxels on which the views disagree are removed from the surface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bench import Run

from .sight import count_covers, depth_buffers, pixels_seen, take
from .silhouettes import Silhouettes
from .voxels import Voxels, surface_of

SLACK = 1.5  # cells that a voxel may lie behind the nearest one of a pixel and still be seen


@dataclass(frozen=True, eq=False)
class Carver:
    """The test of a voxel.

    Parameters
    ----------
    silhouettes : Silhouettes
    voxels : Voxels
    error : function of pixels (n, v)
        The disagreement of the colours of each voxel, see :func:`.agreement.agreement`.
    tolerance : float
        The largest error of a voxel that stays.
    least : int
        Views that must see a voxel before it may be carved.
    """

    silhouettes: Silhouettes
    voxels: Voxels
    error: Callable[[np.ndarray], np.ndarray]
    tolerance: float
    least: int

    def carve(self, filled: np.ndarray, rounds: int, run: Run) -> np.ndarray:
        """The filled voxels that remain when no voxel of the surface is carved any more, or the time is over."""
        filled = filled.copy()
        masks = self.silhouettes.views.masks
        # A voxel is tested again only if other views see it than last time; a sum of numbers identifies their set.
        keys = np.random.SeedSequence(0).generate_state(len(masks), np.uint64)
        asked = np.zeros(filled.shape, dtype=np.uint64)
        camera = self.silhouettes.matrices, self.silhouettes.focal, self.voxels.cell
        covers = count_covers(self.voxels.middles(np.argwhere(filled)), *camera, *masks.shape[1:])
        for done in range(rounds):
            if not run.time_for_more():
                run.note(
                    f"space_carving: {done} rounds were done in limit.seconds={run.seconds:g}; carving is not finished"
                )
                break
            index, pixels = self.seen(filled)
            key = (pixels >= 0) @ keys
            new = np.flatnonzero((asked[tuple(index.T)] != key) & ((pixels >= 0).sum(axis=1) >= self.least))
            asked[tuple(index.T)] = key
            error = self.error(pixels[new])
            wrong = index[new[np.argsort(-error, kind="stable")[: (error > self.tolerance).sum()]]]
            gone = wrong[take(self.voxels.middles(wrong), *camera, covers, masks)]
            if not len(gone):
                break
            filled[tuple(gone.T)] = False
            run.progress(done + 1, rounds)
        return filled

    def seen(self, filled: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The indices (n, 3) of the voxels of the surface, and the pixel in which each view sees them: (n, v)."""
        index, masks = surface_of(filled), self.silhouettes.views.masks
        middles, matrices, cell = self.voxels.middles(index), self.silhouettes.matrices, self.voxels.cell
        buffers = depth_buffers(middles, matrices, self.silhouettes.focal, cell, *masks.shape[1:])
        return index, pixels_seen(middles, matrices, buffers, masks, SLACK * cell)
