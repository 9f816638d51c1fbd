"""One problem: what a method is given, and the truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..geometry.cloud import Frame, PointCloud
from .shape import Shape

if TYPE_CHECKING:
    from trimesh import Trimesh

    from ..geometry.comparison import Comparison


@dataclass(eq=False)
class Case:
    """One problem: what the method is given, and the truth.

    Everything is in the frame of the reference (bounding-box centre at the origin, farthest vertex at radius 1); an
    output is never re-normalised.

    Attributes
    ----------
    id : str
    input : mapping
        The keyword arguments of the method's function, for instance ``{"cloud": PointCloud}``.
    reference : Shape
        The truth, in the case's frame.
    frame : Frame
        From the original coordinates to the case's frame.
    seed : int
        Seeds the sampling of the metrics, equal for all methods: comparisons are paired.
    """

    id: str
    input: Mapping[str, Any]
    reference: Shape
    frame: Frame = Frame()
    seed: int = 0
    tags: tuple[str, ...] = ()
    _cache: dict[str, Any] = field(default_factory=dict, repr=False)
    _memo: Any = field(default=None, repr=False)  # a bench.engine.memo.Memo: shared by the cells of a sweep

    def remember(self, name: str, make: Callable[[], Mapping[str, np.ndarray]]) -> Mapping[str, np.ndarray]:
        """Arrays that follow from the reference and the seed: from the sweep's cache, or computed now."""
        return make() if self._memo is None else self._memo.arrays(name, make)

    def compare(self, output: PointCloud | Trimesh) -> Comparison:
        """The directed distances between ``output`` and the reference, computed once and shared by all metrics."""
        from ..geometry.comparison import Comparison

        known = self._cache.setdefault("comparisons", [])
        for comparison in known:
            if comparison.output is output:
                return comparison
        comparison = Comparison(output, self)
        known.append(comparison)
        del known[:-2]  # an output and its perfect twin; a traced run must not collect all its outputs
        return comparison

    def perfect(self, output: PointCloud | Trimesh) -> PointCloud | Trimesh:
        """What a perfect method would have returned: the reference, of the type and count of ``output``.

        A metric's score of it is the metric's *floor*: the score due to sampling alone.
        """
        if not isinstance(output, PointCloud):
            return self.reference.mesh
        key = f"perfect {len(output)}"
        if key not in self._cache:
            self._cache[key] = PointCloud.of(self.remember(key, lambda: self._sampled(len(output))))
        return self._cache[key]

    def _sampled(self, count: int) -> Mapping[str, np.ndarray]:
        from ..seeds import generator

        points, normals = self.reference.surface.sample(count, generator(self.seed, self.id, "perfect"))
        return {"points": points, "normals": normals}
