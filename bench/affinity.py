"""Which processors a cell may use: two cells that run side by side on one machine get different ones."""

from __future__ import annotations

import contextlib
import fcntl
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path


def available() -> list[int]:
    """The processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


@contextlib.contextmanager
def claim(threads: int) -> Iterator[list[int]]:
    """Hold ``threads`` processors that no other cell of this user holds, as far as there are any.

    Locks on files in the temporary folder, so it works across the processes of any launcher, and the system lets go
    of them when a process dies. Where fewer are free, the rest is shared.
    """
    folder = Path(tempfile.gettempdir()) / f"detailbench-cpus-{os.getuid()}"
    with contextlib.ExitStack() as stack:
        processors = available()
        free: list[int] = []
        with contextlib.suppress(OSError):
            folder.mkdir(exist_ok=True)
            for cpu in processors:
                if len(free) == threads:
                    break
                file = stack.enter_context((folder / str(cpu)).open("w"))
                with contextlib.suppress(BlockingIOError):
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    free.append(cpu)
        taken = [cpu for cpu in processors if cpu not in free]
        yield (free + taken)[:threads]
