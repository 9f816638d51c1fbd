"""A signed distance from features in a multi-resolution hash grid, fitted to oriented points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import register

from ..learned.fitting.trained import at_least, positive
from .fitting.guided import Guided

if TYPE_CHECKING:
    import torch

    from ..learned.training.field import Field


@register("method", cite="Mueller et al. 2022", requires=("torch", "trimesh", "igl", "skimage", "scipy"))
@dataclass(frozen=True)
class HashSdf(Guided):
    """A multi-resolution hash grid and a small network, under the loss of SIREN (Eq. 4.4).

    The encoding is that of Mueller et al. (2022), and so are the betas of Adam; the loss is that of the other methods
    here, because the input has no distances. That loss distinguishes inside and outside only at the points, and
    features do not propagate it far; so the field is first fitted to guesses of the distance, whose sign is that of a
    coarse Poisson indicator of the points (``guided``; without it, walls remain from the sphere). Its gradients are
    those of the trilinear interpolation, exact within a cell. The defaults are for two processor cores, measured on
    training shapes: finer cells than the gaps between points learn noise, and tables of 2^17 or 2^19 rows were slower
    and not better.
    """

    steps: int = 2000  # of training, at most
    batch: int = 1024  # surface points of a step; as many of the space are added
    learning_rate: float = 1e-2  # of Adam, for the features
    betas: tuple[float, float] = (0.9, 0.99)  # of Adam, with a short memory: a row is used in few of the steps
    network_rate: float = 0.3  # of the network, relative to that of the features
    levels: int = 12  # of the grid (published: 16)
    coarsest: int = 8  # cells of the first level along each axis (published: 16)
    finest: int = 256  # cells of the last level along each axis; about the gap between points
    log2_table: int = 15  # a level has at most 2 to the power of this rows (published: 14 to 24)
    features: int = 2  # of a row
    width: int = 64  # of the network's hidden layers
    hidden_layers: int = 1  # of the network
    guided: float = 0.1  # share of the training in which the sign in space is guessed from the points; 0 for none
    sphere: float = 0.5  # radius of the initial sphere

    free_on_load = ("guided", "network_rate")  # not the sphere, which is part of the field

    def __post_init__(self) -> None:
        super().__post_init__()
        at_least(self, levels=1, coarsest=1, features=1, width=1, hidden_layers=1)
        if not self.coarsest <= self.finest <= 65536:
            raise ValueError(f"finest: expected {self.coarsest} (coarsest) to 65536, got {self.finest}")
        if not 4 <= self.log2_table <= 24:
            raise ValueError(f"log2_table: expected 4 to 24, got {self.log2_table}")
        positive(self, "network_rate", "sphere")

    def field(self, generator: torch.Generator) -> Field:
        """The grid and the network, initialised as a sphere."""
        from ..learned.networks.hash_grid import HashGrid
        from .fields.hash_field import HashField

        size = (self.levels, 2**self.log2_table, self.coarsest, self.finest)
        return HashField(
            HashGrid(*size, features=self.features, generator=generator),
            self.oriented_loss(),
            width=self.width,
            hidden_layers=self.hidden_layers,
            radius=self.sphere,
            network_rate=self.network_rate,
            guided=self.guided,
            generator=generator,
        )
