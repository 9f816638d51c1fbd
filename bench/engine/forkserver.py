"""The fork server: a process that has the heavy imports loaded and has computed nothing, and forks workers.

A worker that is forked from it starts in milliseconds. It must be forked from a process that has not *used* its
libraries: OpenMP pools that exist before a fork hang the child. There is one server per set of libraries and thread
count, so each method meets the same process whatever else the sweep holds.

The server belongs to the process that started it (the runner): when their socket closes, for whatever reason, it
kills everything below it and ends. It is a *subreaper*: a daemon that a method leaves behind becomes its child, and
is found and killed when the cell ends.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import gc
import importlib
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import psutil

from ..errors import DetailbenchError
from ..safe_path import environment, isolate_imports
from .affinity import available

_PR_SET_PDEATHSIG = 1
_PR_SET_CHILD_SUBREAPER = 36
_MAX_MESSAGE = 1 << 17
_START = "from bench.engine.forkserver import serve; serve()"
FAILED = 70  # exit status of a worker whose own code fails
LOOK = 0.5  # seconds between looks at whether a server that does not answer is stopped
LOAD_SECONDS = 600.0  # for importing libraries
ANSWER_SECONDS = 60.0  # for forking, and for the end of a worker that was killed: a large one takes a while
# Libraries that size their thread pools by these; the others are held by processor affinity.
THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "IGL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)
# Threads that wait for work sleep. By default they spin: beside one other busy process two threads of torch then took
# 20 times as long for a step of a training, beside three 58 times; alone they were 10 % faster.
WAITING = {"OMP_WAIT_POLICY": "PASSIVE"}
# What every worker needs to make a case and to score an output.
ALWAYS = (
    "numpy",
    "scipy.spatial",
    "trimesh",
    "igl",
    "bench.engine.worker",
    "bench.engine.isolate",
    "bench.geometry.check",
    "bench.geometry.comparison",
    "bench.geometry.io.files",
    "bench.geometry.mesh_surface",
)


def _prctl(option: int, value: int) -> None:
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(option, value)


# -- the side of the runner --------------------------------------------------------------------------------------------


def server_environment(threads: int) -> dict[str, str]:
    """The environment of a server for this number of threads; the user's settings of how threads wait prevail."""
    return {**WAITING, **environment(), **dict.fromkeys(THREAD_VARIABLES, str(threads))}


def start_process(channel: int, threads: int, printed: int) -> subprocess.Popen[bytes]:
    """Start a server's process, given the descriptors of its end of the socket and of the file for what it prints."""
    return subprocess.Popen(
        [sys.executable, "-P", "-c", _START, str(channel), str(threads)],  # -P: see bench/safe_path.py
        pass_fds=[channel],
        stdin=subprocess.DEVNULL,
        stdout=printed,
        stderr=printed,
        env=server_environment(min(threads, len(available()))),
        start_new_session=True,  # Ctrl-C in the terminal is handled by the runner
    )


