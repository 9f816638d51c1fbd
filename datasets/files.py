"""The user's own meshes."""

from __future__ import annotations

import glob
import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from bench import BadInput, Shape, ShapePair, UsageError, register
from bench.geometry.io.suffixes import MESH_SUFFIXES as SUFFIXES

from .common.own_files import TEXTS, UNREADABLE, expanded, find, safe_ids, sha256

if TYPE_CHECKING:
    from trimesh import Trimesh

EXPECTED = f"expected a mesh file, a folder of them, or a pattern such as 'scans/*.ply' ({' '.join(SUFFIXES)})"
# Parameters that were added later: cells that do not use them keep their id (docs/write-a-plugin.md).
LATER = {"since": "0.2"}
CLOUDS = (
    "A point cloud has no reference to be scored against: give it as a scan of dataset=paired with its reference "
    "(dataset.input=SCANS dataset.reference=TRUTHS), or apply a method to it: detailbench apply method=NAME IN OUT"
)


@register("dataset", requires=("trimesh",), own=True)
@dataclass(frozen=True)
class Files:
    """Your meshes: a file, a folder or a glob pattern of PLY, OBJ, STL and OFF.

    A folder means the mesh files in it, not those in its sub-folders; use ``folder/**/*.ply`` for these. Shapes are
    sorted by path, and named after their files. Each file is read when its case runs, so a damaged file fails only its
    own case.

    All files are test data unless you choose some for training: ``train_path`` names other files, and ``train_share``
    takes a share of ``path``, chosen by the files' contents, so that it depends neither on names nor on the other
    files, and copies of a file stay together. A file whose content is in both splits is refused.

    For tasks over pairs (``deform``) each mesh is a source. Its target is the mesh of the same name in ``target_path``
    (a single file there is the target of all); without that, the next mesh, and the first one after the last.
    """

    path: str = ""  # a mesh file, a folder or a glob pattern; several with ':' between them (';' on Windows)
    train_path: str = field(default="", metadata=LATER)  # the same for the train split; path is then for the test split
    train_share: float = field(default=0.0, metadata=LATER)  # of path, for the train split: 0 to 1, by content

    target_path: str = field(default="", metadata=LATER)  # of tasks over pairs: the targets, named as their sources
    corresponding: bool = field(default=False, metadata=LATER)  # whether both meshes of a pair have the same faces

    def __post_init__(self) -> None:
        if not 0 <= self.train_share <= 1:
            raise ValueError(f"train_share: expected 0 to 1, got {self.train_share}")
        if self.train_path and self.train_share:
            raise ValueError("train_path and train_share: give one of them, either other files or a share of path")

    def shapes(self, split: str) -> Iterator[Shape]:
        """The meshes of a split.

        Raises
        ------
        UsageError
            Where the split has none, or where a mesh is in both splits.
        """
        self.check(split)
        for id, found in self._named().items():
            if found.split == split:
                yield Shape(id, _reader(found.file), info={"file": found.file.name})

    def pairs(self, split: str) -> Iterator[ShapePair]:
        """Each mesh of a split with its target.

        Raises
        ------
        UsageError
            As for :meth:`shapes`; where a source has no target, and where there is only one mesh.
        """
        sources = list(self.shapes(split))
        for source, target in zip(sources, self._targets(sources, split), strict=True):
            if self.corresponding:
                target = Shape(target.id, _same_faces(source, target), info=target.info)
            yield ShapePair(f"{source.id}-to-{target.id}", source, target, corresponding=self.corresponding)

    def _targets(self, sources: list[Shape], split: str) -> list[Shape]:
        if not self.target_path:
            if len(sources) < 2:
                raise UsageError(
                    f"dataset files: a pair takes two meshes, but dataset.path={self.path} has one; name targets with "
                    "dataset.target_path=FILE or FOLDER"
                )
            return sources[1:] + sources[:1]
        if split != "test":
            raise UsageError(
                "dataset.target_path: pairs with targets of their own are test data; leave it out to pair the meshes "
                "of the train split with each other"
            )
        found = _by_id([_Found(f, split) for f in _files("target_path", self.target_path)])
        shapes = {id: Shape(id, _reader(one.file), info={"file": one.file.name}) for id, one in found.items()}
        if len(shapes) == 1:
            return [next(iter(shapes.values()))] * len(sources)
        if missing := [source.id for source in sources if source.id not in shapes]:
            raise UsageError(
                f"dataset.target_path={self.target_path} has no mesh named {missing[0]} (of {len(missing)} sources "
                "without a target); name each target as its source, or give one file for all"
            )
        return [shapes[source.id] for source in sources]

    def check(self, split: str = "test") -> None:
        """Raise :class:`bench.UsageError` unless the split has a mesh file, and shares none with the other split."""
        found = self._named().values()
        if self.train_path:
            _refuse_common(found)
        if any(f.split == split for f in found):
            return
        if self.train_share:
            raise UsageError(
                f"dataset.train_share={self.train_share:g} leaves none of the {len(found)} mesh files of "
                f"dataset.path={self.path} to the split {split}; choose another share"
            )
        raise UsageError(
            f"dataset files: split={split} has no meshes, since all of dataset.path={self.path} are test data. Name "
            "others with dataset.train_path=FOLDER, or give a share of them to the train split: dataset.train_share=0.5"
        )

    def count(self, split: str) -> int:
        """The number of meshes in a split."""
        return sum(found.split == split for found in self._named().values())

    def ignored(self) -> str:
        """The point clouds among the files of ``path``, which have no reference to be scored against."""
        from bench.geometry.io.files import CLOUD_READERS

        points = sorted(
            file.name
            for part in _parts("path", self.path)
            for file in _candidates(expanded(part))
            if file.suffix.lower() in set(CLOUD_READERS) - {*SUFFIXES, *TEXTS} and file.is_file()
        )
        shown = ", ".join(points[:3]) + (", ..." if len(points) > 3 else "")
        return f"{len(points)} files of points left out ({shown}); use dataset=paired for scans" if points else ""

    def state(self) -> dict[str, str]:
        """The SHA-256 of each file's content by the id of its shape, so that an edited file is a changed input."""
        state = {f"{id} ({found.file.name})": sha256(found.file) for id, found in self._named().items()}
        if self.target_path:
            state |= {f"target {file.name}": sha256(file) for file in _files("target_path", self.target_path)}
        return state

    def _named(self) -> dict[str, _Found]:
        """The files of both splits by their ids."""
        share = self.train_share
        found = [_Found(f, "train" if share and _share(f) < share else "test") for f in _files("path", self.path)]
        if self.train_path:
            found += [_Found(f, "train") for f in _files("train_path", self.train_path)]
        return _by_id(found)


