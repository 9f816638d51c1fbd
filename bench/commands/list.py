"""List what there is: tasks, datasets, sensors, methods and metrics, where they come from, and what is broken.

detailbench list                    everything
detailbench list methods            one kind
detailbench list method poisson     one plugin: its parameters, their defaults and meaning
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

from ..cli import add_plugin_argument
from ..errors import UsageError, did_you_mean
from ..fields import field_help
from ..registry import KINDS, Plugin, install_line, load_plugins, registry


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("kind", nargs="?", help="tasks, datasets, sensors, methods or metrics")
    parser.add_argument("name", nargs="?", help="one plugin of that kind")
    parser.add_argument("--json", action="store_true", help="print JSON")
    add_plugin_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print the listing; no plugin's heavy libraries are imported for it."""
    load_plugins(args.plugin, warn=False)
    kinds = [_kind(args.kind)] if args.kind else list(KINDS)
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
        print(table(kind))
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
    if plugin.kind == "method":
        facts["tasks"] = [task for task in registry().names("task") if plugin.solves(task)]
    if plugin.kind == "metric":
        facts["version"] = plugin.version
        facts["better"] = plugin.options.get("better", "lower")
        facts["outputs"] = list(plugin.options.get("outputs", ("mesh", "cloud")))
    return facts


def missing(plugin: Plugin) -> list[str]:
    """The libraries that a plugin declares and that are not installed."""
    return [library for library in plugin.requires if importlib.util.find_spec(library) is None]


def table(kind: str) -> str:
    """One kind, a line each, folded to the terminal."""
    plugins = registry().all(kind)
    width = max([len(p.name) for p in plugins] + [12])
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
    return "\n".join(lines) + "\n"


def details(plugin: Plugin) -> str:
    """Everything about one plugin."""
    facts = as_json(plugin)
    lines = [f"{plugin.kind} {plugin.name}", "", inspect.getdoc(plugin.cls) or "", ""]
    for name in ("tasks", "cite", "version", "better", "outputs", "requires", "missing", "origin", "file"):
        value = facts.get(name)
        if value:
            lines.append(f"{name}: {', '.join(value) if isinstance(value, list) else value}")
    lines += ["", "parameters" if facts["parameters"] else "no parameters"]
    for name, parameter in facts["parameters"].items():
        lines.append(f"  {plugin.kind}.{name}={parameter['default']}  {parameter['help']}".rstrip())
    return "\n".join(lines)
