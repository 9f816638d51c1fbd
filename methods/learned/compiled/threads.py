"""Threads of the compiled loops."""

from __future__ import annotations

import threading
from typing import Any

import numba

_chosen = threading.local()


def use(threads: int) -> None:
    """Let the loops that follow in this thread run on so many threads, as far as there are processors."""
    config: Any = numba.config  # a module that fills itself when it is imported
    _chosen.count = max(1, min(threads, config.NUMBA_NUM_THREADS))


def in_use() -> int:
    """How many threads loops are to run on, for :func:`~.pool.in_parts`: one, unless :func:`use` said otherwise."""
    return getattr(_chosen, "count", 1)
