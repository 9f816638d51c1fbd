"""Answers command lines, one per line of its input, each in a fork that has its imports already.

Of a short command's time, most is Python's imports, its own and its fork server's; the tests give hundreds. A request
is JSON: ``words``, ``folder`` (the current directory), ``environment``, ``timeout`` and ``mark``. The answer is JSON,
too: the exit code (null when time ran out), standard output and standard error.

What is forked here has the environment of this process in ``/proc``; it is known by the first letters of the mark,
which are its name there, and that of its descendants.
"""

from __future__ import annotations

import atexit
import contextlib
import fcntl
import gc
import importlib
import json
import os
import runpy
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

# What most commands import in the end; nothing that registers a plugin or computes.
IMPORTS = (
    "hydra.main",
    "hydra.core.override_parser.overrides_parser",
    "hydra._internal.core_plugins.basic_launcher",
    "hydra._internal.core_plugins.basic_sweeper",
    "hydra_plugins.hydra_joblib_launcher.joblib_launcher",
    "hydra.compose",
    "omegaconf._impl",
    "joblib.externals.loky.backend.fork_exec",
    "joblib.externals.loky.process_executor",
    "pandas",
    "pandas.core.methods.to_dict",
    "pyarrow.pandas_compat",
    "pyarrow.parquet",
    "rich.table",
    "bench.cli",
    "bench.commands.apply",
    "bench.commands.leaderboard",
    "bench.commands.plan",
    "bench.commands.run",
    "bench.contract.views",
    "bench.ranking.conventions",
    "bench.ranking.leaderboard",
    "bench.ranking.report.tables",
    "bench.ranking.report.terminal",
    "bench.engine.runner",
    "bench.results.index",
    "bench.sweep.callbacks",
)
OF_COMMANDS = {"figure": ("pyvista.plotting", "bench.pictures.figure", "bench.pictures.printing")}  # what few import
SERVERS = 2  # that a command may need: one for each set of libraries
CALL_NO_METHOD = ("compare", "leaderboard", "list", "new", "plan", "why")
TYPICAL = ("task=denoise", "method=a,b", "metric=[a,b]", "cases=2", "sensor.noise=0.01", "results=/a/b.c-d")
JOBLIB = "joblib.externals.loky.backend"


def answer(request: dict[str, Any]) -> tuple[int | None, str, str]:
    """What ``detailbench WORDS`` says in a session of its own."""
    prepare(" ".join(request["words"][:1]))
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


def prepare(command: str) -> None:
    """Import what a command needs besides, before the first one of its name."""
    if names := OF_COMMANDS.pop(command, None):
        for name in names:
            importlib.import_module(name)
        gc.freeze()


def become_command(request: dict[str, Any], out: int, err: int) -> None:
    """Run the command in this process, and end it."""
    os.setsid()
    for name, file in ((0, os.open(os.devnull, os.O_RDONLY)), (1, out), (2, err)):
        os.dup2(file, name)
    os.chdir(request["folder"])
    same_path = os.environ.get("PYTHONPATH") == request["environment"].get("PYTHONPATH")  # of libraries, too
    calls_methods = request["words"][:1] not in [[name] for name in CALL_NO_METHOD]
    use_environment(request["environment"])
    Path("/proc/self/comm").write_text(request["mark"])
    from bench import cli

    if calls_methods and "hydra/launcher=joblib" in request["words"]:
        with_warm_processes_of_joblib([WarmProcess(same_path) for _ in range(SERVERS)])
    if calls_methods and same_path:
        with_warm_servers()
    sys.argv = ["detailbench", *request["words"]]
    end(cli.main)


def use_environment(environment: dict[str, str]) -> None:
    """Replace the environment of this process."""
    os.environ.clear()
    os.environ.update(environment)
    tempfile.tempdir = None  # what TMPDIR was is kept there


def with_warm_servers() -> None:
    """Have this process start its fork servers for one thread as forks of itself as it is now."""
    from bench.engine import forkserver

    ready, start = [WarmServer() for _ in range(SERVERS)], forkserver.start_process

    def start_process(channel: int, threads: int, printed: int) -> Any:
        if threads > 1 or not ready:  # the libraries are there already, for one thread
            return start(channel, threads, printed)
        return ready.pop().begin(channel, printed)

    forkserver.start_process = start_process


def with_warm_processes_of_joblib(ready: list[WarmProcess]) -> None:
    """Have joblib start its processes as those forks, which know nothing that the command does from here on."""
    module = importlib.import_module(f"{JOBLIB}.fork_exec")
    start = module.fork_exec

    def fork_exec(command: list[str], fds: list[int], env: dict[str, str] | None = None) -> int:
        return ready.pop().begin(command, fds, env or {}) if ready else start(command, fds, env)

    module.fork_exec = fork_exec


def end(main: Callable[[], int]) -> NoReturn:
    """``sys.exit(main())`` without taking the modules down, which is a copy of most of the memory that is shared."""
    code: object = 1
    try:
        code = main()
    except SystemExit as error:
        code = error.code
    except BaseException:
        sys.excepthook(*sys.exc_info())
    threading._shutdown()  # as the interpreter does first: wait for threads, then call what is registered
    atexit._run_exitfuncs()
    if isinstance(code, str):
        print(code, file=sys.stderr)
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(ValueError):  # of a stream that was closed
            stream.flush()
    os._exit(code if isinstance(code, int) else code is not None)


