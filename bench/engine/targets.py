"""The input files of ``detailbench apply``, and the output file of each."""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ..errors import UsageError
from ..geometry.io.files import CLOUD_READERS, check_suffix
from ..text import shortened

MOST_NAMES = 200  # characters of a list of names in a message


class Target(NamedTuple):
    """The inputs of one call, and the file that its output is written to."""

    inputs: tuple[str, ...]
    output: str


def names_a_folder(output: str) -> bool:
    """Whether the last argument of a command stands for many files: a folder, a path ending in ``/``, or ``OUT/*.obj``.

    There a ``*`` is the name of the input without its suffix.
    """
    return output.endswith("/") or "*" in os.path.basename(output) or os.path.isdir(output)


def targets_of(inputs: Sequence[str], output: str, task: Any) -> list[Target]:
    """The calls that the arguments of a command ask for.

    Parameters
    ----------
    inputs : files, patterns (``'SCANS/*.ply'``) and folders
    output : a file, or a name for which :func:`names_a_folder` is true
    task : Task
        Of the kind of its output is the suffix of the files; one that takes images takes folders as they are.

    Raises
    ------
    UsageError
        If files do not exist, two would have the same output, or an output is an input.
    """
    found = [path for word in inputs for path in _files(word, is_folder_an_input=task.takes == "views")]
    counts = getattr(task, "files", (1,))
    if not names_a_folder(output):
        if counts == (1,) and len(found) > 1:
            raise UsageError(
                f"expected one input file for {output}, got {len(found)}: {_listed(found)}. For many, give a folder as "
                "OUTPUT, for instance OUT/"
            )
        targets = [Target(tuple(found), output)]
    else:
        if 1 not in counts:
            raise UsageError(
                f"{output}: this task takes {' or '.join(map(str, counts))} files for one output; give the name of one "
                "output file"
            )
        pattern = _pattern(output, task.output)
        targets = [Target((path,), pattern.replace("*", Path(path).stem)) for path in found]
        _refuse_collisions(targets)
    for target in targets:
        check_suffix(target.output, task.output)
        if same := [path for path in target.inputs if _is_same(path, target.output)]:
            raise UsageError(f"{same[0]}: is an input and would be overwritten; choose another OUTPUT")
    return targets


def _files(word: str, is_folder_an_input: bool) -> list[str]:
    """The files that one argument stands for, sorted by name, with numbers in numeric order."""
    if os.path.isdir(word) and not is_folder_an_input:
        names = [e.path for e in os.scandir(word) if e.is_file() and not e.name.startswith(".")]
        found = [path for path in names if Path(path).suffix.lower() in CLOUD_READERS]
        if not found:
            raise UsageError(f"{word}: holds no file that can be read; expected some of {' '.join(CLOUD_READERS)}")
        return sorted(found, key=_natural)
    if os.path.exists(word):
        return [word]
    if not glob.has_magic(word):
        raise UsageError(f"{word}: no such file")
    if found := glob.glob(word, recursive=True):
        return sorted(found, key=_natural)
    raise UsageError(f"{word}: no file matches this pattern")


def _natural(path: str) -> list[Any]:
    return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", path)]  # in turn: text, number, ...


def _pattern(output: str, kind: str) -> str:
    """``OUT/*.ply`` for the name of a folder."""
    name = os.path.basename(output)
    if "*" not in name or os.path.isdir(output):
        return os.path.join(output, "*.ply")
    if name.count("*") > 1 or glob.has_magic(name.replace("*", "")):
        raise UsageError(f"{output}: expected one * for the name of the input, as in OUT/*.obj")
    return output


def _refuse_collisions(targets: Iterable[Target]) -> None:
    """Refuse two inputs that would become one file."""
    first: dict[str, str] = {}
    for (path,), output in targets:
        if (other := first.setdefault(output, path)) is not path:
            raise UsageError(
                f"{other} and {path} would both become {output}; rename one, or apply to them with different folders"
            )


def _is_same(path: str, output: str) -> bool:
    return os.path.exists(output) and os.path.samefile(path, output)


def _listed(paths: Sequence[str]) -> str:
    return shortened(", ".join(paths), MOST_NAMES)
