"""Records of earlier versions: which of them a run would compute again today, and why.

Until version 0.2, the digest of a source depended on where files stood and on their import lines, so records of a
checkout in another layout look edited. ``earlier_sources.json`` maps the digests of that time:

    {"method jet": {"0123456789abcdef": "fedcba9876543210"}}    old digest: digest of the source with equal results

made by ``scripts/earlier_sources.py``. A source that is edited later has another digest than in the table; records
that it maps are then not current, as they should be.

For plugins that are not shipped, the old digest is computed again from their files, which works as long as
they import nothing of ``bench.geometry`` that has changed.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import json
import math
import os
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ..plugins.registry import registry
from ..text import counted
from .provenance import explain, fingerprint
from .sources import BENCH

if TYPE_CHECKING:
    from ..plan.cell import Cell
    from .store import Results

TABLE = Path(__file__).with_name("earlier_sources.json")
SOURCE = "source of "
UNSCORED = " was not scored"
REASONS = 3  # that one line names


class Standing(NamedTuple):
    """The state of a cell in a results folder.

    Attributes
    ----------
    mark : str
        Today's fingerprint.
    record : str
        The fingerprint of the record in use: ``mark``, or that of an earlier version's record with equal results.
    stale : tuple of str
        Why the newest record is not current, one reason a line; empty if one is in use, or if there is none.
    """

    mark: str
    record: str
    stale: tuple[str, ...] = ()


def standing(results: Results, cell: Cell, parts: Mapping[str, Any]) -> Standing:
    """The record of a cell in use, for today's ingredients ``parts``."""
    mark = fingerprint(dict(parts))
    if results.path(cell.id, mark).exists():
        return Standing(mark, mark)
    metas = [results.meta(cell.id, other) for other in results.fingerprints(cell.id)]
    compared = [
        (seconds_of(meta.get("finished")), meta["fingerprint"], differences(meta["ingredients"], parts))
        for meta in metas
        if isinstance(meta.get("ingredients"), dict) and isinstance(meta.get("fingerprint"), str)
    ]
    compared.sort(key=lambda one: (not one[2], one[0] if one[0] == one[0] else 0.0, one[1]))  # NaN: no date
    if not compared:
        return Standing(mark, mark, tuple(_unscored(results, cell)))
    _, record, lines = compared[-1]
    return Standing(mark, mark, tuple(lines)) if lines else Standing(mark, record)


def _unscored(results: Results, cell: Cell) -> Iterator[str]:
    """If a cell without a record is stored with one metric less: that metric, a later addition to the usual ones.

    The metrics are part of a cell's id, for a record holds the scores of all of them.
    """
    if not (results.folder / "cells").is_dir() or len(cell.metrics) == 1:
        return
    for one in cell.metrics:
        fewer = replace(cell, metrics=tuple(metric for metric in cell.metrics if metric is not one))
        if results.fingerprints(fewer.id):
            yield f"metric {one.name}{UNSCORED}"
            return


