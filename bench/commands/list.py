"""List plugins, presets, experiments, conventions and profiles, where they come from, and what is broken.

detailbench list                    everything
detailbench list methods            one kind
detailbench list method poisson     one plugin: its parameters, their defaults and meaning
detailbench list sensor noisy       one preset: the parameters that it gives to its plugin
detailbench list experiments        the same for conventions, profiles, trainings and presets
detailbench list experiment demo    what it sweeps, chooses and sets
detailbench list datasets --measure build some shapes of each dataset, and show how long that takes here
detailbench list --json             for scripts
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import textwrap
from pathlib import Path
from typing import Any

from ..cli import add_plugin_argument
from ..errors import UsageError, did_you_mean
from ..plugins import config_listing, presets
from ..plugins.config_files import GROUPS, OURS
from ..plugins.listing import listing, missing
from ..plugins.registry import install_line, registry

Facts = dict[str, Any]
KINDS = ("task", "dataset", "sensor", "method", "metric")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument(
        "kind",
        nargs="?",
        help="tasks, datasets, sensors, methods or metrics; experiments, conventions, profiles, trainings or presets",
    )
    parser.add_argument("name", nargs="?", help="one of that kind")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--measure", action="store_true", help="build shapes of each dataset, for its figures here")
    add_plugin_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print the listing; no plugin's heavy libraries are imported for it."""
    kinds = [_kind(args.kind)] if args.kind else list(KINDS)
    if args.measure and kinds != ["dataset"]:
        raise UsageError("--measure is for datasets: detailbench list datasets --measure")
    if kinds[0] in config_listing.GROUPS:
        return _configs(kinds[0], args.name, args.json)
    found = listing(args.plugin)
    if args.name and (lines := _preset_or_set(found, kinds[0], args.name, args.json)):
        print(lines)
        return 0
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
        if not args.kind:
            print(f"more: detailbench list {', '.join(group + 's' for group in config_listing.GROUPS)}")
    return 0


def _kind(word: str) -> str:
    known = (*KINDS, *config_listing.GROUPS)
    for kind in known:
        if word.lower() in (kind, kind + "s"):
            return kind
    places = [kind for kind in KINDS if word in registry().names(kind)]
    places += [group for group in GROUPS if word in presets.files(group) and group not in places]
    if places:
        lines = " or ".join(f"detailbench list {place} {word}" for place in places)
        raise UsageError(f"{word!r} is a name, and the kind stands before it: {lines}")
    raise UsageError(f"there is no kind of plugin or config {word!r}. {did_you_mean(word, [k + 's' for k in known])}")


def _configs(group: str, name: str | None, as_json: bool) -> int:
    """Print the files of a group of configs, or one of them."""
    found, broken = config_listing.described(group)
    if name:
        chosen = [facts for facts in found if facts["name"] == name]
        if not chosen:
            wrong = [entry for entry in broken if Path(entry["file"]).stem == name]
            if wrong:
                raise UsageError(f"{wrong[0]['file']}: {wrong[0]['reason']}")
            hint = did_you_mean(name, [facts["name"] for facts in found])
            raise UsageError(f"no {group} is called {name!r}. {hint}")
        print(json.dumps(chosen, indent=2) if as_json else "\n\n".join(_config(group, facts) for facts in chosen))
    elif as_json:
        print(json.dumps({group: found, "broken": broken}, indent=2))
    else:
        print(config_table(group, found))
        for entry in broken:
            print(f"broken: {entry['file']}: {entry['reason']}")
    return 0


def _preset_or_set(found: Facts, kind: str, name: str, as_json: bool) -> str:
    """A preset, or a set of metrics, in lines; empty where a name is neither."""
    if kind == "metric":
        facts = next((facts for facts in config_listing.sets_of_metrics() if facts["name"] == name), None)
        if facts is None:
            return ""
        lines = [f"set of metrics {name}", "", facts["summary"], "", f"metric={name} is metric=[...] of"]
        return json.dumps(facts, indent=2) if as_json else "\n".join([*lines, *_folded_words(facts["metrics"])])
    preset = next((preset for preset in found["presets"][kind] if preset["name"] == name), None)
    if preset is None or name in registry().names(kind):
        return ""
    plugin = next(facts for facts in found["plugins"][kind] if facts["name"] == preset["plugin"])
    facts = {**preset, "kind": kind, "summary": preset["help"], "parameters": plugin["parameters"]}
    return json.dumps(facts, indent=2) if as_json else _config("preset", facts)


def config_table(group: str, found: list[Facts]) -> str:
    """The files of a group of configs, a line each."""
    width = max([len(facts["name"]) for facts in found] + [12])
    room = _room(width)
    lines = [f"{group}s"]
    for facts in found:
        text = facts.get("summary") or facts.get("prints", "")
        if group == "preset":
            text = f"[{facts['kind']}: {facts['plugin']}] {text}"
        if facts["origin"] != OURS:
            text += f" ({facts['file']})"
        lines.extend(_folded(facts["name"], text, width, room))
    return "\n".join(lines) + "\n"


