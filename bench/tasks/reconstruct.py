"""Surface reconstruction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from ..contract.task import Task, validate_mesh
from ..plugins.registry import register


@register("task")
@dataclass(frozen=True)
class Reconstruct(Task):
    """A point cloud, oriented or not -> a triangle mesh."""

    output: ClassVar[str] = "mesh"
    promise: ClassVar[str] = "a trimesh.Trimesh with faces and finite vertices"
    primary: ClassVar[tuple[str, ...]] = ("surface_distance_mean",)

    def validate(self, output: Any, input: dict[str, Any]) -> None:
        """Check an output against the promise."""
        validate_mesh(output, self.promise)
