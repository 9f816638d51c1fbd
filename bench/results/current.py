"""The choice among several records for one place in a table.

The record that is *current*: its fingerprint is the one that a run of its cell would have today, with the sources,
packages and files that are here now. If none is, or if that is unknown, the newest. So a table shows what
`detailbench run` would find, also after an edit was taken back.

A plugin that is not installed here is not imported for this, whatever file the record names: its source is compared
with that file, if it exists, and everything else about the plugin counts as unchanged.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import DetailbenchError
from ..plan.cell import Cell
from ..plugins.registry import registry
from .earlier import differences, earlier_digest, seconds_of
from .provenance import STATED, ingredients, package_version, source_digest

# Exceptions that the metadata of any folder, and the plugins that they name, may raise.
UNTOLD = (DetailbenchError, KeyError, TypeError, ValueError, AttributeError, OSError, RecursionError, OverflowError)
LONGEST = 1 << 20  # bytes of a plugin's file that a record names and that is compared with it


class Today:
    """The current ingredients of the fingerprints of cells; each plugin is examined once."""

    def __init__(self) -> None:
        self._known: dict[str, dict[str, Any]] = {}

    def is_current(self, meta: Mapping[str, Any]) -> bool:
        """Whether the record with this metadata is what a run would find; False if that is unknown."""
        return self.differences(meta) == []

    def differences(self, meta: Mapping[str, Any]) -> list[str] | None:
        """The differences between the ingredients of a record and today's, one a line; None if unknown."""
        then = meta.get("ingredients")
        if not isinstance(then, Mapping):
            return None
        try:
            cell = Cell.from_json(meta["cell"])
            stated = {key: value for key, value in then.items() if key.startswith(STATED)}
            now = self._of(cell) | {"cell": cell.id} | stated
        except UNTOLD:
            try:
                now = _without_plugins(then, meta)
            except UNTOLD:
                return None
        return None if now is None else differences(then, now)

    def _of(self, cell: Cell) -> dict[str, Any]:
        # Cells of one sweep differ in these alone, which take part in the fingerprint by the cell's id.
        same = {k: v for k, v in cell.to_json().items() if k not in ("seed", "cases", "split")}
        key = json.dumps(same, sort_keys=True)
        if key not in self._known:
            self._known[key] = ingredients(cell, recorded={})
        return self._known[key]


def _without_plugins(then: Mapping[str, Any], meta: Mapping[str, Any]) -> dict[str, Any] | None:
    """Today's ingredients as far as they are known without building the cell; None if a source is missing."""
    recorded = (meta.get("provenance") or {}).get("plugins") or {}
    now = dict(then)
    for key in then:
        if key.startswith("package "):
            name = key.removeprefix("package ")
            # To look for a module inside of a package imports the package.
            now[key] = package_version(name) if name.isidentifier() else then[key]
        elif key.startswith("source of "):
            kind, _, name = key.removeprefix("source of ").partition(" ")
            if name in registry().names(kind):
                file = registry().find(kind, name).file
            else:
                file = Path((recorded.get(f"{kind} {name}") or {}).get("file") or "")
            if file.suffix != ".py" or not file.is_file() or file.stat().st_size > LONGEST:
                return None
            same = then[key] == earlier_digest(file)  # as versions before 0.2 recorded it
            now[key] = then[key] if same else source_digest(file)
    return now


def timestamp(finished: Any, written: float, now: float) -> float:
    """When a record was made, in seconds since the epoch, to decide which record is newer.

    A wrong clock must not make a record the newest for ever: a time in the future is replaced by the file's
    own (``written``), and a file that is itself from the future is older than all others.
    """
    return next((time for time in (seconds_of(finished), written) if time <= now), -math.inf)
