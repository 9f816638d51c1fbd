"""Which processors a cell may use: two cells that run side by side on one machine get different ones.

Claims are lock files in a folder of this user's in the temporary folder, so it works across the
processes of any launcher, and the system releases the locks when a process dies.
"""

from __future__ import annotations

import contextlib
import fcntl
import itertools
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

from ..own_folder import open_own, own_folder


def available() -> list[int]:
    """The processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


@contextlib.contextmanager
def claim(threads: int) -> Iterator[list[int]]:
    """Hold ``threads`` processors that no other cell of this user holds, as far as possible.

    Where fewer are free, the rest is shared.
    """
    with contextlib.ExitStack() as stack:
        processors = available()
        free = list(itertools.islice((cpu for cpu in processors if stack.enter_context(hold(str(cpu)))), threads))
        taken = [cpu for cpu in processors if cpu not in free]
        yield (free + taken)[:threads]


@contextlib.contextmanager
def hold(name: str) -> Iterator[bool]:
    """Hold the lock of this name if it is free; yields whether it was.

    Where there can be no locks (a temporary folder that cannot be written, or that somebody else has prepared), all
    count as free.
    """
    folder = _folder()
    try:
        if folder is None:
            raise PermissionError
        lock = open_own(folder / name, os.O_RDWR)
    except OSError:
        yield True
        return
    try:
        free = True
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            free = False
        except OSError:
            pass  # a file system without locks
        yield free
    finally:
        os.close(lock)


def _folder() -> Path | None:
    """The folder of this user's locks, None where it is not this user's alone."""
    return own_folder(Path(tempfile.gettempdir()) / f"detailbench-cpus-{os.getuid()}")
