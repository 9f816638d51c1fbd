"""Names of files among overrides: Hydra's grammar takes some letters of them for its own, unless they are quoted."""

from __future__ import annotations

import glob
import os
from collections.abc import Sequence
from typing import Any


def quoted_files(overrides: Sequence[str]) -> list[str]:
    """The overrides, with quotes about each name of a file that Hydra would not read as it stands.

    ``dataset.path=scan (2)`` becomes ``dataset.path='scan (2)'`` where a file, a folder, or files of this pattern are
    there: nothing else can be meant. Other values are left alone.
    """
    return [quoted(word) if _names_files(word) and not _is_plain(word) else word for word in overrides]


def quoted(word: str) -> str:
    """``key='value'`` for ``key=value``."""
    from hydra.core.override_parser.types import Quote, QuotedString

    key, _, value = word.partition("=")
    return f"{key}={QuotedString(value, Quote.single).with_quotes()}"


def hint(word: str) -> str:
    """What to do where a value may be a name that needs quotes: ``quote it: "dataset.path='scan (2)'"``."""
    return f'if the value is a name, quote it, for the shell too: "{quoted(word)}"'


def _names_files(word: str) -> bool:
    key, equals, value = word.partition("=")
    if not (equals and value) or "." not in key or "\0" in value:  # parameters of plugins alone name files
        return False
    path = os.path.expanduser(value)
    return os.path.exists(path) or any(True for _ in glob.iglob(path, recursive=True))


def _is_plain(word: str) -> bool:
    """Whether Hydra reads the value as the text that it is."""
    return _read(word) == word.partition("=")[2]


def _read(word: str) -> Any:
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.core.override_parser.types import QuotedString
    from hydra.errors import OverrideParseException

    try:
        (override,) = OverridesParser.create().parse_overrides([word])
    except (OverrideParseException, RecursionError):
        return None
    value = override.value()
    return None if override.is_sweep_override() or isinstance(value, QuotedString) else value
