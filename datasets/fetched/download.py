"""Download a pinned file: resumes interrupted downloads, and accepts a file only if its SHA-256 is right."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from bench import BadInput, UsageError

TIMEOUT = 30  # seconds without a byte
BLOCK = 1 << 18
REPORTS = 10  # number of progress reports in a download


@dataclass(frozen=True)
class Archive:
    """A published file that never changes."""

    name: str
    sha256: str
    size: int  # bytes
    urls: tuple[str, ...]  # tried in turn
    by_hand: str  # a command that gets the same file by other means


def fetch_archive(archive: Archive, folder: Path, say: Callable[[str], None]) -> Path:
    """The archive in ``folder``: an existing file, or else the missing rest of the file, or all of it, is downloaded.

    Raises
    ------
    BadInput
        Where a different file of this name exists.
    UsageError
        Where no address gives the file, with the reason for each and what to do.
    """
    folder.mkdir(parents=True, exist_ok=True)
    target, part = folder / archive.name, folder / f"{archive.name}.part"
    if target.exists():
        if sha256_of(target) != archive.sha256:
            raise BadInput(
                f"{target}: is not {archive.name} as it was published (expected SHA-256 {archive.sha256}): it is cut "
                f"off, or another version. Remove it, or replace it: {archive.by_hand}"
            )
        return target
    reasons = []
    for url in archive.urls:
        # A resumed file may have begun with other bytes; then it is downloaded again, once.
        for _ in range(2 if part.exists() else 1):
            reason = _try(archive, url, part, say)
            if not reason:
                part.replace(target)
                return target
            if part.exists():  # interrupted: the next address, or the next run, resumes there
                break
        reasons.append(f"  {url}: {reason}")
    raise UsageError(
        f"{archive.name} could not be downloaded:\n" + "\n".join(reasons) + "\nWithout a network here, or if these "
        f"addresses no longer have it, get the file by other means, for instance\n  {archive.by_hand}\nput it into "
        f"{folder}, and run the same command again."
    )


def _try(archive: Archive, url: str, part: Path, say: Callable[[str], None]) -> str:
    """Download the rest of ``part``; return the reason why it is not complete and right, empty if it is.

    A complete file with other bytes is removed.
    """
    from http.client import HTTPException

    try:
        _append(archive, url, part, say)
    except (OSError, HTTPException) as error:  # URLError, timeouts, a connection that breaks, a full disk
        return str(getattr(error, "reason", "") or error) or type(error).__name__
    size = part.stat().st_size
    if size < archive.size:
        return f"ended after {size:,} of {archive.size:,} bytes"
    if sha256_of(part) != archive.sha256:
        part.unlink()
        return f"gives another file (expected {archive.size:,} bytes with the SHA-256 {archive.sha256})"
    return ""


def _append(archive: Archive, url: str, part: Path, say: Callable[[str], None]) -> None:
    """Append the missing bytes to ``part``; start again if the server does not resume."""
    from urllib.request import Request, urlopen

    done = part.stat().st_size if part.exists() else 0
    if done >= archive.size:
        return
    headers = {"User-Agent": "detailbench"} | ({"Range": f"bytes={done}-"} if done else {})
    with urlopen(Request(url, headers=headers), timeout=TIMEOUT) as answer:
        done = done if answer.status == 206 else 0
        say(f"{url} ({archive.size / 1e6:.0f} MB{f', from {done / 1e6:.0f} MB on' if done else ''})")
        with part.open("ab" if done else "wb") as file:
            # One byte too many is enough to show that it is another file.
            while done <= archive.size and (block := answer.read(min(BLOCK, archive.size + 1 - done))):
                file.write(block)
                before, done = done, done + len(block)
                if before * REPORTS // archive.size < done * REPORTS // archive.size:
                    say(f"  {min(done / archive.size, 1):.0%}")


def sha256_of(file: Path) -> str:
    """The SHA-256 of a file's content in hexadecimal digits."""
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
