"""Text in tables: names and messages come from anywhere, and must be shown as text by any reader of the table."""

from __future__ import annotations

import re
from collections.abc import Callable

import pandas as pd

from ...text import one_line

# Characters that start a formula in spreadsheets, as listed by OWASP, and the same in full width.
FORMULA = re.compile(r"[=+\-@＝＋－＠]")
JOINED = "message"  # may have several lines, which its printer joins


def plain_texts(frame: pd.DataFrame) -> pd.DataFrame:
    """The same frame with control characters and ends of lines shown, in its cells and in the names of its columns."""
    return _mapped(frame.rename(columns=one_line), one_line, leave=JOINED)


def csv(frame: pd.DataFrame) -> str:
    """A frame as CSV; a text that a spreadsheet would take for a formula has an apostrophe before it."""
    return _mapped(_mapped(frame, one_line), _no_formula).to_csv(index=False, lineterminator="\n")


def _no_formula(text: str) -> str:
    return f"'{text}" if FORMULA.match(text) and not _is_number(text) else text


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _mapped(frame: pd.DataFrame, change: Callable[[str], str], leave: str = "") -> pd.DataFrame:
    """The frame with its texts changed; only columns in which any is are copied."""
    changed = {}
    for name in frame.columns:
        if name == leave or pd.api.types.is_numeric_dtype(frame[name].dtype):
            continue
        texts = {text for text in frame[name] if isinstance(text, str)}
        if new := {text: other for text in texts if (other := change(text)) != text}:
            changed[name] = [new.get(value, value) if isinstance(value, str) else value for value in frame[name]]
    return frame.assign(**changed) if changed else frame
