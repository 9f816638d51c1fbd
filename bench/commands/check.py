"""Hold plugins against the contract: config, determinism under a seed, the promised output, poor input, time.

  detailbench check my_method.py        every plugin in the file
  detailbench check poisson jet         plugins by name

Every trial runs in a child process: a plugin that crashes or hangs is a failed check. Exit code 0 when nothing failed,
3 otherwise.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from ..cli import add_plugin_argument
from ..errors import UsageError, did_you_mean
from ..registry import KINDS, Plugin, load_plugins, registry

MARKS = {"ok": "ok  ", "warn": "warn", "fail": "FAIL"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("what", nargs="+", metavar="FILE|NAME", help="a plugin file, or the name of a plugin")
    parser.add_argument("--json", action="store_true", help="print JSON")
    add_plugin_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Check them all; the exit code says whether one failed."""
    from ..conformance import check_plugin

    files = [w for w in args.what if w.endswith(".py") or Path(w).is_file()]
    loaded = load_plugins([*args.plugin, *files], warn=False)
    report, failed = [], False
    for broken in registry().broken:
        if str(broken.file) in loaded:
            failed = True
            report.append({"plugin": broken.origin, "check": "import", "verdict": "fail", "detail": broken.reason})
            if not args.json:
                print(f"{MARKS['fail']}  {broken.origin}: {broken.reason}\n{broken.details}")
    for plugin in _plugins(args.what, files, already=bool(report)):
        if not args.json:
            print(f"{plugin.kind} {plugin.name} ({plugin.file})")
        for check in check_plugin(plugin, loaded):
            failed = failed or check.verdict == "fail"
            report.append({"plugin": f"{plugin.kind} {plugin.name}", "check": check.name} | vars(check))
            if not args.json:
                print(f"  {MARKS[check.verdict]}  {check.name}{': ' if check.detail else ''}{check.detail}")
                sys.stdout.flush()
    if args.json:
        print(json.dumps(report, indent=2))
    else:
        counts = {v: sum(r["verdict"] == v for r in report) for v in MARKS}
        print(f"{counts['ok']} ok, {counts['warn']} warnings, {counts['fail']} failed")
    return 3 if failed else 0


def _plugins(what: list[str], files: list[str], already: bool) -> list[Plugin]:
    """The plugins of the files, and those named."""
    everything = [p for kind in KINDS for p in registry().all(kind)]
    chosen = []
    for word in what:
        if word in files:
            path = Path(word).expanduser().resolve()
            found = [p for p in everything if p.file == path]
            if not found and not already:
                raise UsageError(f"{word}: registers no plugin; decorate a class with @register(...) from bench")
        else:
            found = [p for p in everything if p.name == word]
            if not found:
                raise UsageError(f"no plugin is called {word!r}. {did_you_mean(word, [p.name for p in everything])}")
        chosen.extend(p for p in found if p not in chosen)
    return chosen
