"""Runs cells: each in a child process of its own, watched, with every finished case stored at once.

It behaves the same under every launcher: a launcher only decides in which process :func:`run_cell` is called.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from ..errors import UsageError
from ..plan.cell import Cell, Settings
from ..results.checks import NoRecord, lacks, of_the_cell
from ..results.earlier import Standing, standing
from ..results.files import COLUMNS, SCHEMA_VERSION
from ..results.imputation import lacks_worst
from ..results.kept_outputs import found
from ..results.provenance import ingredients, memory_keys, plugin_sources, provenance, source_digest
from ..results.store import Record, Results
from ..text import bounded, encodable
from .affinity import claim
from .channel import NoEvent
from .devices import check_device, claim_device
from .forkserver import CannotStart, ForkServer, ServerDied, take_prestarted
from .watch import Death, Worker

STAGES = ("start", "plan", "case", "prepare", "method", "score", "worst")  # of a worker, for each case in this order
BEFORE_ANY_CASE = ("start", "plan")  # a failure there is not the method's: it is tried again each time
TRIES = 3  # of a worker or a server that ends before any case: a system short of memory may have killed it
MAX_SERVERS = 6  # a fork server holds its libraries in memory; the least recently used one goes


class Reporter(Protocol):
    """Receives progress."""

    def cell_begins(self, cell: Cell, planned: int, done: int) -> None:
        """A cell starts; ``done`` of its cases are cached."""

    def event(self, event: Mapping[str, Any]) -> None:
        """An event of the worker."""


class Silent:
    """No progress."""

    def cell_begins(self, cell: Cell, planned: int, done: int) -> None:
        """Nothing."""

    def event(self, event: Mapping[str, Any]) -> None:
        """Nothing."""


@dataclass
class Outcome:
    """The outcome of a cell."""

    record: Record
    cached: int  # how many of its cases were cached
    notes: list[str]  # about damaged files
    for_outputs: int = 0  # how many solved cases were run again only to store their outputs
    stale: tuple[str, ...] = ()  # why the cell's newest record is not current


def run_cell(
    cell: Cell,
    settings: Settings,
    reporter: Reporter | None = None,
    alive: Callable[[], None] = lambda: None,
    known: Mapping[int, Mapping[str, Any]] = {},
) -> Outcome:
    """Run the missing cases of a cell and store them.

    Parameters
    ----------
    cell, settings : what and how
    reporter : where progress goes
    alive : called while waiting; raises to stop
    known : rows of a record elsewhere by the index of their case, which are not run again

    Raises
    ------
    StoreError
        If the results cannot be written.
    UsageError
        If the dataset has no case in the split, or if a case needs a device that this machine does not have.
    """
    results = Results(settings.results, mends=True)
    parts = ingredients(cell)
    with results.lock(cell.id):
        stands = standing(results, cell, parts)
        mark = stands.mark
        rows, stored = standing_rows(results, cell, stands, settings)
        rows = {index: {**row, "cell": cell.id, "fingerprint": mark} for index, row in known.items()} | rows
        if settings.rerun == "always":
            results.forget_partial(cell.id, mark)
        if stored and all(rows.get(row["case_index"]) is row for row in stored.rows):
            return Outcome(stored, len(rows), results.damaged)
        check_device(cell.device)
        weights = prepared_weights(cell, settings, results, reporter, alive)
        for_outputs = len(_without_output(results, cell, stands.record, settings) - rows.keys())
        job = _Job(cell, settings, results, mark, rows, reporter or Silent(), alive, weights)
        cached = len(rows)
        with claim_device(cell.device, alive) as job.device, claim(cell.threads) as cpus:
            job.run(cpus)
        if not job.rows:
            raise UsageError(f"dataset {cell.dataset.label} has no shapes in the split {cell.split!r}")
        meta = _meta(cell, settings, parts, mark, job, cpus)
        meta["references"] = _references(stored, job.ordered_rows())
        record = Record(cell.id, mark, meta, job.ordered_rows())
        results.write(record)
    return Outcome(record, cached, results.damaged, for_outputs, stands.stale)


def prepared_weights(
    cell: Cell, settings: Settings, results: Results, reporter: Reporter | None, alive: Callable[[], None]
) -> dict[str, Any]:
    """The weights that the worker of a cell needs: none, a file, or the reason why there is none.

    The training runs now if it has not run before.
    """
    if cell.training is None:
        return {}
    from .training import TrainingFailed, weights_for

    try:
        weights = weights_for(cell.training, settings, results, (reporter or Silent()).event, alive)
    except TrainingFailed as failed:
        return {"failed": failed.row}
    seen = weights.facts.get("shapes") or [] if cell.split == "test" else []
    return {"path": str(weights.path), "columns": weights.columns, "shapes": seen}


def finished_rows(
    results: Results, cell: Cell, mark: str, settings: Settings
) -> tuple[dict[int, dict[str, Any]], Record | None]:
    """The cases that need not be run again, by index, and the stored record they come from."""
    stored = results.read(cell.id, mark)
    if stored and (missing := lacks(stored.meta)):
        results.leave_out(results.path(cell.id, mark), NoRecord(f"its metadata lack {', '.join(missing)}"))
        stored = None
    if settings.rerun == "always":
        return {}, stored
    same = of_the_cell(cell.to_json()).items()
    rows = stored.rows if stored else []
    rows = rows + [row for row in results.partial_rows(cell.id, mark) if same <= ({"split": cell.split} | row).items()]
    before = stored.meta["settings"]["limit"] if stored else {}
    kept = {row["case_index"]: row for row in rows if not must_rerun(row, settings, before)}
    return {index: row for index, row in kept.items() if not lacks_output(results, row, settings)}, stored


def standing_rows(
    results: Results, cell: Cell, stands: Standing, settings: Settings
) -> tuple[dict[int, dict[str, Any]], Record | None]:
    """:func:`finished_rows` of the record that counts, which an earlier version may have stored.

    Cases that a run adds to that record are stored with its rows, under the current fingerprint.
    """
    rows, stored = finished_rows(results, cell, stands.record, settings)
    if stands.record == stands.mark or (stored and len(rows) == len(stored.rows)):
        return rows, stored
    begun, _ = finished_rows(results, cell, stands.mark, settings)
    return {index: row | {"fingerprint": stands.mark} for index, row in rows.items()} | begun, stored


def lacks_output(results: Results, row: Mapping[str, Any], settings: Settings) -> bool:
    """Whether the settings ask for the output of a solved case whose file is not there."""
    wanted = settings.outputs == "all" or (settings.outputs == "first" and row["case_index"] == 0)
    return wanted and row["status"] == "ok" and found(results.folder, row.get("output")) is None


def _without_output(results: Results, cell: Cell, mark: str, settings: Settings) -> set[int]:
    """The solved cases of a cell that are run again only for their outputs."""
    if settings.outputs == "none" or settings.rerun == "always":
        return set()
    rows, _ = finished_rows(results, cell, mark, replace(settings, outputs="none"))
    return {index for index, row in rows.items() if lacks_output(results, row, settings)}


def _references(stored: Record | None, rows: list[dict[str, Any]]) -> dict[str, str]:
    """The files of the references of the stored outputs by case, relative to the results folder."""
    before = (stored.meta.get("references") or {}) if stored else {}
    now = {row["case"]: row.pop("reference", None) for row in rows}
    return before | {case: path for case, path in now.items() if path}


def must_rerun(row: Mapping[str, Any], settings: Settings, before: Mapping[str, float]) -> bool:
    """Whether a stored row should be computed again: a limit was raised, a library may be installed now, or on request.

    A row with a note counts as cut short by the limit: what a method left out for lack of time may fit now.
    ``before`` are the limits that its cell was last run under, for those that are not columns.
    """
    limit, noted = settings.limit, row["status"] == "ok" and bool(row.get("message"))
    off_the_clock = row["status"] == "timeout" and (
        row.get("stage") != "method" or "limit.setup_seconds" in (row.get("message") or "")  # the clock was stopped
    )
    return (
        row["status"] == "skipped"
        or row.get("stage") in (*BEFORE_ANY_CASE, "train")
        or (settings.rerun == "failed" and row["status"] != "ok")
        or ((noted or row["status"] == "timeout") and limit.seconds > (row.get("limit_seconds") or 0))
        or (off_the_clock and limit.setup_seconds > before.get("setup_seconds", math.inf))
        or (row["status"] == "invalid" and limit.output_points > before.get("output_points", math.inf))
        or (row["status"] == "oom" and limit.memory_gb > (row.get("limit_memory_gb") or 0))
    )


class _Job:
    """The cases of one cell that are still to do."""

    def __init__(
        self,
        cell: Cell,
        settings: Settings,
        results: Results,
        mark: str,
        rows: dict[int, dict[str, Any]],
        reporter: Reporter,
        alive: Callable[[], None],
        weights: dict[str, Any],
    ):
        self.weights = weights
        self.cell, self.settings, self.results, self.mark = cell, settings, results, mark
        self.rows, self.reporter, self.alive = rows, reporter, alive
        self.device = cell.device
        self.ids: list[str] = []
        # Of the worker: its stage and case; whether it has listed the cases, and asks for a successor.
        self.at, self.listed, self.replaced = (-1, 0), False, False
        self.scored: set[int] = set()  # cases whose worst scores were requested: once is enough
        self.constants = constant_columns(cell, settings, mark)

    def run(self, cpus: list[int]) -> None:
        """Fork workers until every case has its row: a new one after each that died.

        Raises
        ------
        CannotStart
            If no worker can start, whatever the method.
        """
        self.reporter.cell_begins(self.cell, self.cell.planned, len(self.rows))
        deaths = starts = 0
        tried = set()  # cases whose fork server was killed once
        while True:
            try:
                death = self.work(cpus)
            except (ServerDied, CannotStart) as error:
                starts += 1
                if starts < TRIES:
                    continue
                if isinstance(error, CannotStart):
                    raise
                death = Death("crashed", str(error), -1, "start", 0.0, "")
            if death is None:
                return
            if death.with_server:  # a system short of memory may have killed it: the case is tried again
                forget_servers()
                if death.index not in tried:
                    tried.add(death.index)
                    continue
            deaths += 1
            if death.index < 0:
                self.no_plan(of_death(death))
                return
            if death.index not in self.rows:  # otherwise it died between two cases, and this one is stored
                self.keep({"case": self.ids[death.index], "case_index": death.index} | of_death(death))
            elif deaths > 2 * len(self.ids):
                self.no_plan(of_death(death))
                return

    def work(self, cpus: list[int]) -> Death | None:
        """Fork workers and follow them to their end; returns how one died, or None when all cases are done.

        Raises
        ------
        ServerDied
            If a library or a plugin of this cell ends the process that imports it.
        CannotStart
            If the worker or its server ended before it loaded anything of this cell.
        """
        server = server_for(self.cell, self.settings)
        limit, verbose = self.settings.limit, self.settings.verbose
        while True:
            before, self.at, self.listed, self.replaced = len(self.rows), (-1, 0), False, False
            try:
                death = Worker(server, self.spec(cpus), limit, self.hear, self.alive, verbose).watch()
            except ServerDied as error:
                forget_servers()
                raise CannotStart(str(error)) from error
            if death is not None:
                break
            missing = [index for index in range(len(self.ids)) if index not in self.rows]
            if not missing:
                return None
            if not (self.replaced and len(self.rows) > before):
                return Death(
                    "crashed", "its worker ended before the case was done", missing[0], STAGES[self.at[1]], 0.0, ""
                )
        if death.stage == "start":
            raise CannotStart("; ".join([death.message, *death.printed.splitlines()[-1:]]))
        return death

    def spec(self, cpus: list[int]) -> dict[str, Any]:
        """The worker's job, as JSON values."""
        s = self.settings
        return {
            "cell": self.cell.to_json(),
            "done": sorted(self.rows),
            "owed": sorted(i for i, row in self.rows.items() if i not in self.scored and lacks_worst(row)),
            "cpus": cpus,
            "threads": self.cell.threads,
            "device": self.device,
            "seconds": s.limit.seconds,
            "memory_gb": s.limit.memory_gb,
            "output_points": s.limit.output_points,
            "cache": str(self.results.folder / ".cache"),
            "cache_gb": s.limit.cache_gb,
            "keys": memory_keys(self.cell),
            "outputs": s.outputs,
            "results": str(self.results.folder),
            "fingerprint": self.mark,
            "weights": self.weights,
        }

    def hear(self, event: dict[str, Any]) -> None:
        """One event of the worker.

        Raises
        ------
        NoEvent
            If the worker cannot have sent it: it runs the announced cases one after the other.
        """
        kind, index = event["event"], event.get("index", self.at[0])
        if not self.fits(event, index):
            raise NoEvent(f"an event {kind!r} that is not expected here")
        if kind == "cases":
            self.ids, self.listed = event["ids"], True
            self.rows = {i: row for i, row in self.rows.items() if i < len(self.ids)}
        elif kind == "row":
            self.keep(event["row"])
        elif kind == "no_plan":
            self.no_plan(event["row"])
        elif kind == "begin":
            self.at = (index, STAGES.index(event["stage"]))
            if event["stage"] == "worst":
                self.scored.add(index)
        elif kind == "worst":
            row = self.rows.get(index, {})  # empty if it could not be stored: that error is on its way
            row |= {key: value for key, value in event["row"].items() if not row.get(key)}
        elif kind == "replace":
            self.replaced = True
        self.reporter.event(event)

    def fits(self, event: dict[str, Any], index: int) -> bool:
        """Whether an event can come now."""
        kind, (now, stage) = event["event"], self.at
        if kind == "begin":
            known = event["stage"] in STAGES and index < (len(self.ids) if self.listed else 0)
            return known and (index, STAGES.index(event["stage"])) > self.at
        if kind in ("cases", "no_plan"):
            return STAGES[stage] == "plan" and not self.listed
        if kind == "row":
            row = event["row"]
            return now >= 0 and (row["case_index"], row["case"]) == (now, self.ids[now]) and now not in self.rows
        return index == now

    def keep(self, row: dict[str, Any]) -> None:
        """Store one finished case at once."""
        from .worker import now

        # The row can be stored whatever text a method, a dataset or a file name contains.
        row = encodable(
            dict.fromkeys(COLUMNS)
            | {"started": now(), "finished": now()}
            | bounded(row)
            | self.weights.get("columns", {})
            | self.constants
        )
        self.results.add_partial(self.cell.id, self.mark, row)
        self.rows[row["case_index"]] = row
        self.reporter.event({"event": "kept", "row": row})

    def no_plan(self, row: dict[str, Any]) -> None:
        """The cases could not be listed: one row has the reason, or one row for each case if they are known."""
        missing = [index for index in range(len(self.ids) or self.cell.planned) if index not in self.rows]
        for index in missing if self.ids else missing[:1]:
            name = self.ids[index] if self.ids else f"case-{index:03d}"
            self.keep({"case": name, "case_index": index} | row)

    def ordered_rows(self) -> list[dict[str, Any]]:
        """All rows by case."""
        # Rows of versions below 4, stored or partial, have no column of the split.
        return [{"split": self.cell.split} | self.rows[index] for index in sorted(self.rows)]


