"""The base of the methods that fit a field to images."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from bench import BadInput, Frame, PointCloud, Run, Views
from bench.geometry.spiral import golden_spiral

from ...learned.fitting.trained import Trained, at_least, positive
from ...learned.networks.shipped import spheres_read

if TYPE_CHECKING:
    from pathlib import Path

    import torch
    from trimesh import Trimesh

    from ...learned.training.field import Field
    from ...learned.training.loop import Sampling
    from .field import ImageField
    from .scene import Scene

FORM = ("omega", "hidden_layers", "width", "appearance", "appearance_width")
BALL = 1.02  # surface beyond this radius is cut off: no samples are there


@dataclass(frozen=True)
class FromImages(Trained):
    """Fits a sine network to images; its zero level within the unit ball is the surface."""

    sine_sphere = True

    steps: int = 1000  # of training, at most
    views: int = 4  # images of a step
    samples: int = 1024  # of a step, on rays through all its images
    space: int = 512  # points of a step anywhere in the ball, for the gradient's length
    omega: float = 30.0  # frequency of the sine layers
    hidden_layers: int = 3  # sine layers after the first
    width: int = 256  # of each layer
    sphere: float = 0.5  # radius of the initial sphere
    color: float = 1.0  # weight of the colours' difference
    mask: float = 30.0  # weight of inside and outside (IDR: 100, of colours from -1 to 1)
    eikonal: float = 0.1  # weight of the gradient's length (IDR)
    steepness: float = 50.0  # of the sigmoid of inside and outside; it doubles five times (IDR)
    motion: Literal["normal", "ray"] = "normal"  # direction in which points of the surface move with the network
    most: float = 0.1  # the largest derivative of the colours by a point (released); 0 for any
    clip: float = 1.0  # largest norm of the gradient; 0 for none
    # of the surface: by the lights of the views, or learned; auto: learned if the views have no lights
    appearance: Literal["auto", "lights", "learned"] = "auto"
    appearance_width: int = 128  # of the learned one's layers

    def __post_init__(self) -> None:
        super().__post_init__()
        at_least(self, views=1, samples=4, space=1, hidden_layers=1, width=1, sphere=0, color=0, mask=0, eikonal=0)
        at_least(self, most=0, clip=0, appearance_width=1)
        positive(self, "omega", "steepness")
        for name, known in (("motion", ("normal", "ray")), ("appearance", ("auto", "lights", "learned"))):
            if getattr(self, name) not in known:
                raise ValueError(f"{name}: expected {', '.join(known)}, got {getattr(self, name)!r}")

    def reads(self) -> tuple[Path, ...]:
        """The file of the initial sphere, if it is shipped."""
        return spheres_read(self.omega, self.hidden_layers, self.width, self.first_sphere)

    def form(self) -> dict[str, Any]:
        """The parameters that determine the function of the weights."""
        return {name: getattr(self, name) for name in FORM}

    def training(self) -> dict[str, Any]:
        """The mean of the last states is the result: samples follow the surface, so losses are not comparable."""
        return {"clip": self.clip, "keep": "mean"}

    # -- what a method adds ----------------------------------------------------------------------------------------

    def sampler(self, field: ImageField, scene: Scene, run: Run) -> Sampling:
        """The sampler of the steps."""
        raise NotImplementedError

    # -- what they share -------------------------------------------------------------------------------------------

    def kind_of_field(self) -> type[ImageField]:
        """The class of the field."""
        from .field import ImageField

        return ImageField

    def multiview(self, views: Views, run: Run) -> Trimesh:
        """The zero level of a field that was fitted to the images."""
        field = self.fit_to_views(views, run)
        return self.extract_in_time(field, Frame(), run)

    def fit_shape(self, views: Views, cloud: PointCloud, run: Run) -> PointCloud:
        """Iso-points of a field fitted to the images: as many as the cloud has, which is not used otherwise."""
        from ..sampling.extraction import iso_cloud

        field = self.fit_to_views(views, run)
        return iso_cloud(field, len(cloud), run.torch_generator())

    def fit_to_views(self, views: Views, run: Run) -> ImageField:
        """The fitted field, in the frame of the views."""
        import torch

        from .scene import Scene

        torch.set_num_threads(run.threads)
        self._check(views)
        scene = Scene(views, run.device)
        if self.appearance == "auto":
            return replace(self, appearance="lights" if scene.lit else "learned").fit_to_views(views, run)
        self.check_files()
        field = self._of_images(scene, self.first_weights(run)).to(run.device)
        about = 0.7 * golden_spiral(4096)  # a guess of the unknown surface
        self.train(field, lambda: self.sampler(field, scene, run), about, Frame(), run)
        return field

    def _of_images(self, scene: Scene, generator: torch.Generator) -> ImageField:
        """The initial field, a sphere."""
        from ...learned.networks.sphere import begin_as_sphere
        from .appearance import Appearance
        from .field import Terms

        terms = Terms(**{name: getattr(self, name) for name in Terms.__dataclass_fields__})
        form = {"hidden_layers": self.hidden_layers, "width": self.width, "generator": generator}
        appearance = Appearance(self.appearance_width, generator) if self.appearance == "learned" else None
        field = self.kind_of_field()(scene, terms, appearance, self.omega, **form)
        begin_as_sphere(field.network, self.first_sphere)
        return field

    def extract(self, field: Field, frame: Frame, resolution: int, seconds: float = float("inf")) -> Trimesh:
        """The zero level of a field within the ball; coarser if it would take more than ``seconds``."""
        from ...learned.meshing.marching import REACH, extract

        def values(points: np.ndarray) -> np.ndarray:
            return np.maximum(field.values(points), np.linalg.norm(points, axis=1) - BALL)

        return extract(values, resolution=resolution, domain=(-REACH, REACH), seconds=seconds)

    def _check(self, views: Views) -> None:
        if not views.masks.any():
            raise BadInput(f"{self.name}: the masks of all {len(views)} views are empty; expected masks of a shape")
        if self.appearance == "lights" and views.light_directions is None:
            raise BadInput(f"{self.name}: the views have no lights; use method.appearance=learned")
