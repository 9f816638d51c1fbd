"""The weights of Eq. 4.4, as parameters of the methods fitted by it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...learned.fitting.trained import at_least

if TYPE_CHECKING:
    from ..losses.oriented import OrientedLoss


@dataclass(frozen=True)
class OrientedWeights:
    """Adds the four weights to a method's parameters; the defaults are the thesis's for fitting one shape."""

    surface: float = 400.0  # of Eq. 4.4: weight of |f| on the points, lambda_1 (IDF as released: 200)
    space: float = 50.0  # of Eq. 4.4: weight of exp(-100 |f|) elsewhere, lambda_3
    eikonal: float = 5.0  # of Eq. 4.4: weight of the gradient's length, lambda_0
    normal: float = 40.0  # of Eq. 4.4: weight of the normals, lambda_2

    def check_weights(self) -> None:
        """Raise ValueError unless the weights are valid."""
        at_least(self, surface=0, space=0, eikonal=0, normal=0)

    def oriented_loss(self) -> OrientedLoss:
        """Eq. 4.4 with these weights."""
        from ..losses.oriented import OrientedLoss

        return OrientedLoss(self.surface, self.space, self.eikonal, self.normal)
