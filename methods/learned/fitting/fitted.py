"""The base of all methods that fit one field to one cloud, and extract its surface by marching cubes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench import BadInput, Frame, PointCloud, Run
from bench.geometry.check import check_points
from bench.geometry.normals import with_normals

from .trained import Trained, at_least

if TYPE_CHECKING:
    from trimesh import Trimesh

    from ..training.field import Field
    from ..training.loop import Sampling

LEAST_POINTS = 10
MOST_ESTIMATED = 1_000_000  # points that normals are estimated for


@dataclass(frozen=True)
class Fitted(Trained):
    """Fits a field in the frame in which the farthest point is at radius 1, and extracts its zero level.

    A method of this family defines :meth:`field`, and sets its training by the defaults of its parameters.
    """

    batch: int = 1024  # surface points of a step; as many of the space are added

    def __post_init__(self) -> None:
        super().__post_init__()
        at_least(self, batch=1)

    # -- what a method adds ----------------------------------------------------------------------------------------

    def sampler(self, points: np.ndarray, normals: np.ndarray, frame: Frame, run: Run) -> Sampling:
        """The source of training batches: oriented points, unless a method overrides this."""
        from ..training.batches import Sampler

        return Sampler(points, normals, self.batch, run.torch_generator())

    def sampler_of(self, field: Field, points: np.ndarray, normals: np.ndarray, frame: Frame, run: Run) -> Sampling:
        """The sampler of a training, for methods whose batches depend on the field."""
        return self.sampler(points, normals, frame, run)

    # -- what they share -------------------------------------------------------------------------------------------

    @property
    def uses_normals(self) -> bool:
        """Whether the sampler does: none are estimated for one that does not."""
        return True

    def reconstruct(self, cloud: PointCloud, run: Run) -> Trimesh:
        """The zero level of a field that was fitted to the points and their normals (estimated if there are none)."""
        field, frame = self.fit_to(cloud, run)
        return self.extract_in_time(field, frame, run)

    def fit_to(self, cloud: PointCloud, run: Run) -> tuple[Field, Frame]:
        """The fitted field, and its frame."""
        import torch

        torch.set_num_threads(run.threads)
        points, normals, frame = oriented(cloud, self.name, run, self.uses_normals and self.trains)
        self.check_files()
        field = self.field(self.first_weights(run)).to(run.device)
        self.train(field, lambda: self.sampler_of(field, points, normals, frame, run), points, frame, run)
        return field, frame


def oriented(cloud: PointCloud, method: str, run: Run, normals: bool = True) -> tuple[np.ndarray, np.ndarray, Frame]:
    """Points in the frame in which the farthest is at radius 1, their normals, given or estimated, and that frame.

    With ``normals=False`` they are all zero. Very large clouds without normals are reduced to a random subset, with a
    note: estimation takes a kilobyte for each point and a minute for a million, and a training draws few.

    Raises
    ------
    BadInput
        If there are too few points, if all coincide, or if values are not finite.
    """
    check_points(cloud.points, method, at_least=LEAST_POINTS)
    frame = Frame.of(cloud.points)
    differing = len(np.unique(cloud.points[:1000], axis=0))
    if differing < LEAST_POINTS:
        differing = len(np.unique(cloud.points, axis=0))
    if differing < LEAST_POINTS:
        raise BadInput(f"{method}: only {differing} of {len(cloud)} points differ; expected at least {LEAST_POINTS}")
    if not normals:
        return frame.apply(cloud.points), np.zeros(cloud.points.shape), frame
    if cloud.normals is None and len(cloud) > MOST_ESTIMATED:
        run.note(f"normals were estimated for {MOST_ESTIMATED:,} of the {len(cloud):,} points; only these are used")
        cloud = PointCloud(cloud.points[np.sort(run.rng.permutation(len(cloud))[:MOST_ESTIMATED])])
    known = with_normals(cloud).normals
    assert known is not None
    return frame.apply(cloud.points), known, frame
