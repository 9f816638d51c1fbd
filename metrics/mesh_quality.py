"""How well shaped the triangles of an output are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import Case, register
from bench.geometry.quality import triangle_quality

if TYPE_CHECKING:
    from trimesh import Trimesh

KEYS = ("triangle_radius_ratio", "triangle_min_angle_deg", "triangle_aspect_ratio", "triangle_sliver_share")
BETTER = dict(zip(KEYS, ("higher", "higher", "lower", "lower"), strict=True))


@register("metric", version=1, better=BETTER, outputs=("mesh",), floor=True, requires=("trimesh",))
@dataclass(frozen=True)
class MeshQuality:
    """Shape of the triangles: radius ratio, smallest angle, aspect ratio, and the share of slivers.

    ``triangle_radius_ratio = mean 2 r / R`` with r the radius of the inscribed and R of the circumscribed circle: 1 for
    equilateral triangles, 0 for degenerate ones (Pebay and Baker 2003). ``triangle_min_angle_deg``: mean of each
    triangle's smallest angle, at most 60. ``triangle_aspect_ratio``: median of longest edge / shortest altitude, times
    ``sqrt(3) / 2`` so that 1 is equilateral. ``triangle_sliver_share``: triangles whose smallest angle is below
    ``sliver`` degrees. Every face counts the same, whatever its size. All are independent of scale and position, and of
    the reference: its own values take the place of the floor, and good triangles say nothing about the shape.
    """

    sliver: float = 5.0  # degrees; a triangle with a smaller angle is a sliver

    def score(self, output: Trimesh, case: Case) -> dict[str, float]:
        """The four scores; the two means and the median over faces."""
        if not len(output.faces):
            return dict(zip(KEYS, (0.0, 0.0, float("inf"), 1.0), strict=True))
        ratio, angle, aspect = triangle_quality(output.vertices, output.faces)
        values = (ratio.mean(), angle.mean(), np.median(aspect), (angle < self.sliver).mean())
        return {key: float(value) for key, value in zip(KEYS, values, strict=True)}
