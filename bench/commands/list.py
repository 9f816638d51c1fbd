"""List what there is: tasks, datasets, sensors, methods and metrics, where they come from, and what is broken.

detailbench list                    everything
detailbench list methods            one kind
detailbench list method poisson     one plugin: its parameters, their defaults and meaning
detailbench list datasets --measure build some shapes of each dataset, and show how long that takes here
detailbench list --json             for scripts
"""

from __future__ import annotations

import argparse
import importlib.util
import inspect
import json
import shutil
import sys
import textwrap
from typing import Any

from .. import catalog
from ..cli import add_plugin_argument
from ..errors import UsageError, did_you_mean
from ..fields import field_help
from ..presets import presets
from ..registry import KINDS, Plugin, install_line, load_plugins, registry


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("kind", nargs="?", help="tasks, datasets, sensors, methods or metrics")
    parser.add_argument("name", nargs="?", help="one plugin of that kind")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--measure", action="store_true", help="build shapes of each dataset, for its figures here")
    add_plugin_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print the listing; no plugin's heavy libraries are imported for it."""
    load_plugins(args.plugin, warn=False)
    kinds = [_kind(args.kind)] if args.kind else list(KINDS)
    if args.measure and kinds != ["dataset"]:
        raise UsageError("--measure is for datasets: detailbench list datasets --measure")
    if args.name:
        plugin = registry().find(kinds[0], args.name)
        print(json.dumps(as_json(plugin), indent=2) if args.json else details(plugin))
        return 0
    if args.json:
        listing: dict[str, Any] = {kind: [as_json(p) for p in registry().all(kind)] for kind in kinds}
        listing["broken"] = [
            {"origin": b.origin, "file": str(b.file or ""), "reason": b.reason} for b in registry().broken
        ]
        print(json.dumps(listing, indent=2))
        return 0
    for kind in kinds:
        print(dataset_table(measure=args.measure) if kinds == ["dataset"] else table(kind))
    for broken in registry().broken:
        print(f"broken: {broken.origin}: {broken.reason}")
    return 0


def _kind(word: str) -> str:
    for kind in KINDS:
        if word.lower() in (kind, kind + "s"):
            return kind
    raise UsageError(f"no kind of plugin is called {word!r}. {did_you_mean(word, [k + 's' for k in KINDS])}")


def as_json(plugin: Plugin) -> dict[str, Any]:
    """A plugin's facts, as JSON values."""
    from ..schema import defaults

    helps = field_help(plugin.cls)
    usual = defaults(plugin)
    facts: dict[str, Any] = {
        "kind": plugin.kind,
        "name": plugin.name,
        "summary": plugin.summary,
        "cite": plugin.cite,
        "origin": plugin.origin,
        "file": str(plugin.file),
        "requires": list(plugin.requires),
        "missing": missing(plugin),
        "parameters": {f.name: {"default": usual[f.name], "help": helps[f.name]} for f in plugin.fields},
    }
    if plugin.kind == "dataset":
        facts |= {"shapes": catalog.known(plugin)}
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


def dataset_table(*, measure: bool = False) -> str:
    """The datasets with what their shapes are like; ``measure`` builds some, otherwise the kept figures are shown."""
    rows = [("dataset", "exactness", "vertices", "build", "tags", "")]
    for plugin in registry().all("dataset"):
        facts = _measured(plugin) if measure else catalog.known(plugin)
        if facts is None:
            rows.append((plugin.name, "-", "-", "-", "-", plugin.summary))
            continue
        low, high = facts["vertices"]
        size = f"{low:,}" if low == high else f"{low:,}-{high:,}"
        exactness, tags = ", ".join(facts["exactness"]), ", ".join(facts["tags"])
        rows.append((plugin.name, exactness, size, f"{facts['seconds']:.2f} s", tags, plugin.summary))
    widths = [max(len(row[column]) for row in rows) for column in range(5)]
    width = shutil.get_terminal_size((120, 24)).columns if sys.stdout.isatty() else 10_000
    lines = []
    for row in rows:
        line = "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=False))
        fits = len(line) + 2 + len(row[5]) <= width
        lines.extend([f"{line}  {row[5]}".rstrip()] if fits else [line.rstrip(), f"    {row[5]}"])
    where = "measured now" if measure else "kept; --measure measures on this machine"
    return "\n".join([*lines, "", f"of the first {catalog.BUILT} test shapes, at default parameters; {where}"])


def _measured(plugin: Plugin) -> dict[str, Any] | None:
    if hasattr(plugin.cls, "state"):  # the user's own files
        return None
    plugin.require()
    return catalog.measure(plugin)


def missing(plugin: Plugin) -> list[str]:
    """The libraries that a plugin declares and that are not installed."""
    return [library for library in plugin.requires if importlib.util.find_spec(library) is None]


def table(kind: str) -> str:
    """One kind, a line each, folded to the terminal."""
    plugins = registry().all(kind)
    width = max([len(name) for name in (*registry().names(kind), *presets(kind))] + [12])
    room = max(60, shutil.get_terminal_size((120, 24)).columns if sys.stdout.isatty() else 10_000) - width - 4
    lines = [f"{kind}s"]
    for plugin in plugins:
        text = plugin.summary
        if kind == "method":
            text = f"[{', '.join(t for t in registry().names('task') if plugin.solves(t))}] {text}"
        if plugin.cite:
            text += f" ({plugin.cite})"
        for library in missing(plugin):
            text += f" -- needs {library}: {install_line(library)}"
        folded = textwrap.wrap(text, room) or [""]
        lines.append(f"  {plugin.name:<{width}}  {folded[0]}")
        lines.extend(" " * (width + 4) + line for line in folded[1:])
    for preset in presets(kind).values():
        folded = textwrap.wrap(f"[preset of {preset.plugin}] {preset.help}", room)
        lines.append(f"  {preset.name:<{width}}  {folded[0]}")
        lines.extend(" " * (width + 4) + line for line in folded[1:])
    return "\n".join(lines) + "\n"


def details(plugin: Plugin) -> str:
    """Everything about one plugin."""
    facts = as_json(plugin)
    lines = [f"{plugin.kind} {plugin.name}", "", inspect.getdoc(plugin.cls) or "", ""]
    for name in ("tasks", "cite", "version", "better", "outputs", "requires", "missing", "origin", "file"):
        value = facts.get(name)
        if value:
            lines.append(f"{name}: {', '.join(value) if isinstance(value, list) else value}")
    for name, preset in facts.get("presets", {}).items():
        lines.append(f"preset: {plugin.kind}={name}  {preset['help']}")
    if facts.get("shapes"):
        shapes = facts["shapes"]
        lines.append(f"exactness: {', '.join(shapes['exactness'])}")
        lines.append(f"tags: {', '.join(shapes['tags'])}")
    lines += ["", "parameters" if facts["parameters"] else "no parameters"]
    for name, parameter in facts["parameters"].items():
        lines.append(f"  {plugin.kind}.{name}={parameter['default']}  {parameter['help']}".rstrip())
    return "\n".join(lines)
