"""What a result depends on (the fingerprint), and where it came from (the provenance)."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.metadata
import importlib.util
import os
import platform
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from .. import __version__
from ..plan.cell import Cell
from ..plan.choice import NO_SENSOR, Choice, digest
from ..plan.training import SHIPPED, TRAINED, Training
from ..plugins.origins import is_from_file
from ..plugins.reads import contents
from ..plugins.weights import content, trained_values
from .sources import BENCH, Stamps, source_closure, source_digest, stamps

# Packages that take part in every cell; a plugin's `requires` come on top.
ALWAYS = ("numpy", "scipy", "trimesh")


STATED = "version that "  # the ingredients for which a program of the user was run


def ingredients(cell: Cell, recorded: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Everything that decides whether a finished result of ``cell`` is current, as a flat mapping for :func:`explain`.

    The parameters and the seed (in ``cell``), the source of the plugins that make the output (with the neighbours
    and the geometry that they import), the versions of metrics, the packages that compute, the state that a dataset
    reports (hashes of the user's files), and the contents of the files that plugins read (:mod:`reads`).

    A method may state the version of a program, which it runs to find out. So the ingredients of a record, which
    may be a stranger's, are given as ``recorded``: versions are then taken from there, and no program is run.
    """
    parts = {"cell": cell.id} | depends_on(cell.choices, cell.dataset)
    if recorded is not None:
        parts |= {key: value for key, value in recorded.items() if key.startswith(STATED)}
    else:
        parts |= stated_versions(cell.method)
    if cell.training:
        parts[WEIGHTS] = weights_of(cell.training)
    return parts


WEIGHTS = "weights"  # the ingredient


def weights_of(training: Training) -> str | None:
    """The identity of weights: the content of a file, or the fingerprint of the training behind them; None without."""
    if training.weights == TRAINED:
        return fingerprint(training_ingredients(training))
    path = training.shipped if training.weights == SHIPPED else Path(os.path.expanduser(training.path))
    return content(path) if path is not None and path.is_file() else None


def training_ingredients(training: Training) -> dict[str, Any]:
    """Everything that the result of a training depends on, like :func:`ingredients` for a cell."""
    return {"training": training.id} | depends_on(training.choices, training.dataset)


def examples_key(training: Training) -> str:
    """A digest over all that the examples of a training depend on: variants of a method may share them."""
    parts = training_ingredients(training)
    del parts["training"]
    plugin = training.method.plugin
    values = trained_values(plugin, training.method.parameters, "examples_by")
    of = {kind: asdict(getattr(training, kind)) for kind in ("task", "dataset", "sensor")}
    return digest([parts, plugin.name, values, of, training.cases, training.seed])[:16]


def depends_on(choices: Iterable[Choice], dataset: Choice | None = None) -> dict[str, Any]:
    """Sources, versions, packages, and the contents of files; with a dataset also the state that it reports."""
    choices = tuple(choices)
    parts: dict[str, Any] = {}
    for choice in choices:
        plugin = choice.plugin
        if choice.kind == "metric":
            parts[f"version of metric {choice.name}"] = plugin.version
        else:
            for part in choice.parts:
                parts[f"source of {choice.kind} {part.name}"] = source_digest(part.file)
    for package in sorted({*ALWAYS, *(r for c in choices for p in c.parts for r in p.requires)}):
        parts[f"package {package}"] = package_version(package)
    state = getattr(dataset.build(), "state", None) if dataset else None
    if state:
        parts.update({f"file {name}": value for name, value in state().items()})
    parts.update({f"content of {name}": value for name, value in contents(choices).items()})
    return parts


def stated_versions(method: Choice) -> dict[str, str]:
    """The version of a program that a method states, since its file is not enough; this may run the program."""
    said = method.made.version() if hasattr(method.made, "version") else ""
    return {f"{STATED}method {method.name} states": said} if said else {}


def memory_keys(cell: Cell) -> dict[str, str]:
    """The dependencies of the shapes, clouds, cases and floors of a cell, for :mod:`bench.engine.memo`.

    Under ``dataset``, ``sensor``, ``task`` and ``metric NAME``: digests over parameters, sources and the
    versions of packages. All our own sources count, since all cells share them.
    """
    common = {
        "detailbench": _own_digest(),
        "packages": {p: package_version(p) for p in (*ALWAYS, "libigl", "pykdtree")},
    }

    def key(choice: Choice) -> str:
        parts = choice.parts
        return digest(
            {
                "common": common,
                "parameters": choice.parameters,
                "sources": [[p.name, source_digest(p.file)] for p in parts],
                "packages": {r: package_version(r) for p in parts for r in p.requires},
                "state": getattr(choice.build(), "state", dict)(),
                **({"contents": read} if (read := contents([choice])) else {}),
            }
        )

    sensor = NO_SENSOR.name if cell.sensor == NO_SENSOR else key(cell.sensor)
    made_by = {"dataset": key(cell.dataset), "sensor": sensor, "task": key(cell.task)}
    return made_by | {f"metric {m.name}": key(m) for m in cell.metrics}


def _own_digest() -> str:
    """A digest over the sources of shapes, tasks, effects and geometry: how cases are made and measured."""
    rooms = (_python_files(str(BENCH / room)) for room in ("contract", "geometry", "tasks"))
    files = [
        str(BENCH / "seeds.py"),
        *(file for room in rooms for file in sorted(room, key=lambda file: file.split(os.sep))),
    ]
    return _digest_of(tuple(files), stamps(files))


