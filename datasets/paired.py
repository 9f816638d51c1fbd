"""The user's own scans, each with its reference."""

from __future__ import annotations

import glob
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bench import BadInput, PointCloud, Shape, UsageError, register

from .common.own_files import TEXTS, expanded, find, safe_ids, sha256
from .common.pairing import Key, keys_of, pairs_of_table, partners, stem

if TYPE_CHECKING:
    from trimesh import Trimesh

SHOWN = 3  # names in a message
EXPECTED = {
    "input": "expected a point cloud, a folder of them, or a pattern such as 'scans/*.ply'",
    "reference": "expected a mesh or a point cloud, a folder of them, or a pattern such as 'truth/*.ply'",
    "mask": "expected observation masks of DTU, or a pattern such as 'ObsMask/ObsMask*_10.mat'",
    "plane": "expected ground planes of DTU, or a pattern such as 'ObsMask/Plane*.mat'",
}


@register("dataset", requires=("trimesh",), own=True, scans=True)
@dataclass(frozen=True)
class Paired:
    """Your scans, each with its truth: a mesh, or a point cloud of a better scanner.

    ``input`` and ``reference`` are patterns, folders or files. A scan and a reference are paired by their names: by
    the text that each ``*`` of both patterns matches (``scans/*_noisy.xyz`` and ``truth/*.obj``), or by the names
    without suffixes where folders are given. If ``reference`` is one file, it is the reference of all scans. Both
    are in the same coordinates; the case is in the frame of the reference, and the scan is not normalised on its own.

    A method gets the scan as it is (``sensor=scan``, the default here). If the reference is a cloud, metrics that need
    a surface are left out, and the message of the row says so.

    If names do not match, list the pairs in ``table``. All pairs are test data unless ``test_names`` or ``train_names``
    lists the scans of a split: text files with one name without suffix on each line.
    """

    path: str = ""  # a folder that all others are relative to; the current one if empty
    input: str = ""  # the scans
    reference: str = ""  # their references
    test_names: str = ""  # a file that lists the scans of the test split; default: all that are not in train_names
    train_names: str = ""  # a file that lists the scans of the train split
    table: str = ""  # instead of these: a file with one pair a line, "scan,reference" or "scan,reference,split"
    units: str = ""  # of the coordinates, as text: mm
    licence: str = ""  # of the data, as text
    crop: list[float] = field(default_factory=list)  # x y z, x y z: corners of a box that both are cut to; [] cuts none
    mask: str = ""  # observation masks of DTU, named like the scans
    plane: str = ""  # ground planes of DTU

    def __post_init__(self) -> None:
        low, high = self.crop[:3], self.crop[3:]
        if self.crop and not (len(low) == len(high) == 3 and all(a < b for a, b in zip(low, high, strict=True))):
            raise ValueError(f"crop: expected six numbers, the lowest x y z and the highest x y z, got {self.crop}")

        others = ("input", "reference", "test_names", "train_names", "mask", "plane")
        if self.table and (given := [name for name in others if getattr(self, name)]):
            raise ValueError(f"table and {given[0]}: give one of them; the table has the scans, references and splits")

    def shapes(self, split: str) -> Iterator[Shape]:
        """The references of a split, each with its scan.

        Raises
        ------
        UsageError
            Where there is none, where a scan has no reference or two, or where a list names a missing scan.
        """
        self.check(split)
        for id, pair in self._named().items():
            if pair.split == split:
                info = {"file": pair.reference.name, "scan": pair.input.name}
                info |= {key: value for key in ("units", "licence") if (value := getattr(self, key))}
                yield Shape(id, self._reference(pair), info=info, scan=self._scan(pair), attributes=_attributes(pair))

    def check(self, split: str = "test") -> None:
        """Raise :class:`bench.UsageError` unless the split has at least one pair, and all its files exist."""
        pairs = self._named().values()
        if any(pair.split == split for pair in pairs):
            return
        raise UsageError(
            f"dataset paired: split={split} has none of the {len(pairs)} pairs. Without lists all are test data; list "
            f"the scans of this split in a text file, one name on each line: dataset.{split}_names=FILE"
        )

    def count(self, split: str) -> int:
        """The number of pairs in a split."""
        return sum(pair.split == split for pair in self._named().values())

    def state(self) -> dict[str, str]:
        """The SHA-256 of each file's content by the id of its shape, so that an edited file is a changed input."""
        return {
            f"{id} {part} ({file.name})": sha256(file)
            for id, pair in self._named().items()
            for part, file in pair.files.items()
        }

    # -- which files -----------------------------------------------------------------------------------------------

    def _named(self) -> dict[str, _Pair]:
        """The pairs of both splits by their ids."""
        if self.table:
            return self._of_table()
        inputs = self._found("input")
        splits = self._splits(inputs)
        inputs = {file: key for file, key in inputs.items() if file in splits}
        parts = [part for part in ("reference", "mask", "plane") if part == "reference" or getattr(self, part)]
        found = {part: self._partners(inputs, part) for part in parts}
        for part, files in found.items():
            if missing := [file for file in inputs if file not in files]:
                raise UsageError(
                    f"dataset.{part}={getattr(self, part)}: {len(missing)} of {len(inputs)} scans have no {part} "
                    f"({_shown(missing)}); give these files the names of their scans, or list "
                    f"the scans that have a {part}: dataset.test_names=FILE"
                )
        pairs = [_Pair(splits[file], file, **{part: files[file] for part, files in found.items()}) for file in inputs]
        ids = safe_ids("-".join(inputs[pair.input]) for pair in pairs)
        return dict(zip(ids, pairs, strict=True))

    def _of_table(self) -> dict[str, _Pair]:
        table = self._at(self.table)
        folder = expanded(self.path) if self.path else table.parent
        pairs = [_Pair(split, scan, truth) for scan, truth, split in pairs_of_table(table, folder)]
        return dict(zip(safe_ids(stem(pair.input) for pair in pairs), pairs, strict=True))

    def _partners(self, inputs: Mapping[Path, Key], part: str) -> dict[Path, Path]:
        """The file of a parameter that belongs to each scan; a single file belongs to all."""
        files = self._found(part)
        if self._at(getattr(self, part)).is_file():
            return dict.fromkeys(inputs, next(iter(files)))
        return partners(inputs, files, part)

    def _found(self, part: str) -> dict[Path, Key]:
        """The files of a parameter, sorted, with the keys that they are matched by."""
        pattern = getattr(self, part)
        if not pattern.strip():
            raise UsageError(f"dataset.{part} is empty; {EXPECTED[part]}")
        path = self._at(pattern)
        if not path.exists():  # a pattern; the name of its folder may look like a pattern, too
            path = Path(glob.escape(str(expanded(self.path)))) / pattern if self.path else path
        given = f"dataset.{part}={pattern}" + (f" (in dataset.path={self.path})" if self.path else "")
        expected = EXPECTED[part]
        if self.path and not expanded(self.path).is_dir():
            raise UsageError(f"dataset.path={self.path}: no such folder; expected one that holds {self._layout}")
        if self.path:
            expected += f"; the folder should hold {self._layout}"
        files = sorted(find(given, path, _suffixes(part), expected, "file that can be read"))
        if path.is_dir():  # notes and lists beside the data
            files = [file for file in files if file.suffix.lower() not in TEXTS] or files
        return keys_of(path, files)

    @property
    def _layout(self) -> str:
        parts = ("input", "reference", "test_names", "train_names", "mask", "plane")
        return ", ".join(getattr(self, part) for part in parts if getattr(self, part))

    def _at(self, name: str) -> Path:
        return expanded(self.path) / expanded(name) if self.path else expanded(name)

    def _splits(self, inputs: Mapping[Path, Key]) -> dict[Path, str]:
        """The split of each scan that is in one."""
        if not (self.test_names or self.train_names):
            return dict.fromkeys(inputs, "test")
        by_name: dict[str, list[Path]] = {}
        for file, key in inputs.items():
            for name in {stem(file), "/".join(key), "-".join(key), f"{file.parent.name}/{stem(file)}"}:
                by_name.setdefault(name, []).append(file)
        splits: dict[Path, str] = {}
        for split in ("test", "train"):
            for file in self._listed(split, by_name):
                if splits.setdefault(file, split) != split:
                    raise UsageError(f"{file}: is in both lists, dataset.test_names and dataset.train_names")
        if not self.test_names:
            splits = dict.fromkeys(inputs, "test") | splits
        return splits

    def _listed(self, split: str, by_name: Mapping[str, list[Path]]) -> list[Path]:
        """The scans that a list names."""
        parameter = f"{split}_names"
        if not (given := getattr(self, parameter)):
            return []
        try:
            lines = self._at(given).read_text(encoding="utf-8-sig").splitlines()
        except (OSError, UnicodeDecodeError) as error:
            raise UsageError(
                f"dataset.{parameter}={given}: cannot be read ({getattr(error, 'strerror', None) or 'no text'}); "
                "expected a text file with the name of one scan on each line"
            ) from error
        names = [line.strip() for line in lines if line.strip() and not line.lstrip().startswith("#")]
        found = {name: by_name.get(name) or by_name.get(stem(Path(name)), []) for name in names}
        if missing := [name for name, files in found.items() if not files]:
            raise UsageError(
                f"dataset.{parameter}={given}: {len(missing)} of {len(names)} names match no scan "
                f"({_shown(missing)}); expected names of dataset.input={self.input} without suffixes"
            )
        return [file for files in found.values() for file in files]

    # -- reading, when the case of a pair runs -------------------------------------------------------------------------

    def _reference(self, pair: _Pair) -> Callable[[], Trimesh | PointCloud]:
        def read() -> Trimesh | PointCloud:
            from bench.geometry.io.files import load_geometry

            return self._cropped(load_geometry(pair.reference), pair.reference)

        return read

    def _scan(self, pair: _Pair) -> Callable[[], PointCloud]:
        def read() -> PointCloud:
            from bench.geometry.io.files import load_cloud

            return self._cropped(load_cloud(pair.input), pair.input)

        return read

    def _cropped(self, geometry: Any, file: Path) -> Any:
        """The part in the box: the points of a cloud, the faces of a mesh that have all corners in it."""
        if not self.crop:
            return geometry
        is_cloud = isinstance(geometry, PointCloud)
        points = np.asarray(geometry.points if is_cloud else geometry.vertices)
        inside = np.asarray(((points >= self.crop[:3]) & (points <= self.crop[3:])).all(axis=1))
        kept = inside if is_cloud else inside[geometry.faces].all(axis=1)
        if not kept.any():
            low, high = points.min(axis=0).round(6).tolist(), points.max(axis=0).round(6).tolist()
            raise BadInput(f"{file}: has nothing within dataset.crop={self.crop}; it extends from {low} to {high}")
        if is_cloud:
            return PointCloud.of({name: array[kept] for name, array in geometry.arrays().items()})
        return geometry.submesh([np.flatnonzero(kept)], append=True, repair=False)