class WarmServer:
    """A child that becomes a fork server when it is told to, and ends with this process: like a ``Popen`` of it."""

    def __init__(self) -> None:
        self._tell, told = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.returncode: int | None = None
        self.pid = os.fork()
        if self.pid:
            told.close()
            return
        os.setsid()
        os.dup2(told.fileno(), 3)
        os.closerange(4, os.sysconf("SC_OPEN_MAX"))  # what this process has open is not to stay open for that
        _serve(socket.socket(fileno=3))

    def begin(self, channel: int, printed: int) -> WarmServer:
        from bench.safe_path import environment

        socket.send_fds(self._tell, [json.dumps(environment()).encode()], [channel, printed])
        self._tell.close()
        return self

    def wait(self, timeout: float | None = None) -> int:
        if self.returncode is None:
            self.returncode = awaited(self.pid, time.monotonic() + (timeout or float("inf")))
        if self.returncode is None:
            raise subprocess.TimeoutExpired("fork server", timeout or 0)
        return self.returncode

    def send_signal(self, number: int) -> None:
        if self.returncode is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


class WarmProcess:
    """A child that becomes a process of joblib when it is told to; it has fork servers of its own, warm ones or not."""

    def __init__(self, servers: bool) -> None:
        self._tell, told = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.pid = os.fork()
        if not self.pid:
            self._tell.close()
            _work_for_joblib(told, servers)

    def begin(self, command: list[str], fds: list[int], env: dict[str, str]) -> int:
        fds = sorted(map(int, fds))
        deaf = signal.getsignal(signal.SIGINT) == signal.SIG_IGN  # which a process inherits
        socket.send_fds(self._tell, [json.dumps([command, fds, {**os.environ, **env}, deaf]).encode()], fds)
        self._tell.close()
        return self.pid


def _work_for_joblib(told: socket.socket, servers: bool) -> NoReturn:
    """Wait to be told, and be what ``python -m ...popen_loky_posix`` is, with the descriptors under their numbers."""
    words, given, _, _ = socket.recv_fds(told, 1 << 17, 16)
    told.close()
    if not words:
        os._exit(0)
    command, fds, environment, deaf = json.loads(words)
    aside = [fcntl.fcntl(fd, fcntl.F_DUPFD, 100 + max(fds)) for fd in given]
    os.closerange(3, 100 + max(fds))
    for fd, number in zip(aside, fds, strict=True):
        os.dup2(fd, number)
        os.close(fd)
    use_environment(environment)
    if deaf:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    if servers:
        with_warm_servers()
    sys.argv = command[2:]  # after python -m
    end(lambda: runpy.run_module(f"{JOBLIB}.popen_loky_posix", run_name="__main__", alter_sys=True))


def _serve(told: socket.socket) -> None:
    """Wait to be told, and be a fork server to the end."""
    from bench.engine.forkserver import THREAD_VARIABLES, serve

    words, fds, _, _ = socket.recv_fds(told, 1 << 17, 2)
    if words:
        channel, printed = fds
        os.dup2(printed, 1)
        os.dup2(printed, 2)
        use_environment({**json.loads(words), **dict.fromkeys(THREAD_VARIABLES, "1")})
        sys.argv = ["-c", str(channel), "1"]
        serve()
    os._exit(0)


def awaited(child: int, deadline: float) -> int | None:
    """The exit code of a child, or None when it is still there at the deadline."""
    while time.monotonic() < deadline:
        pid, status = os.waitpid(child, os.WNOHANG)
        if pid:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.01)
    return None


def ended(child: int, deadline: float) -> int | None:
    """Wait for a child: its exit code, or None when it had to be killed."""
    code = awaited(child, deadline)
    if code is None:
        os.killpg(child, signal.SIGKILL)
        os.waitpid(child, 0)
    return code


def warm_up() -> None:
    """Import what commands and fork servers import, and take the sources apart that most plugins import.

    And find the installed plugins: their names are read from their texts, none is imported.
    """
    from bench.engine.forkserver import ALWAYS

    for name in (*IMPORTS, *ALWAYS):
        importlib.import_module(name)
    import bench
    from bench.plugins.registry import registry
    from bench.results.sources import source_digest
    from bench.sweep.composition import register_base
    from bench.sweep.request import parse

    for folder in ("geometry", "tasks", "metrics"):
        for file in sorted(Path(bench.__path__[0], folder).glob("**/*.py")):
            source_digest(file)
    source_digest(Path(__file__).parent / "faults" / "toys.py")
    registry()
    register_base()
    for word in TYPICAL:  # a parser learns its grammar from what it reads
        parse(word)
    gc.collect()
    gc.freeze()  # or the first full collection in a fork copies the memory that it shares


if __name__ == "__main__":
    warm_up()
    for line in iter(sys.stdin.readline, ""):
        print(json.dumps(answer(json.loads(line))), flush=True)
