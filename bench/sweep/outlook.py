"""The work of a sweep, found without composing the config of every job, which takes longer than small cells."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..errors import UsageError
from ..results.store import Results
from .composition import resolved
from .forecast import Forecast, Pace, seconds_to_do, summary, workers_of
from .parts import Configs, values_of
from .planned import Shelf, entry_of, planned_of
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
    try:
        return _outlook(values_of(jobs), jobs, request, results)
    except UsageError:
        return None


def _outlook(configs: Configs | None, jobs: Sequence[Sequence[str]], request: Request, results: Results) -> Outlook:
    """The outlook of a sweep, from the configs of all its jobs, or from some jobs that are composed one by one."""
    places = range(0, len(jobs), 1 if configs else -(-len(jobs) // COMPOSED))
    plan = planned_of(configs or map(resolved, jobs[:: places.step]))
    shelf, pace = Shelf(results), Pace.of(results)
    seconds: dict[int, float | None] = {}
    ended: dict[int, dict[str, Any]] = {}
    planned = finished = unknown = 0
    threads = 1
    for place, one in zip(places, plan, strict=True):
        if one.cell is None or one.settings is None:
            ended[place] = {"kind": "not_solved", "message": one.reason}
            seconds[place] = 0.0
            continue
        stands = shelf.look_up(one.cell, one.settings, one.mark)
        done = one.cell.planned if stands.complete else min(len(stands.rows), one.cell.planned)
        if stands.complete:
            ended[place] = entry_of(one.cell, stands)
        rest = seconds[place] = seconds_to_do(one.cell, done, pace)
        planned, finished, threads = planned + one.cell.planned, finished + done, max(threads, one.cell.threads)
        unknown += one.cell.planned - done if rest is None else 0
    planned, finished, unknown = (count * len(jobs) // len(places) for count in (planned, finished, unknown))
    workers = workers_of(request, threads)
    kinds = [_kind(job) for job in jobs]
    every = _spread(seconds, kinds)
    text = summary(planned, finished, every, unknown, workers) if any(every) else ""
    return Outlook(Forecast(every, kinds, workers), text, ended if configs else {}, configs)


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
