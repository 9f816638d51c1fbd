"""Denoising."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from ..contract.task import Task, validate_cloud
from ..plugins.registry import register


@register("task")
@dataclass(frozen=True)
class Denoise(Task):
    """A noisy point cloud -> a point cloud nearer to the surface."""

    promise: ClassVar[str] = "a PointCloud with at least one point, all finite"
    primary: ClassVar[tuple[str, ...]] = ("chamfer_l1_mean",)  # both ways: it sees stray points, and holes

    def validate(self, output: Any, input: dict[str, Any]) -> None:
        """Check an output against the promise."""
        validate_cloud(output, self.promise)
