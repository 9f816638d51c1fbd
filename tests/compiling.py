"""One compilation of each function for all test processes: the others wait for it, and load it.

Files of tests that need the same functions come one after the other, so all processes would begin with the same
compilations, which take a minute for the splats alone.
"""

from __future__ import annotations

import contextlib
import fcntl
import functools
from collections.abc import Iterator
from pathlib import Path

from numba.core.caching import Cache
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher

HELD: set[Path] = set()  # by this process


@contextlib.contextmanager
def held(lock: Path) -> Iterator[None]:
    """Hold a lock that other processes respect."""
    if lock in HELD:  # a function that calls itself
        yield
        return
    lock.parent.mkdir(parents=True, exist_ok=True)
    with lock.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        HELD.add(lock)
        try:
            yield
        finally:
            HELD.discard(lock)


def compile_each_function_once() -> None:
    """From now on, this process compiles nothing that another is compiling."""
    compiled = Dispatcher.compile
    if hasattr(compiled, "__wrapped__"):
        return

    @functools.wraps(compiled)
    def compile_or_wait(self, sig):
        if not isinstance(self._cache, Cache):
            return compiled(self, sig)
        function = self.py_func
        lock = Path(self._cache.cache_path, f"{function.__qualname__}-{function.__code__.co_firstlineno}.lock")
        # Threads wait for the first lock, and whoever has it for the second: functions call one another in one order.
        with global_compiler_lock, held(lock):
            return compiled(self, sig)

    Dispatcher.compile = compile_or_wait
