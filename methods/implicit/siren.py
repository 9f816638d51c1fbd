"""SIREN: one sine network, fitted to oriented points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bench import register

from ..learned.fitting.trained import at_least, positive
from ..learned.networks.shipped import spheres_read
from .fitting.guided import Guided

if TYPE_CHECKING:
    from pathlib import Path

    import torch

    from ..learned.training.field import Field


@register("method", cite="Sitzmann et al. 2020", requires=("torch", "trimesh", "igl", "skimage"))
@dataclass(frozen=True)
class Siren(Guided):
    """A sine network that vanishes on the points, has their normals, and a gradient of length 1 (Eq. 4.4)."""

    learning_rate: float = 1e-4  # of Adam
    omega: float = 30.0  # frequency of the sine layers: the thesis tries 30 and 60
    hidden_layers: int = 3  # sine layers after the first: 3 or 7 in the thesis
    width: int = 256  # of each layer
    sphere: float = 0.5  # radius of the initial sphere; 0 for random weights
    clip: float = 0.0  # largest norm of the gradient; 0 for none

    free_on_load = ("sphere", "clip")
    sine_sphere = True

    def __post_init__(self) -> None:
        super().__post_init__()
        at_least(self, hidden_layers=1, width=1, sphere=0, clip=0)
        positive(self, "omega")

    def reads(self) -> tuple[Path, ...]:
        """The file of the initial sphere, if it is shipped."""
        return spheres_read(self.omega, self.hidden_layers, self.width, self.first_sphere)

    def field(self, generator: torch.Generator) -> Field:
        """The network, initialised as a sphere."""
        from ..learned.networks.sphere import begin_as_sphere
        from .fields.sine_field import SineField

        form = {"hidden_layers": self.hidden_layers, "width": self.width, "generator": generator}
        field = SineField(self.oriented_loss(), self.omega, guided=self.guided, **form)
        begin_as_sphere(field.network, self.first_sphere)
        return field

    def training(self) -> dict[str, Any]:
        """Gradients are clipped if requested."""
        return {"clip": self.clip}
