"""The state that a method may leave behind in its process, which must not affect the next case.

A worker runs the cases of a cell one after the other. Changes of the process by one call (its limits, its working
folder, a thread that goes on computing) would affect the next case and its time or status. So the
state before and after a call is compared, and a worker whose state has changed is replaced, at the cost of a fork.
"""

from __future__ import annotations

import contextlib
import os
import resource
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

# Seconds in which threads are watched, so often: one that rests in any of them waits. OpenMP's may spin for 0.2 s.
WINDOW, WINDOWS = 0.01, 30
MORE_DESCRIPTORS = 256  # than before a call
OF_STATUS = ("Umask:", "SigBlk:", "SigIgn:", "Cpus_allowed:", "NoNewPrivs:", "Seccomp:")


def state() -> dict[str, Any]:
    """The state of this process that a method may change and that affects another call, by name."""
    found: dict[str, Any] = {
        "the environment": dict(os.environ),
        "limits": {name: resource.getrlimit(getattr(resource, name)) for name in dir(resource) if _is_limit(name)},
        "handlers of signals": [signal.getsignal(number) for number in signal.valid_signals()],
        "the priority": os.getpriority(os.PRIO_PROCESS, 0),
        "floating-point errors": np.geterr(),
        "the recursion limit": sys.getrecursionlimit(),
        "the working folder": None,
        "descriptors": _descriptors(),
        "processes": _processes(),
        "threads": _threads(),
    }
    with contextlib.suppress(FileNotFoundError):  # it was deleted
        found["the working folder"] = os.getcwd()
    with contextlib.suppress(FileNotFoundError), open("/proc/self/status") as status:  # elsewhere than on Linux
        found["the mask of signals, umask or processors"] = [line for line in status if line.startswith(OF_STATUS)]
    if "torch" in sys.modules:
        torch = sys.modules["torch"]
        found["torch"] = [torch.get_num_threads(), torch.get_default_dtype(), torch.is_grad_enabled()]
    return found


def changes(before: dict[str, Any]) -> list[str]:
    """The changes, in words."""
    try:
        after = state()
    except (OSError, MemoryError) as error:  # no descriptors left, or no memory
        return [f"something that can no longer be read ({type(error).__name__})"]
    compared: dict[str, Callable[[Any, Any], bool]] = {
        "descriptors": _are_closed,
        "processes": _are_new,
        "threads": _are_busy,
    }
    return [
        name
        for name, value in before.items()
        if compared.get(name, lambda old, new: old != new)(value, after.get(name, value))
    ]


def _is_limit(name: str) -> bool:
    return name.startswith("RLIMIT_")


def _descriptors() -> dict[str, str]:
    found = {}
    with contextlib.suppress(FileNotFoundError):
        for name in os.listdir("/proc/self/fd"):
            with contextlib.suppress(FileNotFoundError):  # that of the listing itself
                found[name] = os.readlink(f"/proc/self/fd/{name}")
    return found


def _are_closed(before: dict[str, str], after: dict[str, str]) -> bool:
    return any(after.get(name) != what for name, what in before.items()) or len(after) > len(before) + MORE_DESCRIPTORS


def _processes() -> set[str]:
    """The ids of processes that this one has started, and of those that its fork server took over."""
    found: set[str] = set()
    for pid in ("self", str(os.getppid())):
        for task in Path(f"/proc/{pid}/task").glob("*/children"):
            with contextlib.suppress(OSError):
                found.update(task.read_text().split())
    return found - {str(os.getpid())}


def _are_new(before: set[str], after: set[str]) -> bool:
    return not after <= before


def _threads() -> dict[str, int]:
    """Nanoseconds that each thread but the main one was running, or waiting for a processor."""
    found = {}
    for task in Path("/proc/self/task").glob("[0-9]*"):
        if task.name != str(os.getpid()):
            with contextlib.suppress(OSError, ValueError):
                running, waiting, _ = (task / "schedstat").read_text().split()
                found[task.name] = int(running) + int(waiting)
    return found


def _are_busy(before: dict[str, int], after: dict[str, int]) -> bool:
    """Whether a new thread computes. Those of libraries sleep until they are needed."""
    suspects = after.keys() - before.keys()
    for _ in range(WINDOWS):
        if not suspects:
            return False
        begin, at = time.monotonic(), _threads()
        time.sleep(WINDOW)
        most, now = 0.5e9 * (time.monotonic() - begin), _threads()
        # The time that a thread waits for a processor is counted when it gets one, which may be after the window.
        there = suspects & at.keys() & now.keys()
        suspects = {name for name in there if now[name] - at[name] > most or _is_runnable(name)}
    return bool(suspects)


def _is_runnable(thread: str) -> bool:
    """Whether a thread runs or waits for a processor."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/self/task/{thread}/stat").read_text().rpartition(")")[2].split()[0] == "R"
    return False