class _Pair(NamedTuple):
    """A scan, its reference, and its other files."""

    split: str
    input: Path
    reference: Path
    mask: Path | None = None
    plane: Path | None = None

    @property
    def files(self) -> dict[str, Path]:
        """The files by their kind."""
        named = {"scan": self.input, "reference": self.reference, "mask": self.mask, "plane": self.plane}
        return {part: file for part, file in named.items() if file is not None}


def _attributes(pair: _Pair) -> Mapping[str, np.ndarray] | Callable[[], Mapping[str, np.ndarray]]:
    """The contents of a DTU mask and a ground plane, if the pair has any."""
    if pair.mask is None and pair.plane is None:
        return {}

    def read() -> Mapping[str, np.ndarray]:
        from bench.geometry.io.dtu import load_mask, load_plane

        arrays = {} if pair.mask is None else load_mask(pair.mask)
        return arrays if pair.plane is None else arrays | load_plane(pair.plane)

    return read


def _suffixes(part: str) -> tuple[str, ...]:
    from bench.geometry.io.files import CLOUD_READERS

    return (".mat",) if part in ("mask", "plane") else tuple(CLOUD_READERS)


def _shown(names: list[Any]) -> str:
    texts = [name.name if isinstance(name, Path) else str(name) for name in names[:SHOWN]]
    return ", ".join(texts) + (", ..." if len(names) > SHOWN else "")
