"""Which plugins a module registers, read from its text: importing all of them takes longer than a small run."""

from __future__ import annotations

import re
from pathlib import Path

# A class below one decorator of ours at the beginning of a line, with plain values, and perhaps other decorators.
_REGISTERED = re.compile(
    r'^@register\(\s*"(?P<kind>\w+)"(?P<rest>[^()]*(?:\([^()]*\)[^()]*)*)\)[^\S\n]*\n(?:@.*\n)*class (?P<cls>\w+)',
    re.MULTILINE,
)
_SECOND = re.compile(r'\s*,\s*"(\w+)"')
_NAMED = re.compile(r'\bname\s*=\s*(?:"(\w+)")?')


def snake_case(name: str) -> str:
    """``BallPivoting`` -> ``ball_pivoting``.

    >>> snake_case("ChamferL2Sum"), snake_case("APSS")
    ('chamfer_l2_sum', 'apss')
    """
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower()


def registers(file: Path) -> bool:
    """Whether the text of a module mentions ``register(``; true of an unreadable file: its import reports why."""
    try:
        return b"register(" in file.read_bytes()
    except OSError:
        return True


def declared(file: Path) -> list[tuple[str, str]] | None:
    """The kind and name of each plugin that a module registers.

    None if the text is not enough: a computed name, or a call of ``register`` that decorates nothing.
    """
    try:
        text = file.read_text(encoding="utf-8")
    except (OSError, ValueError):
        return None
    found = []
    for match in _REGISTERED.finditer(text):
        second, named = _SECOND.match(match["rest"]), _NAMED.search(match["rest"])
        if named and not named[1]:
            return None
        name = (named and named[1]) or (second and second[1]) or snake_case(match["cls"])
        found.append((match["kind"], name))
    return found if len(found) == text.count("register(") else None