def _python_files(folder: str) -> Iterator[str]:
    for entry in os.scandir(folder):
        if entry.is_dir():
            yield from _python_files(entry.path)
        elif entry.name.endswith(".py"):
            yield entry.path


@functools.lru_cache(maxsize=4)
def _digest_of(files: tuple[str, ...], _: Stamps | None) -> str:
    return digest([hashlib.sha256(Path(file).read_bytes()).hexdigest() for file in files])


def fingerprint(parts: dict[str, Any]) -> str:
    """Sixteen hexadecimal digits over the ingredients."""
    return digest(parts)[:16]


def explain(then: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """The differences between the ingredients of a stored result and today's, one a line."""
    lines = []
    for key in sorted({*then, *now}):
        before, after = then.get(key), now.get(key)
        if before == after:
            continue
        if key.startswith("source of"):
            lines.append(f"{key} was edited")
        elif key == WEIGHTS:
            lines.append(f"other weights: {_short(before)} -> {_short(after)}")
        elif key.startswith("file "):
            what = "is new" if before is None else "is gone" if after is None else "has other content"
            lines.append(f"{key} {what}")
        elif key.startswith("content of "):
            what = "was not recorded" if before is None else "is no longer read" if after is None else "has changed"
            lines.append(f"{key} {what}")
        else:
            lines.append(f"{key}: {before or 'not installed'} -> {after or 'not installed'}")
    return lines


def _short(digest: Any) -> str:
    return str(digest)[:12] if digest else "none"


# -- packages ----------------------------------------------------------------------------------------------------------


# Import names that differ from their distributions; querying importlib.metadata for all takes half a second.
DISTRIBUTIONS = {
    "CGAL": ("cgal",),
    "igl": ("libigl",),
    "open3d": ("open3d-cpu", "open3d"),
    "skimage": ("scikit-image",),
    "sklearn": ("scikit-learn",),
    "cv2": ("opencv-python-headless", "opencv-python"),
}


@functools.cache
def package_version(module: str) -> str | None:
    """The version of the distribution that provides an import name; None when it is not installed."""
    for name in DISTRIBUTIONS.get(module, (module,)):
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            return importlib.metadata.version(name)
    if importlib.util.find_spec(module) is None:
        return None
    names = importlib.metadata.packages_distributions().get(module, ())
    return next((f"{name} {importlib.metadata.version(name)}" for name in names), "present, version unknown")


# -- machine -----------------------------------------------------------------------------------------------------------


@functools.cache
def machine() -> dict[str, Any]:
    """The machine: host, processor, memory, system, Python, and the commit of a checkout of detailbench."""
    import psutil

    return {
        "host": platform.node(),
        "system": platform.platform(),
        "processor": _processor(),
        "processors": os.cpu_count(),
        "memory_gb": round(psutil.virtual_memory().total / 2**30, 1),
        "python": platform.python_version(),
        "detailbench": __version__,
        "commit": commit_of(BENCH),
        "command": sys.argv,
    }


def provenance(cell: Cell) -> dict[str, Any]:
    """The machine, and for each plugin its file, its origin and its commit."""
    plugins = {
        f"{c.kind} {c.name}": {
            "file": str(c.plugin.file),
            "origin": c.plugin.origin,
            "commit": commit_of(c.plugin.file.parent),
        }
        for c in cell.choices
    }
    return {**machine(), "plugins": plugins}


LONGEST_SOURCE = 1 << 16  # bytes of one file stored in a record
LONGEST_SOURCES = 1 << 18  # and of all files together


def plugin_sources(cell: Cell) -> dict[str, dict[str, str | None]]:
    """The sources of the plugins loaded by ``--plugin``, with the files beside them that they import.

    They are stored in the record for readers: nothing imports them from there.

    Returns
    -------
    dict
        By path: ``sha256`` of the file, and its ``text``, or None if it is longer than :data:`LONGEST_SOURCE`, or
        if the files before it fill :data:`LONGEST_SOURCES`.
    """
    brought = {part.file for choice in cell.choices for part in choice.parts if is_from_file(part)}
    files = {path for file in brought for path in source_closure(file)}
    left, kept = LONGEST_SOURCES, {}
    for path in sorted(file for file in files if not file.is_relative_to(BENCH)):
        content = path.read_bytes()
        fits = len(content) <= min(LONGEST_SOURCE, left)
        left -= len(content) if fits else 0
        text = content.decode("utf-8", "backslashreplace") if fits else None
        kept[str(path)] = {"sha256": hashlib.sha256(content).hexdigest(), "text": text}
    return kept


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "unknown")


@functools.cache
def commit_of(folder: Path) -> dict[str, Any] | None:
    """The commit that a folder's checkout is at and whether it has changes; None outside a checkout."""

    def git(*arguments: str) -> str | None:
        try:
            done = subprocess.run(
                ["git", "-C", str(folder), *arguments], capture_output=True, text=True, timeout=10, check=False
            )
        except (OSError, subprocess.TimeoutExpired):
            return None
        return done.stdout.strip() if done.returncode == 0 else None

    head = git("rev-parse", "HEAD")
    if head is None or git("check-ignore", "-q", ".") is not None:  # an ignored folder, such as a .venv
        return None
    return {"commit": head, "dirty": bool(git("status", "--porcelain", "--untracked-files=no"))}
