"""Pairs files of two patterns by the text that each ``*`` matches.

``scans/*_noisy.ply`` and ``truth/*.obj`` match ``a_noisy.ply`` with ``a.obj``. For a folder or a single file, the
file's name without its suffix is used. Leading zeros of numbers do not count: ``stl024_total.ply`` matches
``ObsMask24_10.mat``. If the patterns have several ``*``, the last ones count, as many as both have; ``**`` counts
if there is no ``*``.
"""

from __future__ import annotations

import csv
import glob
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from bench import UsageError

from .own_files import expanded

TITLES = ("input", "scan", "noisy")  # of the first column of a table
Key = tuple[str, ...]  # the texts that the stars of a pattern match


def keys_of(pattern: Path, files: Iterable[Path]) -> dict[Path, Key]:
    """The texts that the stars of a pattern match in each of its files; the stem of a file if it has no star."""
    text = str(pattern)
    if not (glob.has_magic(text) and "*" in text) or pattern.exists():
        return {file: (_plain(stem(file)),) for file in files}
    parts = _parts(text)
    expression = re.compile(_expression(parts, "*" if "*" in parts else "**"), re.DOTALL)
    keys = {}
    for file in files:
        found = expression.fullmatch(str(file))
        keys[file] = tuple(_plain(group or "") for group in found.groups()) if found else (_plain(stem(file)),)
    return keys


def stem(file: Path) -> str:
    """A file's name without its suffixes: ``a`` for ``a.ply`` and for ``a.xyz.npy``, ``a.b`` for ``a.b.ply``."""
    name = file.stem
    return name.removesuffix(".xyz") if file.suffix.lower() in (".npy", ".npz", ".gz") else name


def partners(inputs: Mapping[Path, Key], others: Mapping[Path, Key], what: str) -> dict[Path, Path]:
    """The one file of ``others`` that belongs to each of ``inputs``, by their keys. Inputs without one are left out.

    Raises
    ------
    UsageError
        Where two of ``others`` belong to an input.
    """
    found: dict[Path, Path] = {}
    depth = max((min(len(a), len(b)) for a in inputs.values() for b in list(others.values())[:1]), default=1)
    known: dict[Key, list[Path]] = {}
    for file, key in others.items():
        known.setdefault(key[-depth:], []).append(file)
    for file, key in inputs.items():
        fitting = known.get(key[-depth:], [])
        if len(fitting) > 1:
            raise UsageError(
                f"{file}: two files match it as its {what}, {fitting[0]} and {fitting[1]}; make the pattern of "
                f"dataset.{what} narrower"
            )
        if fitting:
            found[file] = fitting[0]
    return found


def pairs_of_table(file: Path, folder: Path) -> list[tuple[Path, Path, str]]:
    """The scan, the reference and the split of each line of a table.

    Columns are separated by a tab, a semicolon or a comma, whichever of them comes first in this order in the file; a
    line of titles and lines that begin with ``#`` are left out. The split is ``test`` where there is no third column.

    Parameters
    ----------
    file : Path
    folder : Path
        The folder that the names in the table are relative to.

    Raises
    ------
    UsageError
        Naming the line, and what was expected.
    """
    expected = "expected one pair on each line: scan,reference or scan,reference,split (test or train)"
    try:
        text = file.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or "it is not text"
        raise UsageError(f"dataset.table={file}: cannot be read ({why}); {expected}") from error
    separator = next((letter for letter in "\t;," if letter in text), ",")
    pairs = []
    for number, row in enumerate(csv.reader(text.splitlines(), delimiter=separator), 1):
        cells = [cell.strip() for cell in row]
        if not any(cells) or cells[0].startswith("#") or (number == 1 and cells[0].lower() in TITLES):
            continue
        split = cells[2] if len(cells) > 2 and cells[2] else "test"
        if len(cells) not in (2, 3) or split not in ("test", "train"):
            raise UsageError(f"{file}: line {number} is {separator.join(row)!r}; {expected}")
        scan, reference = (folder / expanded(name) for name in cells[:2])
        for path in (scan, reference):
            if not path.is_file():
                raise UsageError(f"{file}: line {number} names {path}, but there is no such file")
        pairs.append((scan, reference, split))
    if not pairs:
        raise UsageError(f"{file}: has no pairs; {expected}")
    return pairs


def _plain(text: str) -> str:
    return str(int(text)) if text.isdecimal() else text


def _parts(pattern: str) -> list[str]:
    """A pattern in parts: ``*``, ``**``, ``**/``, ``?``, ``[...]`` and plain text."""
    return re.findall(r"\*\*/?|\*|\?|\[!?\]?[^\]]*\]|[^*?\[]+|\[", pattern)


def _expression(parts: Iterable[str], counts: str) -> str:
    """A regular expression for the parts of a pattern, with a group for each part equal to ``counts``."""
    out = []
    for part in parts:
        if part.startswith("*"):
            any_name = "[^/]*" if part == "*" else ".*"
            group = "(" if part.rstrip("/") == counts else "(?:"
            out.append(f"(?:{group}{any_name})/)?" if part.endswith("/") else f"{group}{any_name})")
        elif part == "?":
            out.append("[^/]")
        elif part.startswith("[") and len(part) > 1:
            inverse, letters = part[1] == "!", part[1:-1].removeprefix("!")
            out.append("[" + "^" * inverse + re.escape(letters).replace(r"\-", "-") + "]")
        else:
            out.append(re.escape(part))
    return "".join(out)
