"""Upsampling."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from ..contract.task import Task, validate_cloud
from ..errors import InvalidOutput
from ..geometry.cloud import PointCloud
from ..plugins.registry import register


@register("task")
@dataclass(frozen=True)
class Upsample(Task):
    """A sparse point cloud -> a cloud of exactly ratio x N points."""

    primary: ClassVar[tuple[str, ...]] = ("chamfer_l1_mean",)  # sensitive to the spacing of the points as well

    ratio: int = 4  # number of points for each one of the input

    def __post_init__(self) -> None:
        if self.ratio < 1:
            raise ValueError(f"ratio: expected at least 1, got {self.ratio}")

    @property
    def promise(self) -> str:  # type: ignore[override]
        """The exact count, in words."""
        return f"a PointCloud of exactly {self.ratio} x N points, all finite"

    def input(self, sensed: PointCloud) -> dict[str, Any]:
        """The cloud and the ratio."""
        return {"cloud": sensed, "ratio": self.ratio}

    def expected(self, input: Mapping[str, Any]) -> int:
        """``ratio`` times as many points as the input has."""
        return self.ratio * len(input["cloud"])

    def validate(self, output: Any, input: dict[str, Any]) -> None:
        """Check an output against the promise."""
        validate_cloud(output, self.promise)
        wanted = self.ratio * len(input["cloud"])
        if len(output) != wanted:
            raise InvalidOutput(f"promised {self.promise}: {wanted} points; got {len(output)}")
