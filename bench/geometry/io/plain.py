"""Text files as plain bytes, and the numbers in them, without a step of Python for each line."""

from __future__ import annotations

import codecs
import re
import warnings
from typing import NamedTuple

import numpy as np

# The mark of UTF-32 begins with that of UTF-16: it is asked first.
MARKS = (
    (codecs.BOM_UTF8, ""),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
BLANKS = bytes.maketrans(b"\t\v\f", b"   ")


def decoded(data: bytes) -> bytes:
    """The content of a text file as UTF-8 without a byte order mark; UTF-16 is also known without one.

    Any other content comes back as it is.
    """
    for mark, encoding in MARKS:
        if data.startswith(mark):
            return data.decode(encoding, errors="replace").encode() if encoding else data[len(mark) :]
    head = np.frombuffer(data[: min(len(data), 256) // 2 * 2], dtype=np.uint8).reshape(-1, 2)
    for encoding, high in (("utf-16-le", 1), ("utf-16-be", 0)):
        low = head[:, 1 - high]
        if len(head) > 1 and not head[:, high].any() and ((low >= 32) | ((low >= 9) & (low <= 13))).all():
            return data.decode(encoding, errors="replace").encode()
    return data


def plain_text(data: bytes) -> bytes:
    """The content of a text file as UTF-8, in which every line ends with a newline and every blank is a space."""
    text = decoded(data)
    if b"\r" in text:
        text = text.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    text = text.translate(BLANKS)
    return text if text.endswith(b"\n") else text + b"\n"


def without_comments(text: bytes) -> bytes:
    """A text without what follows a ``#`` in its lines; the lines stay."""
    return re.sub(rb"#[^\n]*", b"", text) if b"#" in text else text


def numbers(text: bytes, kind: type = np.float64) -> np.ndarray:
    """The numbers of a text (n,), separated by blanks and ends of lines; each is the double nearest to its digits.

    Raises
    ------
    ValueError
        If a word is not a number of this kind: that of Python, but for underscores. Whole numbers without an end become
        the largest.
    """
    if not re.search(rb"\S", text):
        return np.empty(0, dtype=kind)  # for which numpy gives one number
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # what older versions of numpy raise
        try:
            return np.fromstring(text, dtype=kind, sep=" ")
        except (ValueError, DeprecationWarning):
            raise ValueError("holds a word that is not a number") from None


class Words(NamedTuple):
    """Where the words of a text begin, and in what line: (n,) int arrays, and the words of each line (lines,)."""

    starts: np.ndarray
    per_line: np.ndarray


def words_of(text: bytes) -> Words:
    """The words of a :func:`plain_text`."""
    content = np.frombuffer(text, dtype=np.uint8)
    begins = content > ord(" ")
    begins[1:] &= content[:-1] <= ord(" ")
    starts = np.flatnonzero(begins)
    ends = np.flatnonzero(content == ord("\n"))
    return Words(starts, np.diff(np.searchsorted(starts, ends), prepend=0))


def first_word_that_is_no_number(text: bytes) -> str:
    """For messages, of a text in which there is one."""
    for word in text.split():
        try:
            numbers(word)
        except ValueError:
            return word.decode("utf-8", errors="replace")
    return ""
