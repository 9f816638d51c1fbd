"""Which file belongs to which: files of two patterns are matched by what the ``*`` of their patterns stand for.

``scans/*_noisy.ply`` and ``truth/*.obj`` match ``a_noisy.ply`` with ``a.obj``. Where a folder or a file is named, the
file's name without its suffix stands for it. Numbers match whatever zeros they begin with: ``stl024_total.ply`` and
``ObsMask24_10.mat``. Of patterns with several ``*`` the last ones count, as many as both have; ``**`` counts
where there is no ``*``.
"""

from __future__ import annotations

import glob
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from bench import UsageError

Key = tuple[str, ...]  # what the stars of a pattern stand for


def keys_of(pattern: Path, files: Iterable[Path]) -> dict[Path, Key]:
    """What the stars of a pattern stand for in each of its files; the stem of a file where the pattern has none."""
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
                f"{file}: two files belong to it as its {what}, {fitting[0]} and {fitting[1]}; make the pattern of "
                f"dataset.{what} narrower"
            )
        if fitting:
            found[file] = fitting[0]
    return found


def _plain(text: str) -> str:
    return str(int(text)) if text.isdecimal() else text


def _parts(pattern: str) -> list[str]:
    """A pattern in parts: ``*``, ``**``, ``**/``, ``?``, ``[...]`` and plain text."""
    return re.findall(r"\*\*/?|\*|\?|\[!?\]?[^\]]*\]|[^*?\[]+|\[", pattern)


def _expression(parts: Iterable[str], counts: str) -> str:
    """A regular expression of the parts of a pattern, with a group for each of those that count."""
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
