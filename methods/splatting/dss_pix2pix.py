"""Denoising by images translated by a network."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np

from bench import PointCloud, Run, register

from .filtering.denoiser import FilteredImages

if TYPE_CHECKING:
    from bench import TrainingData

    from .filtering.cycles import Filter


@register("method", cite="Yifan et al. 2019; Isola et al. 2017", requires=("scipy", "numba", "torch", "safetensors"))
@dataclass(frozen=True)
class DssPix2pix(FilteredImages):
    """Surface splatting with a learned filter: a network turns images of the noisy cloud into images of a clean one.

    The network is that of Pix2Pix with residual blocks; 11,372,931 parameters for ``ngf=64``, as published, and 714,339
    for 16. Weights come with it for noise of 1 % of the diagonal and 20,000 points (``method=dss_pix2pix``), and for
    0.3 % and 100,000 points (``method=dss_pix2pix_03pct``).
    """

    ngf: int = 16  # channels of the first layer (published: 64)
    smoothing: float = 6.0  # pixels; the network corrects the image smoothed by this (published: 0, it makes the image)
    normalisation: Literal["pixel", "batch"] = "batch"  # of features (published: pixel, which learns more slowly)
    dropout: float = 0.0  # share of the numbers in the blocks that is set to zero in training (published: 0.5)
    adversarial: float = 0.0  # weight of the adversarial loss, relative to the L1 distance (published: 0.01)
    neighbours: int = 32  # points for estimating the normals again before rendering; 0 keeps them
    examples_views: int = 20  # pairs of images of each shape in training
    examples_pixels: int = 256  # along each side of these
    steps: int = 3000  # of training; 0 for as many as its seconds allow
    batch: int = 4  # crops of a step (published: 1 whole image)
    crop: int = 128  # pixels along each side of a crop
    learning_rate: float = 1e-3  # of Adam (published: 2e-4)

    examples_by: ClassVar[tuple[str, ...]] = ("neighbours", "examples_views", "examples_pixels")
    trained_by: ClassVar[tuple[str, ...]] = (
        *(
            "ngf",
            "smoothing",
            "normalisation",
            "dropout",
            "adversarial",
            "neighbours",
            "examples_views",
            "examples_pixels",
        ),
        *("steps", "batch", "crop", "learning_rate"),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("ngf", "examples_views", "examples_pixels", "batch"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: expected at least 1, got {getattr(self, name)}")
        if not 0 <= self.dropout < 1:
            raise ValueError(f"dropout: expected a number from 0 to below 1, got {self.dropout}")
        if not self.adversarial >= 0:
            raise ValueError(f"adversarial: expected at least 0, got {self.adversarial}")
        if not self.smoothing >= 0:
            raise ValueError(f"smoothing: expected at least 0, got {self.smoothing}")
        if self.steps < 0:
            raise ValueError(f"steps: expected at least 0, got {self.steps}")
        if self.neighbours < 0 or 0 < self.neighbours < 3:
            raise ValueError(f"neighbours: expected 0, or at least 3, got {self.neighbours}")
        if self.crop < 32:
            raise ValueError(f"crop: expected at least 32, got {self.crop}")
        if not self.learning_rate > 0:
            raise ValueError(f"learning_rate: expected a number above 0, got {self.learning_rate}")

    def examples(self, data: TrainingData, run: Run) -> Mapping[str, np.ndarray]:
        """Images of noisy and clean clouds of each shape, from the same close cameras."""
        from .translation.pairs import pairs_of

        self.prepare()
        return pairs_of(data, run, self.neighbours, self.examples_views, self.examples_pixels)

    def fit(self, examples: Mapping[str, np.ndarray], run: Run) -> Mapping[str, np.ndarray]:
        """The weights of the network, by name."""
        import torch

        from .translation.discriminator import Discriminator
        from .translation.generator import Generator
        from .translation.training import Plan, Training

        torch.set_num_threads(run.threads)
        drawn = torch.Generator().manual_seed(run.seed)
        network = Generator(self.ngf, self.dropout, self.smoothing, self.normalisation, drawn)
        discriminator = Discriminator(self.ngf, drawn) if self.adversarial else None
        run.parameters = sum(parameter.numel() for parameter in network.parameters())
        plan = Plan(**{name: getattr(self, name) for name in Plan.__dataclass_fields__})
        return Training(network, discriminator, examples, plan, run).weights()

    def pictured(self, cloud: PointCloud) -> PointCloud:
        """The cloud with rough normals, like those of the training."""
        from .translation.anew import with_rough_normals

        return with_rough_normals(cloud, self.neighbours)

    def image_filter(self, run: Run) -> Filter:
        """The network."""
        import torch

        from ..learned.networks.loading import loaded
        from .translation.generator import Generator
        from .translation.translate import translated

        torch.set_num_threads(run.threads)
        network = Generator(self.ngf, smoothing=self.smoothing, normalisation=self.normalisation)
        network = loaded(network, run)
        network = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch omits it
        return partial(translated, network=network, device=run.device)
