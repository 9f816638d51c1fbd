"""IDF: a smooth base, and a displacement along its normals that carries the detail."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from bench import register

from ..learned.fitting.trained import at_least, positive
from ..learned.networks.shipped import spheres_read
from ..learned.training.schedules import BASE_FROZEN
from .fitting.guided import Guided

if TYPE_CHECKING:
    from pathlib import Path

    import torch

    from ..learned.training.field import Field


@register("method", cite="Wang et al. 2022", requires=("torch", "trimesh", "igl", "skimage"))
@dataclass(frozen=True)
class Idf(Guided):
    """Implicit displacement fields: two sine networks of low and high frequency (thesis 4.1, Eq. 4.3 and 4.4)."""

    steps: int = 300  # of training, at most
    betas: tuple[float, float] = (0.1, 0.9)  # of Adam, as released: the thesis does not name them
    omega: float = 15.0  # frequency of the base, omega_B
    omega_detail: float = 60.0  # frequency of the displacement, omega_D
    hidden_layers: int = 3  # sine layers after the first, of both networks
    width: int = 256  # of each layer
    alpha: float = 0.05  # largest displacement, relative to the radius
    nu: float = 0.02  # distance to the base at which the displacement is halved (released: 0.05)
    bounded: bool = True  # bound the displacement by alpha tanh; without it, alpha times the network's output
    attenuate: bool = True  # let the displacement fade with the distance to the base, by chi
    schedule: Literal["thesis", "released", "none"] = "released"  # of the loss weights, from the base to the whole
    sphere: float = 0.5  # radius of the initial sphere of the base; 0 for random weights
    guided: float = 0.2  # share of the training in which the sign in space is guessed from the points (thesis: 0)

    free_on_load = ("sphere", "schedule", "guided")
    begin_on_load = BASE_FROZEN
    sine_sphere = True

    def __post_init__(self) -> None:
        super().__post_init__()
        at_least(self, hidden_layers=1, width=1, sphere=0)
        positive(self, "alpha", "nu", "omega", "omega_detail")

    def reads(self) -> tuple[Path, ...]:
        """The file of the initial sphere, if it is shipped."""
        return spheres_read(self.omega, self.hidden_layers, self.width, self.first_sphere)

    def field(self, generator: torch.Generator) -> Field:
        """Both networks; the base is initialised as a sphere."""
        from ..learned.networks.sphere import base_and_detail
        from .fields.displaced_field import DisplacedField

        form = {"hidden_layers": self.hidden_layers, "width": self.width, "generator": generator}
        base, displacement = base_and_detail(self.omega, self.omega_detail, self.first_sphere, **form)
        return DisplacedField(
            self.oriented_loss(),
            base,
            displacement,
            alpha=self.alpha,
            nu=self.nu if self.attenuate else 0.0,
            bounded=self.bounded,
            schedule=self.schedule,
            guided=self.guided,
        )
