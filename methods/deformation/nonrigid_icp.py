"""Non-rigid ICP: nearest points, and offsets of the vertices that are smooth over the mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import PointCloud, Run, register

from .registration.registered import Matched, note_end

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("method", cite="baseline of Wang et al. 2020", requires=("scipy", "trimesh"))
@dataclass(frozen=True)
class NonrigidIcp(Matched):
    """Rounds of nearest points, and of smooth offsets from the source towards them, with decreasing smoothness.

    Similar to Amberg et al. 2007 (decreasing stiffness) and to Huang et al. 2008, the baseline of neural cages
    (Wang et al. 2020; their program has three rounds of fixed smoothing, and a last one). Points on the source are
    paired with the nearest of the target, and those of the target with the nearest on the source; if the target has
    normals, they should agree. Pairs that are far apart probably do not correspond, and are trimmed. A round
    solves for offsets d of the vertices, ``min integral |d - goal|^2 + l^2 |grad d|^2``: a pull spreads
    over a length l along the surface, by cotangent weights. Disconnected parts of a source are joined by weak
    springs, so that a chair of separate bars moves as one. After the last round the offsets are smoothed once more.

    Offsets, not rotations, are smooth: the method suits targets near to the source, in the same pose.
    """

    rounds: int = 20  # of matching
    smooth: float = 1.0  # length over which offsets are smooth in the first round
    smooth_end: float = 0.1  # in the last round; geometric between the two
    smooth_last: float = 0.1  # of the last smoothing, without target; 0 for none

    def __post_init__(self) -> None:
        super().__post_init__()
        self.expect_steps("rounds")
        self.expect_positive("smooth", "smooth_end")
        if not self.smooth_last >= 0:
            raise ValueError(f"smooth_last: expected at least 0, got {self.smooth_last}")

    def deform(self, source: Trimesh, target: Trimesh | PointCloud, run: Run) -> Trimesh:
        """The source with the offsets of the last round.

        Raises
        ------
        BadInput
            For a source without area, or a target without extent.
        """
        from .registration.solving import Factors

        pulled = self.pulled(source, target, run)
        welded = pulled.welded
        offsets, done = np.zeros_like(welded.vertices), 0
        for length in np.geomspace(self.smooth, self.smooth_end, self.rounds):
            if not run.time_for_more():
                break
            matrix, right = pulled.round(welded.vertices + offsets)
            # The unknowns are offsets from the source, not from the last round, so that the total offset is smooth.
            factors = Factors(matrix + length**2 * welded.stiffness)
            offsets, done = factors.solve(right - matrix @ welded.vertices), done + 1
            run.progress(done, self.rounds)
        note_end(run, done, self.rounds, "rounds")
        if self.smooth_last:
            smoother = Factors(pulled.masses + self.smooth_last**2 * welded.stiffness)
            offsets = smoother.solve(pulled.masses @ offsets)
        return welded.mesh(source, welded.vertices + offsets)
