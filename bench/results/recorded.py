"""A stored cell on this machine: which of its records counts, its plugins and its paths.

What the record names may be elsewhere here: ``--plugin FILE`` stands in place of the plugin file that it was run with,
and ``dataset.path=FOLDER`` in place of a path among the parameters of its dataset.
"""

from __future__ import annotations

import typing
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..errors import UsageError, did_you_mean
from ..plan.cell import Cell, Choice, Settings
from ..plan.limits import Limits
from ..plugins.registry import load_plugins, registry
from .current import Today
from .earlier import differences
from .provenance import ingredients
from .store import Record, Results


@dataclass(frozen=True)
class Stored:
    """A stored cell, with the record that tables show.

    Attributes
    ----------
    results : Results
    records : list of Record
        All of the cell, the newest first.
    shown : Record
        The one that counts: the newest that is current, or the newest.
    paths : mapping
        Parameters of the dataset that are given anew.
    """

    results: Results
    records: list[Record]
    shown: Record
    paths: Mapping[str, str]

    @classmethod
    def of(cls, prefix: str, words: Sequence[str]) -> Stored:
        """The one cell whose id begins so; ``words`` are ``results=DIR`` and ``dataset.PARAMETER=PATH``.

        Raises
        ------
        UsageError
            For another word, and when there is no such cell, or none that can be read.
        """
        folder, paths = _split(words)
        results = Results(folder)
        records = results.records(results.find_cell(prefix))
        if not records:
            raise UsageError(f"cell {prefix} in {results.folder}: {'; '.join(results.damaged) or 'has no record'}")
        today = Today()
        shown = next((record for record in records if today.is_current(record.meta)), records[0])
        return cls(results, records, shown, paths)

    @property
    def settings(self) -> Settings:
        """How the record was made; the plugins are those of that machine."""
        stored = self.shown.meta["settings"]
        return Settings(
            results=str(self.results.folder),
            limit=Limits(**stored["limit"]),
            outputs=stored["outputs"],
            plugins=tuple(stored["plugins"]),
            profile=stored["profile"],
        )

    def load(self, given: Sequence[str]) -> tuple[str, ...]:
        """Load the plugins that the cell needs: ``given`` ones, and for what these lack those of the record.

        Returns
        -------
        tuple of str
            The absolute paths of the files that were loaded.

        Raises
        ------
        UsageError
            If a plugin is needed whose file is not there, with what to do.
        """
        loaded = list(load_plugins(given))
        brought = self.shown.meta["provenance"]["plugins"]
        for file in self.shown.meta["settings"]["plugins"]:
            needed = [name for name, facts in brought.items() if facts["file"] == file]
            missing = [name for name in needed if not _is_known(name)]
            if file in loaded or (needed and not missing):
                continue
            if Path(file).is_file():
                loaded += load_plugins([file], warn=False)
            elif missing:
                raise UsageError(self._without(file, missing))
        return tuple(loaded)

    def _without(self, file: str, names: Sequence[str]) -> str:
        cell = self.shown.cell
        kept = (self.shown.meta.get("sources") or {}).get(file) or {}
        look = f"detailbench why {cell} results={self.results.folder} --source"
        where = f" Its source is in the record: `{look}` prints it." if kept.get("text") else ""
        return (
            f"cell {cell} was run with the plugin {file} ({', '.join(names)}), which is not on this machine: name the "
            f"file with --plugin FILE.{where}"
        )

    @property
    def cell(self) -> Cell:
        """The cell with the paths of this machine; to be asked for when the plugins are loaded.

        Raises
        ------
        UsageError
            If a path is none of the dataset's, or leads nowhere.
        """
        cell = Cell.from_json(self.shown.meta["cell"])
        for name in self.paths:
            _check_path(cell.dataset, name)
        cell = replace(cell, dataset=replace(cell.dataset, parameters={**cell.dataset.parameters, **self.paths}))
        check = getattr(cell.dataset.build(), "check", None)
        try:
            if check:
                check()
        except UsageError as error:
            names = [f"dataset.{name}=PATH" for name in _paths_of(cell.dataset)]
            advice = f"\nThe record names this path; say where it is here with {' '.join(names)}" if names else ""
            raise UsageError(f"{error}{advice}") from error
        return cell

    def differences(self, cell: Cell) -> list[str]:
        """What differs between the day of the record and today, one line each; the paths given anew do not count."""
        then = self.shown.meta["ingredients"]
        return differences(then, ingredients(cell) | ({"cell": then["cell"]} if self.paths else {}))


def _split(words: Sequence[str]) -> tuple[str, dict[str, str]]:
    """The results folder, and the paths of the dataset by parameter."""
    folder, paths = "results", {}
    for word in words:
        key, equals, value = word.partition("=")
        if key.startswith("dataset.") and equals:
            paths[key.removeprefix("dataset.")] = value
        elif not equals or key == "results":
            folder = value if equals else word
        else:
            raise UsageError(f"{word}: expected results=DIR, or dataset.path=FOLDER for the data of the record")
    return folder, paths


def _is_known(name: str) -> bool:
    kind, _, plugin = name.partition(" ")
    return plugin in registry().names(kind)


def _paths_of(dataset: Choice) -> list[str]:
    """The parameters of a dataset that are paths: by their type, or by their name."""
    hints = typing.get_type_hints(dataset.plugin.cls)

    def is_path(name: str) -> bool:
        kinds = {hints[name], *typing.get_args(hints[name])}
        return Path in kinds or (str in kinds and name.rpartition("_")[2] in ("path", "file", "folder"))

    return [field.name for field in dataset.plugin.fields if is_path(field.name)]


def _check_path(dataset: Choice, name: str) -> None:
    known = _paths_of(dataset)
    if name not in known:
        hint = did_you_mean(name, known) if known else "It has no parameter that is a path."
        raise UsageError(
            f"dataset.{name}: only a path of the record's dataset, {dataset.name}, can be replaced. {hint}"
        )


def lines_of_source(meta: Mapping[str, Any]) -> Iterator[str]:
    """The sources that a record keeps, each below a line with its path and digest."""
    for path, kept in (meta.get("sources") or {}).items():
        yield f"# {path} (sha256 {kept['sha256']})"
        yield kept["text"].rstrip("\n") if kept["text"] is not None else "# too long to be kept in the record"