def of_death(death: Death) -> dict[str, Any]:
    """The columns that describe how a worker ended."""
    from .worker import now

    return {
        "started": now(-death.seconds),
        "status": death.status,
        "stage": death.stage,
        "message": death.message,
        "traceback": death.printed,
        "seconds": death.seconds if death.stage == "method" else None,
    }


def constant_columns(cell: Cell, settings: Settings, mark: str) -> dict[str, Any]:
    """The columns that are the same in all rows of a cell."""
    import platform

    return {
        "schema_version": SCHEMA_VERSION,
        "cell": cell.id,
        "fingerprint": mark,
        "task": cell.task.label,
        "dataset": cell.dataset.label,
        "sensor": cell.sensor.label if cell.sensor in cell.choices else "",
        "split": cell.split,
        "method": cell.method.name,
        "variant": cell.variant,
        "seed": cell.seed,
        "threads": cell.threads,
        "device": cell.device,
        "host": platform.node(),
        "limit_seconds": settings.limit.seconds,
        "limit_memory_gb": settings.limit.memory_gb,
    }


def _meta(
    cell: Cell, settings: Settings, parts: dict[str, Any], mark: str, job: _Job, cpus: list[int]
) -> dict[str, Any]:
    """The metadata of a record: all that is needed to run it again."""
    from dataclasses import asdict

    from .worker import now

    return {
        "schema_version": SCHEMA_VERSION,
        "cell_id": cell.id,
        "cell": cell.to_json(),
        "fingerprint": mark,
        "ingredients": parts,
        "settings": asdict(settings),
        "planned": len(job.rows),
        "processors_used": cpus,
        "metrics": {
            m.name: {"version": m.plugin.version, "better": m.plugin.options.get("better", "lower")}
            for m in cell.metrics
        },
        "provenance": encodable(provenance(cell)),
        "sources": encodable(plugin_sources(cell)),
        "finished": now(),
    }


