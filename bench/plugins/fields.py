"""The help of a dataclass's fields, from the comments in its source."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import io
import re
import tokenize


@functools.cache
def field_help(cls: type) -> dict[str, str]:
    """The comment behind, or on the line above, each field of a dataclass: the help of its parameters."""
    helps: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        try:
            source = inspect.cleandoc("\n" + inspect.getsource(base)) if dataclasses.is_dataclass(base) else ""
        except (OSError, TypeError):
            continue
        helps.update(_comments_of_fields(source))
    return {f.name: helps.get(f.name, "") for f in dataclasses.fields(cls)}


def _comments_of_fields(source: str) -> dict[str, str]:
    helps: dict[str, str] = {}
    above, current = "", None
    depth_of_def = False
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        line = token.line.strip()
        if token.type == tokenize.NAME and token.string == "def":
            depth_of_def = True  # fields precede the functions
        if depth_of_def:
            break
        match = re.match(r"([a-z]\w*)\s*:\s*\S", line, re.IGNORECASE)
        if token.type == tokenize.COMMENT:
            text = token.string.lstrip("#: ").strip()
            if line.startswith("#"):
                above = f"{above} {text}".strip()
            elif match:
                helps[match.group(1)] = text
        elif token.type == tokenize.NAME and match and match.group(1) == token.string != current:
            current = token.string
            helps.setdefault(current, above)
            above = ""
    return helps