class ForkServer:
    """The runner's handle on one server, which starts to import the libraries of every worker at once.

    Parameters
    ----------
    threads : int
        How many processors the workers will be pinned to; pools are sized by it.
    """

    def __init__(self, threads: int):
        self.threads = threads
        self._loaded = False
        self._printed = tempfile.TemporaryFile()  # noqa: SIM115  a worker has a pipe of its own for that
        self._shown = 0  # bytes of it that the user has seen
        here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with there:
            self._process = start_process(there.fileno(), threads, self._printed.fileno())
        self._socket = here
        self._socket.settimeout(LOOK)

    def load(self, preload: tuple[str, ...], plugins: tuple[str, ...]) -> None:
        """Have it import libraries by name, and plugin files like ``--plugin``, and wait; before the first fork.

        Raises
        ------
        CannotStart
            If it ended before that: not even the libraries of every worker can be imported.
        ServerDied
            If it ended while importing the given libraries.
        """
        try:
            self._ask({"do": "begin"}, patience=LOAD_SECONDS)
        except ServerDied as error:
            raise CannotStart(str(error)) from error
        names = ", ".join((*preload, *plugins))
        request = {"do": "load", "preload": preload, "plugins": plugins}
        self._ask(request, patience=LOAD_SECONDS, doing=f"; it was loading {names}" if names else "")
        self._loaded = True
        if said := self._said():
            print(said, file=sys.stderr)
            self._shown = os.fstat(self._printed.fileno()).st_size

    def _said(self) -> str:
        """What it has printed and the user has not seen yet."""
        if self._printed.closed:  # by another thread
            return ""
        file = self._printed.fileno()  # read in place: the server shares the position of this file
        return os.pread(file, os.fstat(file).st_size, self._shown).decode(errors="replace").strip()

    def _last_words(self) -> str:
        """The last line that it printed: of a traceback, the error."""
        lines = self._said().splitlines()
        return f": {lines[-1].strip()}" if lines else ""

    def _ask(
        self,
        request: dict[str, Any],
        fds: tuple[int, ...] = (),
        patience: float = ANSWER_SECONDS,
        doing: str = "",
    ) -> dict[str, Any]:
        try:
            socket.send_fds(self._socket, [json.dumps(request).encode()], list(fds))
            answer = self._answer(time.monotonic() + patience)
        except OSError:
            answer = b""
        if not answer:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(timeout=5)
            status = f"(exit status {self._process.returncode})"
            raise ServerDied(f"the fork server ended unexpectedly {status}{self._last_words()}{doing}")
        return json.loads(answer)

    def _answer(self, deadline: float) -> bytes:
        """Its answer, empty when it has ended; one that gives none until the deadline is ended here."""
        while time.monotonic() < deadline:
            try:
                return self._socket.recv(_MAX_MESSAGE)
            except TimeoutError:
                self._go_on()
        self._end()
        return b""

    def _go_on(self) -> None:
        """Resume it in case it was stopped, for instance by a method that it has forked."""
        self._process.send_signal(signal.SIGCONT)

    def _end(self) -> None:
        """Kill it and, since it cannot do so itself, its descendants."""
        with contextlib.suppress(psutil.Error):
            for process in psutil.Process(self._process.pid).children(recursive=True):
                with contextlib.suppress(psutil.Error):
                    process.kill()
        self._process.kill()
        self._process.wait()

    def fork(self, spec: dict[str, Any], messages: int, output: int) -> int:
        """Start a worker on ``spec``; it writes to the two file descriptors. Returns its process id."""
        with tempfile.TemporaryFile() as job:  # a job with thousands of finished cases is too long for a message
            job.write(json.dumps(spec).encode())
            job.flush()
            return self._ask({"do": "fork"}, (messages, output, job.fileno()))["pid"]

    def reap(self, pid: int) -> int:
        """Wait for a worker that ended or was killed, kill its remaining descendants; its wait status."""
        return self._ask({"do": "reap", "pid": pid})["status"]

    def close(self) -> None:
        """End the server and all its descendants."""
        self._socket.close()
        self._printed.close()
        if self._loaded:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._go_on()
                self._process.wait(timeout=5)
                return
        self._end()


class ServerDied(DetailbenchError):
    """The fork server is gone: something killed it."""


class CannotStart(DetailbenchError):
    """No worker can be started, whatever the method: an error of the run, never the result of a method."""

    def __init__(self, reason: str):
        super().__init__(
            f"cannot start the processes that run the cases: {reason}. No result was stored for them. Check the Python "
            "environment (PYTHONPATH, installed packages, free memory), then run the same command again"
        )


_prestarted: list[ForkServer] = []


def prestart(threads: int) -> None:
    """Prestart a server before its work is known: it imports while this process reads its configs.

    Useful only with a second processor. The first call of :func:`take_prestarted` with as many threads gets it;
    otherwise it is ended then, or with this process.
    """
    if len(available()) > 1 and not _prestarted:
        _prestarted.append(ForkServer(threads))
        atexit.register(_end_prestarted)


def take_prestarted(threads: int) -> ForkServer:
    """The prestarted server, if its number of threads fits, or a new one."""
    if _prestarted and _prestarted[0].threads == threads:
        return _prestarted.pop()
    _end_prestarted()
    return ForkServer(threads)


