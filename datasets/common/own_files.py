"""The user's own files: found by name, folder or pattern, with safe ids, and compared by content."""

from __future__ import annotations

import functools
import glob
import hashlib
import os
import re
from collections.abc import Iterable
from pathlib import Path

from bench import UsageError
from bench.geometry.io.scenes import companions

UNREADABLE = "unreadable"
TEXTS = (".txt", ".csv")  # may hold points, but are mostly notes and lists


def safe_ids(stems: Iterable[str]) -> list[str]:
    """The stems as ids that are unique (also if case is ignored) and safe as file names."""
    ids: list[str] = []
    taken: set[str] = set()
    for name in stems:
        stem = re.sub(r"[^A-Za-z0-9._-]+", "_", name).strip("._-")[:80] or "mesh"
        id, number = stem, 1
        while id.lower() in taken:
            number += 1
            id = f"{stem}-{number}"
        taken.add(id.lower())
        ids.append(id)
    return ids


def find(given: str, path: Path, suffixes: tuple[str, ...], expected: str, what: str = "mesh file") -> list[Path]:
    """The files of one name, folder or pattern, in any order.

    Parameters
    ----------
    given : str
        As the user gave it, with its parameter, for messages: ``dataset.path=scans``.
    path : Path
        The name, folder or pattern.
    suffixes : tuple of str
        Of the wanted files, in lower case.
    expected, what : str
        For messages.

    Raises
    ------
    UsageError
        Where there is none.
    """
    if path.is_file():
        if path.suffix.lower() not in suffixes:
            raise UsageError(f"{given}: unknown suffix {path.suffix!r}; {expected}")
        return [path]
    if path.is_dir():
        try:
            # Hidden files are not data: macOS leaves ._a.ply beside a.ply.
            found, where = [file for file in path.iterdir() if not file.name.startswith(".")], "the folder"
        except OSError as error:
            raise UsageError(f"{given}: the folder cannot be read ({error.strerror})") from error
    else:
        found, where = [Path(name) for name in glob.glob(str(path), recursive=True)], "the pattern"
        if not found:
            raise UsageError(f"{given}: no such file or folder, and no file matches; {expected}")
    files = [file for file in found if file.suffix.lower() in suffixes and file.is_file()]
    if not files:
        raise UsageError(f"{given}: {where} holds no {what} ({len(found)} others); {expected}")
    return files


def sha256(file: Path) -> str:
    """The SHA-256 of a file's content; a text that begins with :data:`UNREADABLE` if it cannot be read.

    The arrays of a ``.gltf`` lie in files beside it; its SHA-256 is that of the digests of all these files.
    """
    try:
        digests = [_sha256_now(part) for part in (file, *(companions(file) if file.suffix.lower() == ".gltf" else ()))]
        return digests[0] if len(digests) == 1 else hashlib.sha256(" ".join(digests).encode()).hexdigest()
    except OSError as error:
        return f"{UNREADABLE} ({error.strerror})"  # its case reports it; the others run


def _sha256_now(file: Path) -> str:
    stat = file.stat()
    return _sha256_of(file, stat.st_mtime_ns, stat.st_size)


def expanded(path: str) -> Path:
    """A path with ``~`` replaced by the user's home folder."""
    return Path(os.path.expanduser(path))


@functools.lru_cache(maxsize=100_000)  # every cell of a sweep asks; gigabytes of scans are read once
def _sha256_of(file: Path, mtime_ns: int, size: int) -> str:
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
