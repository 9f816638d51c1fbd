"""Text that a terminal would obey is shown; all other text stays as it is."""

from __future__ import annotations

import io
import sys
import unicodedata

from bench.text import Shown, below, one_line, shown, shown_streams

EVERYTHING = "".join(map(chr, [*range(0xD800), *range(0xE000, 0x11000)]))
BIDI = {"LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI"}


def is_obeyed(letter: str) -> bool:
    return unicodedata.category(letter) in ("Cc", "Zl", "Zp") or unicodedata.bidirectional(letter) in BIDI


def test_no_letter_is_left_that_a_terminal_obeys():
    assert [letter for letter in one_line(EVERYTHING) if is_obeyed(letter)] == []
    assert {letter for letter in shown(EVERYTHING) if is_obeyed(letter)} == {"\n", "\t"}


def test_what_is_shown_can_be_read_back():
    marks = {"\u061c", "\u200e", "\u200f"}  # of a direction, too
    for letter in EVERYTHING:
        if is_obeyed(letter) or letter in marks:
            assert one_line(letter).encode().decode("unicode_escape") == letter
        else:
            assert one_line(letter) == letter


def test_a_stream_shows_all_that_is_written_to_it(monkeypatch):
    out, err = io.StringIO(), io.StringIO()
    monkeypatch.setattr(sys, "stdout", out)
    monkeypatch.setattr(sys, "stderr", err)
    with shown_streams(), shown_streams():
        print("\x1b[31m", "a\r", sep="\n")
        sys.stderr.writelines(["\x9b\n", "\x07"])
        below(sys.stdout).write("\x1b[1m")
        assert isinstance(sys.stdout, Shown) and not sys.stdout.isatty()
    assert out.getvalue() == "\\x1b[31m\na\\r\n\x1b[1m" and err.getvalue() == "\\x9b\n\\x07"
    assert (sys.stdout, sys.stderr) == (out, err)
