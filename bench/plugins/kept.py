"""The listing cached from one start to the next, with a stamp of all sources that it comes from.

Showing the parameters of all plugins imports them all, which takes seconds on a busy machine. While the stamp (path,
size and time of change of each source) holds, `detailbench list` imports none.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.metadata
import importlib.util
import json
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ..own_folder import cache_folder
from .config_files import ENTRY_POINTS, installed_folders


def kept_listing(stamp: str | None = None) -> dict[str, Any] | None:
    """The listing cached under this stamp, or under any; None if there is none."""
    with contextlib.suppress(TypeError, KeyError):
        kept = kept_json("listing") or {}
        if stamp in (None, kept["stamp"]):
            return kept["listing"]
    return None


def keep(stamp: str, listing: dict[str, Any]) -> None:
    """Write the listing; if that is impossible, the next start merely takes longer."""
    keep_json("listing", {"stamp": stamp, "listing": listing})


def _path(name: str) -> Path | None:
    """One file for each environment and checkout, in this user's own folder: the modules in it are imported."""
    folder = cache_folder()
    return folder and folder / f"{name}-{_digest([sys.prefix, str(Path(__file__).parent)])}.json"


def kept_json(name: str) -> Any:
    """The value that :func:`keep_json` wrote under this name in this environment; None if there is none."""
    with contextlib.suppress(OSError, ValueError):
        return json.loads(path.read_text(encoding="utf-8")) if (path := _path(name)) else None
    return None


def keep_json(name: str, value: Any) -> None:
    """Cache a value for the next start, if possible."""
    path, content = _path(name), json.dumps(value)
    if path is None:
        return
    with contextlib.suppress(OSError):
        handle, temporary = tempfile.mkstemp(dir=path.parent)
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(content)
        os.replace(temporary, path)


def stamp() -> str:
    """A digest over path, size and time of change of all that a listing can depend on."""
    entries = sorted((e.name, e.value) for e in importlib.metadata.entry_points(group=ENTRY_POINTS))
    modules = {value.partition(":")[0] for _, value in entries} | {"bench", "bench.conf"}
    facts: list[Any] = [sys.version, entries]
    files = {file for module in modules for file in _sources(module)}
    files.update(file for folder in installed_folders() for file in _files_below(folder.path))
    for file in sorted(files):
        with contextlib.suppress(OSError):
            stat = os.stat(file)
            facts.append([file, stat.st_size, stat.st_mtime_ns])
    return _digest(facts)


def _sources(module: str) -> Iterator[str]:
    """The files of a module or package that a listing can depend on."""
    try:
        spec = importlib.util.find_spec(module)
    except (Exception, SystemExit):  # a parent package may do anything; the registry reports it
        return
    if spec is None:
        return
    if not spec.submodule_search_locations:
        yield str(spec.origin)
        return
    for folder in spec.submodule_search_locations:
        yield from _files_below(folder)


def _files_below(folder: str) -> Iterator[str]:
    for path, _, names in os.walk(folder):
        yield from (os.path.join(path, name) for name in names if name.endswith((".py", ".yaml", ".json")))


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value).encode()).hexdigest()[:16]
