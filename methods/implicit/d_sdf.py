"""D-SDF: a distance field evaluated at displaced points, with arbitrary displacement vectors."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from bench import register

from ..learned.fitting.trained import at_least
from .fitting.supervised import Supervised

if TYPE_CHECKING:
    import torch

    from ..learned.training.field import Field


@register("method", cite="Wang et al. 2022; Pumarola et al. 2021", requires=("torch", "trimesh", "igl", "skimage"))
@dataclass(frozen=True)
class DSdf(Supervised):
    """A ReLU network read at x + Delta(x), Delta in R^3 from a second one, fitted to true distances (thesis 4.1.2).

    "We follow network specs of D-NeRF, which contains 2 8-layer MLP networks with ReLU activation and positional
    encodings": as there, ten bands 2^k without pi, the point itself included, width 256, the encoding concatenated to
    the output of the fifth layer. With e = 3 + 6 bands encoded coordinates and width w, a network of 8 layers and m
    outputs has (e + 1) w + 7 (w + 1) w + e w + (w + 1) m parameters: 493,313 + 493,827 = 987,140 for both.

    The thesis does not specify the number of bands (it names eight for its Fourier features), the initialisation (here:
    a linear layer's default), the learning rate (here: D-NeRF's), and whether Delta is bounded or regularised (here:
    not; it speaks of a "lack of constraints"). The code is not in the release.
    """

    steps: int = 250  # of training, at most
    learning_rate: float = 5e-4  # of Adam
    bands: int = 10  # frequencies of the positional encoding: 1, 2, 4, ...
    layers: int = 8  # ReLU layers of each network
    width: int = 256  # of each layer

    def __post_init__(self) -> None:
        super().__post_init__()
        at_least(self, bands=0, layers=1, width=1)

    def field(self, generator: torch.Generator) -> Field:
        """Both networks."""
        from .fields.warped_field import ReluNetwork, WarpedField

        network = partial(ReluNetwork, bands=self.bands, layers=self.layers, width=self.width, generator=generator)
        return WarpedField(self.oriented_loss(), network(1), network(3))
