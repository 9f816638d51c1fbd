"""Text that every file and every terminal can take."""

from __future__ import annotations

import contextlib
import re
import sys
from collections.abc import Iterator, Mapping
from typing import Any, TextIO

# What a terminal obeys instead of showing it: control characters (C0, DEL, C1), separators of lines and paragraphs, and
# those that turn the direction of what is written.
OBEYED = "\x00-\x1f\x7f-\x9f\u2028\u2029\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"
_LINES = re.compile(rf"(?![\n\t])[{OBEYED}]")
_CELL = re.compile(rf"[{OBEYED}]")


def counted(n: int, word: str) -> str:
    """``1 shape``, ``3 shapes``."""
    return f"{n} {word}" if n == 1 else f"{n} {word}s"


def shown(text: str) -> str:
    """A text whose control characters are shown, as ``\\x1b``, except for line ends and tabs."""
    return _LINES.sub(_escaped, text)


def one_line(text: str) -> str:
    """The same for a cell of a table, or a name: ends of lines and tabs are shown, too."""
    return _CELL.sub(_escaped, text)


def _escaped(match: re.Match[str]) -> str:
    return match[0].encode("unicode_escape").decode("ascii")


class Shown:
    """A stream that shows the control characters of all text, instead of having a terminal obey them.

    What is printed may come from anywhere: a file's name, an exception of a method, a table of somebody's results. Who
    has escapes of their own to print (rich, for colours and bars) shows the text first, and writes to ``stream``.
    """

    def __init__(self, stream: TextIO):
        self.stream = stream

    def write(self, text: str) -> int:
        """Write the text, shown."""
        self.stream.write(shown(text))
        return len(text)

    def writelines(self, lines: Iterator[str]) -> None:
        """Write several texts, shown."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


def below(stream: TextIO) -> TextIO:
    """The stream under a :class:`Shown` one, which takes escapes as they are."""
    return stream.stream if isinstance(stream, Shown) else stream


@contextlib.contextmanager
def shown_streams() -> Iterator[None]:
    """Inside, both output streams are :class:`Shown`."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (stream and (stream if isinstance(stream, Shown) else Shown(stream)) for stream in before)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


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


LONGEST = {"message": 10_000, "notes": 10_000, "traceback": 50_000}  # characters of these parts of a row; of others:
LONGEST_TEXT = 1_000
LONGEST_JSON = 1_000_000  # columns that hold JSON, which cannot be cut
JSON_COLUMNS = ("trace", "artefacts", "directions")


def cut(text: str, most: int) -> str:
    """A text of at most this many characters, with the length of the omitted part."""
    if len(text) <= most:
        return text
    kept = most - 40  # with what is said of the rest it is not too long either
    return f"{text[:kept]}... ({len(text) - kept:,} more characters)"


def bounded(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row whose texts have an end, whatever a method raised or noted; JSON that is too long is left out."""
    kept, left_out = dict(row), []
    for key, value in row.items():
        if not isinstance(value, str):
            continue
        if key not in JSON_COLUMNS:
            kept[key] = cut(value, LONGEST.get(key, LONGEST_TEXT))
        elif len(value) > LONGEST_JSON:
            kept[key] = ""
            left_out.append(f"{key}: left out, {len(value):,} characters")
    if left_out:
        kept["message"] = "; ".join(filter(None, [kept.get("message"), *left_out]))
    return kept


def duration(seconds: float) -> str:
    """A time in words, rounded like an estimate: ``40 s``, ``3 min``, ``2 h``, ``4 days``."""
    for unit, size, least in (("days", 86400, 2 * 86400), ("h", 3600, 5400), ("min", 60, 120)):
        if seconds >= least:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s" if seconds >= 1 else f"{seconds:.1g} s"


def shortened(text: str, most: int) -> str:
    """A text of at most this many characters: of a longer one the beginning and the end."""
    if len(text) <= most:
        return text
    end = (most - 1) // 3
    return f"{text[: most - 1 - end]}…{text[len(text) - end :]}"
