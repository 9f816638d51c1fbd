"""Text that every file and every terminal can take."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def encodable(value: Any) -> Any:
    """JSON values with all text in them, keys too, as UTF-8 can hold it.

    A lone surrogate (which is how Python spells a byte of a file's name that is no UTF-8) becomes ``\\udcff``, and a
    NUL, which ends a string for many readers, ``\\x00``; all else stays as it is.
    """
    if isinstance(value, str):
        return value.encode("utf-8", "backslashreplace").decode("utf-8").replace("\0", "\\x00")
    if isinstance(value, Mapping):
        return {encodable(key): encodable(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [encodable(inner) for inner in value]
    return value


def duration(seconds: float) -> str:
    """A time in words, no more exact than an estimate is: ``40 s``, ``3 min``, ``2 h``, ``4 days``."""
    for unit, size, least in (("days", 86400, 2 * 86400), ("h", 3600, 5400), ("min", 60, 120)):
        if seconds >= least:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s" if seconds >= 1 else f"{seconds:.1g} s"


def shortened(text: str, most: int) -> str:
    """A text of at most so many letters: of a longer one the beginning and the end."""
    if len(text) <= most:
        return text
    end = (most - 1) // 3
    return f"{text[: most - 1 - end]}…{text[len(text) - end :]}"
