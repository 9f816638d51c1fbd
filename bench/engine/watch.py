"""Watching one worker: its messages, its output, its clock and its memory, and how it ended."""

from __future__ import annotations

import contextlib
import os
import selectors
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil

from ..plan.limits import Limits
from .channel import LONGEST, NoEvent, read_event
from .forkserver import FAILED, ForkServer, ServerDied

POLL = 0.05  # seconds between looks at the clock and the memory
LOOK_BELOW = 0.5  # seconds between looks at a worker's own children
ENDS_WITHIN = 5.0  # seconds that a worker has to end after it reported that it is done
READS = 64  # of one pipe in a row: endless output does not delay the checks of the limits
TAIL = 16384  # bytes of a worker's output that are stored for the report of its death
PAGE_MB = os.sysconf("SC_PAGE_SIZE") / 2**20
SETUP_MEMORY_GB = 4.0  # for making a case and scoring, if the method's limit is lower


@dataclass
class Death:
    """How a worker ended before its work was done."""

    status: str  # timeout, oom or crashed
    message: str
    index: int  # of the case it was working on; -1 before the first
    stage: str
    seconds: float  # since that stage began
    printed: str  # the end of what it wrote
    with_server: bool = False  # its fork server was gone, too: seldom caused by the case


class Worker:
    """One forked worker, watched until it ends.

    Parameters
    ----------
    server : ForkServer
    spec : the worker's job
    limits : Limits
    on_event : called with the events; raises :class:`NoEvent` for one that the worker cannot have sent
    alive : called at every look; raises when the runner itself should stop
    """

    def __init__(
        self,
        server: ForkServer,
        spec: dict[str, Any],
        limits: Limits,
        on_event: Callable[[dict[str, Any]], None],
        alive: Callable[[], None] = lambda: None,
        verbose: bool = False,
    ):
        self.server, self.limits = server, limits
        self.on_event, self.alive, self.verbose = on_event, alive, verbose
        self.printed = b""
        self._buffer = bytearray()
        self._finished_at: float | None = None  # when it reported that it is done
        self._below: list[psutil.Process] = []
        self._below_at = time.monotonic()  # it has just been forked: it has no children yet
        self._messages, messages_w = os.pipe()
        self._output, output_w = os.pipe()
        try:
            self.pid = server.fork(spec, messages_w, output_w)
        except ServerDied:
            self._close()
            raise
        finally:
            os.close(messages_w)
            os.close(output_w)
        for fd in (self._messages, self._output):
            os.set_blocking(fd, False)
        self._enter("start", -1)

    def watch(self) -> Death | None:
        """Follow the worker to its end; None when it did all its work."""
        killed: tuple[str, str] | None = None
        try:
            killed = self._follow()
        finally:
            self.kill()  # or, of one that has ended, what it started: if its server is gone, nobody else ends that
            ended_at = time.monotonic()
            status = self._reap()
            self._drain(self._output)
            # Of one that had to be killed, no later message is believed: it came after a limit, or after a forged one.
            if not killed:
                try:
                    self._drain(self._messages)
                except NoEvent as error:
                    killed = "crashed", str(error)
            self._close()
        if self._finished_at is not None and not killed:
            return None
        how, message = killed or self._cause(status)
        printed = self.printed.decode(errors="replace").strip()
        seconds = max(0.0, ended_at - self._since)  # it may have been heard later than it ended
        return Death(how, message, self.index, self.stage, seconds, printed, with_server=status is None and not killed)

    def _follow(self) -> tuple[str, str] | None:
        """Read until the worker has ended; the status and the reason to kill it, if it must be killed."""
        with selectors.DefaultSelector() as selector:
            for fd in (self._messages, self._output):
                selector.register(fd, selectors.EVENT_READ)
            while True:
                try:
                    for key, _ in selector.select(POLL):
                        if not self._drain(key.fd):
                            selector.unregister(key.fd)
                except NoEvent as error:
                    return "crashed", str(error)
                self.alive()
                if self._is_over():
                    return None
                if self._finished_at is None:
                    if killed := self._passed_limit():
                        return killed
                elif time.monotonic() - self._finished_at > ENDS_WITHIN:
                    return None  # its work is done, but a thread or a handler of a method keeps it from ending

    def kill(self) -> None:
        """Kill the worker's process group; the server kills processes that left the group."""
        for kill in (os.killpg, os.kill):  # the group does not exist before the worker has made it
            with contextlib.suppress(ProcessLookupError, PermissionError):
                kill(self.pid, signal.SIGKILL)

    # -- its messages ----------------------------------------------------------------------------------------------

    def _drain(self, fd: int) -> bool:
        """Read what is available, of a flood a part; False at the end of the stream.

        Raises
        ------
        NoEvent
            For a message that a worker cannot have sent.
        """
        for _ in range(READS):
            try:
                chunk = os.read(fd, 65536)
            except BlockingIOError:
                return True
            if not chunk:
                return False
            if fd == self._messages:
                self._split(chunk)
                continue
            self.printed = (self.printed + chunk)[-TAIL:]
            if self.verbose:
                sys.stderr.buffer.write(chunk)
                sys.stderr.flush()
        return True

    def _split(self, chunk: bytes) -> None:
        """Hear the events whose lines end in this chunk."""
        *ends, rest = chunk.split(b"\n")
        for end in ends:
            line, self._buffer = bytes(self._buffer + end), bytearray()
            if line:
                self._hear(read_event(line))
        self._buffer += rest
        if len(self._buffer) > LONGEST:
            raise NoEvent(f"more than {LONGEST >> 20} MB without the end of a line")

    def _hear(self, event: dict[str, Any]) -> None:
        kind, now = event["event"], time.monotonic()
        if self._finished_at is not None:
            if kind in ("progress", "doing", "pause", "resume"):  # from a thread that a method has left running
                return
            raise NoEvent(f"an event {kind!r} after 'done'")
        if kind == "pause":
            self._pauses += 1
            if self._pauses == 1:
                self._paused_at = now
                self._deadline += self.limits.setup_seconds
        elif kind == "resume":
            if not self._pauses:
                raise NoEvent("an event 'resume' without a 'pause'")
            self._pauses -= 1
            if self._pauses == 0:
                self._deadline += now - self._paused_at - self.limits.setup_seconds
        elif kind == "done":
            self._finished_at = now
        else:
            self.on_event(event)
        if kind == "begin":
            self._enter(event["stage"], event["index"])

    def _enter(self, stage: str, index: int) -> None:
        self.stage, self.index = stage, index
        self._pauses = 0  # the clock may be stopped while it is stopped
        self._since = time.monotonic()
        self._deadline = self._since + (
            self.limits.seconds if stage == "method" else max(self.limits.setup_seconds, self.limits.seconds)
        )
        self._base_mb = self._resident_mb()

    # -- what it takes ---------------------------------------------------------------------------------------------

    def _passed_limit(self) -> tuple[str, str] | None:
        # Memory first: a look that comes late on a busy machine may find both limits passed.
        limit = self.limits.memory_gb if self.stage == "method" else max(self.limits.memory_gb, SETUP_MEMORY_GB)
        taken = (self._resident_mb() + self._resident_below_mb() - self._base_mb) / 1024
        if taken > limit:
            return "oom", f"took {taken:.1f} GB (limit.memory_gb={self.limits.memory_gb:g})"
        if time.monotonic() > self._deadline:
            seconds, setup_seconds = self.limits.seconds, self.limits.setup_seconds
            if self.stage == "method" and not self._pauses:
                return "timeout", f"stopped after {seconds:g} s (limit.seconds={seconds:g})"
            names = {"case": "making the case", "prepare": "preparing the method", "score": "scoring"}
            name = (names | {"method": "what stops the method's clock"}).get(self.stage, f"the stage {self.stage!r}")
            larger = self.stage != "method" and seconds > setup_seconds
            passed = f"seconds={seconds:g}" if larger else f"setup_seconds={setup_seconds:g}"
            return "timeout", f"{name} took longer than limit.{passed}"
        return None

    def _resident_mb(self) -> float:
        return _resident_mb(self.pid)

    def _resident_below_mb(self) -> float:
        """Resident memory of the worker's own children; shared pages count for each."""
        now = time.monotonic()
        if now - self._below_at > LOOK_BELOW:
            self._below_at = now
            with contextlib.suppress(psutil.Error):
                self._below = psutil.Process(self.pid).children(recursive=True)
        return sum(_resident_mb(process.pid) for process in self._below)

    # -- how it ended ----------------------------------------------------------------------------------------------

    def _is_over(self) -> bool:
        """Whether it has ended. The end of its pipe is no proof: a grandchild may hold the other end."""
        try:
            return psutil.Process(self.pid).status() == psutil.STATUS_ZOMBIE
        except psutil.NoSuchProcess:
            return True

    def _reap(self) -> int | None:
        try:
            return self.server.reap(self.pid)
        except ServerDied:
            return None

    def _cause(self, status: int | None) -> tuple[str, str]:
        from .worker import OUT_OF_MEMORY

        if status is None:
            return "crashed", "the fork server was killed"
        if os.WIFSIGNALED(status):
            number = os.WTERMSIG(status)
            with contextlib.suppress(ValueError):
                message = f"killed by {signal.Signals(number).name} (signal {number})"
                words = self.printed.decode(errors="replace").lower()
                if any(w in words for w in OUT_OF_MEMORY):
                    return "oom", f"{message} after it could not allocate (limit.memory_gb={self.limits.memory_gb:g})"
                return "crashed", message
            return "crashed", f"killed by signal {number}"
        message = f"ended with exit status {os.WEXITSTATUS(status)}"
        if os.WEXITSTATUS(status) == FAILED and self.printed:  # the last line of a traceback names the error
            message = f"{message}: {self.printed.decode(errors='replace').strip().splitlines()[-1]}"
        return "crashed", message

    def _close(self) -> None:
        os.close(self._messages)
        os.close(self._output)


def _resident_mb(pid: int) -> float:
    with contextlib.suppress(OSError, ValueError, IndexError):
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * PAGE_MB
    if sys.platform != "linux":
        with contextlib.suppress(psutil.Error):
            return psutil.Process(pid).memory_info().rss / 2**20
    return 0.0
