"""One answer for one or several scans: trials, evidence and ranks together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import DetailbenchError
from .candidates import Candidate
from .evidence import Evidence, evidence
from .gaps import gaps_of
from .priors import nearest
from .scan import NORMAL_MEDIAN, Scan
from .trials import Setup, Trial, trials
from .verdict import CRITERIA, Verdict, verdict

if TYPE_CHECKING:
    from trimesh import Trimesh

OUTPUT = "OUT.ply"  # the output of the command line


@dataclass(frozen=True, eq=False)
class Recommendation:
    """The result.

    Attributes
    ----------
    scans, candidates, setup
        The request.
    solved : tuple of int
        The candidates that solved all scans and their halves, in the order of ``verdict`` and ``evidence``.
    trials : for each scan a list, in the order of the candidates
    evidence : for each scan, of the solved ones
    verdict : Verdict
        Of the solved ones.
    """

    scans: Sequence[Scan]
    candidates: Sequence[Candidate]
    setup: Setup
    solved: tuple[int, ...]
    trials: list[list[Trial]]
    evidence: list[Evidence]
    verdict: Verdict

    @property
    def ranked(self) -> list[tuple[int, Candidate]]:
        """Places in the verdict with their candidates, best first."""
        return [(int(place), self.candidates[self.solved[place]]) for place in self.verdict.order]

    @property
    def failed(self) -> dict[str, str]:
        """Labels of the other candidates, and why they have no rank."""
        return {
            candidate.label: next(row[i].why for row in self.trials if row[i].meshes is None)
            for i, candidate in enumerate(self.candidates)
            if i not in self.solved
        }

    @property
    def tied(self) -> list[Candidate]:
        """The candidates without a significantly better one, best first."""
        return [candidate for place, candidate in self.ranked if self.verdict.low[place] == 1]

    def command(self, candidate: Candidate) -> str:
        """The line that applies a candidate to the first scan."""
        return candidate.command(self.setup.task, self.scans[0].name, OUTPUT)

    def costs(self, place: int) -> tuple[float, float]:
        """The most seconds and megabytes of a call of a method, over the scans."""
        found = [row[self.solved[place]] for row in self.trials]
        return max(t.seconds for t in found), max(t.peak_mb for t in found)

    def above_noise(self, place: int) -> float:
        """Median distance of held-out points to the mesh, as a multiple of its value from noise alone.

        The median of the scans; NaN if a scan has no measurable noise.
        """
        noises = [NORMAL_MEDIAN * scan.state.noise * scan.spacing for scan in self.scans]
        held = [e.median_held[place] for e in self.evidence]
        return float(np.median([h / n if n > 0 else np.nan for h, n in zip(held, noises, strict=True)]))


def recommend(
    scans: Sequence[Scan],
    chosen: Sequence[Candidate],
    setup: Setup,
    on_done: Callable[[int, int], None] = lambda done, total: None,
) -> Recommendation:
    """Try candidates on scans and rank them.

    Parameters
    ----------
    scans, chosen, setup
    on_done : called with the number of ended trials and the total, which grows for scans with holes

    Raises
    ------
    DetailbenchError
        If fewer than two candidates solved all scans, with the reasons.
    """
    count = _Count(on_done, len(scans) * len(chosen))
    found = trials([(scan.cloud, scan.half(0), scan.half(1)) for scan in scans], chosen, setup, count.one_more)
    solved = _solved(found, chosen)
    names = [candidate.choice.name for candidate in chosen]
    gaps = [
        gaps_of(scan, [_meshes(row[i])[0] for i in solved], [names[i] for i in solved], setup.seed)
        for scan, row in zip(scans, found, strict=True)
    ]
    with_gaps = [(number, gap) for number, gap in enumerate(gaps) if gap is not None]
    if with_gaps:
        count.total += len(with_gaps) * len(solved)
        clouds = [(gap.rest(scans[number]),) for number, gap in with_gaps]
        filled = trials(clouds, [chosen[i] for i in solved], setup, count.one_more)
        for (number, _), row in zip(with_gaps, filled, strict=True):
            for i, trial in zip(solved, row, strict=True):
                found[number][i] = found[number][i].then(trial)
        solved = _solved(found, chosen)
    held = [
        evidence(
            scan,
            [_meshes(row[i])[:3] for i in solved],
            setup.seed,
            gap,
            [mesh for i in solved for mesh in _meshes(row[i])[3:]],
        )
        for scan, row, gap in zip(scans, found, gaps, strict=True)
    ]
    ranks = verdict(held, [names[i] for i in solved], setup.seed)
    return Recommendation(scans, chosen, setup, solved, found, held, ranks)


class _Count:
    """The number of ended trials, over all threads."""

    def __init__(self, on_done: Callable[[int, int], None], total: int):
        self.total, self._on_done, self._done, self._lock = total, on_done, 0, Lock()

    def one_more(self) -> None:
        with self._lock:
            self._done += 1
            self._on_done(self._done, self.total)


def _solved(found: list[list[Trial]], chosen: Sequence[Candidate]) -> tuple[int, ...]:
    solved = tuple(i for i in range(len(chosen)) if all(row[i].meshes is not None for row in found))
    if len(solved) >= 2:
        return solved
    reasons = {chosen[i].label: row[i].why for row in found for i in range(len(chosen)) if row[i].why}
    listed = "; ".join(f"{label}: {why}" for label, why in reasons.items())
    raise DetailbenchError(
        f"{len(solved)} of {len(chosen)} methods solved all scans; a ranking needs two. Raise --limit or --memory, "
        f"lower --points, or name other methods. {listed}"
    )


def _meshes(trial: Trial) -> tuple[Trimesh, ...]:
    """Of a trial that solved its scan."""
    assert trial.meshes is not None
    return trial.meshes


def as_json(found: Recommendation) -> dict[str, Any]:
    """All figures, lengths in radii of the scans; NaN is null."""
    ranks = found.verdict

    def entry(place: int, candidate: Candidate) -> dict[str, Any]:
        seconds, peak_mb = found.costs(place)
        return {
            "method": candidate.label,
            "rank": [int(ranks.low[place]), int(ranks.high[place])],
            "score": float(ranks.score[place]),
            **{
                name.replace(" ", "_").replace("-", "_"): float(ranks.criteria[place, c])
                for c, name in enumerate(CRITERIA)
            },
            "above_noise": _number(found.above_noise(place)),
            "pieces": [int(e.pieces[place]) for e in found.evidence],
            "open_edges": [int(e.open_edges[place]) for e in found.evidence],
            "seconds": seconds,
            "peak_mb": peak_mb,
            "notes": sorted({row[found.solved[place]].note for row in found.trials} - {""}),
            "command": found.command(candidate),
        }

    return {
        "task": found.setup.task,
        "seed": found.setup.seed,
        "scans": [
            {
                "file": scan.name,
                "points": scan.total,
                "tried": len(scan.cloud),
                "radius": float(scan.frame.radius),
                "spacing": float(scan.spacing),
                **scan.state._asdict(),
                "hidden": float(of_scan.hidden),
                "most_like": nearest(scan.state).sensor,
            }
            for scan, of_scan in zip(found.scans, found.evidence, strict=True)
        ],
        "tied_for_first": [candidate.label for candidate in found.tied],
        "ranking": [entry(place, candidate) for place, candidate in found.ranked],
        "failed": found.failed,
    }


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
