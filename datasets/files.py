"""The user's own meshes."""

from __future__ import annotations

import functools
import glob
import hashlib
import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bench import Shape, UsageError, register

if TYPE_CHECKING:
    from trimesh import Trimesh

SUFFIXES = (".ply", ".obj", ".stl", ".off")
EXPECTED = f"expected a mesh file, a folder of them, or a pattern such as 'scans/*.ply' ({' '.join(SUFFIXES)})"


@register("dataset", requires=("trimesh",))
@dataclass(frozen=True)
class Files:
    """Your meshes: a file, a folder or a glob pattern of PLY, OBJ, STL and OFF.

    A folder means the mesh files in it, not those in its sub-folders; use ``folder/**/*.ply`` for these. Shapes are
    sorted by path, and named after their files. Each is read when its turn comes, so that a damaged file fails as its
    own case and the others go on. All files are test data: the ``train`` split is empty, and a learned method must
    bring weights that were trained elsewhere.
    """

    path: str = ""  # a mesh file, a folder or a glob pattern; several with ':' between them (';' on Windows)

    def shapes(self, split: str) -> Iterator[Shape]:
        """All files for ``test``, none for ``train``."""
        if split == "train":
            return
        for id, file in self._named().items():
            yield Shape(id, _reader(file), info={"file": file.name})

    def check(self) -> None:
        """Raise :class:`bench.UsageError` unless ``path`` leads to at least one mesh file."""
        self._files()

    def state(self) -> dict[str, str]:
        """The SHA-256 of each file's content by the id of its shape, so that an edited file is a changed input."""
        return {f"{id} ({file.name})": _sha256(file) for id, file in self._named().items()}

    def _named(self) -> dict[str, Path]:
        """The files by ids that are unique (also where upper and lower case are one) and safe as file names."""
        named: dict[str, Path] = {}
        taken: set[str] = set()
        for file in self._files():
            stem = re.sub(r"[^A-Za-z0-9._-]+", "_", file.stem).strip("._-")[:80] or "mesh"
            id, number = stem, 1
            while id.lower() in taken:
                number += 1
                id = f"{stem}-{number}"
            taken.add(id.lower())
            named[id] = file
        return named

    def _files(self) -> list[Path]:
        parts = [part for part in self.path.split(os.pathsep) if part.strip()]
        if not parts:
            raise UsageError(f"dataset.path is empty; {EXPECTED}")
        # A file whose name holds the separator is meant as it stands.
        if Path(self.path).expanduser().exists():
            parts = [self.path]
        return sorted({file for part in parts for file in _matches(part)})


def _matches(part: str) -> list[Path]:
    path = Path(part).expanduser()
    if path.is_file():
        if path.suffix.lower() not in SUFFIXES:
            raise UsageError(f"dataset.path={part}: unknown suffix {path.suffix!r}; {EXPECTED}")
        return [path]
    if path.is_dir():
        try:
            found, where = list(path.iterdir()), "the folder"
        except OSError as error:
            raise UsageError(f"dataset.path={part}: the folder cannot be read ({error.strerror})") from error
    else:
        found, where = [Path(name) for name in glob.glob(str(path), recursive=True)], "the pattern"
        if not found:
            raise UsageError(f"dataset.path={part}: no such file or folder, and no file matches; {EXPECTED}")
    files = [file for file in found if file.suffix.lower() in SUFFIXES and file.is_file()]
    if not files:
        raise UsageError(f"dataset.path={part}: {where} holds no mesh file ({len(found)} others); {EXPECTED}")
    return files


def _reader(file: Path) -> Callable[[], Trimesh]:
    def read() -> Trimesh:
        from bench.geometry.files import load_mesh

        return load_mesh(file)

    return read


def _sha256(file: Path) -> str:
    try:
        stat = file.stat()
        return _sha256_of(file, stat.st_mtime_ns, stat.st_size)
    except OSError as error:
        return f"unreadable ({error.strerror})"  # its case says so; the others go on


@functools.lru_cache(maxsize=100_000)  # every cell of a sweep asks; gigabytes of scans are read once
def _sha256_of(file: Path, mtime_ns: int, size: int) -> str:
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
