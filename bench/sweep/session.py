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
    """One sweep's folder below the results, where its jobs leave what they did. Its name tells who waits for it."""

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
        """Whether the front door is there still, as far as can be seen from this machine."""
        pid, start, host = self.owner
        return host != platform.node() or _start_time(pid) == start

    def leave(self, name: str, **values: Any) -> None:
        """Leave word of one job."""
        write_atomically(self.folder / f"{name}.json", json.dumps(values).encode())

    def entries(self, known: Collection[str] = ()) -> Iterator[tuple[str, dict[str, Any]]]:
        """What jobs left by now, by name, in the order of the jobs; without the names that are known."""
        names = []
        with contextlib.suppress(OSError):
            names = [entry.name for entry in os.scandir(self.folder) if entry.name.endswith(".json")]
        for name in sorted(set(names).difference(known)):
            with contextlib.suppress(OSError, ValueError):
                yield name, json.loads((self.folder / name).read_text())

    def read(self) -> list[dict[str, Any]]:
        """What all jobs left, in the order of the jobs."""
        return [entry for _, entry in self.entries()]

    def has(self, name: str) -> bool:
        """Whether a job has left word."""
        return (self.folder / f"{name}.json").exists()

    @contextlib.contextmanager
    def open(self) -> Iterator[Session]:
        """Clear what killed sweeps left behind; remove our own folder in the end."""
        shelf = self.folder.parent
        for old in [] if shelf.is_symlink() else shelf.glob("*-*-*"):  # never what a link leads to
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
    """When a process started, in ticks: an id that is used again does not fool us. Empty when there is none."""
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
