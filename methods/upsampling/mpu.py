"""MPU: a cloud doubled repeatedly, each time by another network on patches of the same size."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from bench import PointCloud, Run, generator, register
from bench.geometry.farthest import load_compiled

if TYPE_CHECKING:
    from bench import TrainingData

    from .networks.unit import Form, Units


@register("method", cite="Wang et al. 2019", requires=("torch", "safetensors", "scipy", "numba"))
@dataclass(frozen=True)
class Mpu:
    """Multi-step progressive upsampling (thesis 3.1): networks on patches, trained level by level."""

    levels: int = 4  # doublings, each with its own unit
    single: bool = False  # one unit for all levels ("no multi-stage")
    stages: Literal["progressive", "apart", "at_once"] = "progressive"  # how the units are trained
    growth: int = 12  # channels of a layer of a dense block
    convolutions: int = 3  # layers of a dense block
    neighbours: int = 32  # in feature space
    features: Literal["dense", "pu_net"] = "dense"  # the network for the features of points
    expansion: Literal["code", "pu_net"] = "code"  # the expansion of a point to two
    code: float = 0.2  # the two copies are marked by minus and plus this (thesis: 1)
    skip: float = 0.2  # weight of the features of the level before (thesis: 1); 0 for none
    patch: int = 156  # points of a patch at most (thesis: 312)
    share: float = 0.25  # largest share of the cloud in a patch (which always has at least neighbours + 1 points)
    recut: bool = True  # each level cuts its own patches; without it, those of the first pass through all levels
    overlap: float = 3.0  # patches that a point is in, on average
    central: int = 1  # number of patches, where a point is nearest the seed, whose copies of it count (thesis: 0, all)
    bases: tuple[int, ...] = (625, 2500)  # points of the clouds in training; 0 for the clouds of the sensor
    scans: tuple[str, ...] = ()  # instead of bases, levels + 1 sensors of doubling density, the sparsest first
    noise: float = 0.0025  # of the clouds in training (but not of the sensor's), relative to the radius of the shape
    scale: float = 0.2  # patches in training are scaled by up to this
    steps: int = 5000  # of training (thesis: 120,300); 0 for as many as its seconds allow, with stages by the clock
    batch: int = 8  # patches of a step (thesis: 28)
    learning_rate: float = 2e-3  # of Adam (thesis: 5e-4, for a hundred times as many steps)
    decay: float = 0.1  # factor of the learning rate over the last fifth of training (thesis: 1)
    inherit: bool = True  # a unit starts with the weights of the one before it (thesis: False)

    examples_by: ClassVar[tuple[str, ...]] = ("levels", "bases", "scans")
    trained_by: ClassVar[tuple[str, ...]] = (
        *(
            "levels",
            "single",
            "stages",
            "growth",
            "convolutions",
            "neighbours",
            "features",
            "expansion",
            "code",
            "skip",
        ),
        *("patch", "share", "bases", "scans", "noise", "scale"),
        *("steps", "batch", "learning_rate", "decay", "inherit", "recut"),
    )

    def __post_init__(self) -> None:
        for name in ("levels", "growth", "convolutions", "neighbours", "batch"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: expected at least 1, got {getattr(self, name)}")
        for name in ("skip", "noise", "scale", "steps", "central"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name}: expected at least 0, got {getattr(self, name)}")
        for name in ("learning_rate", "overlap", "decay"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: expected a number above 0, got {getattr(self, name)}")
        if self.convolutions < 2:
            raise ValueError(f"convolutions: expected at least 2, got {self.convolutions}")
        if self.patch < 2:
            raise ValueError(f"patch: expected at least 2, got {self.patch}")
        if not 0 < self.share <= 1:
            raise ValueError(f"share: expected a number above 0, up to 1, got {self.share}")
        if not self.scale < 1:
            raise ValueError(f"scale: expected less than 1, got {self.scale}")
        if self.scans and len(self.scans) != self.levels + 1:
            raise ValueError(f"scans: expected {self.levels + 1} sensors (levels + 1), got {len(self.scans)}")
        if not self.scans and (not self.bases or min(self.bases) < 0):
            raise ValueError(f"bases: expected counts of points, got {self.bases}")

    def examples(self, data: TrainingData, run: Run) -> Mapping[str, np.ndarray]:
        """Clouds of each shape at doubling densities: inputs, and Poisson disks of the exact surface as truths."""
        from .training.clouds import pack

        return pack(self._pyramids(data, run))

    def fit(self, examples: Mapping[str, np.ndarray], run: Run) -> Mapping[str, np.ndarray]:
        """The weights of all units, by name."""
        import torch

        from .training.fit import Plan, Training

        torch.set_num_threads(run.threads)
        network = self._network(torch.Generator().manual_seed(run.seed)).to(run.device)
        run.parameters = sum(parameter.numel() for parameter in network.parameters())
        own = {name: getattr(self, name) for name in Plan.__dataclass_fields__}
        return Training(network, examples, Plan(**own), run).weights()

    prepare = staticmethod(load_compiled)

    def upsample(self, cloud: PointCloud, ratio: int, run: Run) -> PointCloud:
        """Exactly ``ratio`` times as many points, in arbitrary order.

        A ratio that is not a power of two is reached from the next power by thinning; above 2**levels, the network is
        applied again to its output.
        """
        import torch

        from bench.geometry.check import check_points
        from bench.geometry.farthest import farthest_points

        from .patches.progressive import double, double_whole, patch_size

        check_points(cloud.points, "mpu", at_least=2)
        torch.set_num_threads(run.threads)
        network = self._network()
        run.parameters = sum(parameter.numel() for parameter in network.parameters())
        assert run.weights is not None  # a method that learns from examples always has them
        network.load_state_dict({name: torch.from_numpy(np.array(array)) for name, array in run.weights.items()})
        network.to(run.device).eval()
        points, left = np.asarray(cloud.points, dtype=np.float64), math.ceil(math.log2(ratio))
        while left > 0:
            times = left if self.single else min(left, self.levels)
            size = patch_size(len(points), self.patch, self.neighbours, self.share)
            doubling = double if self.recut else double_whole
            points = doubling(points, network, times, size, self.overlap, self.central)
            left -= times
        count = ratio * len(cloud)
        return PointCloud(points if len(points) == count else points[farthest_points(points, count)])

    def _network(self, generator: Any = None) -> Units:
        from .networks.unit import Units

        return Units(1 if self.single else self.levels, self._form(), generator)

    def _form(self) -> Form:
        from .networks.unit import Form

        skip = 0.0 if self.single else self.skip  # the unit is trained without a level before it
        return Form(self.growth, self.convolutions, self.neighbours, self.code, skip, self.features, self.expansion)

    def _pyramids(self, data: TrainingData, run: Run) -> Any:
        from bench.geometry.poisson_disk import sample_poisson_disk

        for number, case in enumerate(data.cases):
            if self.scans:
                # The same generator for all densities, so that a scanner has the same position.
                yield number, [data.sense(case, s, generator(data.seed, case.id)).points for s in self.scans]
            else:
                rng = generator(data.seed, case.id, "poisson disks")
                for base in self.bases:
                    count = base or len(case.input["cloud"])
                    start = sample_poisson_disk(case.reference, base, rng)[0] if base else case.input["cloud"].points
                    dense = [sample_poisson_disk(case.reference, count << k, rng)[0] for k in range(1, self.levels + 1)]
                    yield number, [start, *dense]
            run.progress(number + 1, data.count)