# -- fork servers ------------------------------------------------------------------------------------------------------

_servers: dict[tuple[Any, ...], ForkServer] = {}
_sources: dict[str, str] = {}  # digests of the plugin sources loaded by the servers


def server_for(cell: Cell, settings: Settings) -> ForkServer:
    """The fork server for the libraries of a cell's method; all are restarted when a plugin of it was edited since.

    What the dataset, the sensor and the metrics of the first cell need is loaded with it; a later cell's dataset is
    imported by the worker, off the clock.
    """
    plugins = [plugin for choice in cell.choices for plugin in choice.parts]
    digests = {str(plugin.file): source_digest(plugin.file) for plugin in plugins}
    if any(_sources.get(file, digest) != digest for file, digest in digests.items()):
        forget_servers()
    _sources.update(digests)
    libraries = frozenset(library for plugin in cell.method.parts for library in plugin.requires)
    key = (os.getpid(), libraries, settings.plugins, cell.threads)
    if key in _servers:
        _servers[key] = _servers.pop(key)  # the most recently used comes last
        return _servers[key]
    while len(_servers) >= MAX_SERVERS:
        _servers.pop(next(iter(_servers))).close()
    preload = tuple(sorted({library for plugin in plugins for library in plugin.requires}))
    for file in settings.plugins:  # it loads them all, also those of later cells, which may be edited until then
        _sources.setdefault(file, source_digest(Path(file)))
    server = take_prestarted(cell.threads)
    try:
        server.load(preload, settings.plugins)
    except (ServerDied, CannotStart):
        server.close()
        raise
    _servers[key] = server
    return server


def forget_servers() -> None:
    """End all fork servers of this process."""
    _sources.clear()
    while _servers:
        _servers.popitem()[1].close()
