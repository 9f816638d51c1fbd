"""What there is, as plain values, kept from one listing to the next.

Importing every plugin module to print its first line takes longer as the plugins grow. So the facts are kept in the
user's cache folder with a stamp of all sources that they come from (path, size and time of change); while the stamp
holds, a listing imports no plugin at all.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.metadata
import importlib.util
import inspect
import json
import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .registry import Plugin

ENTRY_POINTS = "detailbench.plugins"


def listing(files: Sequence[str] = ()) -> dict[str, Any]:
    """Every plugin, every preset, and what is broken.

    Parameters
    ----------
    files : paths of plugin files, as ``--plugin`` names them

    Returns
    -------
    dict
        ``plugins`` and ``presets``: by kind, lists of facts; ``broken``: a list of origin, file and reason.
    """
    if files:
        return _made(files)
    stamp, path = _stamp(), _path()
    with contextlib.suppress(OSError, ValueError, TypeError, KeyError):
        kept = json.loads(path.read_text(encoding="utf-8"))
        if kept["stamp"] == stamp:
            return kept["listing"]
    made = _made(())
    _keep(path, json.dumps({"stamp": stamp, "listing": made}))
    return made


def _made(files: Sequence[str]) -> dict[str, Any]:
    from .presets import presets
    from .registry import KINDS, load_plugins, registry

    load_plugins(files, warn=False)
    found = registry()
    return {
        "plugins": {kind: [as_json(plugin) for plugin in found.all(kind)] for kind in KINDS},
        "presets": {kind: [p._asdict() | {"values": dict(p.values)} for p in presets(kind).values()] for kind in KINDS},
        "broken": [{"origin": b.origin, "file": str(b.file or ""), "reason": b.reason} for b in found.broken],
    }


def as_json(plugin: Plugin) -> dict[str, Any]:
    """A plugin's facts, as JSON values."""
    from . import catalog
    from .fields import field_help
    from .presets import presets
    from .registry import registry
    from .schema import defaults

    helps = field_help(plugin.cls)
    usual = defaults(plugin)
    facts: dict[str, Any] = {
        "kind": plugin.kind,
        "name": plugin.name,
        "summary": plugin.summary,
        "doc": inspect.getdoc(plugin.cls) or "",
        "cite": plugin.cite,
        "origin": plugin.origin,
        "file": str(plugin.file),
        "requires": list(plugin.requires),
        "parameters": {f.name: {"default": usual[f.name], "help": helps[f.name]} for f in plugin.fields},
    }
    if plugin.kind == "dataset":
        facts["shapes"] = catalog.known(plugin)
    presets_of = [p for p in presets(plugin.kind).values() if p.plugin == plugin.name]
    if presets_of:
        facts["presets"] = {p.name: {"help": p.help, **p.values} for p in presets_of}
    if plugin.kind == "method":
        facts["tasks"] = [task for task in registry().names("task") if plugin.solves(task)]
    if plugin.kind == "metric":
        facts["version"] = plugin.version
        facts["better"] = plugin.options.get("better", "lower")
        facts["outputs"] = list(plugin.options.get("outputs", ("mesh", "cloud")))
    return facts


def missing(requires: Sequence[str]) -> list[str]:
    """The libraries that are declared and not installed."""
    return [library for library in requires if importlib.util.find_spec(library) is None]


# -- what is kept ------------------------------------------------------------------------------------------------------


def _path() -> Path:
    """One file for each environment."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "detailbench" / f"listing-{_digest([sys.prefix])}.json"


def _keep(path: Path, content: str) -> None:
    """Write the file; where that is not possible the next listing takes longer, no more."""
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent)
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(content)
        os.replace(temporary, path)


def _stamp() -> str:
    entries = sorted((e.name, e.value) for e in importlib.metadata.entry_points(group=ENTRY_POINTS))
    modules = {value.partition(":")[0] for _, value in entries} | {"bench", "bench.conf"}
    facts = [sys.version, entries]
    for file in sorted(file for module in modules for file in _sources(module)):
        with contextlib.suppress(OSError):
            stat = os.stat(file)
            facts.append([file, stat.st_size, stat.st_mtime_ns])
    return _digest(facts)


def _sources(module: str) -> Iterator[str]:
    """The files of a module or package that a listing can depend on."""
    try:
        spec = importlib.util.find_spec(module)
    except (Exception, SystemExit):  # a parent package may do anything; the registry says so
        return
    if spec is None:
        return
    if not spec.submodule_search_locations:
        yield str(spec.origin)
        return
    for folder in spec.submodule_search_locations:
        for path, _, names in os.walk(folder):
            yield from (os.path.join(path, name) for name in names if name.endswith((".py", ".yaml", ".json")))


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value).encode()).hexdigest()[:16]
