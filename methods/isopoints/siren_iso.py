"""SIREN regularised by iso-points: a field from noisy, sparse or incomplete points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from bench import Frame, Run, register

from ..learned.fitting.fitted import Fitted
from ..learned.fitting.trained import at_least, positive
from ..learned.networks.shipped import spheres_read

if TYPE_CHECKING:
    from pathlib import Path

    import torch

    from ..learned.training.field import Field
    from ..learned.training.loop import Sampling

LEAST, MOST = 256, 20_000  # iso-points


@register("method", cite="Yifan et al. 2021", requires=("torch", "trimesh", "igl", "skimage", "scipy"))
@dataclass(frozen=True)
class SirenIso(Fitted):
    """A sine network fitted to noisy points with iso-points (thesis 4.2: Eq. 4.13 to 4.16).

    After a short warm-up, while the surface is still smooth, points are extracted from it, evenly spaced. They fill
    holes (the field vanishes there too), smooth (its gradient follows the normals of nearby iso-points), and detect
    outliers of the input, and sheets of the surface without points of the input (``sheets``, which the
    thesis does not have). At intervals they are extracted again. ``iso=false`` is the baseline.
    """

    steps: int = 1000  # of training, at most
    batch: int = 512  # points of the input in a step; as many of the space are added
    learning_rate: float = 5e-4  # of Adam (thesis: 1e-4)
    omega: float = 30.0  # frequency of the sine layers
    hidden_layers: int = 3  # sine layers after the first
    width: int = 128  # of each layer (thesis: 256)
    sphere: float = 0.5  # radius of the initial sphere; 0 for random weights
    clip: float = 1.0  # largest norm of the gradient; 0 for none
    # the final state: the last, the mean of the last ones, or the one nearest to the (noisy) points
    keep: Literal["last", "mean", "best"] = "last"
    surface: float = 1000.0  # weight of |f| on points and iso-points
    normal: float = 100.0  # weight of their normals
    space: float = 50.0  # weight of exp(-steepness |f|) elsewhere (released: 100)
    eikonal: float = 100.0  # weight of the gradient's length
    steepness: float = 100.0  # of the term for the space
    steepening: float = 0.0  # growth of the steepness over the training (released: 1, it doubles)
    squared: bool = False  # the deviation of the gradient's length is squared (released)
    near: float = 0.0  # share of the space's points that are near the input's (released: 0.5)
    iso: bool = True  # whether to use iso-points
    share: float = 0.3  # iso-points for each point of the input (thesis: 1/8, released: 1/16)
    warm_up: int = 60  # steps before the first iso-points (thesis: 300 of 30,000)
    refresh: int = 20  # steps between new iso-points (thesis: 2,000 of 30,000)
    per_step: int = 512  # iso-points of a step (released: 5,000)
    pca: int = 8  # neighbours of an iso-point's normal; more make the surface smoother
    hold: float = 1.0  # weight of iso-points, relative to the input's points
    outliers: bool = True  # points that iso-points do not confirm have less weight (Eq. 4.15)
    sheets: bool = True  # where the field vanishes far from the points it is pushed away from 0 instead of kept at 0
    # steps before bag-like parts of the surface without points are pushed away as well; 0: never
    lobes_after: int = 300
    sigma: float = 60.0  # degrees by which a normal may differ, sigma_n of Eq. 4.16
    # width of the outlier weight: by the noise of the points, or by the spacing of iso-points (thesis)
    bandwidth: Literal["noise", "spacing"] = "noise"
    # iso-points count as much as the input's points, or by their number (released)
    mixing: Literal["equal", "by_count"] = "equal"
    facing: float = 50.0  # penalty of gradients in space that are opposite to the nearest point's normal (released: 2)
    facing_until: float = 1.0  # until this share of the training is done (released: 1/30)

    free_on_load = (
        *("sphere", "clip", "keep", "surface", "normal", "space", "eikonal", "steepness", "steepening", "squared"),
        *("near", "iso", "share", "warm_up", "refresh", "per_step", "pca", "hold", "outliers", "sheets", "sigma"),
        *("lobes_after", "bandwidth", "mixing", "facing", "facing_until"),
    )
    sine_sphere = True

    def __post_init__(self) -> None:
        super().__post_init__()
        at_least(self, hidden_layers=1, width=1, sphere=0, clip=0, surface=0, normal=0, space=0, eikonal=0)
        at_least(self, steepening=0, hold=0, facing=0, warm_up=0, lobes_after=0, refresh=1, per_step=1, pca=3)
        positive(self, "omega", "steepness", "share", "sigma")
        for name, most in (("near", 1), ("sigma", 180), ("facing_until", 1)):
            if not 0 <= getattr(self, name) <= most:
                raise ValueError(f"{name}: expected 0 to {most}, got {getattr(self, name)}")

    def reads(self) -> tuple[Path, ...]:
        """The file of the initial sphere, if it is shipped."""
        return spheres_read(self.omega, self.hidden_layers, self.width, self.first_sphere)

    def field(self, generator: torch.Generator) -> Field:
        """The network, initialised as a sphere."""
        from ..learned.networks.sphere import begin_as_sphere
        from .fitting.field import RegularisedField, Weights

        own = {name: getattr(self, name) for name in Weights.__dataclass_fields__}
        form = {"hidden_layers": self.hidden_layers, "width": self.width, "generator": generator}
        field = RegularisedField(Weights(**own), self.omega, **form)
        begin_as_sphere(field.network, self.first_sphere)
        return field

    def sampler_of(self, field: Field, points: np.ndarray, normals: np.ndarray, frame: Frame, run: Run) -> Sampling:
        """Points, iso-points of the field, points of the space."""
        from .fitting.field import RegularisedField
        from .fitting.guide import GuidedSampler, Plan

        assert isinstance(field, RegularisedField)
        own = {name: getattr(self, name) for name in Plan.__dataclass_fields__ if hasattr(self, name)}
        plan = Plan(count=int(np.clip(round(self.share * len(points)), LEAST, MOST)), **own)
        return GuidedSampler(field.network, points, normals, plan, run, run.torch_generator())

    def training(self) -> dict[str, Any]:
        """Gradient clipping, and the final state: the loss of a batch of noisy points favours overfitting."""
        return {"clip": self.clip, "keep": self.keep}
