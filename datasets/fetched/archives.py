"""Read single files out of Debian packages and wheels, without root and without the tools of either.

Nothing is unpacked to a path that an archive names: callers request files by their exact names and get their content,
so no name in an archive (``../``, ``/etc``, a link) decides where something is written.
"""

from __future__ import annotations

import io
import lzma
import tarfile
import zipfile
import zlib
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import IO, Literal

from bench import BadInput

MAGIC = b"!<arch>\n"
HEADER = 60  # bytes before each member of an ar archive: name 16, time 12, user 6, group 6, mode 8, size 10, end 2
Mode = Literal["r|", "r|gz", "r|bz2", "r|xz"]
MODES: dict[str, Mode] = {"": "r|", ".gz": "r|gz", ".bz2": "r|bz2", ".xz": "r|xz"}
BROKEN = (tarfile.TarError, lzma.LZMAError, zlib.error, EOFError, OSError)


def files_of_deb(deb: Path, wanted: Collection[str], inner: str = "") -> Iterator[tuple[str, bytes]]:
    """Name and content of the wanted files of a Debian package, in the order of the archive.

    Parameters
    ----------
    deb : Path
        An ``ar`` archive whose member ``data.tar``, compressed or not, has the files.
    wanted : collection of str
        Names as in ``usr/share/doc/x``, without a leading ``./``; missing files are left out.
    inner : str
        The name of a ``tar.gz`` in the package that has the files instead.

    Raises
    ------
    BadInput
        For a file that is not such a package, or is damaged.
    """
    with deb.open("rb") as file:
        name, content = _member(file, "data.tar", deb)
        mode = MODES.get(name.removeprefix("data.tar"))
        if mode is None:
            raise BadInput(f"{deb}: {name} is compressed in a way that Python's tarfile does not read; use dpkg-deb -x")
        try:
            if not inner:
                yield from _regular(content, mode, wanted)
                return
            for _, stream in _streams(content, mode, {inner}):
                yield from _regular(stream, "r|gz", wanted)
        except BROKEN as error:
            raise BadInput(f"{deb}: is damaged or cut off ({error}); remove it and fetch it again") from None


def files_of_wheel(wheel: Path, wanted: Collection[str]) -> Iterator[tuple[str, bytes]]:
    """Name and content of the wanted files of a wheel.

    Raises
    ------
    BadInput
        For a file that is not a zip archive, or is damaged.
    """
    try:
        with zipfile.ZipFile(wheel) as archive:
            there = set(archive.namelist())
            for name in wanted:
                if name in there:
                    yield name, archive.read(name)
    except (zipfile.BadZipFile, *BROKEN) as error:
        raise BadInput(f"{wheel}: is damaged, cut off or not a wheel ({error}); remove it and fetch it again") from None


def _member(file: IO[bytes], start: str, path: Path) -> tuple[str, IO[bytes]]:
    """The first member of an ar archive whose name begins with ``start``: its name, and its content as a stream."""
    if file.read(len(MAGIC)) != MAGIC:
        raise BadInput(f"{path}: is not a Debian package; expected an ar archive, which begins with '!<arch>'")
    while header := file.read(HEADER):
        digits = header[48:58].strip()
        if len(header) < HEADER or header[58:] != b"`\n" or not digits.isdigit():
            raise BadInput(f"{path}: is damaged or cut off; remove it and fetch it again")
        name, size = header[:16].decode("ascii", errors="replace").strip().rstrip("/"), int(digits)
        if name.startswith(start):
            return name, io.BufferedReader(_Window(file, size))
        file.seek(size + size % 2, io.SEEK_CUR)
    raise BadInput(f"{path}: has no {start}; expected a Debian package")


class _Window(io.RawIOBase):
    """The next ``size`` bytes of a stream."""

    def __init__(self, stream: IO[bytes], size: int):
        self._stream, self._left = stream, size

    def readable(self) -> bool:
        return True

    def readinto(self, buffer) -> int:
        data = self._stream.read(min(len(buffer), self._left))
        buffer[: len(data)] = data
        self._left -= len(data)
        return len(data)


def _streams(content: IO[bytes], mode: Mode, wanted: Collection[str]) -> Iterator[tuple[str, IO[bytes]]]:
    """The wanted regular files of a tar stream; each must be read before the next."""
    with tarfile.open(fileobj=content, mode=mode) as tar:
        for member in tar:
            name = member.name.removeprefix("./")
            if name in wanted and member.isreg():
                stream = tar.extractfile(member)
                assert stream is not None  # only links and folders have none
                yield name, stream


def _regular(content: IO[bytes], mode: Mode, wanted: Collection[str]) -> Iterator[tuple[str, bytes]]:
    for name, stream in _streams(content, mode, wanted):
        yield name, stream.read()
