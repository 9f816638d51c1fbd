"""The duration of a sweep: from finished cases in the same folder, from declarations of methods, from its start.

All times are wall-clock seconds of whole cases: making the input and scoring the output
count, too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ..engine.affinity import available
from ..text import counted, duration

if TYPE_CHECKING:
    from ..plan.cell import Cell
    from ..results.store import Results
    from .request import Request


@dataclass(frozen=True)
class Pace:
    """Median seconds of a case, by kind of cell."""

    known: Mapping[tuple[str, ...], float] = field(default_factory=dict)

    @classmethod
    def of(cls, results: Results) -> Pace:
        """The times of the finished cases in a folder."""
        import pandas as pd

        rows = results.rows()
        rows = rows[rows["seconds"].notna()] if len(rows) else rows
        if rows.empty:
            return cls()
        begin, end = (
            pd.to_datetime(rows[c], format="ISO8601", utc=True, errors="coerce") for c in ("started", "finished")
        )
        rows = rows.assign(wall=(end - begin).dt.total_seconds().clip(lower=rows["seconds"]).fillna(rows["seconds"]))
        known: dict[tuple[str, ...], float] = {}
        for columns in (
            ["task", "method", "variant", "dataset"],
            ["task", "method", "variant"],
            ["task", "method", "dataset"],
            ["task", "method"],
        ):
            medians = rows.fillna({"variant": ""}).groupby(columns)["wall"].median()
            known |= {(*columns, *key): float(seconds) for key, seconds in medians.items()}
        return cls(known)

    def seconds(self, cell: Cell) -> float | None:
        """Seconds of one case of a cell; None if no similar cell was timed and its method declares nothing.

        Cases of the same method with the same parameters come first, then a parameter ``seconds`` with which a method
        is given its time, then the same method with other parameters.
        """
        names = {
            "task": cell.task.label,
            "method": cell.method.name,
            "variant": cell.method.variant,
            "dataset": cell.dataset.label,
        }

        def timed(*columns: str) -> float | None:
            return self.known.get((*columns, *(names[column] for column in columns)))

        same = timed("task", "method", "variant", "dataset") or timed("task", "method", "variant")
        declared = cell.method.parameters.get("seconds")
        if not same and isinstance(declared, (int, float)) and declared > 0:
            return float(declared)
        return same or timed("task", "method", "dataset") or timed("task", "method")


class Forecast:
    """The time for the rest of a sweep, corrected by the times of its first jobs.

    Parameters
    ----------
    expected : of each job, its expected seconds: 0 if all is cached, None if unknown
    kinds : of each job, a text that is the same for jobs of similar duration, such as its method
    workers : how many jobs are run at a time
    """

    def __init__(self, expected: Sequence[float | None], kinds: Sequence[str], workers: int = 1):
        self._expected, self._kinds, self.workers = list(expected), list(kinds), max(workers, 1)
        self._took: dict[int, float] = {}  # of ended jobs, 0 if all was cached

    def ended(self, job: int, seconds: float) -> None:
        """Record the time of an ended job: 0 if all its cases were cached."""
        if 0 <= job < len(self._expected):
            self._took[job] = seconds

    def left(self) -> float | None:
        """Seconds until the end; None if unknown for a remaining job."""
        ran = {job: took for job, took in self._took.items() if took}
        both = [(self._expected[job], took) for job, took in ran.items() if self._expected[job]]
        factor = sum(took for _, took in both) / sum(expected or 0.0 for expected, _ in both) if both else 1.0
        by_kind: dict[str, list[float]] = {}
        for job, took in ran.items():
            by_kind.setdefault(self._kinds[job], []).append(took)
        means = {kind: sum(took) / len(took) for kind, took in by_kind.items()}
        overall = sum(ran.values()) / len(ran) if ran else None
        rest: list[float] = []
        for job, (expected, kind) in enumerate(zip(self._expected, self._kinds, strict=True)):
            if job not in self._took:
                seconds = expected * factor if expected is not None else means.get(kind, overall)
                if seconds is None:
                    return None
                rest.append(seconds)
        return max(sum(rest) / self.workers, max(rest, default=0.0))


def workers_of(request: Request, threads: int = 1) -> int:
    """How many cells the launcher of a request runs at a time, as far as processors allow."""
    if request.launcher != "joblib" or request.hydra is None:
        return 1
    from omegaconf import OmegaConf

    count = OmegaConf.select(request.hydra, "hydra.launcher.n_jobs")
    processors = len(available())
    asked = count if isinstance(count, int) and count else -1
    asked = asked if asked > 0 else processors + 1 + asked  # as joblib counts: -1 for all
    return max(1, min(asked, processors // max(threads, 1)))


def summary(planned: int, finished: int, seconds: Sequence[float | None], unknown: int, workers: int) -> str:
    """``48 cases, 12 finished, 36 to do, about 3 min``: the last line of a plan and the first of a sweep.

    Parameters
    ----------
    planned, finished : cases
    seconds : of each cell, for its unfinished cases; None if unknown
    unknown : unfinished cases of cells whose time is unknown
    workers : how many cells are run at a time
    """
    text = f"{counted(planned, 'case')}, {finished} finished, {planned - finished} to do"
    if known := [s for s in seconds if s]:
        beside = f", {workers} cells at a time" if workers > 1 else ""
        text += f", about {duration(max(sum(known) / workers, max(known)))}{beside}"
    return text + (f" and {counted(unknown, 'case')} never timed" if unknown else "")


def seconds_to_do(cell: Cell, finished: int, pace: Pace) -> float | None:
    """Seconds for a cell's unfinished cases; None if unknown."""
    to_do = cell.planned - finished
    one = pace.seconds(cell) if to_do else 0.0
    return None if one is None else to_do * one
