"""Tables and texts as JSON that a browser reads, and that can stand inside a page."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

from ..text import encodable

if TYPE_CHECKING:
    import pandas as pd

DIGITS = 9  # significant ones; a page shows five at most
ENDS = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"}


def number(value: Any) -> float | int | str | None:
    """A number for JSON: None for NaN and for missing values, ``"Infinity"`` and ``"-Infinity"`` in words.

    Example
    -------
    >>> [number(x) for x in (0.1, 3.0, float("nan"), float("-inf"))]
    [0.1, 3, None, '-Infinity']
    """
    if value is None:
        return None
    try:
        value = float(value)
    except TypeError:  # pandas' NA, which is not a float
        return None
    if math.isnan(value):
        return None
    if math.isinf(value):
        return "Infinity" if value > 0 else "-Infinity"
    return int(value) if value == int(value) and abs(value) < 2**53 else float(f"{value:.{DIGITS}g}")


def columns(frame: pd.DataFrame) -> dict[str, Any]:
    """A table by columns: numbers as a list, texts as ``{"values": distinct texts, "codes": which one}``.

    A missing text is the empty one.
    """
    import pandas as pd

    found: dict[str, Any] = {}
    for name in frame.columns:
        column = frame[name]
        if pd.api.types.is_numeric_dtype(column.dtype) or pd.api.types.is_bool_dtype(column.dtype):
            found[name] = [number(value) for value in column]
        elif column.isna().all():
            found[name] = {"values": [""], "codes": [0] * len(column)}
        else:
            texts = [value if isinstance(value, str) else "" if value is None or value != value else str(value)
                     for value in column]  # fmt: skip
            codes, values = pd.factorize(pd.Series(texts, dtype=object))
            found[name] = {"values": list(values), "codes": [int(code) for code in codes]}
    return found


def script_json(value: Any) -> str:
    """JSON that can stand inside a ``<script>``: no text in it ends the script or starts a comment.

    The characters ``<``, ``>`` and ``&`` are written as escapes, which JSON reads as the same. NaN is an error:
    numbers come from :func:`number`.
    """
    text = json.dumps(encodable(value), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    for letter, escape in ENDS.items():
        text = text.replace(letter, escape)
    return text
