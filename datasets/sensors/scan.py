"""No simulation: the scan that comes with a shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import BadInput, PointCloud, Shape, notice, register
from bench.geometry.extents import unlike
from bench.geometry.used import used_vertices


@register("sensor", scans=True)
@dataclass(frozen=True)
class Scan:
    """The scan that came with the shape, point for point as in its file: the sensor of ``dataset=paired``.

    It is in the frame of its reference, and keeps its own normals and colours. In a chain, effects can degrade it:
    ``sensor=chain 'sensor.steps=[scan,{gaussian:{sigma:0.01}}]'``.
    """

    def sense(self, shape: Shape, rng: np.random.Generator) -> PointCloud:
        """The scan of a shape, in the frame of its case.

        Raises
        ------
        BadInput
            If no scan came with the shape.
        """
        if shape.scan is None:
            raise BadInput(f"{shape.id}: has no scan; sensor=scan is only for datasets with scans (dataset=paired)")
        scan = shape.scan
        if hint := unlike(scan.points, "the scan", used_vertices(shape.mesh), "the reference"):
            notice(f"{shape.id}: {hint}")
        return scan
