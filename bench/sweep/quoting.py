"""File names in overrides: some of their characters have a meaning in Hydra's grammar, unless they are quoted."""

from __future__ import annotations

import glob
import os
from collections.abc import Sequence
from typing import Any

COMMANDS = ("method.command", "method.version_command")  # texts with braces: places for files


def quoted_files(overrides: Sequence[str]) -> list[str]:
    """The overrides, with quotes around each file name that Hydra would not read literally.

    ``dataset.path=scan (2)`` becomes ``dataset.path='scan (2)'`` if a file, a folder, or files of this pattern
    exist: nothing else can be meant. So does a command, ``method.command=prog {input} {output}``, whose braces Hydra
    cannot read. Other values are unchanged.
    """
    return [quoted(word) if _is_unread_name(word) or _is_unread_command(word) else word for word in overrides]


def quoted(word: str) -> str:
    """``key='value'`` for ``key=value``."""
    from hydra.core.override_parser.types import Quote, QuotedString

    key, _, value = word.partition("=")
    return f"{key}={QuotedString(value, Quote.single).with_quotes()}"


def is_override(word: str) -> bool:
    """Whether an argument of a command line is a key and its value, not the name of a file."""
    key, equals, _ = word.partition("=")
    return bool(equals) and key.lstrip("+").replace(".", "_").replace("@", "_").replace("/", "_").isidentifier()


def hint(word: str) -> str:
    """Advice if a value may be a name that needs quotes: ``quote it: "dataset.path='scan (2)'"``."""
    return f'if the value is a name, quote it, for the shell too: "{quoted(word)}"'


def _names_files(word: str) -> bool:
    key, equals, value = word.partition("=")
    if not (equals and value) or "." not in key or "\0" in value:  # only parameters of plugins name files
        return False
    path = os.path.expanduser(value)
    return os.path.exists(path) or any(True for _ in glob.iglob(path, recursive=True))


def _is_unread_name(word: str) -> bool:
    return _names_files(word) and not _is_plain(word)


def _is_unread_command(word: str) -> bool:
    """Whether an override is the command of a method and is invalid to Hydra without quotes."""
    return word.partition("=")[0] in COMMANDS and not _can_be_read(word)


def _is_plain(word: str) -> bool:
    """Whether Hydra reads the value literally."""
    return _read(word) == word.partition("=")[2]


def _can_be_read(word: str) -> bool:
    return _parsed(word) is not None


def _parsed(word: str) -> Any:
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import OverrideParseException

    try:
        return OverridesParser.create().parse_overrides([word])[0]
    except (OverrideParseException, RecursionError):
        return None


def _read(word: str) -> Any:
    from hydra.core.override_parser.types import QuotedString

    if (override := _parsed(word)) is None:
        return None
    value = override.value()
    return None if override.is_sweep_override() or isinstance(value, QuotedString) else value
