"""One cage for one pair of shapes, optimised by gradient descent: the baseline of the networks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from bench import PointCloud, Run, register

if TYPE_CHECKING:
    import numpy as np
    from trimesh import Trimesh

    from .training.one_pair import Settings


@register("method", cite="baseline of Wang et al. 2020", requires=("torch", "scipy", "numba", "trimesh"))
@dataclass(frozen=True)
class CagePerPair:
    """Minimises the loss of Neural Cages for one pair (figure 5.11) over the vertices of the deformed cage.

    The source cage is a fixed sphere about the source's box; the loss is the Chamfer distance between points
    of both surfaces plus shape terms (Eq. 5.5, 5.6 and symmetry). It has no knowledge of the category: a leg of a chair
    moves to the nearest part.

    A character is posed (``pose_transfer``) by the cage of the template, which is optimised towards the target in the
    same way, and then as by ``character_cages``: the cage is fitted to the character by landmarks, and moved by the
    offsets.
    """

    subdivisions: int = 1  # of the cage: 12, 42, 162, ... vertices
    radius: float = 1.8  # of the cage, in halves of the target's longest edge: the corners of that box are at 1.73
    coordinates: Literal["mean_value", "green", "harmonic"] = "mean_value"  # of the source in the cage
    points: int = 1024  # of each surface, drawn again every few steps
    redraw: int = 10  # steps between draws
    p2f: float = 0.1  # weight of Eq. 5.5
    normal: float = 0.1  # weight of Eq. 5.6
    symmetry: float = 0.0  # weight of the distance to the mirror image at x = 0
    neighbours: int = 16  # of a neighbourhood
    steps: int = 300
    learning_rate: float = 0.02  # of Adam; it falls to a tenth over the last half
    cage_vertices: int = 77  # approximate number, of the cage around the template of a pose transfer

    def __post_init__(self) -> None:
        for name, least in (
            ("subdivisions", 0),
            ("points", 16),
            ("redraw", 1),
            ("neighbours", 4),
            ("steps", 1),
            ("cage_vertices", 20),
        ):
            if getattr(self, name) < least:
                raise ValueError(f"{name}: expected at least {least}, got {getattr(self, name)}")
        for name in ("p2f", "normal", "symmetry"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name}: expected at least 0, got {getattr(self, name)}")
        for name in ("learning_rate", "radius"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: expected a number above 0, got {getattr(self, name)}")

    def prepare(self) -> None:
        """Load the compiled loops, or compile them."""
        from .coordinates.mean_value import load_compiled

        load_compiled()

    def deform(self, source: Trimesh, target: Trimesh | PointCloud, run: Run) -> Trimesh:
        """The source with other vertices. The cages are stored as ``cage`` and ``deformed_cage``."""
        import torch

        from .meshes.boxes import boxed
        from .meshes.round_cages import ball_cage, cage_mesh
        from .training.one_pair import Descent

        torch.set_num_threads(run.threads)
        pair = boxed(source, target, 16 * self.points, run.rng)
        cage, faces = ball_cage(self.subdivisions, self.radius)
        descent = Descent(self._settings(), pair, cage, faces, run)
        moved = descent.run()
        for name, place in (("cage", cage), ("deformed_cage", moved)):
            run.keep(name, lambda place=place: cage_mesh(pair.scale * place + pair.centre, faces))
        return pair.restored(source, descent.deformed(pair.vertices))

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

        from .characters.body_cage import body_cage
        from .characters.posing import Posing
        from .meshes.boxes import boxed
        from .training.one_pair import Descent

        torch.set_num_threads(run.threads)
        posing = Posing(source, template, landmarks, run)
        pair = boxed(template, target, 16 * self.points, run.rng)
        unit = pair.scale / posing.unit  # the unit of the descent, in that of the transfer
        cage, faces = body_cage(pair.restored(template, pair.vertices - pair.centre / pair.scale), self.cage_vertices)
        cage = cage / pair.scale
        offsets = Descent(self._settings(), pair, cage, faces, run).run() - cage
        return posing.posed(unit * cage, faces, unit * offsets)

    def _settings(self) -> Settings:
        from .training.one_pair import Settings

        return Settings(**{name: getattr(self, name) for name in Settings.__dataclass_fields__})
