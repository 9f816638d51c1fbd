"""Neural Cages: a network that puts a cage around a shape and deforms it to another shape."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from bench import PointCloud, Run, register

if TYPE_CHECKING:
    from trimesh import Trimesh

    from bench import TrainingData

    from .networks.cage_network import CageNetwork


@register("method", cite="Wang et al. 2020", requires=("torch", "safetensors", "scipy", "numba", "trimesh"))
@dataclass(frozen=True)
class NeuralCages:
    """Neural Cages (thesis 5.1): 577,158 parameters; a source takes the shape of a target by a cage of 42 vertices.

    From points of both shapes, a network moves the vertices of a template to a cage around the source, and those to
    the deformed cage; mean value coordinates move all vertices of the source along, so details stay. It learns from
    pairs of one category with a common orientation, without correspondences (``partners=false`` uses the given pairs,
    and their correspondences if there are any).
    """

    shapes: str = "chairs"  # a name for the training shapes; there are weights for chairs and for tables
    points: int = 512  # of a shape that the network and the losses see (Wang et al.: 1,024)
    code: int = 256  # size of the code of a shape
    cage: Literal["predicted", "invariant", "identity"] = "predicted"  # for each source, one learned cage, a sphere
    coordinates: Literal["mean_value", "green"] = "mean_value"  # of the source's vertices in the cage
    mvc: float = 1.0  # weight of Eq. 5.4, negative coordinates (released: 0.1)
    p2f: float = 0.1  # weight of Eq. 5.5, distances to neighbourhoods' planes
    normal: float = 0.1  # weight of Eq. 5.6, those planes' normals
    symmetry: float = 0.5  # weight of the distance to the mirror image at x = 0 (thesis: 0.1)
    laplacian: float = 0.0  # weight of the change of the uniform Laplacian, instead of p2f and normal (table 5.1)
    neighbours: int = 16  # of a neighbourhood
    stretch: float = 0.25  # in training, each axis of a shape is scaled by up to this share
    partners: bool = True  # a source's target in training is any other shape
    warm_up: float = 0.08  # share of the training in which cages do not change
    steps: int = 2000  # of training (Wang et al.: about 4,000); 0 for as many as its seconds allow
    batch: int = 4  # pairs of a step, each in both directions and the source to itself (Wang et al.: 8)
    learning_rate: float = 1e-3  # of Adam; a tenth of it for the cage
    decay: float = 0.01  # factor of the learning rate at the end of training

    examples_by: ClassVar[tuple[str, ...]] = ()
    trained_by: ClassVar[tuple[str, ...]] = (
        *(
            "shapes",
            "points",
            "code",
            "cage",
            "coordinates",
            "mvc",
            "p2f",
            "normal",
            "symmetry",
            "laplacian",
            "neighbours",
        ),
        *("stretch", "partners", "warm_up", "steps", "batch", "learning_rate", "decay"),
    )

    def __post_init__(self) -> None:
        for name, least in (("points", 16), ("code", 1), ("neighbours", 4), ("batch", 1), ("steps", 0)):
            if getattr(self, name) < least:
                raise ValueError(f"{name}: expected at least {least}, got {getattr(self, name)}")
        for name in ("mvc", "p2f", "normal", "symmetry", "laplacian"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name}: expected at least 0, got {getattr(self, name)}")
        for name in ("learning_rate", "decay"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: expected a number above 0, got {getattr(self, name)}")
        for name in ("stretch", "warm_up"):
            if not 0 <= getattr(self, name) < 1:
                raise ValueError(f"{name}: expected at least 0 and less than 1, got {getattr(self, name)}")

    def examples(self, data: TrainingData, run: Run) -> Mapping[str, np.ndarray]:
        """Points of the two surfaces of each pair."""
        from .training.pairs import pairs_of

        return pairs_of(data, run)

    def fit(self, examples: Mapping[str, np.ndarray], run: Run) -> Mapping[str, np.ndarray]:
        """The weights of the network, by name."""
        import torch

        from .training.fit import Plan, Training

        torch.set_num_threads(run.threads)
        network, faces = self._network(torch.Generator().manual_seed(run.seed))
        run.parameters = sum(parameter.numel() for parameter in network.parameters())
        own = {name: getattr(self, name) for name in Plan.__dataclass_fields__}
        return Training(network.to(run.device), faces, examples, Plan(**own), run).weights()

    def prepare(self) -> None:
        """Load the compiled loops, or compile them."""
        from .coordinates.mean_value import load_compiled

        load_compiled()

    def deform(self, source: Trimesh, target: Trimesh | PointCloud, run: Run) -> Trimesh:
        """The source with other vertices. The cages are stored as ``cage`` and ``deformed_cage``."""
        import torch

        from ..learned.networks.loading import loaded
        from .coordinates.deforming import deformed
        from .meshes.boxes import boxed
        from .meshes.round_cages import cage_mesh

        torch.set_num_threads(run.threads)
        network, faces = self._network()
        network = loaded(network, run)
        pair = boxed(source, target, max(self.points, 1024), run.rng)
        with torch.no_grad():
            clouds = (torch.from_numpy(cloud).float()[None].to(run.device) for cloud in (pair.source, pair.target))
            cage, moved = (vertices.double() for vertices in network(*clouds))
            vertices = torch.from_numpy(pair.vertices)[None].to(run.device)
            vertices, _ = deformed(vertices, cage, faces, moved, self.coordinates, run.threads)
        for name, place in (("cage", cage), ("deformed_cage", moved)):
            run.keep(name, lambda place=place: cage_mesh(pair.scale * place[0].cpu().numpy() + pair.centre, faces))
        return pair.restored(source, vertices[0].cpu().numpy())

    def _network(self, generator: Any = None) -> tuple[CageNetwork, np.ndarray]:
        import torch

        from .meshes.round_cages import sphere_cage
        from .networks.cage_network import CageNetwork

        template, faces = sphere_cage()
        return CageNetwork(torch.from_numpy(template).float(), self.code, self.cage, generator), faces
