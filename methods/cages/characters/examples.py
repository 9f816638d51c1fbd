"""The training set of characters: posed targets as clouds, and the positions of the template's vertices in them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from bench import UsageError

from ...learned.training.held_out import held_out_rows
from .body_cage import body_cage

if TYPE_CHECKING:
    from bench import Run, TrainingData

FULL = 32767  # the largest integer of a coordinate
POINTS = 2048  # of a target
VERTICES = 1500  # of the template, at most


def poses_of(data: TrainingData, run: Run, cage_vertices: int) -> dict[str, np.ndarray]:
    """Clouds of targets and vertices of the posed template, each around its own box centre, in the template's unit.

    That unit is half of the longest edge of the template's box at rest.

    Returns
    -------
    dict
        ``targets`` (poses, 2048, 3) and ``posed`` (poses, v, 3), int16 in units of ``scale``; ``rest`` (v, 3), the same
        vertices of the template at rest; ``cage`` (n, 3) and ``cage_faces``.
    """
    from bench import PointCloud, generator
    from bench.geometry.sampling import sample_uniform

    targets, posed = [], []
    rest: np.ndarray | None = None
    for number, case in enumerate(data.cases):
        template, target = case.input["template"], case.input["target"]
        rng = generator(data.seed, case.id, "points")
        unit = half_edge(template.vertices)
        vertices = template.vertices / unit
        if rest is None:
            rows = np.sort(rng.permutation(len(vertices))[:VERTICES])
            rest = vertices[rows]
            cage, faces = body_cage(type(template)(vertices, template.faces, process=False), cage_vertices)
        elif len(vertices) <= rows.max() or np.abs(vertices[rows] - rest).max() > 1e-6:
            raise UsageError("character_cages: the training has several templates; expected one for all cases")
        if isinstance(target, PointCloud):
            points = target.points[rng.permutation(len(target.points))[:POINTS]]
            points = points[rng.integers(len(points), size=POINTS)] if len(points) < POINTS else points
        else:
            points = sample_uniform(target, POINTS, rng)[0]
        targets.append(points / unit)
        posed.append(case.reference.attributes["template_posed"][rows] / unit)
        run.progress(number + 1, data.count)
    scale = float(max(np.abs(targets).max(), np.abs(posed).max())) / FULL
    small = {
        name: np.round(np.array(value) / scale).astype(np.int16)
        for name, value in (("targets", targets), ("posed", posed))
    }
    assert rest is not None  # there is at least one case
    return small | {"scale": np.array(scale), "rest": rest, "cage": cage, "cage_faces": faces}


def half_edge(vertices: np.ndarray) -> float:
    """Half of the longest edge of the box of vertices (v, 3)."""
    return float(np.ptp(vertices, axis=0).max() / 2)


class Poses:
    """The examples of :func:`poses_of`.

    Parameters
    ----------
    examples : mapping
    held_out : bool
        Take the last tenth of the poses, at least one; otherwise the others (all, if there is only one).
    """

    def __init__(self, examples: Mapping[str, np.ndarray], held_out: bool = False):
        rows = held_out_rows(len(examples["targets"]), held_out)
        self._targets, self._posed = examples["targets"][rows], examples["posed"][rows]
        self._scale = np.float32(examples["scale"])

    def __len__(self) -> int:
        return len(self._targets)

    def drawn(self, numbers: np.ndarray, points: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Clouds (b, points, 3) and the template's vertices (b, v, 3) of poses by their numbers (b,), float32."""
        rows = rng.integers(self._targets.shape[1], size=points)
        return self._targets[numbers[:, None], rows] * self._scale, self._posed[numbers] * self._scale
