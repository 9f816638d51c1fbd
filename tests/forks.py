"""Answers command lines, one per line of its input, each in a fork that has its imports already.

Of a short command's time, a third is Python's imports; the tests give hundreds. A request is JSON: ``words``,
``folder`` (the current directory), ``environment`` and ``timeout``. The answer is JSON, too: the exit code (null when
time ran out), standard output and standard error.
"""

from __future__ import annotations

import importlib
import json
import os
import signal
import sys
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any

# What most commands import in the end; nothing that registers a plugin or computes.
IMPORTS = (
    "hydra.main",
    "hydra.core.override_parser.overrides_parser",
    "hydra._internal.core_plugins.basic_launcher",
    "hydra._internal.core_plugins.basic_sweeper",
    "hydra_plugins.hydra_joblib_launcher.joblib_launcher",
    "pandas",
    "pyarrow.parquet",
    "bench.cli",
    "bench.commands.leaderboard",
    "bench.commands.run",
    "bench.ranking.leaderboard",
    "bench.ranking.report.tables",
    "bench.ranking.report.terminal",
    "bench.engine.runner",
    "bench.engine.worker",
    "bench.results.index",
)


def answer(request: dict[str, Any]) -> tuple[int | None, str, str]:
    """What ``detailbench WORDS`` says in a session of its own."""
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of threads: those of the libraries wait for work
            child = os.fork()
        if not child:
            become_command(request, out.fileno(), err.fileno())
        status = ended(child, time.monotonic() + request["timeout"])
        for file in (out, err):
            file.seek(0)
        return status, out.read(), err.read()


def become_command(request: dict[str, Any], out: int, err: int) -> None:
    """Run the command in this process, and end it."""
    os.setsid()
    for name, file in ((0, os.open(os.devnull, os.O_RDONLY)), (1, out), (2, err)):
        os.dup2(file, name)
    os.chdir(request["folder"])
    os.environ.clear()
    os.environ.update(request["environment"])
    sys.argv = ["detailbench", *request["words"]]
    from bench import cli

    sys.exit(cli.main())


def ended(child: int, deadline: float) -> int | None:
    """Wait for a child: its exit code, or None when it had to be killed."""
    while time.monotonic() < deadline:
        pid, status = os.waitpid(child, os.WNOHANG)
        if pid:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.01)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return None


def warm_up() -> None:
    """Import what commands import, and take the sources apart that plugins import: for their digests."""
    for name in IMPORTS:
        importlib.import_module(name)
    from bench.results.sources import source_digest

    source_digest(Path(__file__).parent / "faults" / "toys.py")


if __name__ == "__main__":
    warm_up()
    for line in iter(sys.stdin.readline, ""):
        print(json.dumps(answer(json.loads(line))), flush=True)
