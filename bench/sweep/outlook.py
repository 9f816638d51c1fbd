"""The work of a sweep, found without composing the config of every job, which takes longer than small cells."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..engine.runner import standing_rows
from ..errors import UsageError
from ..plan.cell import Cell, Settings
from ..results.earlier import standing
from ..results.provenance import ingredients
from ..results.store import Results
from .forecast import Forecast, Pace, seconds_to_do, summary, workers_of
from .parts import Configs, values_of
from .planned import Shelf, entry_of, planned_job, planned_of
from .request import Request

COMPOSED = 12  # jobs that represent all of a sweep where each is composed by itself


@dataclass(frozen=True)
class Outlook:
    """A forecast of a sweep, and the same in words: empty if no time is known.

    Attributes
    ----------
    ended : dict
        By place in the sweep, the entries of jobs that need not be launched: their cells are finished, or they have
        no cell. Empty if that is not known beforehand.
    configs : the config of each job; None if that is not known beforehand
    """

    forecast: Forecast
    text: str
    ended: Mapping[int, dict[str, Any]] = field(default_factory=dict)
    configs: Configs | None = None


def look_ahead(jobs: Sequence[Sequence[str]], request: Request, results: Results) -> Outlook | None:
    """The work of the jobs of a sweep; None if one of them is wrong: the job itself reports that.

    Every job is looked up if their configs can be assembled from parts. Otherwise, some of the jobs, evenly spread,
    represent all.

    Parameters
    ----------
    jobs : the overrides of each job
    request : that of the sweep, which names its launcher
    results : where finished cases are
    """
    configs = values_of(jobs)
    try:
        return _likely(jobs, request, results) if configs is None else _outlook(configs, jobs, request, results)
    except UsageError:
        return None


def _outlook(configs: Configs, jobs: Sequence[Sequence[str]], request: Request, results: Results) -> Outlook:
    """The outlook of a sweep whose cells are all known."""
    shelf, pace = Shelf(results), Pace.of(results)
    seconds: list[float | None] = []
    ended: dict[int, dict[str, Any]] = {}
    planned = finished = unknown = 0
    threads = 1
    for place, one in enumerate(planned_of(configs)):
        if one.cell is None or one.settings is None:
            ended[place] = {"kind": "not_solved", "message": one.reason}
            seconds.append(0.0)
            continue
        stands = shelf.look_up(one.cell, one.settings, one.mark)
        done = one.cell.planned if stands.complete else min(len(stands.rows), one.cell.planned)
        if stands.complete:
            ended[place] = entry_of(one.cell, stands)
        rest = seconds_to_do(one.cell, done, pace)
        seconds.append(rest)
        planned, finished, threads = planned + one.cell.planned, finished + done, max(threads, one.cell.threads)
        unknown += one.cell.planned - done if rest is None else 0
    workers = workers_of(request, threads)
    text = summary(planned, finished, seconds, unknown, workers) if any(seconds) else ""
    return Outlook(Forecast(seconds, [_kind(job) for job in jobs], workers), text, ended, configs)


def _likely(jobs: Sequence[Sequence[str]], request: Request, results: Results) -> Outlook:
    """The outlook of a sweep from some of its jobs, each composed by itself."""
    chosen = range(0, len(jobs), -(-len(jobs) // COMPOSED))
    found = {job: planned_job(jobs[job]) for job in chosen}
    cells = {job: (one.cell, one.settings) if one.cell and one.settings else None for job, one in found.items()}
    done = {job: _finished(results, *entry) if entry else 0 for job, entry in cells.items()}
    pace = Pace.of(results)
    seconds = {job: seconds_to_do(entry[0], done[job], pace) if entry else 0.0 for job, entry in cells.items()}
    kinds = [_kind(job) for job in jobs]
    every = _spread(seconds, kinds)
    planned = {job: entry[0].planned if entry else 0 for job, entry in cells.items()}
    unknown = sum(planned[job] - done[job] for job in chosen if seconds[job] is None)
    workers = workers_of(request, max((entry[0].threads for entry in cells.values() if entry), default=1))
    cases, finished, unknown = (
        n * len(jobs) // len(chosen) for n in (sum(planned.values()), sum(done.values()), unknown)
    )
    text = summary(cases, finished, every, unknown, workers) if any(every) else ""
    return Outlook(Forecast(every, kinds, workers), text)


def _finished(results: Results, cell: Cell, settings: Settings) -> int:
    rows, _ = standing_rows(results, cell, standing(results, cell, ingredients(cell)), settings)
    return min(len(rows), cell.planned)


def _kind(job: Sequence[str]) -> str:
    """The overrides of a job that choose its method and task."""
    return " ".join(word for word in job if re.match(r"\+?(method|task)\b", word))


def _spread(seconds: Mapping[int, float | None], kinds: Sequence[str]) -> list[float | None]:
    """Seconds of every job: of those that were not looked up, the mean of their kind; None if unknown."""
    of_kind: dict[str, list[float]] = {}
    for job, value in seconds.items():
        if value is not None:
            of_kind.setdefault(kinds[job], []).append(value)
    means = {kind: sum(values) / len(values) for kind, values in of_kind.items()}
    return [seconds[job] if job in seconds else means.get(kind) for job, kind in enumerate(kinds)]
