"""The cells of all jobs of a sweep, and which are finished, without composing or opening each one."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..engine.runner import lacks_output, must_rerun, standing_rows
from ..plan.cell import Cell, NotSolved, Settings, check_root, id_of, settings_of
from ..plan.numbers import WHOLE_NUMBERS, check_whole_number
from ..results.earlier import standing
from ..results.index import states
from ..results.provenance import fingerprint, ingredients
from ..results.store import Results
from .composition import resolved
from .parts import Values, values_of

# Cells that differ only in these depend on the same sources, packages and files.
OWN = ("seed", "cases", "threads")


@dataclass(frozen=True)
class Planned:
    """One job of a sweep.

    Attributes
    ----------
    cell, settings : the cell, and how it is run; None for a pair without a cell
    mark : str
        Today's fingerprint of the cell; empty without one.
    reason : str
        Why there is no cell.
    """

    cell: Cell | None
    settings: Settings | None
    mark: str = ""
    reason: str = ""


@dataclass(frozen=True)
class _Drawing:
    """The common part of cells that differ only in :data:`OWN`."""

    cell: Cell
    settings: Settings
    plain: Mapping[str, Any]
    parts: Mapping[str, Any]

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> _Drawing:
        check_root(values)
        cell = Cell.from_config(values)
        return cls(cell, settings_of(values), cell.to_json(), ingredients(cell))

    def planned(self, values: Mapping[str, Any]) -> Planned:
        """The job whose config has these values."""
        own = {key: values[key] for key in OWN}
        for key in (key for key in WHOLE_NUMBERS if key in own):
            check_whole_number(key, own[key])
        cell = replace(self.cell, **own)
        vars(cell)["id"] = id_of({**self.plain, **own})
        vars(cell)["_there"] = self.cell._there  # datasets count their shapes once
        return Planned(cell, self.settings, fingerprint({**self.parts, "cell": cell.id}))


def planned_jobs(jobs: Sequence[Sequence[str]]) -> Iterator[Planned]:
    """Every job of a sweep, in order; each is composed by itself if it has to be (:mod:`bench.sweep.parts`).

    Raises
    ------
    UsageError
        During iteration, for a job that cannot be composed, or has no cell for any reason except parts that do not fit.
    """
    configs = values_of(jobs)
    return planned_of(map(resolved, jobs) if configs is None else configs)


def planned_of(configs: Iterable[Values]) -> Iterator[Planned]:
    """The jobs with these resolved configs, as :func:`planned_jobs`."""
    drawings: dict[tuple[Any, ...], _Drawing | Planned] = {}
    kept = []  # nodes that keys identify by address
    for values in configs:
        key = tuple(
            (name, id(value) if isinstance(value, (dict, list)) else (type(value), value))
            for name, value in values.items()
            if name not in OWN
        )
        if key not in drawings:
            kept.append(values)
            try:
                drawings[key] = _Drawing.of(values)
            except NotSolved as error:
                drawings[key] = Planned(None, None, reason=str(error))
        drawing = drawings[key]
        yield drawing if isinstance(drawing, Planned) else drawing.planned(values)


@dataclass(frozen=True)
class Stands:
    """The state of a job in a results folder.

    Attributes
    ----------
    rows : sequence of mappings
        Its rows that need not be computed again.
    complete : bool
        Whether they are all rows of its record, so that nothing is left to do.
    fingerprint : str
        Of that record.
    stored : sequence of mappings
        All rows of that record; none if there is no record.
    stale : tuple of str
        Why its newest record is not current.
    """

    rows: Sequence[Mapping[str, Any]]
    complete: bool
    fingerprint: str
    stored: Sequence[Mapping[str, Any]] = ()
    stale: tuple[str, ...] = ()


class Shelf:
    """The cells in a results folder, read at once from its index.

    Parameters
    ----------
    results : the folder
    """

    def __init__(self, results: Results):
        self.results = results
        self._rows, self._lacking = states(results)
        self._seen = {cell for cell, _ in self._rows} | self._begun()

    def _begun(self) -> set[str]:
        try:
            return {name.partition("-")[0] for name in os.listdir(self.results.folder / ".partial")}
        except OSError:
            return set()

    def has_any(self, cell: Cell) -> bool:
        """Whether there is a record of a cell, finished cases of one that was interrupted, or one of fewer metrics."""
        if cell.id in self._seen:
            return True
        plain = cell.to_json()
        return len(cell.metrics) > 1 and any(
            id_of({**plain, "metrics": [m for m in plain["metrics"] if m is not metric]}) in self._seen
            for metric in plain["metrics"]
        )

    def look_up(self, cell: Cell, settings: Settings, mark: str) -> Stands:
        """The state of a cell: as found by :func:`bench.engine.runner.run_cell`, which opens its records."""
        if (cell.id, mark) in self._rows and f"{cell.id}-{mark}.parquet" not in self._lacking:
            rows = self._rows[cell.id, mark]
            before = self._limits(cell, mark, rows)
            again = (must_rerun(row, settings, before) or lacks_output(self.results, row, settings) for row in rows)
            if settings.rerun != "always" and not any(again):
                return Stands(rows, True, mark, rows)
        if not self.has_any(cell):
            return Stands([], False, mark)
        stands = standing(self.results, cell, ingredients(cell))
        found, stored = standing_rows(self.results, cell, stands, settings)
        complete = stored is not None and all(found.get(row["case_index"]) is row for row in stored.rows)
        record, rows = (stored.fingerprint, stored.rows) if stored else (mark, [])
        return Stands(list(found.values()), complete, record, rows, stands.stale)

    def _limits(self, cell: Cell, mark: str, rows: Sequence[Mapping[str, Any]]) -> Mapping[str, float]:
        """The limits that a record was made under, if they decide whether a case is run again."""
        if not any(row["status"] in ("invalid", "timeout") for row in rows):
            return {}
        return (self.results.meta(cell.id, mark).get("settings") or {}).get("limit") or {}


def entry_of(cell: Cell, stands: Stands) -> dict[str, Any]:
    """The entry that the job of a finished cell would leave in its session's folder."""
    solved, count = sum(row["status"] == "ok" for row in stands.rows), len(stands.rows)
    left_out = f" ({cell.left_out})" if cell.left_out else ""
    return {
        "kind": "cell",
        "title": cell.title,
        "cell": cell.id,
        "fingerprint": stands.fingerprint,
        "solved": solved,
        "planned": count,
        "cached": count,
        "for_outputs": 0,
        "stale": (),
        "notes": [],
        "line": f"{cell.title}: {solved}/{count} solved{left_out}, all cached",
        "took": 0.0,
    }
