"""Common parameters and first steps of the methods: a welded source with samples, and the points of the target."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import PointCloud, Run

if TYPE_CHECKING:
    from trimesh import Trimesh

    from .nearest import Matching
    from .pulled import Pulled
    from .samples import Samples
    from .welded import Welded

MOST_SAMPLES = 1_000_000


@dataclass(frozen=True)
class Registered:
    """A source is fitted to the points of a target. Lengths are in the frame, in which the target has radius 1."""

    samples: int = 5000  # points on the source's faces that are matched, and of the target, at most
    reach: float = 0.1  # vertices of different parts of the source within this distance are joined by a spring
    joint: float = 0.1  # the weight of a spring; an edge between regular triangles has 0.58

    def __post_init__(self) -> None:
        if not 10 <= self.samples <= MOST_SAMPLES:
            raise ValueError(f"samples: expected 10 to {MOST_SAMPLES}, got {self.samples}")
        self.expect_positive("reach", "joint")

    def expect_positive(self, *names: str) -> None:
        """Raise ValueError unless parameters are more than 0."""
        for name in names:
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: expected more than 0, got {getattr(self, name)}")

    def expect_steps(self, *names: str) -> None:
        """Raise ValueError unless parameters are at least 1."""
        for name in names:
            if not getattr(self, name) >= 1:
                raise ValueError(f"{name}: expected at least 1, got {getattr(self, name)}")

    def begin(self, source: Trimesh, target: Trimesh | PointCloud, run: Run) -> tuple[Welded, Samples, PointCloud]:
        """The welded source, points on its faces, and points of the target."""
        from .samples import Samples, points_of
        from .welded import Welded

        welded = Welded(source, self.reach, self.joint)
        samples = Samples(welded.vertices, welded.faces, self.samples, run.rng)
        return welded, samples, points_of(target, self.samples, run.rng)


@dataclass(frozen=True)
class Matched(Registered):
    """A source is fitted in rounds, each to goals by nearest points in both directions."""

    normal_scale: float = (
        0.1  # opposite normals are as far apart as points at twice this distance; 0: normals are ignored
    )
    trim: float = 4.0  # pairs farther apart than this many times the median are left out
    sliding: float = 0.5  # share of the tangential displacement that is left out of a goal, 0 to 1

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.normal_scale >= 0:
            raise ValueError(f"normal_scale: expected at least 0, got {self.normal_scale}")
        if not self.trim >= 1:
            raise ValueError(f"trim: expected at least 1, got {self.trim}")
        if not 0 <= self.sliding <= 1:
            raise ValueError(f"sliding: expected 0 to 1, got {self.sliding}")

    def matching(self) -> Matching:
        """The rule for matching points."""
        from .nearest import Matching

        return Matching(self.normal_scale, self.trim, self.sliding)

    def pulled(self, source: Trimesh, target: Trimesh | PointCloud, run: Run) -> Pulled:
        """The source, with the energy that pulls it to the target."""
        from .pulled import Pulled

        return Pulled(*self.begin(source, target, run), self.matching())


def note_end(run: Run, done: int, wanted: int, what: str) -> None:
    """Note that the clock ended a loop early, if it did."""
    if done < wanted:
        run.note(f"the time limit ended the {what} after {done:,} of {wanted:,}")
