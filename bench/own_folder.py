"""Folders and files that are this user's own: nobody else may prepare or change caches and locks.

Caches from one start to the next are trusted when they are read, so whoever may write there decides what a run
sees. A folder is accepted if it is not a link, belongs to this user, and nobody else may write into it.
"""

from __future__ import annotations

import contextlib
import errno
import functools
import hashlib
import hmac
import os
import stat
import tempfile
from pathlib import Path

SEAL = hashlib.sha256().digest_size  # bytes at the end of a sealed content
KEY_SIZE = 32


def own_folder(folder: Path) -> Path | None:
    """The folder, made where it is not there; None where it is not this user's alone, or cannot be made."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()
        if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid():
            return None
        if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            folder.chmod(0o700)
    except OSError:
        return None
    return folder


def cache_folder() -> Path | None:
    """This user's folder of caches, ``~/.cache/detailbench`` or below ``XDG_CACHE_HOME``; None where there is none."""
    try:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError:  # nobody's home
        return None
    return own_folder(Path(os.path.realpath(base / "detailbench")))  # a link in one's home is one's own


def open_own(path: Path, flags: int) -> int:
    """A file of this user's, opened (as ``os.open``) and made where it is not there: not through a link, and not cut.

    Raises
    ------
    OSError
        If it cannot be, or if it is not a regular file.
    """
    opened = os.open(path, flags | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC | os.O_NONBLOCK, 0o666)
    if not stat.S_ISREG(os.fstat(opened).st_mode):
        os.close(opened)
        raise OSError(errno.EINVAL, "is not a regular file", str(path))
    return opened


def read_regular(path: Path) -> bytes:
    """The content of a regular file.

    Raises
    ------
    OSError
        If it cannot be read, or is something else: a FIFO would be waited for, and a device has no end.
    """
    if not stat.S_ISREG(os.stat(path).st_mode):
        raise OSError(errno.EINVAL, "is not a regular file", str(path))
    with open(path, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK)) as file:
        return file.read()


# -- seals -------------------------------------------------------------------------------------------------------------


@functools.cache
def _key() -> bytes:
    """A secret of this user's, the same in all processes; if it cannot be stored, another one in each process."""
    folder = cache_folder()
    if folder is not None:
        path = folder / "key"
        for _ in range(2):
            with contextlib.suppress(OSError):
                key = path.read_bytes()
                if len(key) == KEY_SIZE:
                    return key
            with contextlib.suppress(OSError):
                handle, temporary = tempfile.mkstemp(dir=folder)
                with os.fdopen(handle, "wb") as file:
                    file.write(os.urandom(KEY_SIZE))
                os.replace(temporary, path)
    return os.urandom(KEY_SIZE)


def seal(name: str, content: bytes | memoryview) -> bytes:
    """What only this user's processes can put behind the content of an entry of this name."""
    made = hmac.new(_key(), name.encode() + b"\0", hashlib.sha256)
    made.update(content)
    return made.digest()


def unsealed(name: str, content: bytes) -> memoryview | None:
    """The content without its seal; None where this user did not make it, or not under this name."""
    body = memoryview(content)[:-SEAL]
    return body if hmac.compare_digest(seal(name, body), content[-SEAL:]) else None
