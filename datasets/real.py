"""Scans and models that people made: a small test set that is fetched at set-up."""

from __future__ import annotations

import functools
import hashlib
import json
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from bench import BadInput, MissingData, Shape, ShapePair, UsageError, register

from .fetched import cortex
from .fetched.packages import PACKAGES, fetch_packages

if TYPE_CHECKING:
    from trimesh import Trimesh

TABLE = Path(__file__).with_name("real.json")
GROUPS = ("closed", "crossing", "open")
HALVES = ("left", "right")


class Mesh(NamedTuple):
    """A line of ``real.json``."""

    name: str
    group: str  # closed, crossing (closed, but some faces cross others) or open
    package: str
    file: str
    vertices: int
    faces: int
    genus: int | None
    about: str
    sha256: str


@register("dataset", requires=("igl", "trimesh"))
@dataclass(frozen=True)
class Real:
    """Scans and models that people made, fetched at set-up by `make real`; all are test data.

    31 closed meshes without self-intersections, no two of one object: scans and models of animals and figures, machine
    parts, a molecule, a cortex. ``which=all`` adds six closed ones of which some faces cross others, and six with
    borders. The files come from CGAL's demos (Debian's package ``libcgal-demo``) and from nilearn; the SHA-256 of each
    is checked when it is read. The mesh is all that is known of a shape.

    ``pairs``: the folds of one half of an average brain on the inflated other half (``base_vertices``), mirrored and in
    one vertex order by FreeSurfer's registration; the two halves of a brain differ, so no transfer is perfect. With
    ``pairing=surfaces``, two surfaces of one half with the same faces: white, pial (outer) and inflated.
    """

    which: str | list[str] = "closed"  # closed, crossing, open, all, or names of meshes: [bunny,fandisk]
    path: str = ""  # where `detailbench fetch real` put the files; by default ~/.cache/detailbench/real
    pairing: Literal["hemispheres", "surfaces"] = "hemispheres"  # pairs of both halves, or of surfaces of one half

    def __post_init__(self) -> None:
        self._chosen()

    @property
    def folder(self) -> Path:
        """Where the files are: ``path``, or ``detailbench/real`` in the user's cache."""
        if self.path:
            return Path(os.path.expanduser(self.path))
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "detailbench" / "real"

    def shapes(self, split: str) -> Iterator[Shape]:
        """The chosen meshes, always in the same order.

        Raises
        ------
        MissingData
            Where the files were not fetched.
        UsageError
            For the train split, which has none.
        """
        self._require(split, [(mesh.package, mesh.file) for mesh in self._chosen()])
        for mesh in self._chosen():
            yield self._shape(mesh)

    def pairs(self, split: str) -> Iterator[ShapePair]:
        """Pairs of surfaces of the cortex with the same faces, and their inflated half as ``base_vertices``; see above.

        Raises
        ------
        MissingData, UsageError
            As for :meth:`shapes`.
        """
        self._require(split, [("nilearn", file) for file in _table()[1]])
        return self._hemispheres() if self.pairing == "hemispheres" else self._surfaces()

    def check(self, split: str = "test") -> None:
        """Raise :class:`bench.MissingData` unless all files exist, UsageError for the train split."""
        self._require(split, [(package, file) for package, file, _ in _files()])

    def state(self) -> dict[str, str]:
        """The frozen SHA-256 of each file that may be read."""
        return {f"{package}/{file}": sha256 for package, file, sha256 in _files()}

    def fetch(self, say: Callable[[str], None]) -> None:
        """Download what is missing, and write ``LICENCES.txt`` beside it.

        Parameters
        ----------
        say : is called with each line for the user

        Raises
        ------
        UsageError, BadInput
            If that fails, with what to do.
        """
        wanted: dict[str, dict[str, str]] = {package: {} for package in PACKAGES}
        for package, file, sha256 in _files():
            wanted[package][file] = sha256
        fetch_packages(self.folder, wanted, say)

    def _chosen(self) -> list[Mesh]:
        """The meshes that ``which`` names, in the order of the table.

        Raises
        ------
        ValueError
            For a name that is not in the table.
        """
        meshes, which = _table()[0], self.which
        names = which.split(",") if isinstance(which, str) else which
        names = [name.strip() for name in names]
        known = {mesh.name for mesh in meshes}
        unknown = [name for name in names if name not in known | {"all", *GROUPS}]
        if unknown or not names:
            raise ValueError(
                f"which: expected {', '.join(GROUPS)}, all, or names of meshes ({', '.join(sorted(known))}); got "
                f"{', '.join(unknown) or 'nothing'}"
            )
        return [mesh for mesh in meshes if {mesh.name, mesh.group, "all"} & set(names)]

    def _require(self, split: str, files: list[tuple[str, str]]) -> None:
        if split != "test":
            raise UsageError(
                f"dataset real: split={split} has no meshes, since all are test data, so that nothing is tuned on "
                "them; train on procedural shapes, or on your own files (dataset=files)"
            )
        missing = sum(not (self.folder / package / file).is_file() for package, file in files)
        if missing:
            line = f"detailbench fetch real dataset.path={self.path}" if self.path else "make real"
            same = "" if self.path else " (the same as: detailbench fetch real)"
            raise MissingData(
                f"dataset real: {missing} of its {len(files)} files are not in {self.folder}", line + same
            )

    def _shape(self, mesh: Mesh) -> Shape:
        origin = PACKAGES[mesh.package]
        info = {
            "file": f"{mesh.package}/{mesh.file}",
            "about": mesh.about,
            "source": origin.source,
            "licence": origin.licence,
            "sha256": mesh.sha256,
            "genus": mesh.genus,
        }
        return Shape(f"real-{mesh.name}", lambda: self._read(mesh), info=info)

    def _read(self, mesh: Mesh) -> Trimesh:
        from bench.geometry.io.files import load_mesh

        data = self._content(mesh.package, mesh.file, mesh.sha256)
        if mesh.package == "nilearn":
            return _mesh(*_surface(data, mesh.file))
        return load_mesh(self.folder / mesh.package / mesh.file)

    def _content(self, package: str, file: str, sha256: str) -> bytes:
        """A file's bytes, checked against the frozen SHA-256."""
        path = self.folder / package / file
        try:
            data = path.read_bytes()
        except OSError as error:
            raise BadInput(f"{path}: cannot be read ({error.strerror}); fetch it with: make real") from None
        if hashlib.sha256(data).hexdigest() != sha256:
            raise BadInput(
                f"{path}: is not the file of this test set (expected SHA-256 {sha256}): it was changed, "
                "or is another version. Remove it and run: make real"
            )
        return data

    def _surface_of(self, file: str) -> cortex.Surface:
        return _surface(self._content("nilearn", file, _table()[1][file]), file)

    def _hemispheres(self) -> Iterator[ShapePair]:
        """The folds of one half on the other: outer and inner surface, in both directions."""
        made = {"left": cortex.left, "right": cortex.mirrored_right}
        for source, target in (HALVES, HALVES[::-1]):
            for kind in ("pial", "white"):
                id = f"real-cortex-{kind}-{source}-to-{target}"
                one, other = (self._half(f"{id}-{half}", kind, half, made[half]) for half in (source, target))
                yield ShapePair(id, one, other)

    def _surfaces(self) -> Iterator[ShapePair]:
        """Two surfaces of one half: with grey matter added, and with folds removed."""
        for source, target in (("white", "pial"), ("white", "inflated"), ("pial", "inflated")):
            for half in HALVES:
                id = f"real-cortex-{half}-{source}-to-{target}"
                one, other = (self._half(f"{id}-{kind}", kind, half, _own_half(half)) for kind in (source, target))
                yield ShapePair(id, one, other)

    def _half(self, id: str, kind: str, half: str, made: Callable[..., cortex.Surface]) -> Shape:
        origin = PACKAGES["nilearn"]
        info = {"surface": kind, "half": half, "source": origin.source, "licence": origin.licence, "genus": 0}
        # Each surface is made on first use: whoever needs only the shape does not need the base.
        return Shape(
            id,
            lambda: _mesh(*made(kind, self._surface_of)),
            info=info,
            attributes=lambda: {"base_vertices": made("inflated", self._surface_of)[0]},
        )


def _own_half(half: str) -> Callable[[str, cortex.Reader], cortex.Surface]:
    return lambda kind, read: read(cortex.file_of(kind, half))


@functools.cache
def _table() -> tuple[tuple[Mesh, ...], dict[str, str]]:
    """The meshes, and the SHA-256 of the files of the cortex."""
    table = json.loads(TABLE.read_text(encoding="utf-8"))
    return tuple(Mesh(**line) for line in table["meshes"]), table["cortex"]


def _files() -> list[tuple[str, str, str]]:
    """Package, file and SHA-256 of all fetched files, each once."""
    meshes, surfaces = _table()
    files = [(mesh.package, mesh.file, mesh.sha256) for mesh in meshes]
    return list(dict.fromkeys([*files, *(("nilearn", file, sha256) for file, sha256 in surfaces.items())]))


def _surface(data: bytes, name: str) -> cortex.Surface:
    from .fetched.gifti import read_surface

    return read_surface(data, name)


def _mesh(vertices: np.ndarray, faces: np.ndarray) -> Trimesh:
    from trimesh import Trimesh

    return Trimesh(vertices, faces, process=False)
