"""The training set: points of the two surfaces of each pair."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ...learned.training.held_out import held_out_rows

if TYPE_CHECKING:
    from bench import Case, Run, TrainingData

FULL = 32767  # the largest integer of a coordinate
POINTS = 4096  # of each surface


def pairs_of(data: TrainingData, run: Run) -> dict[str, np.ndarray]:
    """Points of source and target of each pair, around their box centres, in halves of the target's longest edge.

    If both have the same faces, point i of one corresponds to point i of the other.

    Returns
    -------
    dict
        ``points`` (pairs, 2, 4096, 3) int16; ``scale``, the unit of those; ``corresponding`` (pairs,) bool.
    """
    from bench import generator

    clouds, known = [], []
    for number, case in enumerate(data.cases):
        source, target, same = _sampled(case, generator(data.seed, case.id, "surfaces"))
        clouds.append((source, target))
        known.append(same)
        run.progress(number + 1, data.count)
    points = np.array(clouds)
    scale = float(np.abs(points).max()) / FULL
    return {
        "points": np.round(points / scale).astype(np.int16),
        "scale": np.array(scale),
        "corresponding": np.array(known),
    }


def _sampled(case: Case, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, bool]:
    from bench.geometry.sampling import sample_uniform
    from bench.geometry.used import used_vertices

    source, reference = case.input["source"], case.reference
    same = np.array_equal(source.faces, reference.mesh.faces)
    theirs = used_vertices(reference.mesh)
    low, extent = theirs.min(axis=0), np.ptp(theirs, axis=0)
    if same:
        face = rng.choice(len(source.faces), POINTS, p=source.area_faces / source.area)
        weights = rng.dirichlet((1.0, 1.0, 1.0), POINTS)
        clouds = [
            np.einsum("pk,pka->pa", weights, mesh.vertices[mesh.faces[face]]) for mesh in (source, reference.mesh)
        ]
    else:
        clouds = [sample_uniform(source, POINTS, rng)[0], reference.surface.sample(POINTS, rng)[0]]
    unit = extent.max() / 2
    return clouds[0] / unit, (clouds[1] - low - extent / 2) / unit, same


class Pairs:
    """The examples of :func:`pairs_of`.

    Parameters
    ----------
    examples : mapping
    held_out : bool
        Take the last tenth of the pairs, at least one; otherwise the others (all, if there is only one).
    """

    def __init__(self, examples: Mapping[str, np.ndarray], held_out: bool = False):
        rows = held_out_rows(len(examples["points"]), held_out)
        self._points, self._scale = examples["points"][rows], float(examples["scale"])
        self.corresponding = bool(np.all(examples["corresponding"]))

    def __len__(self) -> int:
        return len(self._points)

    def drawn(
        self, number: int, points: int, stretch: float, partners: bool, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Draw clouds (points, 3) float32 of a source and a target.

        Parameters
        ----------
        number : int
            Of the pair.
        points : int
        stretch : float
            Each axis of each shape is scaled up or down by at most this share; then the shape fits the box again.
        partners : bool
            The target is any shape of any pair; otherwise that of the pair, point by point if they correspond.
        """
        rows = rng.integers(self._points.shape[2], size=points)
        source = self._points[number, 0, rows]
        if partners:
            other, side = rng.integers(len(self)), rng.integers(2)
            target = self._points[other, side, rng.integers(self._points.shape[2], size=points)]
        else:
            target = self._points[number, 1, rows if self.corresponding else rng.permutation(rows)]
        return self._stretched(source, stretch, rng), self._stretched(target, stretch, rng)

    def _stretched(self, cloud: np.ndarray, stretch: float, rng: np.random.Generator) -> np.ndarray:
        cloud = cloud * np.float32(self._scale)
        if not stretch:
            return cloud
        cloud = cloud * rng.uniform(1 - stretch, 1 + stretch, 3).astype(np.float32)
        low, high = cloud.min(axis=0), cloud.max(axis=0)
        return (cloud - (low + high) / 2) * (2 / (high - low).max())
