"""Points2Surf: a network predicts signed distances from points around each query."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from bench import BadInput, PointCloud, Run, register

if TYPE_CHECKING:
    from trimesh import Trimesh

    from bench import TrainingData

    from .networks.surface_network import SurfaceNetwork

SHARE = 0.8  # of the remaining time may be used for evaluating the network
LEAST = 16  # nodes along the longest side, even if the time is too short


@register("method", cite="after Erler et al. 2020", requires=("torch", "safetensors", "scipy", "skimage", "trimesh"))
@dataclass(frozen=True)
class Points2surf:
    """After Points2Surf (Erler et al. 2020), trained at a hundredth of its size, for a quarter of an hour.

    A network is evaluated at the nodes of a grid near the points: from the nearest points and a random part of all, it
    predicts the distance to the surface, and the side. Signs are propagated to the other nodes, and marching cubes give
    the surface. Needs no normals. ``width=1024``, ``turn`` and ``transforms`` make the published network of 6,167,814
    parameters.

    Ours: the width, no transforms by default, 96 points of a patch (theirs: 300) and 256 of the cloud (theirs: 1,000),
    which all queries of a cloud share, the shapes, random rotations and reflections in training, Adam, a distance that
    is not squared, and training queries only near the surface.
    """

    width: int = 176  # channels of the pooled features (theirs: 1024); all others are in proportion
    turn: bool = False  # whether a rotation is predicted from the patch (theirs: yes, except for the variant "max")
    transforms: bool = False  # whether features are multiplied by a matrix predicted from them (theirs: yes)
    points: int = 96  # of a patch, those nearest to a query (theirs: 300)
    subsample: int = 256  # points of the whole cloud (theirs: 1,000)
    near: bool = False  # whether a query has its own subsample, denser near it (theirs: yes, except for "max")
    resolution: int = 64  # nodes along the longest side (theirs: 256)
    counts: tuple[int, int] = (2000, 12000)  # least and largest number of points of a cloud in training
    noise: tuple[float, float] = (0.001, 0.02)  # least and largest in training, relative to the radius of the shape
    steps: int = 5000  # of training; 0 for as many as its seconds allow
    batch: int = 64  # queries of a step
    learning_rate: float = 2e-3  # of Adam
    decay: float = 0.02  # factor of the learning rate over the last half of training

    examples_by: ClassVar[tuple[str, ...]] = ()
    trained_by: ClassVar[tuple[str, ...]] = (
        *("width", "turn", "transforms", "points", "subsample", "near"),
        *("counts", "noise", "steps", "batch", "learning_rate", "decay"),
    )

    def __post_init__(self) -> None:
        for name, least in (("width", 16), ("points", 8), ("subsample", 8), ("resolution", LEAST), ("steps", 0)):
            if getattr(self, name) < least:
                raise ValueError(f"{name}: expected at least {least}, got {getattr(self, name)}")
        if self.batch < 2:
            raise ValueError(f"batch: expected at least 2, got {self.batch}")
        for name in ("learning_rate", "decay"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: expected a number above 0, got {getattr(self, name)}")
        for name in ("counts", "noise"):
            if not 0 < getattr(self, name)[0] <= getattr(self, name)[1]:
                raise ValueError(f"{name}: expected two numbers above 0, the smaller first, got {getattr(self, name)}")

    def examples(self, data: TrainingData, run: Run) -> Mapping[str, np.ndarray]:
        """Points of each shape without noise, and true signed distances of queries near it."""
        from .training.surfaces import surfaces_of

        return surfaces_of(data, run)

    def fit(self, examples: Mapping[str, np.ndarray], run: Run) -> Mapping[str, np.ndarray]:
        """The weights of the network, by name."""
        import torch

        from .training.surface_training import Plan, Training

        torch.set_num_threads(run.threads)
        network = self._network(torch.Generator().manual_seed(run.seed)).to(run.device)
        run.parameters = sum(parameter.numel() for parameter in network.parameters())
        own = {name: getattr(self, name) for name in Plan.__dataclass_fields__}
        return Training(network, examples, Plan(**own), run).weights()

    def reconstruct(self, cloud: PointCloud, run: Run) -> Trimesh:
        """A closed surface, outward."""
        import torch

        from bench.geometry.check import check_points

        from ..learned.networks.loading import loaded
        from .queries.asking import Asking
        from .training.surfaces import radius_of

        check_points(cloud.points, "points2surf", at_least=8)
        torch.set_num_threads(run.threads)
        points = np.array(cloud.points, dtype=np.float64)
        if not np.ptp(points, axis=0).max() > 0:
            raise BadInput(f"points2surf: all {len(points)} points coincide; expected points of a surface")
        settings = (radius_of(points), self.points, self.subsample, self.near, run)
        ask = Asking(loaded(self._network(), run), points, *settings)
        grid = self._grid(ask, points, run)
        return grid.mesh(ask(grid.places))

    def _grid(self, ask: Any, points: np.ndarray, run: Run) -> Any:
        """The finest grid for which there is time, estimated from the time for some of its nodes."""
        from .queries.grid import Grid

        resolution, grid = self.resolution, Grid.around(points, self.resolution)
        some = grid.places[:256]
        ask(some[:2])  # warm-up: the first call is slow
        started = time.perf_counter()
        ask(some)
        each = (time.perf_counter() - started) / len(some)
        while each * grid.asked.sum() > SHARE * run.seconds_left() and resolution > LEAST:
            resolution = max(LEAST, resolution // 2)
            grid = Grid.around(points, resolution)
        if resolution < self.resolution:
            run.note(f"points2surf: a resolution of {resolution} instead of {self.resolution}, for lack of time")
        return grid

    def _network(self, generator: Any = None) -> SurfaceNetwork:
        from .networks.surface_network import SurfaceNetwork

        return SurfaceNetwork(self.width, self.turn, self.transforms, generator)
