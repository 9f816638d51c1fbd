"""Threads of the compiled loops."""

from __future__ import annotations

import threading
from typing import Any

import numba

_chosen = threading.local()


def use(threads: int) -> None:
    """Let subsequent loops of this thread run on this number of threads, or on all processors if these are fewer."""
    config: Any = numba.config  # a module that fills itself when it is imported
    _chosen.count = max(1, min(threads, config.NUMBA_NUM_THREADS))


def in_use() -> int:
    """The number of threads of loops, for :func:`~.pool.in_parts`: one, unless :func:`use` set another."""
    return getattr(_chosen, "count", 1)
