"""A character that follows the deformation of a template's cage."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from bench import BadInput, PointCloud, Run

from ..coordinates.mean_value import mean_value_coordinates
from ..meshes.round_cages import cage_mesh
from .examples import half_edge
from .fitting import LAPLACIAN, RATE, STEPS, fitted

if TYPE_CHECKING:
    from trimesh import Trimesh

LANDMARKS = 8  # at least: fewer hardly constrain a cage


class Posing:
    """Template and character in the unit of the template, half of the longest edge of its box.

    The character is scaled to the height of the template, as in the thesis.

    Parameters
    ----------
    source : Trimesh
        The character at rest, upright along z, its box centre at the origin.
    template : Trimesh
        The same of the template.
    landmarks : mapping
        (2, 3) arrays, on template and character.
    run : Run
    """

    def __init__(self, source: Trimesh, template: Trimesh, landmarks: Mapping[str, np.ndarray], run: Run):
        from bench.geometry.used import used_vertices

        if len(landmarks) < LANDMARKS:
            raise BadInput(f"the landmarks: expected at least {LANDMARKS}, got {len(landmarks)}")
        self.unit = half_edge(used_vertices(template))
        heights = [np.ptp(used_vertices(mesh)[:, 2]) for mesh in (template, source)]
        if not min(heights) > 0:
            raise BadInput("template and character: expected a height along z, got a flat one")
        self._scale = float(heights[0] / heights[1]) / self.unit
        self._source, self._run = source, run
        there, here = np.array(list(landmarks.values()), dtype=np.float64).transpose(1, 0, 2)
        self._there, self._here = there / self.unit, here * self._scale

    def posed(
        self,
        cage: np.ndarray,
        faces: np.ndarray,
        offsets: np.ndarray,
        steps: int = STEPS,
        rate: float = RATE,
        laplacian: float = LAPLACIAN,
    ) -> Trimesh:
        """The character posed by the template's cage (n, 3), fitted to it and moved by ``offsets`` (n, 3)."""
        import torch

        run = self._run
        own = fitted(cage, faces, self._there, self._here, run, steps=steps, learning_rate=rate, laplacian=laplacian)
        vertices = torch.from_numpy(np.array(self._source.vertices, dtype=np.float64) * self._scale)[None]
        weights = mean_value_coordinates(vertices, torch.from_numpy(own)[None], faces, run.threads)[0].numpy()
        output = self._source.copy()
        output.vertices = weights @ (own + offsets) / self._scale
        for name, place in (("cage", own), ("deformed_cage", own + offsets)):
            run.keep(name, lambda place=place: cage_mesh(place / self._scale, faces))
        return output


def target_points(target: Trimesh | PointCloud, count: int, rng: np.random.Generator) -> np.ndarray:
    """At most ``count`` points of a target (n, 3), relative to the centre of its own box."""
    from bench.geometry.sampling import sample_uniform

    if isinstance(target, PointCloud):
        points = target.points if len(target) <= count else target.points[rng.permutation(len(target))[:count]]
        low, high = target.points.min(axis=0), target.points.max(axis=0)
    else:
        points = sample_uniform(target, count, rng)[0]
        low, high = points.min(axis=0), points.max(axis=0)
    return points - (low + high) / 2
