"""How wide a text is in LaTeX's usual font, so that tables can be made to fit without compiling them.

The widths are those of Computer Modern at ``\\footnotesize`` (8.5 pt), read from the font by ``\\fontcharwd``. Times
and the other fonts of journals are narrower.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable

BOLD = 1.16  # of digits
_WIDTHS = {
    2.4: " !',.:;<[]`il",
    2.6: "fj",
    2.9: "-",
    3.1: "I",
    3.4: "()rts_",
    3.9: "cez",
    4.3: '"$*/0123456789\\^ago{}~',
    4.5: "Jkqvxy",
    4.8: "Sbdhnpu",
    5.4: "LZF",
    6.1: "BCTwEP>?",
    6.6: "ADGHKNOQRUVXY&+=@",
    7.1: "#%m",
    7.9: "M",
    8.7: "W|",
}
_OF = {letter: width for width, letters in _WIDTHS.items() for letter in letters}
_OTHER = 8.5  # arrows and characters missing in the font
_SMALL = 0.72  # superscripts
_SAFE = 1.02  # for kerns and rounding


@functools.lru_cache(maxsize=10_000)
def width_of(latex: str) -> float:
    """The width in points of a piece of LaTeX that :mod:`latex` writes: a text, a number, a sign.

    Example
    -------
    >>> width_of("12")
    8.77
    """
    latex = re.sub(r"\\cite\{[^{}]*\}", "[12]", latex)
    bold = BOLD if "textbf" in latex else 1.0
    text, signs = re.subn(r"\^(\{[^{}]*\}|\\\w+)", "", latex)
    text = re.sub(r"\\(textbf|underline|scriptsize)\b ?", "", text)
    text, arrows = re.subn(r"\\(downarrow|uparrow|rightarrow|approx|cdot|pm|times|S)\b", "", text)
    text = re.sub(r"\\text\w+", "W", text)
    escaped = re.findall(r"\\([#$%&_{}])", text)
    printed = [*escaped, *re.sub(r"\\[#$%&_{}]|[${}\\]", "", text)]
    plain = sum(_OF.get(letter, _OTHER) for letter in printed)
    power = sum(_OF[letter] for letter in "-3") * _SMALL
    return round(_SAFE * (bold * plain + signs * power + arrows * _OTHER), 2)


def widest(texts: Iterable[str]) -> float:
    """The width of the widest of some texts."""
    return max(map(width_of, texts), default=0.0)