def _end_prestarted() -> None:
    while _prestarted:
        _prestarted.pop().close()


# -- the side of the server --------------------------------------------------------------------------------------------


def serve() -> None:
    """The server's main loop; the arguments are the socket's file descriptor and the number of threads."""
    isolate_imports()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(1))  # not without ending its descendants
    _prctl(_PR_SET_CHILD_SUBREAPER, 1)
    _prctl(_PR_SET_PDEATHSIG, signal.SIGCONT)  # one that a method stopped sees the end of the runner, too
    channel, threads = socket.socket(fileno=int(sys.argv[1])), int(sys.argv[2])
    if hasattr(os, "sched_setaffinity"):  # before all else: libraries count processors when they are imported
        os.sched_setaffinity(0, available()[:threads])
    try:
        _import(ALWAYS)
        importlib.import_module("bench.engine.worker")  # without it there is no worker: the traceback says why
        while True:
            message, fds, _, _ = socket.recv_fds(channel, _MAX_MESSAGE, 3)
            if not message:
                break  # the runner is gone
            request = json.loads(message)
            answer: dict[str, int] = {}
            match request["do"]:
                case "load":
                    _load(request)
                case "fork":
                    answer = {"pid": _fork(channel, *fds)}
                case "reap":
                    answer = {"status": _reap(request["pid"])}
            channel.send(json.dumps(answer).encode())
    except ConnectionError:
        pass  # the runner ended while we were answering
    finally:
        _kill_descendants()


def _load(request: dict[str, Any]) -> None:
    """Import what the workers of this server need beyond :data:`ALWAYS`."""
    from ..plugins.registry import registry

    found = registry()
    for path in request["plugins"]:
        found.load_file(path)
    _import(request["preload"])
    print(end="", flush=True)  # what is still in the buffer would be printed by every worker
    gc.collect()
    gc.freeze()  # pages that the collector never touches stay shared with the workers


def _import(modules: Iterable[str]) -> None:
    for module in modules:
        with contextlib.suppress(ImportError):  # the worker says which library is missing
            importlib.import_module(module)


def _fork(channel: socket.socket, messages: int, output: int, job: int) -> int:
    with os.fdopen(job, "rb") as file:
        file.seek(0)
        spec = json.load(file)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)  # where it is ignored, nobody learns how a process ended
    server = os.getpid()
    pid = os.fork()
    if pid:
        os.close(messages)
        os.close(output)
        return pid
    status = FAILED
    try:
        os.setsid()  # a process group of its own, to be killed as a whole
        _prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != server:
            os._exit(status)
        channel.close()
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        os.dup2(output, 1)
        os.dup2(output, 2)
        os.close(output)
        from .worker import work

        work(spec, messages)
        status = 0
    except BaseException as error:  # nothing may return into the server's loop
        import traceback

        try:
            sys.stdout.flush()
        finally:
            traceback.print_exception(error)  # last, for its last line is what the runner shows
    finally:
        try:
            sys.stdout.flush()
            sys.stderr.flush()
        finally:
            os._exit(status)


def _reap(pid: int) -> int:
    _, status = os.waitpid(pid, 0)
    _kill_descendants()
    return status


def _children() -> list[int]:
    """The ids of this process's children, adopted ones too."""
    if sys.platform == "linux":
        found: list[int] = []
        for task in Path(f"/proc/{os.getpid()}/task").iterdir():
            with contextlib.suppress(OSError):
                found.extend(int(p) for p in (task / "children").read_text().split())
        return found
    return [p.pid for p in psutil.Process().children()]


def _kill_descendants() -> None:
    """Kill all descendants; orphans become children of this process, until none is left."""
    while True:
        with contextlib.suppress(psutil.Error):
            for process in psutil.Process().children(recursive=True):
                with contextlib.suppress(psutil.Error):
                    process.kill()
        try:
            while True:
                os.waitpid(-1, 0)
        except ChildProcessError:
            if not _children():
                return
