"""Settings of the regularisers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal


@dataclass(frozen=True)
class Regularity:
    """Settings of repulsion and projection; lengths in the unit of the points.

    ``form`` selects one of two forms, where thesis and released code differ:

    ============== ================================== =================================================
    \\               thesis                             released
    ============== ================================== =================================================
    near (psi)     exp(-d^2 / D^2)                    exp(-d^2 / 2 D^2), of projection exp(-d^2 / 4 D^2)
    repulsion      sum of psi / (d^2 + 1e-4)          mean of (d^2 + 1e-4)^(-1/2), weighted by psi
    projection     to the plane of the weighted PCA   to the mean plane of the neighbours' normals
    ============== ================================== =================================================

    Parameters
    ----------
    neighbours : int
        The number of nearest neighbours of a point.
    repulsion_distance, projection_distance : float
        D: those beyond do not count.
    angle : float
        Theta of Eq. 3.15, in degrees: neighbours whose normals differ by more hardly count. (The released code squares
        the denominator of Eq. 3.15, as here, and converts degrees wrongly.)
    repulsion, projection : float
        Weights gamma_r and gamma_p.
    largest : float
        Of a move by projection, along each axis, before its weight.
    form : "released" or "thesis"
    """

    neighbours: int = 32
    repulsion_distance: float = 0.05
    projection_distance: float = 0.3
    angle: float = 60.0
    repulsion: float = 0.03
    projection: float = 0.05
    largest: float = 0.02
    form: Literal["released", "thesis"] = "released"

    @classmethod
    def of(cls, method: Any, spacing: float) -> Regularity:
        """The settings of a method, whose distances are in spacings of the points."""
        return cls(
            repulsion=method.repulsion,
            projection=method.projection,
            repulsion_distance=method.repulsion_distance * spacing,
            projection_distance=method.projection_distance * spacing,
            form=method.regularisers,
        )

    def __post_init__(self) -> None:
        if self.neighbours < 3:
            raise ValueError(f"neighbours: expected at least 3, got {self.neighbours}")
        for name in ("repulsion_distance", "projection_distance", "angle", "largest"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: expected a number above 0, got {getattr(self, name)}")
        for name in ("repulsion", "projection"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name}: expected at least 0, got {getattr(self, name)}")
        if self.form not in ("released", "thesis"):
            raise ValueError(f"form: expected released or thesis, got {self.form!r}")


PRESETS = {
    "fit": Regularity(),
    "fine-tune": Regularity(repulsion=0.05, projection=0.02, repulsion_distance=0.05, projection_distance=0.1),
    "filter": Regularity(repulsion=0.05, projection=0.05, repulsion_distance=0.03, projection_distance=0.1),
}
