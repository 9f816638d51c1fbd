"""What the reader of a result should know about its input: one line each, from wherever it is found.

Functions on arrays and readers of files call :func:`notice`. Who runs them collects the lines and shows them: as the
message of a row, below a leaderboard, or in the terminal.
"""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator
from contextvars import ContextVar
from typing import Any

_collector: ContextVar[list[str] | None] = ContextVar("notices", default=None)


class InputWarning(UserWarning):
    """The category of a :func:`notice` that is not collected."""


def show_as_lines() -> None:
    """Print a notice that is not collected as one plain line on stderr, without the line of code that it comes from."""
    warnings.formatwarning = _formatted


_format = warnings.formatwarning


def _formatted(message: Any, category: type[Warning], *where: Any, **more: Any) -> str:
    is_notice = issubclass(category, InputWarning)
    return f"note: {message}\n" if is_notice else _format(message, category, *where, **more)


def notice(text: str) -> None:
    """Report a fact about an input that its reader should know; repeated, it counts once."""
    collected = _collector.get()
    if collected is None:
        warnings.warn(text, InputWarning, stacklevel=3)
    elif text not in collected:
        collected.append(text)


@contextlib.contextmanager
def collected(into: list[str] | None = None) -> Iterator[list[str]]:
    """The notices of what is done inside, in the order of their coming; those around get none of them.

    They are added to ``into`` where that is given.
    """
    found: list[str] = [] if into is None else into
    token = _collector.set(found)
    try:
        yield found
    finally:
        _collector.reset(token)
