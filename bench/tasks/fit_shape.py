"""Shape fitting: points whose renderings match images."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from ..contract.ball_views import views_of_a_ball
from ..contract.case import Case
from ..contract.shape import Shape
from ..contract.task import Task, describe_views, validate_cloud, views_words
from ..contract.views import Views
from ..contract.views_file import load_views
from ..errors import UsageError
from ..geometry.cloud import Frame, PointCloud
from ..geometry.spiral import golden_spiral
from ..plugins.registry import register


@register("task")
@dataclass(frozen=True)
class FitShape(Task):
    """Images of a shape and an initial cloud -> a cloud of the shape's surface.

    A method is called as ``fit_shape(views, cloud, run)``: images with masks, cameras and known lights, and oriented
    points that do not depend on the shape. It returns a cloud of any number of points. The task ``multiview``
    asks for a mesh instead.
    """

    takes: ClassVar[str] = "views"
    output: ClassVar[str] = "cloud"
    promise: ClassVar[str] = "a PointCloud, not empty, all finite"
    primary: ClassVar[tuple[str, ...]] = ("chamfer_l1_mean",)
    files: ClassVar[tuple[int, ...]] = (1, 2)

    start: Literal["sphere", "cube", "square"] = "sphere"  # what the points lie on; a square faces the first camera
    points: int = 2000  # how many of them
    size: float = 0.7  # radius of the sphere, or half the edge of cube and square; the shape has the radius 1

    def __post_init__(self) -> None:
        if self.start not in ("sphere", "cube", "square"):
            raise ValueError(f"start: expected sphere, cube or square, got {self.start!r}")
        if self.points < 4:
            raise ValueError(f"points: expected at least 4, got {self.points}")
        if not self.size > 0:
            raise ValueError(f"size: expected a number above 0, got {self.size}")

    def input(self, sensed: Views) -> dict[str, Any]:
        """The views, and the initial points."""
        return {"views": sensed, "cloud": self.beginning(sensed.extrinsics[0, :, :3])}

    def beginning(self, axes: np.ndarray | None = None) -> PointCloud:
        """The initial points, evenly spread, with normals outwards.

        A Fibonacci sphere, six lattices, or one lattice that faces a camera with the rows ``axes`` (3, 3).
        """
        if self.start == "square":
            axes = np.eye(3) if axes is None else axes
            u, v = _lattice(self.points)
            return PointCloud(
                self.size * (u[:, None] * axes[0] + v[:, None] * axes[1]), np.tile(-axes[2], (self.points, 1))
            )
        if self.start == "sphere":
            outwards = golden_spiral(self.points)
            return PointCloud(self.size * outwards, outwards)
        # The same number on each side, the rest on the last ones.
        sides = np.array_split(np.arange(self.points), 6)
        points, normals = [], []
        for number, members in enumerate(sides):
            axis, sign = number // 2, 2 * (number % 2) - 1
            u, v = _lattice(len(members))
            place = np.empty((len(members), 3))
            place[:, axis], place[:, axis - 2], place[:, axis - 1] = sign, u, v
            points.append(place)
            normals.append(np.tile(sign * np.eye(3)[axis], (len(members), 1)))
        return PointCloud(self.size * np.concatenate(points), np.concatenate(normals))

    def describe(self, case: Case) -> dict[str, float]:
        """The number of views, their width in pixels, and the share of them that the shape covers."""
        return describe_views(case.input["views"])

    def describe_words(self, medians: Mapping[str, float]) -> str:
        """The same, in a sentence."""
        return views_words(medians)

    def read(self, paths: Sequence[str]) -> tuple[dict[str, Any], Frame]:
        """Views from an ``.npz`` file with the arrays of :meth:`bench.Views.arrays`, and an initial cloud.

        The frame is that of the cloud; without one, cameras are assumed to look at a shape of radius 1 at the origin.
        """
        from ..geometry.io.files import load_cloud

        if len(paths) not in self.files:
            raise UsageError(f"expected VIEWS.npz, or VIEWS.npz and an initial cloud; got {len(paths)} files")
        views = load_views(paths[0])
        if len(paths) == 1:
            return self.input(views), Frame()
        cloud = load_cloud(paths[1])
        frame = Frame.of(cloud.points)
        if cloud.normals is None:
            raise UsageError(f"{paths[1]}: the initial cloud needs normals")
        start = PointCloud(frame.apply(cloud.points), cloud.normals)
        return {"views": views.in_frame(frame), "cloud": start}, frame

    def validate(self, output: Any, input: dict[str, Any]) -> None:
        """Check an output against the promise."""
        validate_cloud(output, self.promise)

    def toy(self) -> Case:
        """A small case for the conformance kit: twelve images of a ball, shaded in closed form."""
        from trimesh.creation import icosphere

        shape, frame = Shape("toy", icosphere(subdivisions=3), tags=("smooth",)).framed()
        return Case("toy", self.input(views_of_a_ball(12, 48)), shape, frame, 0, ("smooth",))


def _lattice(count: int) -> tuple[np.ndarray, np.ndarray]:
    """An even spread over the square from -1 to 1: a lattice of the golden ratio."""
    k = np.arange(count) + 0.5
    return 2 * k / max(count, 1) - 1, 2 * ((k * (np.sqrt(5) - 1) / 2) % 1) - 1
