"""Direct residual: the sum of a smooth and a detailed network, without a direction of displacement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import register

from ..learned.fitting.trained import at_least, positive
from ..learned.networks.shipped import spheres_read
from .fitting.supervised import Supervised

if TYPE_CHECKING:
    from pathlib import Path

    import torch

    from ..learned.training.field import Field


@register("method", cite="Wang et al. 2022", requires=("torch", "trimesh", "igl", "skimage"))
@dataclass(frozen=True)
class DirectResidual(Supervised):
    """The sum of two sine networks of low and high frequency, fitted to true distances (thesis 4.1.2).

    f^(x) = N_B(x) + N_D(x), with the networks of IDF: 397,314 parameters. The released class differs from the thesis's
    formula by one default, a factor alpha = 0.05 before N_D; its tanh and its attenuation chi are off by default. Here
    alpha is 1, and all three are parameters. The thesis does not specify weights and schedule of the fit: here both
    networks learn at one rate from the beginning. The base is initialised as IDF's sphere.
    """

    omega: float = 15.0  # frequency of the base, omega_B
    omega_detail: float = 60.0  # frequency of the residual, omega_D
    hidden_layers: int = 3  # sine layers after the first, of both networks
    width: int = 256  # of each layer
    alpha: float = 1.0  # factor of the residual (released class: 0.05)
    bounded: bool = False  # bound the residual by alpha tanh (released class: False)
    attenuate: bool = False  # let the residual fade with the distance to the base, by chi (released class: False)
    nu: float = 0.02  # with attenuate: distance to the base at which the residual is halved
    sphere: float = 0.5  # radius of the initial sphere of the base; 0 for random weights

    free_on_load = ("sphere",)
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
        from .fields.residual_field import ResidualField

        form = {"hidden_layers": self.hidden_layers, "width": self.width, "generator": generator}
        base, residual = base_and_detail(self.omega, self.omega_detail, self.first_sphere, **form)
        nu = self.nu if self.attenuate else 0.0
        return ResidualField(self.oriented_loss(), base, residual, alpha=self.alpha, nu=nu, bounded=self.bounded)