class _Found(NamedTuple):
    """A mesh file and the split that it belongs to."""

    file: Path
    split: str


def _by_id(found: list[_Found]) -> dict[str, _Found]:
    """The files by ids that are unique (also if case is ignored) and safe as file names."""
    return dict(zip(safe_ids(one.file.stem for one in found), found, strict=True))


def _refuse_common(found: Iterable[_Found]) -> None:
    """Raise :class:`UsageError` with both names for two files of equal content in different splits."""
    files: dict[str, dict[str, Path]] = {"test": {}, "train": {}}
    for one in found:
        files[one.split].setdefault(sha256(one.file), one.file)
    for content in files["test"].keys() & files["train"].keys():
        if not content.startswith(UNREADABLE):
            raise UsageError(
                f"{files['test'][content]} (dataset.path) and {files['train'][content]} (dataset.train_path) have the "
                "same content; a mesh must not be in both splits: remove it from one of them"
            )


def _parts(key: str, path: str) -> list[str]:
    """The files, folders and patterns of a parameter."""
    parts = [part for part in path.split(os.pathsep) if part.strip()]
    if not parts:
        raise UsageError(f"dataset.{key} is empty; {EXPECTED}")
    # A file whose name contains the separator is one file, not several.
    return [path] if expanded(path).exists() else parts


def _files(key: str, path: str) -> list[Path]:
    """The mesh files that a parameter names, sorted."""
    return sorted({file for part in _parts(key, path) for file in _matches(key, part)})


def _candidates(path: Path) -> list[Path]:
    """All files that a file, a folder or a pattern names, of any kind."""
    return [path, *(path.iterdir() if path.is_dir() else map(Path, glob.iglob(str(path), recursive=True)))]


def _matches(key: str, part: str) -> list[Path]:
    path = expanded(part)
    try:
        return find(f"dataset.{key}={part}", path, SUFFIXES, EXPECTED)
    except UsageError as error:
        from bench.geometry.io.files import CLOUD_READERS

        if any(file.suffix.lower() in CLOUD_READERS and file.is_file() for file in _candidates(path)):
            raise UsageError(f"{error}. {CLOUDS}") from None
        raise


def _reader(file: Path) -> Callable[[], Trimesh]:
    def read() -> Trimesh:
        from bench.geometry.io.files import NoFaces, load_mesh

        try:
            return load_mesh(file)
        except NoFaces as error:
            raise BadInput(f"{error}. {CLOUDS}") from None

    return read


def _same_faces(source: Shape, target: Shape) -> Callable[[], Trimesh]:
    def read() -> Trimesh:
        import numpy as np

        theirs, mesh = source.mesh.faces, target.mesh
        if not np.array_equal(theirs, mesh.faces):
            raise BadInput(
                f"dataset.corresponding=true, but {source.info['file']} ({len(theirs):,} faces) and "
                f"{target.info['file']} ({len(mesh.faces):,} faces) do not have the same faces in the same order; "
                "expected the same faces, or dataset.corresponding=false"
            )
        return mesh

    return read


def _share(file: Path) -> float:
    """A number from 0 to 1 that depends only on a file's content; 1 for a file that cannot be read."""
    content = sha256(file)
    return 1.0 if content.startswith(UNREADABLE) else int(content[:13], 16) / 16**13
