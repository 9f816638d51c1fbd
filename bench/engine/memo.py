"""The cache on disk shared by the cells of a sweep: meshes, clouds and views, samples of references, floors.

Every method meets the same cases, and each of its cells runs in a process of its own. Without a cache, each would
make the same mesh, scan it the same way and draw the same samples again, which takes longer than most methods do.

::

    DIR/.cache/ab/ab12....npz     named arrays under the digest of all that they depend on, sealed

The cache changes nothing but time: an entry holds the very bytes that would be computed, its name covers all that
it was computed from (parameters, sources, versions, seed), and a damaged or missing one is made again. So is one that
somebody else made: entries of a copied or downloaded folder lack this user's seal. The cache stays below
``limit.cache_gb`` by removing the least recently used entries; 0 switches it off.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shutil
import tempfile
import time
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..contract.identity import shape_digest
from ..contract.shape import Shape
from ..errors import UsageError
from ..geometry.cloud import PointCloud
from ..own_folder import read_regular, seal, unsealed
from ..plan.choice import digest
from ..text import encodable

if TYPE_CHECKING:
    from trimesh import Trimesh


Arrays = Mapping[str, np.ndarray]
SPARE_BYTES = 1 << 30  # on a disk with less than this left, nothing is cached: results go first
PRUNE_EVERY = 50  # writes of one process between two looks at the size of the whole
OURS = re.compile(r"([0-9a-f]{2})/(\1[0-9a-f]{62}\.npz|.+\.tmp)")


@dataclass(frozen=True)
class Memo:
    """A part of the cache.

    Attributes
    ----------
    folder : Path, or None
        Without one nothing is cached.
    key : str
        What everything in this part depends on.
    limit_gb : float
    writes : bool
        Whether new arrays are cached; otherwise the cache is only read.
    """

    folder: Path | None = None
    key: str = ""
    limit_gb: float = 2.0
    writes: bool = True

    def at(self, *parts: Any) -> Memo:
        """The part below this one for arrays that also depend on ``parts`` (JSON values)."""
        return replace(self, key=digest([self.key, *parts]))

    def arrays(self, name: str, make: Callable[[], Arrays]) -> Arrays:
        """The arrays of that name: those that are cached, otherwise those that ``make`` returns."""
        if self.folder is None or self.limit_gb <= 0:
            return make()
        entry = digest([self.key, name])
        path = self.folder / entry[:2] / f"{entry}.npz"
        known = _read(path, entry)
        if known is not None:
            return known
        made = make()
        if self.writes:
            self._write(path, entry, made)
        return made

    def _write(self, path: Path, entry: str, arrays: Arrays) -> None:
        """Write an entry, if there is room; a cache that cannot be written is no error."""
        with contextlib.suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            if shutil.disk_usage(path.parent).free < SPARE_BYTES:
                return
            sink = io.BytesIO()
            named: dict[str, Any] = dict(arrays)
            np.savez(sink, **named)
            handle, temporary = tempfile.mkstemp(suffix=".tmp", dir=path.parent)
            try:
                with os.fdopen(handle, "wb") as file:
                    file.write(sink.getbuffer())
                    file.write(seal(entry, sink.getbuffer()))
                os.replace(temporary, path)
            except OSError:
                os.unlink(temporary)
        _Writes.count += 1
        if self.folder is not None and _Writes.count % PRUNE_EVERY == 1:
            prune(self.folder, self.limit_gb)


class _Writes:
    count = 0


def _read(path: Path, entry: str) -> Arrays | None:
    try:
        content = unsealed(entry, read_regular(path))
        if content is None:
            return None
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        os.utime(path)
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile):
        return None
    return arrays


def prune(folder: Path, limit_gb: float) -> None:
    """Remove what a writer that was killed has left, and the least recently used entries beyond ``limit_gb``."""
    entries = []
    for path in folder.glob("*/*"):
        # Nothing else is removed, wherever the links of a folder that somebody else made may lead.
        if path.parent.is_symlink() or not OURS.fullmatch(f"{path.parent.name}/{path.name}"):
            continue
        with contextlib.suppress(OSError):
            stat = path.lstat()
            if path.suffix == ".tmp" and time.time() - stat.st_mtime > 3600:
                path.unlink()
            else:
                entries.append((stat.st_mtime, stat.st_size, path))
    total = sum(size for _, size, _ in entries)
    for _, size, path in sorted(entries):
        if total <= limit_gb * 1e9:
            return
        with contextlib.suppress(OSError):
            path.unlink()
            total -= size


class RememberedDataset:
    """A dataset whose meshes and clouds are cached; all else is the dataset's own."""

    def __init__(self, dataset: Any, memo: Memo):
        self._dataset, self._memo = dataset, memo

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._dataset, name)
        return self._shapes if name == "shapes" else value

    def _shapes(self, split: str) -> Iterator[Shape]:
        for shape in self._dataset.shapes(split):
            shape.id = encodable(shape.id)  # seeds and rows are made of it
            yield self._cached(shape, split) if self._is_frozen() else shape

    def _is_frozen(self) -> bool:
        """Whether its meshes follow from its key: not the user's own files, but those that are fetched and pinned."""
        return not hasattr(self._dataset, "state") or hasattr(self._dataset, "fetch")

    def _cached(self, shape: Shape, split: str) -> Shape:
        def made() -> Trimesh | PointCloud:
            return _geometry_of(self._memo.at(split, shape.id).arrays("geometry", lambda: _arrays_of(shape)))

        return shape.replace_mesh(made)


def _arrays_of(shape: Shape) -> Arrays:
    if shape.cloud is not None:
        return shape.cloud.arrays()
    return {"vertices": np.asarray(shape.mesh.vertices, dtype=np.float64), "faces": np.asarray(shape.mesh.faces)}


def _geometry_of(arrays: Arrays) -> Trimesh | PointCloud:
    if "points" in arrays:
        return PointCloud.of(arrays)
    from trimesh import Trimesh

    return Trimesh(arrays["vertices"], arrays["faces"], process=False)


class RememberedSensor:
    """A sensor whose outputs are cached, by shape and by the state of the generator it was given.

    Tasks that give it the same shape share its output.

    Parameters
    ----------
    sensor : the sensor
    memo : Memo
    noun : type
        The class of its output, which has ``arrays()`` and ``of(arrays)``; see :func:`sensors.noun_of`.
    """

    def __init__(self, sensor: Any, memo: Memo, noun: Any = PointCloud):
        self._sensor, self._memo, self._noun = sensor, memo, noun

    def __getattr__(self, name: str) -> Any:
        return getattr(self._sensor, name)

    def sense(self, shape: Shape, rng: np.random.Generator) -> Any:
        """The output of the sensor for ``shape``.

        Raises
        ------
        UsageError
            If its class is not the one that the sensor declares.
        """
        # Spawned generators differ by their key alone, which is no part of the state.
        start = [str(rng.bit_generator.state), str(rng.bit_generator.seed_seq)]
        known = self._memo.at(shape.id, shape_digest(shape), start).arrays(
            self._noun.__name__, lambda: self._made(shape, rng).arrays()
        )
        return self._noun.of(known)

    def _made(self, shape: Shape, rng: np.random.Generator) -> Any:
        made = self._sensor.sense(shape, rng)
        if not isinstance(made, self._noun):
            raise UsageError(
                f"sensor {type(self._sensor).__name__}: expected a {self._noun.__name__} from sense(), got "
                f'{type(made).__name__}; declare what it gives: @register("sensor", gives=...)'
            )
        return made
