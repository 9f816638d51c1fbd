"""The contents of a group's YAML files as plain values, for instance for ``detailbench list experiments``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..errors import UsageError
from .metric_sets import FULL, metric_set
from .presets import content_of, files, presets
from .registry import KINDS

GROUPS = ("experiment", "convention", "profile", "training", "preset")  # beside the kinds of plugins
KEPT_FOR_HYDRA = ("defaults", "hydra", "published", "convention")


def described(group: str) -> tuple[list[dict[str, Any]], list[dict[str, str]]]:
    """The files of a group, by name, and those that are wrong, with file and reason.

    Each has name, summary, help (the comment, line by line), file, origin, and by group: of an experiment what it
    chooses, sweeps and sets, of a convention its columns, of presets their kind, plugin and values.
    """
    if group == "preset":
        return [facts for kind in KINDS if kind != "metric" for facts in _presets(kind)], []
    found, broken = [], []
    for name, file in files(group).items():
        try:
            text = file.text()
            content = content_of(file.path, text)
            facts = _facts(name, text, file.path, file.folder.origin)
            found.append(facts | (_convention(content) if group == "convention" else _of_run(content)))
        except UsageError as error:
            broken.append({"file": file.path, "reason": str(error).removeprefix(f"{file.path}: ")})
    return found, broken


def sets_of_metrics() -> list[dict[str, Any]]:
    """The sets of metrics by name: those of files, and the one of all metrics."""
    found = [{"name": FULL, "summary": "every installed metric", "metrics": metric_set(FULL)}]
    for name, file in files("metric").items():
        facts = _facts(name, file.text(), file.path, file.folder.origin)
        found.append(facts | {"metrics": metric_set(name)})
    return found


def _facts(name: str, text: str, path: str, origin: str) -> dict[str, Any]:
    """The comment of a file: its first paragraph, up to a line with a command, and all of it."""
    lines = [line[1:].rstrip() for line in text.splitlines() if line.startswith("#") and "@package" not in line]
    first = next((place for place, line in enumerate(lines) if line.startswith("   ")), len(lines))
    summary = " ".join(line.strip() for line in lines[:first])
    return {"name": name, "summary": summary, "help": [line[1:] for line in lines], "file": path, "origin": origin}


def _presets(kind: str) -> list[dict[str, Any]]:
    return [
        {
            "name": preset.name,
            "summary": preset.help,
            "kind": kind,
            "plugin": preset.plugin,
            "values": dict(preset.values),
            "file": preset.file,
            "origin": preset.origin,
        }
        for preset in presets(kind).values()
    ]


def _convention(content: Mapping[str, Any]) -> dict[str, Any]:
    said = content.get("convention")
    return dict(said) if isinstance(said, Mapping) else {}


def _of_run(content: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of a run: ``chosen`` by group, ``swept`` values, and ``values`` of other keys."""
    chosen = {}
    for entry in content.get("defaults") or []:
        for key, value in entry.items() if isinstance(entry, Mapping) else ():
            chosen[str(key).removeprefix("override").strip().lstrip("/")] = value
    hydra = content.get("hydra") or {}
    swept = (hydra.get("sweeper") or {}).get("params") or {}
    published = content.get("published") or {}
    return {
        "chosen": chosen,
        "swept": {key: str(value) for key, value in swept.items()},
        "values": {key: value for key, value in content.items() if key not in KEPT_FOR_HYDRA},
        "published": published.get("source", ""),
    }
