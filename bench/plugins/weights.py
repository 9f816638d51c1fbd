"""Weights of learned methods: which plugins learn, and safetensors files with the facts about the training.

A file has the arrays and, as text in its header, how they were made: see :data:`FACTS`. Files that come with a
package lie in a folder ``weights`` beside the source of their plugin, with floating-point numbers as float16.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ..errors import BadInput
from ..text import shortened
from .registry import Plugin
from .schema import defaults

FACTS = {
    "method": "the name of the method",
    "parameters": "those that the weights depend on (trained_by)",
    "task": "whose cases the training had",
    "dataset": "of the shapes, all of the train split",
    "sensor": "that measured them",
    "cases": "how many cases there were",
    "seed": "of the training",
    "steps": "that were made",
    "seconds": "that they took, by the clock",
    "cpu_seconds": "of the processor",
    "device": "cpu or cuda",
    "threads": "of the processor",
    "curve": "[seconds, step, validation] in turn: the validation error while it was trained",
    "shapes": "digests of the shapes, by which one is known again in a test split",
    "examples": "SHA-256 of what the method made of them, see content()",
    "detailbench": "the version",
    "commit": "of the checkout, with + where files were changed",
    "training": "the fingerprint of the training",
    "finished": "when, UTC",
}
LONGEST_HEADER = 100_000_000  # bytes, the limit of the format


def is_learned(plugin: Plugin) -> bool:
    """Whether a method is trained on examples before it is used."""
    return plugin.kind == "method" and all(callable(getattr(plugin.cls, name, None)) for name in ("examples", "fit"))


def trained_values(plugin: Plugin, parameters: Mapping[str, Any], attribute: str = "trained_by") -> dict[str, Any]:
    """The parameters that the weights depend on; with ``"examples_by"``, those that the examples depend on."""
    cls: Any = plugin.cls
    names = getattr(cls, attribute, None)
    names = cls.trained_by if names is None else names
    return {name: parameters[name] for name in names if name in parameters}


def shipped(plugin: Plugin, parameters: Mapping[str, Any]) -> Path | None:
    """The file that comes with a plugin and was trained with these parameters; None if there is none."""
    wanted = trained_values(plugin, parameters)
    usual = trained_values(plugin, defaults(plugin))  # a parameter missing in a file is newer than the file
    for path in sorted((plugin.file.parent / "weights").glob("*.safetensors")):
        facts = facts_of(path)
        if facts.get("method") == plugin.name and _same({**usual, **(facts.get("parameters") or {})}, wanted):
            return path
    return None


def check_fits(plugin: Plugin, parameters: Mapping[str, Any], path: Path) -> None:
    """Refuse a file of weights of another method, or trained with other parameters.

    Raises
    ------
    BadInput
        Naming the file, the difference, and the right override.
    """
    facts = facts_of(path)
    if facts.get("method") != plugin.name:
        theirs = facts.get("method")
        what = (
            f"it was trained as {shortened(str(theirs), MOST)}"
            if theirs
            else "its header does not say how it was trained"
        )
        raise BadInput(f"training.weights={path}: expected weights of {plugin.name}, but {what}")
    theirs = {**defaults(plugin), **(facts.get("parameters") or {})}
    for name, here in trained_values(plugin, parameters).items():
        if not _same(theirs.get(name), here):
            there = shortened(str(theirs.get(name)), MOST)
            raise BadInput(
                f"training.weights={path}: was trained with {name}={there}, and {name} is {here} here; set "
                f"method.{name}={there}, or train it again: detailbench train method={plugin.name} --help"
            )


def _same(a: Any, b: Any) -> bool:
    return json.dumps(a, sort_keys=True) == json.dumps(b, sort_keys=True)


def facts_of(path: str | Path) -> dict[str, Any]:
    """The header of a file, each value as it was passed to :func:`save`.

    Raises
    ------
    BadInput
        Naming the file, if it cannot be read or is not a safetensors file.
    """
    path = Path(os.path.expanduser(path))
    stat = _stat(path)
    return dict(_facts(str(path.absolute()), stat.st_mtime_ns, stat.st_size))


@functools.lru_cache(maxsize=256)
def _facts(path: str, mtime_ns: int, size: int) -> Mapping[str, Any]:
    try:
        with open(path, "rb") as file:
            header = _header(file, path)
            ends = [about["data_offsets"][1] for name, about in header.items() if name != "__metadata__"]
            if file.tell() + max(ends, default=0) != size:
                raise BadInput(f"{path}: is cut off, or longer than its header says; {EXPECTED}")
            metadata = header.get("__metadata__") or {}
        return {key: json.loads(value) for key, value in metadata.items() if key in FACTS}
    except OSError as error:
        raise BadInput(f"{path}: cannot be read ({error.strerror}); {EXPECTED}") from error
    except BadInput:
        raise
    except (ValueError, AttributeError, TypeError, KeyError, IndexError, RecursionError) as error:
        raise _damaged(path, error) from error


EXPECTED = "expected a safetensors file that detailbench train made"
MOST = 100  # characters quoted from a header


def _damaged(path: str | Path, error: Exception) -> BadInput:
    return BadInput(f"{path}: its header is damaged ({shortened(str(error), MOST)}); {EXPECTED}")


def _stat(path: Path) -> os.stat_result:
    """The status of a file; pipes, which might block for ever, and devices are refused."""
    try:
        if path.exists() and not path.is_file():
            raise BadInput(f"{path}: is a folder, a pipe or a device; {EXPECTED}")
        return path.stat()
    except OSError as error:
        raise BadInput(f"{shortened(str(path), MOST)}: cannot be read ({error.strerror}); {EXPECTED}") from error


def _header(file: BinaryIO, path: str) -> dict[str, Any]:
    """The header of a file: its length in eight bytes, and JSON."""
    head = file.read(8)
    length = struct.unpack("<Q", head)[0] if len(head) == 8 else LONGEST_HEADER + 1
    if length > LONGEST_HEADER or len(text := file.read(length)) < length:
        raise BadInput(f"{path}: is not a safetensors file, or is cut off; {EXPECTED}")
    header = json.loads(text)
    if not isinstance(header, dict):
        raise BadInput(f"{path}: is not a safetensors file; {EXPECTED}")
    return header


def content(path: str | Path) -> str:
    """SHA-256 over the arrays of a file, 64 hexadecimal digits; the facts in its header do not count.

    Raises
    ------
    BadInput
        If it cannot be read.
    """
    path = Path(os.path.expanduser(path))
    stat = _stat(path)
    try:
        return _content(str(path.absolute()), stat.st_mtime_ns, stat.st_size)
    except OSError as error:
        raise BadInput(f"{path}: cannot be read ({error.strerror}); {EXPECTED}") from error
    except BadInput:
        raise
    except (ValueError, RecursionError) as error:
        raise _damaged(path, error) from error


@functools.lru_cache(maxsize=256)
def _content(path: str, mtime_ns: int, size: int) -> str:
    with open(path, "rb") as file:
        arrays = {name: about for name, about in _header(file, path).items() if name != "__metadata__"}
        total = hashlib.sha256(json.dumps(arrays, sort_keys=True).encode())
        while block := file.read(1 << 20):
            total.update(block)
    return total.hexdigest()


def load(path: str | Path) -> dict[str, np.ndarray]:
    """The arrays of a file; floating-point numbers of less than 32 bits as float32.

    Raises
    ------
    BadInput
        Naming the file, if it is damaged.
    """
    return {name: a.astype(np.float32) if a.dtype == np.float16 else a for name, a in as_stored(path).items()}


def as_stored(path: str | Path) -> dict[str, np.ndarray]:
    """The arrays of a file, of the types that they were stored in.

    Raises
    ------
    BadInput
        Naming the file, if it is damaged, or has numbers that numpy does not know (bfloat16).
    """
    from safetensors import SafetensorError
    from safetensors.numpy import load_file

    path = Path(os.path.expanduser(path))
    _stat(path)
    try:
        return load_file(str(path))
    except (OSError, SafetensorError, AttributeError, KeyError, TypeError) as error:  # a type unknown to numpy
        raise BadInput(f"{path}: cannot be read ({error}); expected a safetensors file of numpy's types") from error


def as_bytes(arrays: Mapping[str, np.ndarray], facts: Mapping[str, Any], *, half: bool = False) -> bytes:
    """The content of a safetensors file.

    Parameters
    ----------
    arrays : mapping of names to arrays
    facts : mapping
        JSON values for the header.
    half : bool
        Whether floating-point numbers become float16, as in the shipped files.
    """
    from safetensors.numpy import save

    def stored(array: np.ndarray) -> np.ndarray:
        array = np.asarray(array)
        return np.ascontiguousarray(array.astype(np.float16) if half and array.dtype.kind == "f" else array)

    header = {key: json.dumps(value) for key, value in facts.items()}
    # A number (an array of no dimension) loses its shape in np.ascontiguousarray.
    return _sorted(save({name: stored(a).reshape(np.shape(a)) for name, a in arrays.items()}, header))


def _sorted(saved: bytes) -> bytes:
    """The same file with its header in alphabetical order: the library writes it in another one each time."""
    length = struct.unpack("<Q", saved[:8])[0]
    header = json.loads(saved[8 : 8 + length])
    text = json.dumps(header, sort_keys=True, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % 8)  # the arrays begin at a multiple of eight bytes
    return struct.pack("<Q", len(text)) + text + saved[8 + length :]
