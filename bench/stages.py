"""The current stage of the work, for a waiting user: ``reading``, ``normals``, ``solving``, ``writing``.

Functions that may take a while report it with :func:`stage`. Their caller may listen; otherwise it costs nothing.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from contextvars import ContextVar

_listener: ContextVar[Callable[[str], None] | None] = ContextVar("listener", default=None)
_current: ContextVar[str] = ContextVar("stage", default="")


@contextlib.contextmanager
def listening(listener: Callable[[str], None]) -> Iterator[None]:
    """Inside, ``listener`` is called with the name of each stage that begins or goes on."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


@contextlib.contextmanager
def stage(name: str) -> Iterator[None]:
    """Say that what is done inside is ``name``; after it goes on what was being done before."""
    listener = _listener.get()
    if listener is None:
        yield
        return
    before = _current.get()
    token = _current.set(name)
    listener(name)
    try:
        yield
    finally:
        _current.reset(token)
        listener(before)
