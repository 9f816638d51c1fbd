"""ARAP: the surface nearest to the target whose neighbourhoods are rotated as rigidly as possible."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import PointCloud, Run, register

from .registration.registered import Matched, note_end

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("method", cite="Sorkine and Alexa 2007", requires=("scipy", "trimesh"))
@dataclass(frozen=True)
class Arap(Matched):
    """As rigid as possible, pulled to nearest points, in rounds from stiff to soft.

    ``min integral |x - goal|^2 + l^2 / 2 E(x)``, E the energy of Sorkine and Alexa: each vertex has a rotation, and E
    penalises the difference of the edges around it, with cotangent weights, from the rotated edges of the source.
    Rotations (by singular values) and vertices (by a linear system) are solved alternately (local, global); the matrix
    is factorised once per round, because it depends only on the pairs. A round begins with the best rigid motion of the
    whole, which leaves E unchanged, and which the alternating steps would find slowly. The paper moves handles that a
    user drags; here points on the source are pulled to the nearest of the target and vice versa, if the normals agree
    and the distance is not far above the median. l falls over the rounds. Weak springs between nearby parts act as
    edges in E, so a chair of separate bars is held together, and rotates as a whole without cost.

    Stretching costs more than bending: if a target has longer legs, legs stay short, or bend.
    """

    rounds: int = 15  # of matching
    turns: int = 3  # local and global steps of a round
    stiff: float = 1.0  # l in the first round, a length
    soft: float = 0.3  # in the last round; geometric between the two

    def __post_init__(self) -> None:
        super().__post_init__()
        self.expect_steps("rounds", "turns")
        self.expect_positive("stiff", "soft")

    def deform(self, source: Trimesh, target: Trimesh | PointCloud, run: Run) -> Trimesh:
        """The source at the vertices of the last round.

        Raises
        ------
        BadInput
            For a source without area, or a target without extent.
        """
        from .registration.rotations import Rigidity, moved_rigidly
        from .registration.solving import Factors

        pulled = self.pulled(source, target, run)
        welded = pulled.welded
        rigidity = Rigidity(welded.vertices, *welded.links)
        moved, done = welded.vertices, 0
        for length in np.geomspace(self.stiff, self.soft, self.rounds):
            if not run.time_for_more():
                break
            matrix, right = pulled.round(moved)
            factors = Factors(matrix + length**2 * welded.stiffness)
            moved = moved_rigidly(moved, matrix, right)
            for _ in range(self.turns):
                turned = rigidity.right_side(rigidity.rotations(moved))
                moved = factors.solve(right + length**2 * turned)
            done += 1
            run.progress(done, self.rounds)
        note_end(run, done, self.rounds, "rounds")
        return welded.mesh(source, moved)
