"""Threads of the compiled loops."""

from __future__ import annotations

from typing import Any

import numba


def use(threads: int) -> None:
    """Let the compiled loops that follow run on so many threads, as far as there are processors.

    Numba's own pool is taken: it is everywhere, and other pools warn of versions that they do not like.
    """
    config: Any = numba.config  # a module that fills itself when it is imported
    config.THREADING_LAYER = "workqueue"
    numba.set_num_threads(max(1, min(threads, config.NUMBA_NUM_THREADS)))
