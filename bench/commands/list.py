"""List what there is: tasks, datasets, sensors, methods and metrics, where they come from, and what is broken.

detailbench list                    everything
detailbench list methods            one kind
detailbench list method poisson     one plugin: its parameters, their defaults and meaning
detailbench list datasets --measure build some shapes of each dataset, and show how long that takes here
detailbench list --json             for scripts
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import textwrap
from typing import Any

from ..cli import add_plugin_argument
from ..errors import UsageError, did_you_mean
from ..plugins.listing import listing, missing

Facts = dict[str, Any]
KINDS = ("task", "dataset", "sensor", "method", "metric")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("kind", nargs="?", help="tasks, datasets, sensors, methods or metrics")
    parser.add_argument("name", nargs="?", help="one plugin of that kind")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--measure", action="store_true", help="build shapes of each dataset, for its figures here")
    add_plugin_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print the listing; no plugin's heavy libraries are imported for it."""
    kinds = [_kind(args.kind)] if args.kind else list(KINDS)
    if args.measure and kinds != ["dataset"]:
        raise UsageError("--measure is for datasets: detailbench list datasets --measure")
    found = listing(args.plugin)
    for facts in (facts for kind in KINDS for facts in found["plugins"][kind]):
        facts["missing"] = missing(facts["requires"])
    if args.name:
        facts = _find(found, kinds[0], args.name)
        print(json.dumps(facts, indent=2) if args.json else details(facts))
    elif args.json:
        print(json.dumps({kind: found["plugins"][kind] for kind in kinds} | {"broken": found["broken"]}, indent=2))
    else:
        for kind in kinds:
            datasets = kinds == ["dataset"]
            print(dataset_table(found, measure=args.measure) if datasets else table(found, kind))
        for broken in found["broken"]:
            print(f"broken: {broken['origin']}: {broken['reason']}")
    return 0


def _kind(word: str) -> str:
    for kind in KINDS:
        if word.lower() in (kind, kind + "s"):
            return kind
    raise UsageError(f"no kind of plugin is called {word!r}. {did_you_mean(word, [k + 's' for k in KINDS])}")


def _find(found: Facts, kind: str, name: str) -> Facts:
    by_name = {facts["name"]: facts for facts in found["plugins"][kind]}
    presets = {preset["name"]: preset["plugin"] for preset in found["presets"][kind]}
    if presets.get(name, name) in by_name:
        return by_name[presets.get(name, name)]
    from ..plugins.registry import registry

    registry().find(kind, name, also=presets)  # says what is wrong
    raise AssertionError(name)


def dataset_table(found: Facts, *, measure: bool = False) -> str:
    """The datasets with what their shapes are like; ``measure`` builds some, otherwise the kept figures are shown."""
    rows = [("dataset", "exactness", "vertices", "build", "tags", "")]
    for dataset in found["plugins"]["dataset"]:
        facts = _measured(dataset["name"]) if measure else dataset["shapes"]
        if facts is None:
            rows.append((dataset["name"], "-", "-", "-", "-", dataset["summary"]))
            continue
        low, high = facts["vertices"]
        size = f"{low:,}" if low == high else f"{low:,}-{high:,}"
        exactness, tags = ", ".join(facts["exactness"]), ", ".join(facts["tags"])
        seconds = f"{facts['seconds']:.2f} s"
        rows.append((dataset["name"], exactness, size, seconds, tags, dataset["summary"]))
    widths = [max(len(row[column]) for row in rows) for column in range(5)]
    width = shutil.get_terminal_size((120, 24)).columns if sys.stdout.isatty() else 10_000
    lines = []
    for row in rows:
        line = "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=False))
        fits = len(line) + 2 + len(row[5]) <= width
        lines.extend([f"{line}  {row[5]}".rstrip()] if fits else [line.rstrip(), f"    {row[5]}"])
    where = "measured now" if measure else "kept; --measure measures on this machine"
    return "\n".join([*lines, "", f"of the first test shapes, at default parameters; {where}"])


def _measured(name: str) -> Facts | None:
    from ..plugins import catalog
    from ..plugins.registry import registry

    plugin = registry().find("dataset", name)
    if hasattr(plugin.cls, "state"):  # the user's own files
        return None
    plugin.require()
    return catalog.measure(plugin)


def table(found: Facts, kind: str) -> str:
    """One kind, a line each, folded to the terminal."""
    plugins, presets = found["plugins"][kind], found["presets"][kind]
    width = max([len(facts["name"]) for facts in (*plugins, *presets)] + [12])
    room = max(60, shutil.get_terminal_size((120, 24)).columns if sys.stdout.isatty() else 10_000) - width - 4
    lines = [f"{kind}s"]
    for facts in plugins:
        text = facts["summary"]
        if kind == "method":
            text = f"[{', '.join(facts['tasks'])}] {text}"
        if facts["cite"]:
            text += f" ({facts['cite']})"
        if facts["missing"]:
            from ..plugins.registry import install_line

            text += "".join(f" -- needs {library}: {install_line(library)}" for library in facts["missing"])
        lines.extend(_folded(facts["name"], text, width, room))
    for preset in presets:
        lines.extend(_folded(preset["name"], f"[preset of {preset['plugin']}] {preset['help']}", width, room))
    return "\n".join(lines) + "\n"


def _folded(name: str, text: str, width: int, room: int) -> list[str]:
    folded = textwrap.wrap(text, room) or [""]
    return [f"  {name:<{width}}  {folded[0]}"] + [" " * (width + 4) + line for line in folded[1:]]


def details(facts: Facts) -> str:
    """Everything about one plugin."""
    kind = facts["kind"]
    lines = [f"{kind} {facts['name']}", "", facts["doc"], ""]
    for name in ("tasks", "gives", "cite", "version", "better", "outputs", "requires", "missing", "origin", "file"):
        value = facts.get(name)
        if value:
            lines.append(f"{name}: {', '.join(value) if isinstance(value, list) else value}")
    if facts.get("shapes"):
        lines += [
            f"{name}: {', '.join(facts['shapes'][name])}"
            for name in ("exactness", "tags", "kinds")
            if facts["shapes"].get(name)
        ]
    for name, preset in facts.get("presets", {}).items():
        lines.append(f"preset: {kind}={name}  {preset['help']}")
    lines += ["", "parameters" if facts["parameters"] else "no parameters"]
    for name, parameter in facts["parameters"].items():
        lines.append(f"  {kind}.{name}={parameter['default']}  {parameter['help']}".rstrip())
    return "\n".join(lines)
