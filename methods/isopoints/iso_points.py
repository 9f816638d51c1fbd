"""Points on the zero level of a field, as a cloud."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from bench import BadInput, PointCloud, Run, build_parts, register

if TYPE_CHECKING:
    from bench import Plugin


@register("method", cite="Yifan et al. 2021", requires=("torch", "trimesh", "igl", "skimage", "scipy"))
@dataclass(frozen=True)
class IsoPoints:
    """Evenly spread points on the zero level of a field: a saved one, or one that is fitted to the cloud.

    Any method of the bench that fits a field to a cloud is possible (``siren``, ``idf``, ``siren_iso``, ...): its name
    and its parameters are ``of``, or are read from the file that it saved. A saved field is in the frame of its cloud:
    use the same cloud. The iso-points replace the cloud's: as many (denoise), or ``ratio`` times as many (upsample).
    """

    load: str = ""  # a field that a method saved (method.save=FILE)
    of: Any = "siren_iso"  # otherwise the method that fits one: a name, or {name: {parameter: value}}
    edges: float = 0.0  # more points where normals differ: the exponent of edge-aware resampling; 0 for an even spread
    rounds: int = 3  # of thinning, spreading and inserting
    tolerance: float = 1e-5  # the largest value of the field at a point

    def __post_init__(self) -> None:
        if self.rounds < 1:
            raise ValueError(f"rounds: expected at least 1, got {self.rounds}")
        for name, least in (("edges", 0.0), ("tolerance", 1e-7)):
            if not getattr(self, name) >= least:
                raise ValueError(f"{name}: expected at least {least}, got {getattr(self, name)}")
        if not self.load and not hasattr(self._part.made, "fit_to"):
            raise ValueError(f"of: {self._part.plugin.name} does not fit a field to a cloud; expected siren or similar")

    @cached_property
    def _part(self) -> Any:
        if not self.load:
            return build_parts("method", [self.of], "of")[0]
        from ..learned.training.files import saved_as

        name, form = saved_as(self.load)
        return build_parts("method", [{name: {**form, "load": self.load, "steps": 0}}], "load")[0]

    @property
    def plugins(self) -> tuple[Plugin, ...]:
        """The method that fits the field."""
        return self._part.plugins

    def prepare(self) -> None:
        """Prepare the method that fits the field."""
        if hasattr(self._part.made, "prepare"):
            self._part.made.prepare()

    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        """As many points as the cloud has."""
        return self._sampled(cloud, len(cloud), run)

    def upsample(self, cloud: PointCloud, ratio: int, run: Run) -> PointCloud:
        """``ratio`` times as many."""
        return self._sampled(cloud, ratio * len(cloud), run)

    def _sampled(self, cloud: PointCloud, count: int, run: Run) -> PointCloud:
        from .sampling.extraction import Extraction, NoLevel, iso_cloud

        if not hasattr(self._part.made, "fit_to"):
            raise BadInput(f"{self.load}: was saved by {self._part.plugin.name}, whose field is not fitted to a cloud")
        field, frame = self._part.made.fit_to(cloud, run)
        how = Extraction(count, self.rounds, edges=self.edges or None, tolerance=self.tolerance)
        try:
            found = iso_cloud(field, count, run.torch_generator(), how)
        except NoLevel as error:
            raise BadInput(f"iso_points: {error}") from error
        return PointCloud(frame.invert(found.points), found.normals)
