"""The work of a sweep, found without composing the config of every job, which takes longer than small cells."""

from __future__ import annotations

import copy
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..engine.runner import standing_rows
from ..errors import UsageError
from ..plan.cell import Cell, NotSolved, Settings, settings_of
from ..plan.keys import GROUPS
from ..plugins import presets
from ..plugins.registry import KINDS
from ..plugins.schema import NAME_KEY
from ..results.earlier import standing
from ..results.provenance import ingredients
from ..results.store import Results
from .composition import resolved
from .forecast import Forecast, Pace, seconds_to_do, summary, workers_of
from .planned import Planned, Shelf, entry_of, planned_jobs
from .request import Request, parse

LOOKED_UP = 100  # jobs of a large sweep that represent all


@dataclass(frozen=True)
class Outlook:
    """A forecast of a sweep, and the same in words: empty if no time is known.

    Attributes
    ----------
    ended : dict
        By place in the sweep, the entries of jobs that need not be launched: their cells are finished, or they have
        no cell. Empty if that is not known beforehand.
    """

    forecast: Forecast
    text: str
    ended: Mapping[int, dict[str, Any]] = field(default_factory=dict)


def look_ahead(jobs: Sequence[Sequence[str]], request: Request, results: Results) -> Outlook | None:
    """The work of the jobs of a sweep; None if they differ in a way that cannot be looked up.

    Every job is looked up if their configs can be assembled from parts. Otherwise, some jobs of a large sweep,
    evenly spread, represent all.

    Parameters
    ----------
    jobs : the overrides of each job
    request : that of the sweep, which names its launcher
    results : where finished cases are
    """
    try:
        plan = planned_jobs(jobs)
        if plan is not None:
            return _outlook(plan, jobs, request, results)
    except UsageError:
        return None  # the job itself reports the error
    return _likely(jobs, request, results)


def _outlook(plan: Iterator[Planned], jobs: Sequence[Sequence[str]], request: Request, results: Results) -> Outlook:
    """The outlook of a sweep whose cells are all known."""
    shelf, pace = Shelf(results), Pace.of(results)
    seconds: list[float | None] = []
    ended: dict[int, dict[str, Any]] = {}
    planned = finished = unknown = 0
    threads = 1
    for place, one in enumerate(plan):
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
    return Outlook(Forecast(seconds, [_kind(job) for job in jobs], workers), text, ended)


def _likely(jobs: Sequence[Sequence[str]], request: Request, results: Results) -> Outlook | None:
    """The outlook of a sweep from some of its jobs."""
    chosen = range(0, len(jobs), -(-len(jobs) // LOOKED_UP) or 1)
    try:
        cells = dict(zip(chosen, likely_cells([jobs[job] for job in chosen]), strict=True))
        done = {job: _finished(results, *entry) if entry else 0 for job, entry in cells.items()}
    except UsageError:
        return None  # the job itself reports the error
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


def likely_cells(jobs: Sequence[Sequence[str]]) -> Iterator[tuple[Cell, Settings] | None]:
    """The cells of jobs that differ in plugins, their parameters and plain values; None for a pair that has no cell.

    The first job is composed, and the changes of the others are applied to it. An experiment may give
    parameters to a plugin that other jobs lack: such a cell may be missed.

    Raises
    ------
    UsageError
        If a job cannot be composed, or if jobs differ in more, for instance in their profile.
    """
    first = dict(_parsed(jobs[0]))
    base = resolved(jobs[0])
    cases: dict[str, int] = {}  # by dataset: a profile takes all of the user's own files
    for job in jobs:
        words = _parsed(job)
        values = copy.deepcopy(base)
        changed = [(key, value) for key, value in words if first.get(key, value) != value or key not in first]
        for key, value in changed:
            _change(values, key, value)
        chosen = {key for key, _ in changed if key in KINDS}
        if "dataset" in chosen:
            name = values["dataset"]["_name_"]
            cases[name] = cases[name] if name in cases else resolved(job)["cases"]
            values["cases"] = dict(words).get("cases", cases[name])
        for key, value in words:  # choosing another plugin has dropped the values that the overrides give it
            if key.partition(".")[0] in chosen and "." in key:
                _change(values, key, value)
        try:
            yield Cell.from_config(values), settings_of(values)
        except NotSolved:
            yield None


def _parsed(job: Sequence[str]) -> list[tuple[str, Any]]:
    return [(override.key_or_group, override.value()) for override in map(parse, job)]


def _change(values: dict[str, Any], key: str, value: Any) -> None:
    """Put one override's value into a composed config."""
    group, _, parameter = key.partition(".")
    if key in KINDS and key != "metric":
        plugin = presets.resolve(key, str(value))
        given = presets.presets(key, plugin).get(str(value))
        values[key] = {NAME_KEY: plugin, **(copy.deepcopy(dict(given.values)) if given else {})}
    elif parameter and isinstance(values.get(group), dict):
        *inner, last = parameter.split(".")
        node = values[group]
        for name in inner:
            node = node.setdefault(name, {})
        node[last] = value if group in KINDS else _as_before(node.get(last), value, key)
    elif key in values and key not in GROUPS and not isinstance(values[key], dict):
        values[key] = _as_before(values[key], value, key)
    else:
        raise UsageError(f"{key}={value}: jobs that differ in this are composed one by one")


def _as_before(now: Any, value: Any, key: str) -> Any:
    """A value for a key of the run for which Hydra accepted another one: of the same type, or left to Hydra."""
    if type(value) is type(now) or (type(now), type(value)) == (float, int):
        return value
    raise UsageError(f"{key}={value}: a value of another type is composed")
