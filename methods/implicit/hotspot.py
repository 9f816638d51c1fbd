"""HotSpot: a signed distance from points without normals, regularised by the heat equation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import register

from ..learned.fitting.fitted import Fitted
from ..learned.fitting.trained import at_least, positive
from ..learned.networks.shipped import spheres_read

if TYPE_CHECKING:
    from pathlib import Path

    import torch

    from ..learned.training.field import Field


@register("method", cite="Wang et al. 2025", requires=("torch", "trimesh", "igl", "skimage"))
@dataclass(frozen=True)
class Hotspot(Fitted):
    """A sine network that is zero at the points, whose exp(-lambda |f|) is the heat around them; uses no normals.

    Away from the surface h = exp(-lambda |f|) should solve the screened Poisson equation laplace h = lambda^2 h: with
    growing lambda, only distances do, while an eikonal term alone also allows other f. The minimised term is the
    integral of (|grad h|^2 + lambda^2 h^2) / 2, so walls without points vanish. The terms are the paper's, the
    integral by uniform samples, with sine layers; the weights, and the growth of lambda, were chosen here, for two
    processor cores. Inside and outside are determined by the initial sphere, and by the radius beyond which there are
    no points, where f should be positive (our addition: without it, some fits end inside out).
    """

    batch: int = 1024  # surface points of a step; as many of the space are added
    learning_rate: float = 2e-4  # of Adam
    omega: float = 30.0  # frequency of the sine layers
    hidden_layers: int = 3  # sine layers after the first
    width: int = 256  # of each layer
    surface: float = 175.0  # weight of |f| on the points
    eikonal: float = 5.0  # weight of the gradient's length
    heat: float = 30.0  # weight of the heat; higher removes more
    absorption: float = 40.0  # lambda at the end, in 1 / radius: how sharply heat decays from the points
    absorption_begin: float = 4.0  # lambda at the beginning; it grows by equal factors
    sphere: float = 0.5  # radius of the initial sphere

    free_on_load = ("sphere", "surface", "eikonal", "heat", "absorption", "absorption_begin")
    sine_sphere = True

    def __post_init__(self) -> None:
        super().__post_init__()
        positive(self, "omega", "absorption", "absorption_begin", "sphere")
        at_least(self, hidden_layers=1, width=1, surface=0, eikonal=0, heat=0)

    def reads(self) -> tuple[Path, ...]:
        """The file of the initial sphere, if it is shipped."""
        return spheres_read(self.omega, self.hidden_layers, self.width, self.first_sphere)

    def field(self, generator: torch.Generator) -> Field:
        """The network, initialised as a sphere."""
        from ..learned.networks.sine_network import SineNetwork
        from ..learned.networks.sphere import begin_as_sphere
        from .fields.heat_field import HeatField

        network = SineNetwork(self.omega, hidden_layers=self.hidden_layers, width=self.width, generator=generator)
        begin_as_sphere(network, self.first_sphere)
        weights = {"surface": self.surface, "eikonal": self.eikonal, "heat": self.heat}
        return HeatField(network, absorption=(self.absorption_begin, self.absorption), **weights)

    @property
    def uses_normals(self) -> bool:
        """It is fitted only to the points."""
        return False
