"""Deformation transfer: the deformation of each triangle of a template, applied to triangles of a character."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from bench import BadInput, PointCloud, Run, register

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("method", cite="Sumner and Popović 2004", requires=("scipy", "trimesh"))
@dataclass(frozen=True)
class DeformationTransfer:
    """Transfers deformation gradients of the template's triangles to the character's, joined by a Poisson equation.

    After Sumner and Popović 2004. The posed template must be known vertex by vertex (``task.target=corresponding``);
    for any other target the template is registered to it first, as rigidly as possible, which finds only near poses.
    Corresponding triangles are found by mapping the template at rest onto the character with the thin-plate spline
    of the landmarks, and taking the nearest triangles whose normals agree (the paper also fits the meshes to each
    other). Disconnected parts of a character are joined by weak springs; the paper has none.
    """

    partners: int = 3  # triangles of the template whose mean gradient a triangle of the character gets
    registration: Literal["arap", "nonrigid_icp"] = "arap"  # of the template, if its posed vertices are not given
    reach: float = 0.1  # vertices of different parts within this distance are joined by a spring
    joint: float = 0.1  # the weight of a spring; an edge between regular triangles has 0.58

    def __post_init__(self) -> None:
        if self.partners < 1:
            raise ValueError(f"partners: expected at least 1, got {self.partners}")
        if self.registration not in ("arap", "nonrigid_icp"):
            raise ValueError(f"registration: expected arap or nonrigid_icp, got {self.registration!r}")
        for name in ("reach", "joint"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: expected more than 0, got {getattr(self, name)}")

    def pose_transfer(
        self,
        source: Trimesh,
        template: Trimesh,
        landmarks: Mapping[str, np.ndarray],
        target: Trimesh | PointCloud,
        run: Run,
    ) -> Trimesh:
        """The character in the pose.

        Raises
        ------
        BadInput
            For fewer than four landmarks, or landmarks that lie in a plane.
        """
        from .registration.gradients import corresponding_faces, deformation_gradients
        from .registration.poisson import Poisson
        from .registration.welded import Welded

        posed = self._posed(template, target, run)
        gradients = deformation_gradients(template.vertices, posed, template.faces)
        welded = Welded(source, self.reach, self.joint)
        there, here = _places(landmarks)
        partners = corresponding_faces(template, there, here, welded.vertices, welded.faces, self.partners)
        return welded.mesh(source, Poisson(welded).solve(gradients[partners].mean(axis=1)))

    def _posed(self, template: Trimesh, target: Trimesh | PointCloud, run: Run) -> np.ndarray:
        """The template's vertices (v, 3) in the pose."""
        if not isinstance(target, PointCloud) and np.array_equal(target.faces, template.faces):
            return np.asarray(target.vertices)
        from .arap import Arap
        from .nonrigid_icp import NonrigidIcp

        run.note("the posed template is not given (task.target=corresponding): it is registered to the target")
        registration = Arap() if self.registration == "arap" else NonrigidIcp()
        return np.asarray(registration.deform(template, target, run).vertices)


def _places(landmarks: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    there, here = (np.array([places[k] for places in landmarks.values()]).reshape(-1, 3) for k in (0, 1))
    spread = np.linalg.svd(there - there.mean(axis=0), compute_uv=False) if len(there) > 3 else np.zeros(3)
    if spread[2] <= 1e-6 * max(spread[0], 1e-300):
        raise BadInput(f"the landmarks: expected at least four that do not lie in a plane, got {len(there)}")
    return there, here
