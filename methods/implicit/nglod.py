"""NGLOD: features on grids of several resolutions, and a small decoder for each level of detail."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from bench import register

from .fitting.supervised import Supervised

if TYPE_CHECKING:
    import torch

    from ..learned.training.field import Field

FEATURES, HIDDEN = 32, 128


@register("method", cite="Takikawa et al. 2021", requires=("torch", "trimesh", "igl", "skimage"))
@dataclass(frozen=True)
class Nglod(Supervised):
    """Neural geometric level of detail: features on dense grids, a decoder per level, fitted to true distances.

    A level of detail sums the features of its grid and of all coarser ones, each interpolated between the eight
    vertices around a point, and decodes them and the point, 35 -> 128 -> 1; all levels learn at once, from the sum of
    their squared errors. Distances are sampled as in the released code: two fifths on the surface, two fifths 0.01
    from it, one fifth in the box. That steps by 512 points at a rate of 1e-3 throughout; here the rate falls over the
    last fifth, as for all methods of this family.

    Dense parameters, which are trained and reported in the results, and active ones, which a sparse grid would store
    (cells that contain surface, here for a sphere of radius 1; NGLOD's authors count those):

    =====  ======  ===========  ==========  ==========
    base   levels  finest side  dense       active
    =====  ======  ===========  ==========  ==========
    2      4       32           1,353,476   420,036
    2      5       64           10,146,213  1,637,861
    2      6       128          78,844,998  6,413,062
    3      4       64           10,137,476  1,629,156
    =====  ======  ===========  ==========  ==========

    The thesis calls 4 and 6 levels 64^3 and 256^3, "comparable" to its own 397,314 parameters and 300 times as many.
    64^3 and 256^3 would be base 3; comparable is the active count of base 2, so that is the default.
    """

    steps: int = 1500  # of training, at most
    learning_rate: float = 1e-3  # of Adam
    levels: int = 4  # of detail; each is twice as fine as the one before
    base: int = 2  # the coarsest grid has 2^base cells along each side
    lod: int = 0  # the level of detail that is extracted, 1 to levels; 0 for the finest
    # Adam of the grid; sparse: only vertices around the points of a step move, and the rest costs no time;
    # auto: sparse if the finest grid has 128 cells along each side or more
    optimizer: Literal["auto", "dense", "sparse"] = "auto"

    free_on_load = ("lod", "optimizer")  # a level of detail is chosen when a surface is extracted

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.levels < 1:
            raise ValueError(f"levels: expected at least 1, got {self.levels}")
        if self.base < 0:
            raise ValueError(f"base: expected at least 0, got {self.base}")
        if self.base + self.levels > 9:
            raise ValueError(
                f"levels: expected at most {9 - self.base} with base={self.base}, got {self.levels}: a finest grid of "
                f"{2 ** (self.base + self.levels - 1)} cells a side does not fit into memory"
            )
        if not 0 <= self.lod <= self.levels:
            raise ValueError(f"lod: expected 0 to {self.levels}, the number of levels, got {self.lod}")
        if self.optimizer not in ("auto", "dense", "sparse"):
            raise ValueError(f"optimizer: expected auto, dense or sparse, got {self.optimizer!r}")

    def field(self, generator: torch.Generator) -> Field:
        """The grids, with features near 0, and the decoders."""
        from .fields.nglod_field import NglodField

        finest = self.base + self.levels - 1
        return NglodField(
            self.oriented_loss(),
            self.levels,
            self.base,
            lod=self.lod or self.levels,
            features=FEATURES,
            hidden=HIDDEN,
            generator=generator,
            sparse=self.optimizer == "sparse" or (self.optimizer == "auto" and finest >= 7),
        )

    def training(self) -> dict[str, Any]:
        """All points of a step at once, because a dense gradient costs the same for any number."""
        return {**super().training(), "chunk": 2 * self.batch}
