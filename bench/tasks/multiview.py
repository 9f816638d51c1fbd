"""Reconstruction from images: views of a shape to a mesh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from ..contract.ball_views import views_of_a_ball
from ..contract.case import Case
from ..contract.shape import Shape
from ..contract.task import Task, describe_views, validate_mesh, views_words
from ..errors import UsageError
from ..geometry.cloud import Frame
from ..plugins.registry import register


@register("task")
@dataclass(frozen=True)
class Multiview(Task):
    """Images of a shape with masks and cameras, and lights where they are known -> a triangle mesh.

    A method is called as ``multiview(views, run)``. The shape lies within the unit ball around the origin; nothing else
    is known about it besides the images.
    """

    takes: ClassVar[str] = "views"
    output: ClassVar[str] = "mesh"
    promise: ClassVar[str] = "a trimesh.Trimesh with faces and finite vertices"
    primary: ClassVar[tuple[str, ...]] = ("surface_distance_mean",)

    max_pixels: int = field(default=512, metadata={"since": "0.2"})  # longest side of images of your own; 0: no limit

    def __post_init__(self) -> None:
        if self.max_pixels < 0:
            raise ValueError(f"max_pixels: expected 0 (no limit) or more, got {self.max_pixels}")

    def describe(self, case: Case) -> dict[str, float]:
        """The number of views, their width in pixels, and the share of them that the shape covers."""
        return describe_views(case.input["views"])

    def describe_words(self, medians: Mapping[str, float]) -> str:
        """The same, in a sentence."""
        return views_words(medians)

    def read(self, paths: Sequence[str]) -> tuple[dict[str, Any], Frame]:
        """Views from a folder of images with masks and cameras, or from an ``.npz`` file.

        The folder has ``transforms.json`` (NeRF, instant-ngp, nerfstudio), ``cameras.npz`` (DTU in IDR and NeuS), or a
        COLMAP model as text. The frame is the ball in the file, or one estimated from the masks. A file
        has the arrays of :meth:`bench.Views.arrays`, of a shape in the unit ball.
        """
        from ..contract.image_folders.reading import read_views

        if len(paths) != 1:
            raise UsageError(f"expected one folder or file of views, got {len(paths)}: {', '.join(paths) or 'none'}")
        views, frame = read_views(paths[0], self.max_pixels)
        return self.input(views), frame

    def validate(self, output: Any, input: dict[str, Any]) -> None:
        """Check an output against the promise."""
        validate_mesh(output, self.promise)

    def toy(self) -> Case:
        """A small case for the conformance kit: twelve images of a ball, shaded in closed form."""
        from trimesh.creation import icosphere

        shape, frame = Shape("toy", icosphere(subdivisions=3), tags=("smooth",)).framed()
        return Case("toy", self.input(views_of_a_ball(12, 48)), shape, frame, 0, ("smooth",))
