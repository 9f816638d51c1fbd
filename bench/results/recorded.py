"""A stored cell on this machine: its record in use, its plugins and its paths.

A record may be somebody else's, so it is not trusted: no plugin file that it names is imported, unless the user
names the file with ``--plugin``; and its plugins write no files (:func:`writing_nothing`). Its paths may
not exist here: ``dataset.path=FOLDER`` replaces a path among the parameters of its dataset.
"""

from __future__ import annotations

import os
import typing
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..errors import UsageError, did_you_mean
from ..plan.cell import NO_SENSOR, Cell, Choice, Settings, check_limits
from ..plan.limits import Limits
from ..plugins.reads import written
from ..plugins.registry import Plugin, load_plugins, registry
from ..plugins.schema import defaults
from .checks import lacks
from .current import Today
from .earlier import SOURCE, differences
from .provenance import ingredients, plugin_sources
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
        The one in use: the newest that is current, or the newest.
    paths : mapping
        Replaced parameters of the dataset.
    """

    results: Results
    records: list[Record]
    shown: Record
    paths: Mapping[str, str]

    @classmethod
    def of(cls, prefix: str, words: Sequence[str]) -> Stored:
        """The one cell whose id has this prefix; ``words`` are ``results=DIR`` and ``dataset.PARAMETER=PATH``.

        Raises
        ------
        UsageError
            For another argument, and if there is no such cell, or none that can be read.
        """
        folder, paths = _split(words)
        results = Results(folder)
        records = results.records(results.find_cell(prefix))
        if not records:
            raise UsageError(f"cell {prefix} in {results.folder}: {'; '.join(results.damaged) or 'has no record'}")
        today = Today()
        shown = next((record for record in records if today.is_current(record.meta)), records[0])
        if missing := lacks(shown.meta):
            raise UsageError(
                f"{results.path(shown.cell, shown.fingerprint)}: its metadata lack {', '.join(missing)}; only a record "
                "written by `detailbench run` can be explained or repeated"
            )
        return cls(results, records, shown, paths)

    @property
    def settings(self) -> Settings:
        """How the record was made; the plugins are those of that machine."""
        stored = self.shown.meta["settings"]
        limit = Limits(**{key: value for key, value in stored["limit"].items() if hasattr(Limits, key)})
        check_limits(limit)
        kept = {key: stored[key] for key in ("outputs", "profile") if key in stored}
        return Settings(results=str(self.results.folder), limit=limit, plugins=tuple(stored.get("plugins", ())), **kept)

    @property
    def title(self) -> str:
        """The cell in one line, as in its rows: no plugin is needed."""
        row = self.shown.rows[0]
        method = f"{row['method']}[{row['variant']}]" if row["variant"] else row["method"]
        return " ".join(filter(None, [row["task"], row["dataset"], row["sensor"], method, f"seed={row['seed']}"]))

    @property
    def missing(self) -> list[str]:
        """The plugins of the cell that are not loaded, as ``method NAME``."""
        meta = self.shown.meta
        named = [key.removeprefix(SOURCE) for key in meta["ingredients"] if key.startswith(SOURCE)]
        return [name for name in dict.fromkeys([*meta["provenance"].get("plugins", {}), *named]) if not _is_known(name)]

    def load(self, given: Sequence[str]) -> tuple[str, ...]:
        """Load the plugin files that the user names: importing runs them, so the record's own are not.

        Returns
        -------
        tuple of str
            The absolute paths of the files that were loaded.

        Raises
        ------
        UsageError
            If the cell needs a plugin that these and the installed ones lack, with what to do.
        """
        loaded = load_plugins(given)
        if missing := self.missing:
            raise UsageError(self._without(missing))
        return loaded

    def _without(self, missing: Sequence[str]) -> str:
        """The plugins of a record that are not loaded, and what to do."""
        cell, sources = self.shown.cell, self.shown.meta.get("sources", {})
        files: dict[str, list[str]] = {}
        for name in missing:
            facts = self.shown.meta["provenance"].get("plugins", {}).get(name, {})
            files.setdefault(facts.get("file", "an unknown file"), []).append(name)
        run_with = " and ".join(f"{file} ({', '.join(names)})" for file, names in files.items())
        look = f"detailbench why {cell} results={self.results.folder} --source"
        kept = any(sources.get(file, {}).get("text") for file in files)
        return (
            f"cell {cell} was run with the plugin {run_with}. Plugin files that a record names are not imported "
            "automatically, because importing runs them: if you trust the file, name it with --plugin FILE."
            + (f" Its source is in the record: `{look}` prints it." if kept else "")
        )

    @property
    def cell(self) -> Cell:
        """The cell with the paths of this machine; available once the plugins are loaded.

        Raises
        ------
        UsageError
            If a path is not one of the dataset's, or does not exist.
        """
        cell = _cell_of(self.shown, self.paths)
        check = getattr(cell.dataset.build(), "check", None)
        try:
            if check:
                check()
        except UsageError as error:
            names = [f"dataset.{name}=PATH" for name in _paths_of(cell.dataset)]
            advice = (
                f"\nThe record names this path; set its location on this machine with {' '.join(names)}"
                if names
                else ""
            )
            raise UsageError(f"{error}{advice}") from error
        return cell

    def differences(self, cell: Cell) -> list[str]:
        """The differences between the record and today, one a line; replaced paths do not count."""
        then = self.shown.meta["ingredients"]
        lines = differences(then, ingredients(cell, recorded=then) | ({"cell": then.get("cell")} if self.paths else {}))
        return lines + (list(_edited(self.shown.meta, cell)) if any(line.startswith(SOURCE) for line in lines) else [])


def _cell_of(record: Record, paths: Mapping[str, str]) -> Cell:
    """The cell of a record, with other paths of its dataset; its plugins and parameters must exist.

    Raises
    ------
    UsageError
        If it is not a valid cell, for instance of another version.
    """
    try:
        cell = Cell.from_json(record.meta["cell"])
        for name in paths:
            _check_path(cell.dataset, name)
        cell = replace(cell, dataset=replace(cell.dataset, parameters={**cell.dataset.parameters, **paths}))
        kinds = {kind: getattr(cell, kind) for kind in ("task", "dataset", "sensor", "method")}
        fits = all(choice.kind == kind for kind, choice in kinds.items()) and all(
            choice.kind == "metric" for choice in cell.metrics
        )
        for choice in cell.choices:
            choice.build()
        if fits and cell.method.solves(cell.task.name):
            return cell
        reason = "its plugins do not fit"
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        reason = f"{type(error).__name__}: {error}"
    raise UsageError(f"cell {record.cell}: the cell of its record cannot be made here ({reason})")


def _edited(meta: Mapping[str, Any], cell: Cell) -> Iterator[str]:
    """The differences between the files of plugins and those stored in a record, one a line."""
    here = {Path(path).name: (path, kept) for path, kept in plugin_sources(cell).items()}
    for path, kept in meta.get("sources", {}).items():
        found, now = here.get(Path(path).name, ("", {}))
        if not found:
            yield f"{path} of the record: no file of this name was loaded"
        elif now["sha256"] != kept.get("sha256"):
            pair = [(one or "").splitlines() for one in (kept.get("text"), now["text"])]
            same = len(os.path.commonprefix(pair)) if all(pair) else 0
            yield f"{found} differs from the record's" + (f" from line {same + 1} on" if all(pair) else "")


def writing_nothing(cell: Cell) -> tuple[Cell, list[str]]:
    """The cell without the files that its plugins would write, and the parameters that name such files.

    A plugin declares what it writes (:mod:`bench.plugins.reads`); the parts of a plugin, such as the steps of a
    chain, are checked too.
    """
    found: list[str] = []

    def cleared(choice: Choice | None) -> Choice | None:
        if choice is None or choice == NO_SENSOR:
            return choice
        values, parts = dict(choice.parameters), {part.name: part for part in choice.parts}
        for name in set(written(choice.made)).intersection(values):
            usual = defaults(choice.plugin)[name]
            if values[name] != usual:
                found.append(f"{choice.kind}.{name}={values[name]}")
                values[name] = usual
        return replace(choice, parameters={key: _of_parts(value, parts, found) for key, value in values.items()})

    def all_cleared(of: Any, kinds: Iterable[str]) -> Any:
        return replace(of, **{kind: cleared(getattr(of, kind)) for kind in kinds})

    kinds = ("task", "dataset", "sensor", "method")
    training = cell.training and all_cleared(cell.training, kinds)
    metrics = tuple(map(cleared, cell.metrics))
    return replace(all_cleared(cell, kinds), metrics=metrics, training=training), found


def _of_parts(value: Any, parts: Mapping[str, Plugin], found: list[str]) -> Any:
    """A parameter without the files that its parts would write; the parameters of these are added to ``found``."""
    if isinstance(value, (list, tuple)):
        return [_of_parts(inner, parts, found) for inner in value]
    if not isinstance(value, Mapping):
        return value
    kept: dict[str, Any] = {}
    for name, inner in value.items():
        writes = written(parts[name].cls) if name in parts and isinstance(inner, Mapping) else ()
        found.extend(f"{name}.{key}={inner[key]}" for key in writes if inner.get(key))
        inner = {key: one for key, one in inner.items() if key not in writes} if writes else inner
        kept[name] = _of_parts(inner, parts, found)
    return kept


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
    """The sources stored in a record, each below a line with its path and digest."""
    for path, kept in (meta.get("sources") or {}).items():
        yield f"# {path} (sha256 {kept['sha256']})"
        yield kept["text"].rstrip("\n") if kept["text"] is not None else "# too long to be kept in the record"