def differences(then: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """The differences between a record's ingredients and today's, one a line; earlier digests are mapped."""
    return explain(translated(then, now), dict(now))


def translated(then: Mapping[str, Any], now: Mapping[str, Any]) -> dict[str, Any]:
    """A record's ingredients, with digests of earlier versions replaced where they map to the sources of ``now``."""
    return dict(then) | {
        key: now[key]
        for key, value in then.items()
        if key.startswith(SOURCE) and key in now and now[key] != value and _same(key, value, now[key])
    }


def _same(key: str, before: Any, after: Any) -> bool:
    plugin = key.removeprefix(SOURCE)
    if not isinstance(before, str):
        return False
    if plugin in table():
        return table()[plugin].get(before) == after
    kind, _, name = plugin.partition(" ")
    return name in registry().names(kind) and earlier_digest(registry().find(kind, name).file) == before


@functools.cache
def table() -> Mapping[str, Mapping[str, str]]:
    """By kind and name of a shipped plugin, the meaning of digests of earlier versions."""
    return json.loads(TABLE.read_text(encoding="utf-8"))


def told(stale: Iterable[Iterable[str]]) -> str:
    """One line on cells that are run again although they have records, none of them current; empty without such cells.

    Parameters
    ----------
    stale : iterable of iterable of str
        For each cell, why its newest record is not current; cells without such a record add nothing.
    """
    lines = [tuple(cell) for cell in stale]
    count = sum(map(bool, lines))
    if not count:
        return ""
    reasons = Counter(reason for cell in lines for reason in cell).most_common()
    shown = [f"{reason} ({cells} cells)" if cells > 1 else reason for reason, cells in reasons[:REASONS]]
    more = [counted(len(reasons) - REASONS, "more reason")] if len(reasons) > REASONS else []
    cells = "1 cell has a stored result that is" if count == 1 else f"{count} cells have stored results that are"
    known = any(not reason.endswith(UNSCORED) for reason, _ in reasons)
    hint = ". `detailbench why CELL` shows more" if known else ""
    return f"{cells} not current: {'; '.join([*shown, *more])}{hint}"


def seconds_of(finished: Any) -> float:
    """A time in ISO 8601 as seconds since the epoch, NaN if it is invalid."""
    try:
        moment = datetime.fromisoformat(finished)
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    except (TypeError, ValueError, OverflowError):
        return math.nan


# -- the digest of earlier versions ------------------------------------------------------------------------------------


def earlier_digest(file: Path) -> str:
    """The digest of a plugin's file as versions before 0.2 made it: over names and bytes, import lines included."""
    closure = sorted(_closure(file), key=str)
    return _digest(tuple((str(path), stat.st_mtime_ns, stat.st_size) for path in closure for stat in [path.stat()]))


@functools.lru_cache(maxsize=1024)
def _digest(keys: tuple[tuple[str, int, int], ...]) -> str:
    total = hashlib.sha256()
    for path, _, _ in keys:
        total.update(os.path.basename(path).encode() + b"\0" + Path(path).read_bytes() + b"\0")
    return total.hexdigest()[:16]


def _closure(file: Path) -> set[Path]:
    known: set[Path] = set()
    todo = [file.resolve()]
    while todo:
        path = todo.pop()
        if path in known or not path.is_file():
            continue
        known.add(path)
        stat = path.stat()
        todo.extend(_local_imports(path, stat.st_mtime_ns, stat.st_size))
    return known


@functools.lru_cache(maxsize=1024)
def _local_imports(path: Path, mtime_ns: int, size: int) -> tuple[Path, ...]:
    try:
        tree = ast.parse(path.read_bytes())
    except (SyntaxError, ValueError):
        return ()
    return tuple(found for name in _imported_names(tree) if (found := _resolve(name, path)))


def _imported_names(tree: ast.AST) -> Iterator[str]:
    """Dotted names; relative ones keep their leading dots."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = "." * node.level + (node.module or "")
            yield base
            dot = "" if base.endswith(".") else "."
            yield from (f"{base}{dot}{alias.name}" for alias in node.names if alias.name != "*")


def _resolve(name: str, importer: Path) -> Path | None:
    """The file of an import that counted as the plugin's own, or None."""
    level = len(name) - len(name.lstrip("."))
    if level:
        folder = importer.parent
        for _ in range(level - 1):
            folder = folder.parent
    elif name.startswith("bench.geometry."):
        folder, name = BENCH, name.removeprefix("bench.")
    elif not (importer.parent / "__init__.py").exists():
        folder = importer.parent
    else:
        return None
    stem = folder.joinpath(*name.strip(".").split("."))
    for candidate in (stem.with_suffix(".py"), stem / "__init__.py"):
        if candidate.is_file() and candidate.resolve() != importer:
            return candidate.resolve()
    return None
