"""The whole numbers among the keys of a run."""

from __future__ import annotations

from typing import Any

from ..errors import UsageError
from ..text import cut

# The bounds of whole numbers. A seed is one 32-bit word of the generators: larger ones would repeat.
ALL_CASES = 100_000  # as many cases as a dataset has
WHOLE_NUMBERS = {"cases": (1, ALL_CASES), "threads": (1, 1024), "seed": (0, 2**32 - 1)}


def check_whole_number(key: str, value: Any) -> None:
    """Raise :class:`UsageError` unless a key, or one of a group as ``training.cases``, can have this value."""
    least, most = WHOLE_NUMBERS[key.rpartition(".")[2]]
    if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= most:
        raise UsageError(f"{key}={cut(str(value), 100)}: expected a whole number of at least {least}, at most {most}")
