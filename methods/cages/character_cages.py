"""Neural Cages for characters: a network trained on one body poses others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from bench import PointCloud, Run, register

if TYPE_CHECKING:
    from trimesh import Trimesh

    from bench import TrainingData


HELD = 0.98  # of the template's vertices that its cage must enclose: rounding to half precision may cut off a few


@register("method", cite="Wang et al. 2020", requires=("torch", "safetensors", "numba", "open3d", "skimage", "trimesh"))
@dataclass(frozen=True)
class CharacterCages:
    """Neural Cages for characters (thesis 5.1.2): 1,362,023 parameters; a cage learned on one body poses others.

    From a posed target, a network moves the cage of a template, the body that it was trained on with correspondences.
    For another character the template's cage is fitted by landmarks, so that they have the same mean value coordinates
    in it (Eq. 5.7), while its shape stays smooth (Eq. 5.8); the template's offsets then move that cage. The network
    learns only the pose, not the body shape of the target (released: both). The template is that of the training.
    """

    cage_vertices: int = 77  # approximate number, of the template's cage (the other cage of Wang et al. has 126)
    code: int = 512  # size of the code of a target
    points: int = 1024  # of the target that the network sees (released: 2,048)
    worst: float = 0.1  # weight of each pose's largest squared distance, relative to the mean (released: 1)
    steps: int = 12000  # of training; 0 for as many as its seconds allow
    batch: int = 16  # poses of a step (released: 4)
    learning_rate: float = 1e-3  # of Adam
    decay: float = 0.01  # factor of the learning rate at the end of training
    fit_steps: int = 600  # of the fit of the cage to a character (released: 3,000 to 8,000)
    fit_rate: float = 2e-3  # learning rate of that fit, in halves of the template's longest edge
    fit_laplacian: float = 0.05  # weight of Eq. 5.8 (released: 0.05 and 0.1)

    examples_by: ClassVar[tuple[str, ...]] = ("cage_vertices",)
    trained_by: ClassVar[tuple[str, ...]] = (
        *("cage_vertices", "code", "points", "worst", "steps", "batch", "learning_rate", "decay"),
    )

    def __post_init__(self) -> None:
        least = {"cage_vertices": 20, "code": 1, "points": 16, "batch": 1, "steps": 0, "fit_steps": 1}
        for name, number in least.items():
            if getattr(self, name) < number:
                raise ValueError(f"{name}: expected at least {number}, got {getattr(self, name)}")
        for name in ("worst", "fit_laplacian"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name}: expected at least 0, got {getattr(self, name)}")
        for name in ("learning_rate", "decay", "fit_rate"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: expected a number above 0, got {getattr(self, name)}")

    def examples(self, data: TrainingData, run: Run) -> Mapping[str, np.ndarray]:
        """Targets, the posed template, and a cage around it at rest."""
        from .characters.examples import poses_of

        return poses_of(data, run, self.cage_vertices)

    def fit(self, examples: Mapping[str, np.ndarray], run: Run) -> Mapping[str, np.ndarray]:
        """The weights of the network, by name, and its cage."""
        import torch

        from .characters.training import Plan, PoseTraining
        from .networks.cage_network import PoseNetwork

        torch.set_num_threads(run.threads)
        generator = torch.Generator().manual_seed(run.seed)
        network = PoseNetwork(torch.from_numpy(np.array(examples["cage"])).float(), self.code, generator)
        run.parameters = sum(parameter.numel() for parameter in network.parameters())
        own = {name: getattr(self, name) for name in Plan.__dataclass_fields__}
        weights = PoseTraining(network.to(run.device), examples, Plan(**own), run).weights()
        return {**weights, "cage_faces": np.array(examples["cage_faces"], dtype=np.int32)}

    def prepare(self) -> None:
        """Load the compiled loops, or compile them."""
        from .coordinates.mean_value import load_compiled

        load_compiled()

    def pose_transfer(
        self,
        source: Trimesh,
        template: Trimesh,
        landmarks: Mapping[str, np.ndarray],
        target: Trimesh | PointCloud,
        run: Run,
    ) -> Trimesh:
        """The character in the pose. Its cages are stored as ``cage`` and ``deformed_cage``."""
        import torch

        from bench.geometry.used import used_vertices
        from bench.geometry.winding import inside

        from .characters.posing import Posing, target_points
        from .networks.cage_network import PoseNetwork

        torch.set_num_threads(run.threads)
        weights = run.weights
        assert weights is not None  # a method that learns from examples always has them
        faces = np.array(weights["cage_faces"], dtype=np.int64)
        cage = np.array(weights["cage"], dtype=np.float64)
        network = PoseNetwork(torch.from_numpy(cage).float(), self.code)
        run.parameters = sum(parameter.numel() for parameter in network.parameters())
        network.load_state_dict(
            {name: torch.from_numpy(np.array(a)).float() for name, a in weights.items() if name != "cage_faces"}
        )
        network = network.to(run.device).eval().requires_grad_(False)
        posing = Posing(source, template, landmarks, run)
        if inside(cage, faces, used_vertices(template) / posing.unit).mean() < HELD:
            run.note("the cage does not enclose the template: weights fit only the template of their training")
        points = target_points(target, max(self.points, 2048), run.rng) / posing.unit
        moved = network(torch.from_numpy(points).float()[None].to(run.device))[0].double().cpu().numpy()
        return posing.posed(cage, faces, moved - cage, self.fit_steps, self.fit_rate, self.fit_laplacian)
