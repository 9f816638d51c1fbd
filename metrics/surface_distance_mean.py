"""Exact distance between two surfaces, both ways."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import Case, register

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("metric", version=1, length=1, better="lower", outputs=("mesh",), floor=True, requires=("igl",))
@dataclass(frozen=True)
class SurfaceDistanceMean:
    """Exact two-way distance between an output mesh and the reference: the mean of p2f_mean and s2f_mean.

    ``(mean_p min_(x on the reference mesh) |p - x| + mean_q min_(x on the output) |q - x|) / 2`` over uniform samples
    p of the output and q of the reference, in frame units. It counts both wrong and missing parts of the output: the
    mean distance of Metro (Cignoni et al. 1998), which takes the larger of the two directions; this takes their mean.
    Unlike ``chamfer_l1_mean`` it measures to the surfaces and not to samples of them, so it has no floor of
    ``0.5 sqrt(A / N)``: the reference itself scores 0 up to its tessellation, and differences between good methods
    stay visible.
    """

    def score(self, output: Trimesh, case: Case) -> dict[str, float]:
        """``{"surface_distance_mean": frame units}``."""
        pair = case.compare(output)
        forward, backward = pair.to_surface.distance.mean(), pair.from_surface.distance.mean()
        return {"surface_distance_mean": float((forward + backward) / 2)}
