"""The split of examples into training and validation."""

from __future__ import annotations


def held_out_rows(count: int, held_out: bool) -> slice:
    """Of ``count`` examples the last tenth, at least one, if ``held_out``; otherwise the rest (all, if there is one).

    Examples
    --------
    >>> held_out_rows(25, True), held_out_rows(25, False), held_out_rows(1, True)
    (slice(23, 25, None), slice(0, 23, None), slice(0, 1, None))
    """
    last = max(1, count // 10) if count > 1 else 0
    return slice(count - last, count) if held_out and last else slice(0, count - last)
