"""EC-Net: four times as many points, attracted to the sharp edges of a shape."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from bench import PointCloud, Run, register
from bench.geometry.farthest import load_compiled

if TYPE_CHECKING:
    from bench import TrainingData

    from .networks.ec_network import EcNetwork


@register("method", cite="Yu et al. 2018b", requires=("torch", "safetensors", "scipy", "numba"))
@dataclass(frozen=True)
class EcNet:
    """EC-Net (Yu et al. 2018b): 823,652 parameters, four times as many points; 16 times by two passes.

    It learns from the distances of its points to the triangles of a shape and to its sharp edges. The published edges
    were marked by hand; here they are those of the meshes of polyhedral shapes (``cad``, ``furniture``), by their
    angles. The published patches have 1,024 points (``method=ec_net_thesis``), nearest along geodesics; here they are
    nearest in space, and radii are widened by sqrt(1024 / points). The half of a patch that is nearest its seed
    is upsampled.

    The released code returns all points of all patches, twelve times as many, and a file of edge points. Here farthest
    points are kept, to the exact count, after each pass.
    """

    points: int = 156  # of a patch (thesis: 1,024), half of which are upsampled; all points if a cloud has fewer
    overlap: float = 3.0  # patches that upsample a point, on average
    geodesic: bool = False  # patches are cut along the surface, as published
    central: int = 1  # number of patches, where a point is nearest the seed, whose copies of it count (thesis: 0, all)
    bases: tuple[int, ...] = (625, 2500)  # points of the clouds in training; 0 for the clouds of the sensor
    scans: tuple[str, ...] = ()  # instead of bases, sensors of four times as many points each, the sparsest first
    angle: float = 30.0  # degrees between the normals of two faces above which an edge is sharp
    faces: int = 3000  # of a mesh in training, at most
    triangles: int = 400  # of the surface around a patch (released: 800)
    segments: int = 120  # of edges around a patch
    noise: float = 0.0025  # of the inputs in training, relative to the radius of the shape
    jitter: float = 0.005  # of every other patch in training, relative to its radius
    scale: float = 0.2  # patches in training are scaled by up to this
    shift: float = 0.0  # and moved by up to this (thesis: 0.2)
    steps: int = 4400  # of training; 0 for as many as its seconds allow
    batch: int = 8  # patches of a step (thesis: 12)
    learning_rate: float = 1e-3  # of Adam
    decay: float = 0.05  # factor of the learning rate over the last fifth of training (thesis: 1)

    examples_by: ClassVar[tuple[str, ...]] = ("bases", "scans", "angle", "faces")
    trained_by: ClassVar[tuple[str, ...]] = (
        *("points", "bases", "scans", "angle", "faces", "triangles", "segments", "noise", "jitter", "scale", "shift"),
        *("steps", "batch", "learning_rate", "decay"),
    )

    def __post_init__(self) -> None:
        from .settings import check_training

        check_training(self)
        for name in ("faces", "triangles", "segments"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: expected at least 1, got {getattr(self, name)}")
        if self.overlap < 1.5:
            raise ValueError(f"overlap: expected at least 1.5 (half of a patch is upsampled), got {self.overlap}")
        if not 0 < self.angle < 180:
            raise ValueError(f"angle: expected a number of degrees above 0 and below 180, got {self.angle}")

    def examples(self, data: TrainingData, run: Run) -> Mapping[str, np.ndarray]:
        """Pairs of clouds of each shape, as of PU-Net; and the triangles and sharp edges of each shape."""
        from .training.clouds import pack
        from .training.edges import edged, pack_edged
        from .training.pairs import pairs_of

        surfaces, pairs = [], []
        for number, (case, of_case) in enumerate(pairs_of(data, run, self.bases, self.scans)):
            surfaces.append(edged(case.reference, self.faces, self.angle))
            pairs += [(number, pair) for pair in of_case]
        return pack(pairs) | pack_edged(surfaces)

    def fit(self, examples: Mapping[str, np.ndarray], run: Run) -> Mapping[str, np.ndarray]:
        """The weights of the network, by name."""
        import torch

        from .training.ec_training import Plan, Training

        torch.set_num_threads(run.threads)
        network = self._network(torch.Generator().manual_seed(run.seed)).to(run.device)
        run.parameters = sum(parameter.numel() for parameter in network.parameters())
        own = {name: getattr(self, name) for name in Plan.__dataclass_fields__}
        return Training(network, examples, Plan(**own), self._widening(), run).weights()

    prepare = staticmethod(load_compiled)

    def upsample(self, cloud: PointCloud, ratio: int, run: Run) -> PointCloud:
        """Exactly ``ratio`` times as many points.

        A ratio that is not a power of four is reached from the next power by thinning.
        """
        import torch

        from bench.geometry.check import check_points

        from ..learned.networks.loading import loaded
        from .networks.ec_network import cropped
        from .networks.pu_network import RATIO
        from .patches.cut import cut, cut_along
        from .patches.passes import in_passes

        check_points(cloud.points, "ec_net", at_least=1)
        torch.set_num_threads(run.threads)
        network = loaded(self._network(), run)
        # Patches overlap twice as much, since half of each is upsampled.
        points = in_passes(
            *(cloud.points, ratio, RATIO, self.points, 2 * self.overlap),
            *(lambda patches: network(patches)[0], run, self.central, cropped, cut_along if self.geodesic else cut),
        )
        return PointCloud(points)

    def _network(self, generator: Any = None) -> EcNetwork:
        from .networks.ec_network import EcNetwork

        return EcNetwork(self._widening(), generator)

    def _widening(self) -> float:
        return math.sqrt(1024 / self.points)
