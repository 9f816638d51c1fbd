"""One sweep's folder, in which its jobs report."""

from __future__ import annotations

import contextlib
import json
import os
import platform
import shutil
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import StoreError
from ..results.files import write_atomically


@dataclass(frozen=True)
class Session:
    """One sweep's folder below the results, for the outcomes of its jobs. Its name identifies the waiting process."""

    results: Path
    name: str

    @classmethod
    def new(cls, results: Path) -> Session:
        """A session of this process."""
        return cls(results, f"{os.getpid()}-{_start_time(os.getpid())}-{platform.node()}")

    @property
    def folder(self) -> Path:
        """Where its files are."""
        return self.results / ".sweeps" / self.name

    @property
    def owner(self) -> tuple[int, str, str]:
        """Process id, start time and host of the front door."""
        pid, start, host = self.name.split("-", 2)
        return int(pid), start, host

    def is_watched(self) -> bool:
        """Whether the front door is still running, as far as this machine can tell."""
        pid, start, host = self.owner
        return host != platform.node() or _start_time(pid) == start

    def leave(self, name: str, **values: Any) -> None:
        """Record the outcome of one job."""
        write_atomically(self.folder / f"{name}.json", json.dumps(values).encode())

    def entries(self, known: Collection[str] = ()) -> Iterator[tuple[str, dict[str, Any]]]:
        """The entries of jobs so far, by name, in the order of the jobs; without the known names."""
        names = []
        with contextlib.suppress(OSError):
            names = [entry.name for entry in os.scandir(self.folder) if entry.name.endswith(".json")]
        for name in sorted(set(names).difference(known)):
            with contextlib.suppress(OSError, ValueError):
                yield name, json.loads((self.folder / name).read_text())

    def read(self) -> list[dict[str, Any]]:
        """The entries of all jobs, in order."""
        return [entry for _, entry in self.entries()]

    def has(self, name: str) -> bool:
        """Whether a job has recorded its outcome."""
        return (self.folder / f"{name}.json").exists()

    @contextlib.contextmanager
    def open(self) -> Iterator[Session]:
        """Clear the remains of killed sweeps; remove our own folder in the end."""
        shelf = self.folder.parent
        for old in [] if shelf.is_symlink() else shelf.glob("*-*-*"):  # never the target of a link
            with contextlib.suppress(ValueError, OSError):
                if not Session(self.results, old.name).is_watched():
                    shutil.rmtree(old)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StoreError(f"cannot write {self.folder}: {error.strerror}") from error
        try:
            yield self
        finally:
            shutil.rmtree(self.folder, ignore_errors=True)


def _start_time(pid: int) -> str:
    """When a process started, in ticks: it detects a reused id. Empty if there is none."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
        fields = stat.rpartition(")")[2].split()
        return "" if fields[0] == "Z" else fields[19]
    except OSError:
        import psutil

        try:
            return str(int(psutil.Process(pid).create_time() * 100))
        except psutil.NoSuchProcess:
            return ""
