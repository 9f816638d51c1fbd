"""The distances of the DTU multi-view benchmark, in the units of the reference's file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import Case, PointCloud, generator, register
from bench.geometry.io.dtu import LOW_HIGH, MASK, PLANE, STEP
from bench.geometry.neighbours import OrderedPoints
from bench.geometry.thinning import grids_on, thinned

if TYPE_CHECKING:
    from trimesh import Trimesh


@register(
    "metric",
    version=1,
    length="file",
    better="lower",
    outputs=("mesh", "cloud"),
    floor=True,
    requires=("scipy", "pykdtree"),
)
@dataclass(frozen=True)
class DtuDistances:
    """Accuracy, completeness and their mean as the DTU benchmark measures them, in the units of its files (mm).

    The output is thinned until no two points are within ``thin`` of each other; a mesh is first sampled with a grid of
    this spacing on each triangle, and at its vertices. ``dtu_accuracy``: the mean distance to the nearest reference
    point, over the output points in observed cells of the mask. ``dtu_completeness``: the mean distance of the
    reference points above the ground plane to the nearest output point, among those in the box of the mask, widened by
    ``margin`` below and twice that above. ``dtu_overall``: the mean of both. Distances of ``cut`` and more are left
    out, so a part that is missing altogether does not count; inf where none is left. ``..._median``: of the same
    distances. After the MATLAB code of Aanaes et al. 2016 and DTUeval-python, which agrees with it to 0.02 %.

    The reference needs an observation mask (``dataset=dtu``, or ``dataset=paired`` with ``dataset.mask``); without a
    plane all its points count. It is not thinned, since the files of DTU are.
    """

    thin: float = 0.2  # smallest distance between two points of the output, in the units of the file
    cut: float = 20.0  # distances from here on are left out
    margin: float = 60.0  # by which the box of the mask is widened
    thin_reference: float = 0.0  # the same for the reference; 0: it is thinned already, as the files of DTU are

    def __post_init__(self) -> None:
        for name in ("thin", "cut"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: expected more than 0, got {getattr(self, name)}")
        for name in ("margin", "thin_reference"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name}: expected 0 or more, got {getattr(self, name)}")

    def score(self, output: PointCloud | Trimesh, case: Case) -> dict[str, float]:
        """The five scores, or ``{}`` where the reference has no observation mask: see :meth:`why_not`."""
        known = case.reference.attributes
        if MASK not in known:
            return {}
        truth = self._reference(case)
        box = known[LOW_HIGH]
        points = self._points(output, case)
        inside = ((points >= box[0] - self.margin) & (points < box[1] + 2 * self.margin)).all(axis=1)
        points = points[inside]
        above = truth
        if PLANE in known:
            above = truth[truth @ known[PLANE][:3] + known[PLANE][3] > 0]
        observed = points[_observed(points, known[MASK], box[0], float(known[STEP][0]))]
        scores = self._statistics("dtu_accuracy", observed, truth)
        scores |= self._statistics("dtu_completeness", above, points)
        return scores | {"dtu_overall": (scores["dtu_accuracy"] + scores["dtu_completeness"]) / 2}

    def why_not(self, output: PointCloud | Trimesh, case: Case) -> str:
        """Why an output has no score."""
        if case.reference.cloud is None:  # most references have no mask, and no reason need be given
            return ""
        return "the reference has no observation mask; name it with dataset.mask=FILE, or score --mask FILE"

    def _reference(self, case: Case) -> np.ndarray:
        """(n, 3) points of the reference, in the units of its file."""
        cloud = case.reference.cloud
        framed = case.compare(case.reference.mesh).reference_points if cloud is None else cloud.points
        points = case.frame.invert(framed)
        if not self.thin_reference:
            return points
        rng = generator(case.seed, case.id, "thinned reference")
        name = f"reference thinned to {self.thin_reference:g}"
        return case.remember(name, lambda: {"points": thinned(points, self.thin_reference, rng)})["points"]

    def _points(self, output: PointCloud | Trimesh, case: Case) -> np.ndarray:
        """(n, 3) points of the output, thinned, in the units of the reference's file."""
        if isinstance(output, PointCloud):
            points = case.frame.invert(output.points)
        else:
            vertices = case.frame.invert(output.vertices)
            points = np.concatenate([vertices, *grids_on(vertices[output.faces], self.thin)])
        return thinned(points, self.thin, generator(case.seed, case.id, "thinned"))

    def _statistics(self, name: str, points: np.ndarray, others: np.ndarray) -> dict[str, float]:
        """Mean and median of the distances of points to the nearest of others, below the cut."""
        distances = np.empty(0)
        if len(points) and len(others):
            distances = OrderedPoints(points).nearest_in(OrderedPoints(others)).distance
            distances = distances[distances < self.cut]
        if not len(distances):
            return {name: float("inf"), f"{name}_median": float("inf")}
        return {name: float(distances.mean()), f"{name}_median": float(np.median(distances))}


def _observed(points: np.ndarray, mask: np.ndarray, corner: np.ndarray, step: float) -> np.ndarray:
    """(n,) bool array: which points are in a cell of the mask that was seen; cells are centred at multiples of step."""
    cells = np.around((points - corner) / step).astype(np.int64)
    within = ((cells >= 0) & (cells < mask.shape)).all(axis=1)
    seen = np.zeros(len(points), dtype=bool)
    seen[within] = mask[tuple(cells[within].T)]
    return seen