def _config(group: str, facts: Facts) -> str:
    """Everything about one file of configs."""
    if group == "preset":
        lines = [f"{facts['kind']} {facts['name']}: a preset of {facts['plugin']}", "", facts["summary"]]
    else:
        lines = [f"{group} {facts['name']}", "", *facts["help"]]
    lines += ["", f"file: {facts['file']}", ""]
    if group == "preset":
        lines += _values(facts["values"], f"{facts['kind']}.") or ["the defaults of its plugin"]
        others = [name for name in facts.get("parameters", {}) if name not in facts["values"]]
        lines += [f"at their defaults: {', '.join(others)}"] if others else []
    elif group == "convention":
        lines += _columns_of_paper(facts)
    else:
        for title in ("chosen", "swept", "values"):
            lines += [f"{TITLES[title]}", *_values(facts[title], ""), ""] if facts[title] else []
        lines += [f"the paper's numbers stand beside ours: {facts['published']}"] if facts["published"] else []
    return "\n".join(lines).rstrip()


TITLES = {"chosen": "chooses", "swept": "sweeps over all combinations of", "values": "sets"}


def _values(values: Facts, prefix: str) -> list[str]:
    """One line for each value; a list of mappings, as the steps of a chain, has one for each entry."""
    lines = []
    for name, value in values.items():
        if isinstance(value, list) and any(isinstance(entry, dict) for entry in value):
            lines.append(f"  {prefix}{name}=")
            for entry in value:
                steps = entry.items() if isinstance(entry, dict) else [(entry, {})]
                for step, given in steps:
                    lines.append(f"    {step}  {', '.join(f'{k}={v}' for k, v in (given or {}).items())}".rstrip())
        elif isinstance(value, dict):
            lines += _values(value, f"{prefix}{name}.")
        else:
            lines += _wrapped(f"{prefix}{name}={value}")
    return lines


def _wrapped(text: str) -> list[str]:
    """A line with an indent, folded at commas to the terminal."""
    folded = textwrap.wrap(text.replace(",", ", "), _room(0) - 4, break_long_words=False) or [""]
    return [f"  {folded[0].replace(', ', ',')}", *(f"      {line.replace(', ', ',')}" for line in folded[1:])]


def _folded_words(words: list[str]) -> list[str]:
    return textwrap.wrap(", ".join(words), _room(0), initial_indent="  ", subsequent_indent="  ")


def _columns_of_paper(facts: Facts) -> list[str]:
    lines = [f"prints: {facts.get('prints', '')}", f"after: {facts.get('paper', '')}; {facts.get('code', '')}"]
    lines += [f"differs: {facts['differs']}"] if facts.get("differs") else []
    columns = [(str(c["title"]), f"{c.get('factor', 1):g} x {c['score']}") for c in facts.get("columns", [])]
    width = max([len(title) for title, _ in columns] + [0])
    return [*lines, "", "columns", *(f"  {title:<{width}}  {formula}" for title, formula in columns)]


def _room(width: int) -> int:
    return max(60, shutil.get_terminal_size((120, 24)).columns if sys.stdout.isatty() else 10_000) - width - 4


def _find(found: Facts, kind: str, name: str) -> Facts:
    by_name = {facts["name"]: facts for facts in found["plugins"][kind]}
    presets = {preset["name"]: preset["plugin"] for preset in found["presets"][kind]}
    if presets.get(name, name) in by_name:
        return by_name[presets.get(name, name)]
    registry().find(kind, name, also=presets)  # raises what is wrong
    raise AssertionError(name)


def dataset_table(found: Facts, *, measure: bool = False) -> str:
    """The datasets with the traits of their shapes; ``measure`` builds some, otherwise cached figures are shown."""
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

    plugin = registry().find("dataset", name)
    if hasattr(plugin.cls, "state"):  # the user's own files
        return None
    plugin.require()
    return catalog.measure(plugin)


def table(found: Facts, kind: str) -> str:
    """One kind, a line each, folded to the terminal."""
    plugins, presets = found["plugins"][kind], found["presets"][kind]
    width = max([len(facts["name"]) for facts in (*plugins, *presets)] + [12])
    room = _room(width)
    lines = [f"{kind}s"]
    for facts in plugins:
        text = facts["summary"]
        if kind == "method":
            text = f"[{', '.join(facts['tasks'])}] {text}"
        if facts["cite"]:
            text += f" ({facts['cite']})"
        if facts["missing"]:
            text += "".join(f" -- needs {library}: {install_line(library)}" for library in facts["missing"])
        lines.extend(_folded(facts["name"], text, width, room))
    for preset in presets:
        lines.extend(_folded(preset["name"], f"[preset of {preset['plugin']}] {preset['help']}", width, room))
    for chosen in config_listing.sets_of_metrics() if kind == "metric" else ():
        lines.extend(_folded(chosen["name"], f"[set] {chosen['summary']}", width, room))
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
