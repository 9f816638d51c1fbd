"""The files that a plugin reads: results depend on their content, not on their names.

Found without a declaration: a parameter of type ``Path``, and a parameter of type ``str`` whose value
is the name of an existing file (or lists of these). A plugin declares the rest:

``reads(self)``
    Files that no parameter names, such as weights that come with the package.
``writes``
    A class attribute: the parameters that name files which the plugin writes. Without it, a parameter called ``save``.
"""

from __future__ import annotations

import functools
import hashlib
import os
import types
import typing
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import UsageError
from .schema import field_types

if TYPE_CHECKING:
    from ..plan.choice import Choice

WRITES = ("save",)


def contents(choices: Iterable[Choice]) -> dict[str, str]:
    """SHA-256 of every file that some plugins read, under a text that names it; empty where they read none.

    The text names a file as its parameter does, or relative to the source of its plugin: a checkout may be moved.

    Raises
    ------
    UsageError
        For a file that cannot be read.
    """
    return {label: _sha256(file, label) for choice in choices for label, file in files_of(choice)}


def files_of(choice: Choice) -> Iterator[tuple[str, Path]]:
    """The files that a plugin with its parameters reads, each with a text that names it."""
    made = choice.made
    for name, value, _ in [] if hasattr(made, "state") else _named(choice, made):  # state() declares it
        if (path := Path(os.path.expanduser(value))).is_file():
            yield f"{value} ({choice.kind}.{name})", path
    for path in getattr(made, "reads", tuple)():
        near = path.is_relative_to(choice.plugin.file.parent)
        shown = path.relative_to(choice.plugin.file.parent).as_posix() if near else path.name
        yield f"{shown} (read by {choice.kind} {choice.name})", path


def check_files(choice: Choice) -> None:
    """Raise :class:`UsageError` for a parameter of type ``Path`` that names no existing file or folder."""
    made = choice.made
    for name, value, is_path in _named(choice, made):
        if is_path and not Path(os.path.expanduser(value)).exists():
            raise UsageError(
                f"{choice.kind}.{name}={value}: no such file or folder (looked for from {Path.cwd()}). If the "
                f'plugin itself creates it, declare it in its class: writes = ("{name}",)'
            )


def written(plugin: Any) -> tuple[str, ...]:
    """The parameters of a plugin, its class or an object, that name files which it writes."""
    names = getattr(plugin, "writes", WRITES)
    return tuple(names) if isinstance(names, (tuple, list, set, frozenset)) else WRITES


def _named(choice: Choice, made: Any) -> Iterator[tuple[str, str, bool]]:
    """Parameter, value, and whether its type is a path, for each that may name a file that is read."""
    outputs = written(made)
    for name, hint in field_types(choice.plugin).items():
        kinds = set(_scalars(hint))
        if name in choice.parameters and name not in outputs and kinds & {str, Path}:
            for text in _texts(choice.parameters[name]):
                yield name, text, Path in kinds and str not in kinds


def _scalars(hint: Any) -> Iterator[Any]:
    """The types in ``list[Path] | None``; the values of a Literal are not types."""
    origin = typing.get_origin(hint)
    if origin in (list, tuple, dict, typing.Union, types.UnionType):
        for inner in typing.get_args(hint):
            yield from _scalars(inner)
    else:
        yield hint


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str) and value and "\0" not in value:
        yield value
    elif isinstance(value, (list, tuple, dict)):
        for inner in value.values() if isinstance(value, dict) else value:
            yield from _texts(inner)


def _sha256(file: Path, label: str) -> str:
    try:
        stat = os.stat(file)
        return _sha256_of(str(file.absolute()), stat.st_mtime_ns, stat.st_size)
    except OSError as error:
        raise UsageError(f"{label}: cannot be read ({error.strerror})") from error


@functools.lru_cache(maxsize=4096)  # every cell of a sweep asks
def _sha256_of(file: str, mtime_ns: int, size: int) -> str:
    with open(file, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
