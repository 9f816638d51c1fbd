"""What methods store beside their outputs (:meth:`bench.Run.keep`): geometry, images and arrays, as files of a case."""

from __future__ import annotations

import io
import os
import re
import uuid
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import UsageError
from ..geometry.cloud import PointCloud

NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,63}")
LIMIT_BYTES = 256 * 2**20  # of the arrays that one case stores: 160 states of 20,000 vertices, 300 images of 512 x 512


def check_name(name: str) -> None:
    """Raise :class:`ValueError` unless ``name`` is a plain file name on every system, without its suffix."""
    if not isinstance(name, str) or not NAME.fullmatch(name):
        raise ValueError(
            f"run.keep: the name {name!r}: expected 1 to 64 letters, digits and ._-, not beginning with a dot or a dash"
        )


def suffix_of(value: Any) -> str:
    """``.ply``, ``.png`` or ``.npz``: how a value is stored.

    Raises
    ------
    ValueError
        If it cannot be stored, listing what can.
    """
    if isinstance(value, PointCloud) or (hasattr(value, "vertices") and hasattr(value, "faces")):
        return ".ply"
    if isinstance(value, np.ndarray):
        if value.dtype == np.uint8 and (value.ndim == 2 or value.shape[2:] == (3,)) and value.size:
            return ".png"
        raise ValueError(
            f"run.keep: cannot store an array of {value.dtype} in the shape {value.shape}; expected an image of uint8, "
            "(h, w, 3) or (h, w), or a dict of arrays"
        )
    if hasattr(value, "arrays") or _is_mapping_of_arrays(value):
        return ".npz"
    raise ValueError(
        f"run.keep: cannot store a {type(value).__name__}; expected a Trimesh, a PointCloud, Views, an image (uint8 "
        "array) or a dict of arrays"
    )


def _is_mapping_of_arrays(value: Any) -> bool:
    """Whether all keys are names and all values arrays of numbers, bools or text, so that nothing needs pickle."""
    return isinstance(value, Mapping) and all(
        isinstance(key, str) and NAME.fullmatch(key) and isinstance(array, (np.ndarray, np.generic, int, float))
        and np.asarray(array).dtype.kind in "biufcU"
        for key, array in value.items()
    )  # fmt: skip


class Artefacts:
    """The files that one case stores.

    Parameters
    ----------
    folder : Path
        Where they are stored; created with the first.
    root : Path
        The folder to which the listed paths are relative.
    note : function
        Called with a sentence about what could not be stored.
    """

    def __init__(self, folder: Path, root: Path, note: Callable[[str], None]):
        self._folder, self._root, self._note = folder, root, note
        self._files: dict[str, tuple[Path, int]] = {}  # of each name: the file and its bytes

    @property
    def paths(self) -> list[str]:
        """The files, in the order in which they were first stored, relative to the root."""
        return [path.relative_to(self._root).as_posix() for path, _ in self._files.values()]

    def keep(self, name: str, value: Any) -> str | None:
        """Store a value, or the result of a function; the path as in :attr:`paths`, None if it was left out.

        Raises
        ------
        ValueError
            If it cannot be stored.
        """
        value = value() if callable(value) else value
        path = self._folder / f"{name}{suffix_of(value)}"
        earlier, taken = self._files.get(name), sum(size for _, size in self._files.values())
        size = size_of(value)
        if taken - (earlier[1] if earlier else 0) + size > LIMIT_BYTES:
            self._note(f"run.keep: {name} was not stored: a case stores at most {LIMIT_BYTES / 2**20:.0f} MB")
            return None
        try:
            write(value, path)
            if earlier and earlier[0] != path:
                earlier[0].unlink(missing_ok=True)
        except (OSError, UsageError) as error:  # for instance a full disk: not the method's fault
            self._note(f"run.keep: {name} was not stored: {error}")
            return None
        self._files[name] = path, size
        return path.relative_to(self._root).as_posix()


def _arrays(value: Any) -> Mapping[str, np.ndarray]:
    """The arrays that a value holds, by name."""
    if isinstance(value, np.ndarray):
        return {"image": value}
    if hasattr(value, "vertices"):
        return {"vertices": np.asarray(value.vertices), "faces": np.asarray(value.faces)}
    arrays = value if isinstance(value, Mapping) else value.arrays()
    return {name: np.asarray(array) for name, array in arrays.items()}


def size_of(value: Any) -> int:
    """The bytes of the arrays that a value holds."""
    return sum(array.nbytes for array in _arrays(value).values())


def write(value: Any, path: Path) -> None:
    """Write one value in the format of ``path``'s suffix, under a temporary name that is then renamed."""
    if path.suffix == ".ply":
        from ..geometry.io.files import save

        save(value, path)
        return
    content = _png(value) if path.suffix == ".png" else _npz(_arrays(value))
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}.tmp")
    try:
        temporary.write_bytes(content)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def _png(image: np.ndarray) -> bytes:
    from PIL import Image

    sink = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(image)).save(sink, format="png")
    return sink.getvalue()


def _npz(arrays: Mapping[str, np.ndarray]) -> bytes:
    """What `numpy.load` reads; numpy.savez takes arrays as keywords, so it cannot take one called ``file``."""
    sink = io.BytesIO()
    with zipfile.ZipFile(sink, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as entry:
                np.lib.format.write_array(entry, np.asanyarray(array), allow_pickle=False)
    return sink.getvalue()
