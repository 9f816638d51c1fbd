"""KeypointDeformer: unsupervised keypoints, and a cage that follows them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from bench import PointCloud, Run, register

if TYPE_CHECKING:
    from trimesh import Trimesh

    from bench import TrainingData

    from .networks.keypoint_network import KeypointNetwork


@register("method", cite="after Jakab et al. 2021", requires=("torch", "safetensors", "scipy", "numba", "trimesh"))
@dataclass(frozen=True)
class KeypointDeformer:
    """After KeypointDeformer (Jakab et al. 2021): 485,652 parameters; a source follows unsupervised keypoints.

    The paper's idea: one network predicts ordered keypoints of both shapes; the vertices of a cage around the source
    move by the keypoints' differences times an influence, the sum of a canonical matrix and of an offset that is
    predicted for each source; mean value coordinates carry the source along. The loss has the Chamfer distances from
    the deformed source to the target and from keypoints to farthest points of their shape, and the squared norm of the
    offset. The cage is a shrunk sphere.

    Ours: a keypoint moves only the nearest vertices; fewer points, smaller encoders without batch normalisation, and
    weights of the terms for them; the cage is shrunk in closed form, and leaves no point outside; influences start at
    0, and the canonical one has ten times the learning rate; a term for symmetry at x = 0, as in Neural Cages, also of
    the keypoints; pairs are trained in both directions, and stretched. The released code was not consulted.

    It learns from pairs of one category with a common orientation, without correspondences (``partners=false``
    uses the given pairs, and their correspondences if there are any). It comes without weights.
    """

    keypoints: int = 12  # of a shape (Jakab et al.: 12 for chairs, 8 for airplanes)
    points: int = 512  # of a shape that the network and the losses see
    code: int = 256  # size of the code of a shape
    subdivisions: int = 1  # of the cage: 12, 42, 162, ... vertices
    gap: float = 0.4  # between the source and its cage, in halves of the target's longest edge
    influenced: int = 14  # vertices of the cage that a keypoint moves; 0 for all
    farthest: float = 0.2  # weight of the Chamfer distance between keypoints and farthest points
    offset: float = 1e-3  # weight of the squared norm of the offset of the influence
    symmetry: float = 0.1  # weight of the distances to the mirror image at x = 0
    stretch: float = 0.25  # in training, each axis of a shape is scaled by up to this share
    partners: bool = True  # a source's target in training is any other shape
    warm_up: float = 0.05  # share of the training in which keypoints approach farthest points, and nothing moves
    steps: int = 2000  # of training; 0 for as many as its seconds allow
    batch: int = 4  # pairs of a step, each in both directions
    learning_rate: float = 1e-3  # of Adam; ten times it for the canonical influence
    decay: float = 0.01  # factor of the learning rate at the end of training

    examples_by: ClassVar[tuple[str, ...]] = ()
    trained_by: ClassVar[tuple[str, ...]] = (
        *("keypoints", "points", "code", "subdivisions", "gap", "influenced", "farthest", "offset", "symmetry"),
        *("stretch", "partners", "warm_up", "steps", "batch", "learning_rate", "decay"),
    )

    def __post_init__(self) -> None:
        least = {"points": 16, "code": 1, "subdivisions": 0, "influenced": 0, "batch": 1, "steps": 0}
        for name, number in least.items():
            if getattr(self, name) < number:
                raise ValueError(f"{name}: expected at least {number}, got {getattr(self, name)}")
        if not 1 <= self.keypoints <= self.points:
            raise ValueError(f"keypoints: expected 1 to {self.points} (points), got {self.keypoints}")
        for name in ("farthest", "offset", "symmetry"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name}: expected at least 0, got {getattr(self, name)}")
        for name in ("gap", "learning_rate", "decay"):
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

        from .training.keypoints import KeypointTraining, Plan

        torch.set_num_threads(run.threads)
        network = self._network(torch.Generator().manual_seed(run.seed))
        run.parameters = sum(parameter.numel() for parameter in network.parameters())
        own = {name: getattr(self, name) for name in Plan.__dataclass_fields__}
        return KeypointTraining(network.to(run.device), examples, Plan(**own), run).weights()

    def prepare(self) -> None:
        """Load the compiled loops, or compile them."""
        from .coordinates.mean_value import load_compiled

        load_compiled()

    def deform(self, source: Trimesh, target: Trimesh | PointCloud, run: Run) -> Trimesh:
        """The source with other vertices.

        Stored are the cages, as ``cage`` and ``deformed_cage``, and the keypoints of the source and of the target, as
        ``keypoints`` and ``deformed_keypoints``.
        """
        import torch

        from ..learned.networks.loading import loaded
        from .coordinates.mean_value import mean_value_coordinates
        from .meshes.boxes import boxed
        from .meshes.round_cages import cage_mesh

        torch.set_num_threads(run.threads)
        network = loaded(self._network(), run)
        pair = boxed(source, target, max(self.points, 1024), run.rng)
        with torch.no_grad():
            clouds = (torch.from_numpy(cloud).float()[None].to(run.device) for cloud in (pair.source, pair.target))
            keyed = network(*clouds)
            faces = network.faces.cpu().numpy()
            cage, moved = keyed.cage.double(), keyed.moved.double()
            vertices = torch.from_numpy(pair.vertices)[None].to(run.device)
            vertices = mean_value_coordinates(vertices, cage, faces, run.threads) @ moved

        def placed(tensor: torch.Tensor) -> np.ndarray:
            return pair.scale * tensor[0].double().cpu().numpy() + pair.centre

        for name, corners in (("cage", cage), ("deformed_cage", moved)):
            run.keep(name, lambda corners=corners: cage_mesh(placed(corners), faces))
        for name, points in (("keypoints", keyed.keypoints), ("deformed_keypoints", keyed.wanted)):
            run.keep(name, lambda points=points: PointCloud(placed(points)))
        return pair.restored(source, vertices[0].cpu().numpy())

    def _network(self, generator: Any = None) -> KeypointNetwork:
        import torch

        from .meshes.round_cages import ball_cage
        from .networks.keypoint_network import KeypointNetwork

        directions, faces = (torch.from_numpy(array) for array in ball_cage(self.subdivisions, 1.0))
        arguments = self.keypoints, self.code, self.gap, self.influenced
        return KeypointNetwork(directions.float(), faces.long(), *arguments, generator)
