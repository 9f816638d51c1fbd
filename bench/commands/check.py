"""Check that plugins keep the contract: config, determinism under a seed, the promised output, poor input, time.

  detailbench check my_method.py        every plugin in the file
  detailbench check poisson jet         plugins by name
  detailbench check poisson_9           a plugin with the parameters of a preset
  detailbench check siren method.steps=50 method.resolution=64    with other parameters, for instance a short training
  detailbench check fscore metric.t=0.02          of a metric, as of any other kind of plugin: dataset., sensor., task.

Every trial runs in a child process: a plugin that crashes or hangs is a failed check. It hangs when it takes longer
than limit.seconds (default: 300). Exit code 0 when nothing failed, 3 otherwise.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..cli import add_plugin_argument
from ..errors import UsageError, did_you_mean
from ..plan.limits import Limits
from ..plugins import presets
from ..plugins.registry import KINDS, Plugin, load_plugins, registry

MARKS = {"ok": "ok  ", "warn": "warn", "fail": "FAIL"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument(
        "what", nargs="+", metavar="FILE|NAME|key=value", help="plugin files, names of plugins; method.steps=50, ..."
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    add_plugin_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Check them all; the exit code says whether one failed."""
    from ..authoring.conformance import check_plugin
    from ..sweep.quoting import is_override

    overrides = [word for word in args.what if is_override(word)]
    what = [word for word in args.what if word not in overrides]
    if not what:
        raise UsageError("name a plugin or a plugin file: detailbench check my_method.py")
    files = [w for w in what if w.endswith(".py") or Path(w).is_file()]
    loaded = load_plugins([*args.plugin, *files], warn=False)
    report, failed = [], False
    for broken in registry().broken:
        if str(broken.file) in loaded:
            failed = True
            report.append({"plugin": broken.origin, "check": "import", "verdict": "fail", "detail": broken.reason})
            if not args.json:
                print("\n".join(filter(None, (f"{MARKS['fail']}  {broken.origin}: {broken.reason}", broken.details))))
    plugins = _plugins(what, files, already=bool(report))
    _refuse_foreign(overrides, [plugin for plugin, _ in plugins])
    given = [settings(plugin, name, overrides) for plugin, name in plugins]
    for (plugin, name), (values, limit) in zip(plugins, given, strict=True):
        if not args.json:
            print(f"{plugin.kind} {name} ({plugin.file})")
        for check in check_plugin(plugin, loaded, values, limit):
            failed = failed or check.verdict == "fail"
            report.append({"plugin": f"{plugin.kind} {name}", "check": check.name} | vars(check))
            if not args.json:
                print(f"  {MARKS[check.verdict]}  {check.name}{': ' if check.detail else ''}{check.detail}")
                sys.stdout.flush()
    if args.json:
        print(json.dumps(report, indent=2))
    else:
        counts = {v: sum(r["verdict"] == v for r in report) for v in MARKS}
        print(f"{counts['ok']} ok, {counts['warn']} warnings, {counts['fail']} failed")
    return 3 if failed else 0


def _refuse_foreign(overrides: Sequence[str], plugins: Sequence[Plugin]) -> None:
    """Each override must be a limit, or a parameter of a plugin that is checked."""
    for word in overrides:
        if not word.lstrip("+").startswith("limit.") and not any(_own([word], plugin) for plugin in plugins):
            known = ", ".join(f"{kind}.PARAMETER=..." for kind in sorted({p.kind for p in plugins})) or "nothing"
            raise UsageError(f"{word}: expected limit.seconds=..., or a parameter of the checked plugins: {known}")


def _own(overrides: Sequence[str], plugin: Plugin) -> list[str]:
    """The overrides of parameters of ``plugin``; ``metric.samples=9`` stands for ``metric.NAME.samples=9``."""
    found = []
    for word in overrides:
        bare = word.lstrip("+")
        if not bare.startswith(f"{plugin.kind}."):
            continue
        key = bare.partition("=")[0].split(".")[1:]
        if plugin.kind == "metric" and not (len(key) > 1 and key[0] in registry().names("metric")):
            word = word.replace("metric.", f"metric.{plugin.name}.", 1)
        elif plugin.kind == "metric" and key[0] != plugin.name:
            continue
        found.append(word)
    return found


def settings(plugin: Plugin, name: str, overrides: Sequence[str]) -> tuple[dict[str, Any], Limits]:
    """The parameters of a plugin, or of its preset called ``name``, and the limits, as the overrides set them."""
    from ..authoring.conformance import LIMIT
    from ..plugins.schema import build
    from ..sweep.overrides import checked

    limits = [word for word in overrides if word.lstrip("+").startswith("limit.")]
    own = _own(overrides, plugin)
    if own or name != plugin.name:
        own = [f"metric=[{name}]" if plugin.kind == "metric" else f"{plugin.kind}={name}", *own]
    if not (limits or own):
        return {}, LIMIT
    values = checked([*own, *limits], "check").values
    chosen = values["metric"][plugin.name] if plugin.kind == "metric" and own else values[plugin.kind]
    parameters = chosen if own else {}
    if own:
        build(plugin, parameters)  # reject an invalid value here, not as a failed check
    said = [word.lstrip("+").partition("=")[0].removeprefix("limit.") for word in limits]
    return parameters, replace(LIMIT, **{name: values["limit"][name] for name in said})


def _plugins(what: list[str], files: list[str], already: bool) -> list[tuple[Plugin, str]]:
    """The plugins of the files, and those named, each with its name or that of its preset."""
    everything = [p for kind in KINDS for p in registry().all(kind)]
    chosen: list[tuple[Plugin, str]] = []
    for word in what:
        if word in files:
            path = Path(os.path.expanduser(word)).resolve()
            found = [(p, p.name) for p in everything if p.file == path]
            if not found and not already:
                raise UsageError(f"{word}: registers no plugin; decorate a class with @register(...) from bench")
        else:
            found = [(p, word) for p in everything if p.name == presets.resolve(p.kind, word)]
            if not found:
                of_presets = (name for kind in KINDS if kind != "metric" for name in presets.names(kind))
                names = [*(p.name for p in everything), *of_presets]
                raise UsageError(f"no plugin is called {word!r}. {did_you_mean(word, names)}")
        chosen.extend(p for p in found if p not in chosen)
    return chosen
