"""Results on disk: one Parquet file per finished cell, written to a temporary name and renamed.

::

    DIR/cells/ab/ab12cd34ef56-0123456789abcdef.parquet   cell id - fingerprint; one row per planned case
    DIR/.partial/...jsonl                                finished cases of a cell that is still running
    DIR/.locks/ab12cd34ef56                              held by the process that runs the cell
    DIR/.index/                                          all rows in one file, rebuilt when stale
    DIR/.sweeps/SESSION/                                 the progress of a running sweep; removed when it ends
    DIR/damaged/                                         invalid files, set aside by a run
    DIR/outputs/CELL-FINGERPRINT/CASE.ply                stored outputs (outputs=first|all)
    DIR/trainings/...                                    weights of learned methods (bench/engine/training.py)
    DIR/outputs/CELL-FINGERPRINT/CASE/NAME.*             and files stored by their methods (run.keep)

Every file is independent, so the results of two machines are merged by copying one folder into the other. The columns
and the metadata are described in docs/results.md.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import stat
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from ..errors import StoreError, UsageError, did_you_mean
from ..own_folder import open_own, read_regular
from ..text import cut, encodable
from .checks import NAME, NEEDED, NoRecord, read_meta, read_record
from .files import COLUMNS, MEASURED, META_KEY, NOT_INDEXED, STATUSES, write_atomically
from .kept_outputs import found, found_reference

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa


@dataclass
class Record:
    """A finished cell: its metadata and one row per planned case."""

    cell: str
    fingerprint: str
    meta: dict[str, Any]
    rows: list[dict[str, Any]] = field(default_factory=list)

    @property
    def solved(self) -> int:
        """How many cases are ``ok``."""
        return sum(row["status"] == "ok" for row in self.rows)


class Results:
    """A folder of results.

    Parameters
    ----------
    folder : path
    mends : bool
        Whether invalid files are set aside, as a run does; readers move nothing.
    """

    def __init__(self, folder: str | Path, *, mends: bool = False):
        try:
            self.folder = Path(folder).expanduser().absolute()
            self.folder.exists()
        except (OSError, RuntimeError) as error:  # an invalid name, or the home of an unknown user
            reason = error.strerror if isinstance(error, OSError) else error
            raise UsageError(f"results={cut(str(folder), 100)}: cannot be a folder: {reason}") from error
        self.mends = mends
        self.damaged: list[str] = []  # the files that were left out, and why, for the report
        self._noted: set[Path] = set()

    def prepare(self) -> None:
        """Make the folder and check that it is writable.

        Raises
        ------
        StoreError
            If it cannot.
        """
        if self.folder.exists() and not self.folder.is_dir():
            raise StoreError(f"results={self.folder}: is a file; expected a folder")
        probe = self.folder / ".sweeps" / f".probe-{os.getpid()}"
        write_atomically(probe, bytes(1 << 16))  # a full disk accepts an empty file, but no content
        probe.unlink(missing_ok=True)

    # -- one record ------------------------------------------------------------------------------------------------

    def path(self, cell: str, fingerprint: str) -> Path:
        """The path of the record of a cell under a fingerprint."""
        return self.folder / "cells" / cell[:2] / f"{cell}-{fingerprint}.parquet"

    def read(self, cell: str, fingerprint: str) -> Record | None:
        """The record, or None when there is none; an invalid file is left out and reported in ``damaged``."""
        return self._read(self.path(cell, fingerprint))

    def _read(self, path: Path) -> Record | None:
        try:
            table, meta = read_record(path)
        except FileNotFoundError:
            return None
        except NoRecord as error:
            self.leave_out(path, error)
            return None
        return Record(
            meta["cell_id"], meta["fingerprint"], meta, [dict.fromkeys(COLUMNS) | row for row in table.to_pylist()]
        )

    def leave_out(self, path: Path, why: NoRecord) -> None:
        """Report, once, that a file is left out; a run sets it aside if it was read and is invalid."""
        if path in self._noted:
            return
        self._noted.add(path)
        if not why.damaged:
            self.damaged.append(f"{path}: left out: {why}")
        elif not self.mends:
            self.damaged.append(f"{path}: damaged ({why}); left out")
        elif target := self._set_aside(path):
            self.damaged.append(f"{path}: damaged ({why}); set aside as {target}, its cell will be computed again")
        else:
            self.damaged.append(f"{path}: damaged ({why}) and could not be set aside; left out")

    def _set_aside(self, path: Path) -> Path | None:
        """Move a file to ``damaged``, without replacing anything; None if it cannot be moved."""
        folder = self.folder / "damaged"
        try:
            folder.mkdir(exist_ok=True)
            if folder.is_symlink():
                return None
            target, number = folder / path.name, 1
            while os.path.lexists(target):
                target, number = folder / f"{path.stem}.{number}{path.suffix}", number + 1
            os.replace(path, target)
        except OSError:
            return None
        return target

    def write(self, record: Record) -> None:
        """Write a finished cell and delete its partial file."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        sink = pa.BufferOutputStream()
        table = _table(record)
        # A record has few rows: reading many small compressed columns takes three times as long, and saves no space.
        # Without dictionaries, statistics and a second copy of the metadata a file is a third as large.
        long = {name: "zstd" if name in NOT_INDEXED else "none" for name in table.column_names}
        slim = {"use_dictionary": False, "write_statistics": False, "store_schema": False}
        meta = table.schema.metadata
        with pq.ParquetWriter(sink, table.schema, compression=long, write_page_checksum=True, **slim) as writer:
            writer.write_table(table)
            writer.add_key_value_metadata(meta)
        write_atomically(self.path(record.cell, record.fingerprint), sink.getvalue().to_pybytes())
        with contextlib.suppress(OSError):
            self._partial(record.cell, record.fingerprint).unlink(missing_ok=True)

    def records(self, cell: str) -> list[Record]:
        """All records of a cell, the newest first; see :func:`bench.results.current.timestamp`."""
        from .current import timestamp

        now = time.time()
        found = []
        for path in sorted((self.folder / "cells" / cell[:2]).glob(f"{cell}-*.parquet")):
            with contextlib.suppress(FileNotFoundError):
                written = path.stat().st_mtime
                if record := self._read(path):
                    found.append((timestamp(record.meta.get("finished"), written, now), record))
        return [record for _, record in sorted(found, key=lambda pair: pair[0], reverse=True)]

    def fingerprints(self, cell: str) -> list[str]:
        """Those of a cell's records, without reading them."""
        return sorted(
            path.stem.partition("-")[2] for path in (self.folder / "cells" / cell[:2]).glob(f"{cell}-*.parquet")
        )

    def find_cell(self, prefix: str) -> str:
        """The one cell id that begins with ``prefix``.

        Raises
        ------
        UsageError
            If there is none, or several.
        """
        ids = sorted({path.stem.partition("-")[0] for path, _ in self._files() if NAME.fullmatch(path.stem)})
        found = [i for i in ids if i.startswith(prefix.lower())] if prefix else []
        if len(found) == 1:
            return found[0]
        if not ids:
            raise UsageError(f"{self.folder}: there are no results here; choose the folder with results=DIR")
        if not found:
            raise UsageError(f"no cell {prefix!r} in {self.folder}. {did_you_mean(prefix, ids[:50])}")
        raise UsageError(f"cell {prefix!r} is not unique in {self.folder}: {', '.join(found[:8])}")

    # -- cases of an unfinished cell -----------------------------------------------------------------------------------

    def _partial(self, cell: str, fingerprint: str) -> Path:
        return self.folder / ".partial" / f"{cell}-{fingerprint}.jsonl"

    def partial_rows(self, cell: str, fingerprint: str) -> list[dict[str, Any]]:
        """The cases that an interrupted run of this cell had finished; lines that are not rows are ignored.

        The last one may be cut off, and any may be damaged: its case is run again.
        """
        rows = []
        with contextlib.suppress(OSError):
            for line in read_regular(self._partial(cell, fingerprint)).split(b"\n"):
                with contextlib.suppress(ValueError, RecursionError):  # not JSON, or not UTF-8
                    rows.append(json.loads(line))
        names = {"cell": cell, "fingerprint": fingerprint}
        return [_plain(row) for row in rows if is_row(row, NEEDED) and names.items() <= row.items()]

    def add_partial(self, cell: str, fingerprint: str, row: Mapping[str, Any]) -> None:
        """Store one finished case, safe from whatever happens to this process next."""
        path = self._partial(cell, fingerprint)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with os.fdopen(open_own(path, os.O_WRONLY | os.O_APPEND), "ab") as file:
                # A line cut off by an earlier crash is closed first; empty lines are not rows.
                file.write(b"\n" + json.dumps(row).encode() + b"\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise StoreError(
                f"cannot write {path}: {error.strerror or error}. Earlier results are intact; free some space and run "
                "the same command again"
            ) from error

    def forget_partial(self, cell: str, fingerprint: str) -> None:
        """Drop the cases of an unfinished cell, to run them again."""
        with contextlib.suppress(OSError):
            self._partial(cell, fingerprint).unlink(missing_ok=True)

    @contextlib.contextmanager
    def lock(
        self, cell: str, alive: Callable[[], None] | None = None, waits: Callable[[], None] = lambda: None
    ) -> Iterator[None]:
        """Hold a cell, or a training: two sweeps into one folder share the work. The system releases it when the holder
        dies.

        Parameters
        ----------
        cell : the name of the lock
        alive : called while waiting; raises to stop. Without it the wait cannot be stopped
        waits : called once if it has to wait; only with ``alive``
        """
        path = self.folder / ".locks" / cell
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            file = os.fdopen(open_own(path, os.O_RDWR), "r+")
        except OSError as error:
            raise StoreError(f"cannot write {path}: {error.strerror or error}; choose results=DIR") from error
        with file:
            with contextlib.suppress(OSError):  # a file system without locks: the worst is work done twice
                if alive is not None:
                    _wait(file, alive, waits)
                fcntl.flock(file, fcntl.LOCK_EX)
            yield

    # -- all rows --------------------------------------------------------------------------------------------------

    def _files(self) -> Iterator[tuple[Path, os.stat_result]]:
        """Every record file, and its stat, in no order."""
        for shelf in self._listed(self.folder / "cells"):
            for path in self._listed(shelf) if os.path.isdir(shelf) else ():
                if path.suffix != ".parquet" or path.name.startswith("."):
                    continue
                try:
                    found = path.stat()
                except OSError as error:  # for instance a broken link
                    self.leave_out(path, NoRecord(f"cannot be read: {error.strerror}", damaged=False))
                    continue
                if stat.S_ISREG(found.st_mode):
                    yield path, found
                else:
                    self.leave_out(path, NoRecord("is not a regular file", damaged=False))

    def _listed(self, folder: Path) -> list[Path]:
        """The entries of a folder; one that cannot be read is left out and reported."""
        try:
            with os.scandir(folder) as entries:
                return [Path(entry.path) for entry in entries]
        except FileNotFoundError:
            return []
        except OSError as error:
            self.leave_out(folder, NoRecord(f"cannot be read: {error.strerror}", damaged=False))
            return []

    def rows(self, *, use_index: bool = True, of: Collection[tuple[str, str]] | None = None) -> pd.DataFrame:
        """One row per planned case of every cell: the record in use if there are several.

        The first call reads every file; later ones read an index beside them and the files that changed since.

        Parameters
        ----------
        use_index : bool
        of : collection of (cell, fingerprint), optional
            Only these records, those of one run. Without it, of several records for one place in a table the one that
            is current is used if that is known (:mod:`bench.results.current`), and the newest otherwise.
        """
        from . import index

        return index.rows([self], use_index=use_index, of=of)

    def meta(self, cell: str, fingerprint: str) -> dict[str, Any]:
        """The metadata of a record, empty if it cannot be read; the rows are not read."""
        try:
            return read_meta(self.path(cell, fingerprint))
        except (NoRecord, FileNotFoundError):
            return {}

    def output_of(self, row: Mapping[str, Any]) -> Path | None:
        """The file of a row's stored output, wherever the folder is now; None if there is none."""
        return found(self.folder, row.get("output"))

    def reference_of(self, row: Mapping[str, Any]) -> Path | None:
        """The file of the reference of a row's stored output; None if there is none."""
        return found_reference(self.folder, self.meta(row["cell"], row["fingerprint"]), row)


LOOK = 0.2  # seconds between looks at a lock that another process holds


def _wait(file: IO[str], alive: Callable[[], None], waits: Callable[[], None]) -> None:
    """Wait until the lock of a file is free, unless its file system has no locks."""
    said = False
    while True:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        except BlockingIOError:
            if not said:
                waits()
                said = True
            alive()
            time.sleep(LOOK)


def is_row(value: Any, needed: Iterable[str] = ("case", "case_index", "status")) -> bool:
    """Whether a value, from a partial file or from a worker, can become a row of a record."""
    if not isinstance(value, dict) or any(value.get(key) is None for key in needed):
        return False
    types = {**COLUMNS, **{key: "float64" for key in value if key.startswith(MEASURED)}}
    fits = all(value.get(key) is None or _fits(value[key], kind) for key, kind in types.items())
    return fits and value["case_index"] >= 0 and value["status"] in STATUSES


def _fits(value: Any, kind: str) -> bool:
    """Whether a value fits a column of this type."""
    if isinstance(value, int) and not isinstance(value, bool):
        return kind != "string" and -(2**63) <= value < 2**63
    return isinstance(value, {"string": str, "float64": float}.get(kind, ()))


def _plain(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row with the columns of a record, and the reference of its output, which is not a column."""
    plain = {}
    for key, value in row.items():
        if key in COLUMNS or key.startswith(MEASURED):
            is_float = COLUMNS.get(key, "float64") == "float64" and value is not None
            plain[key] = float(value) if is_float else encodable(value)
        elif key == "reference" and isinstance(value, str):
            plain[key] = encodable(value)
    return plain


def _table(record: Record) -> pa.Table:
    """The rows of a record as a table with the documented columns, the metadata in its schema."""
    import pyarrow as pa

    scores = sorted({key for row in record.rows for key in row if key.startswith(MEASURED)})
    types = {**COLUMNS, **dict.fromkeys(scores, "float64")}
    schema = pa.schema(
        [pa.field(name, _arrow_type(pa, kind)) for name, kind in types.items()],
        metadata={META_KEY: json.dumps(record.meta).encode()},
    )
    return pa.Table.from_pylist([{name: row.get(name) for name in types} for row in record.rows], schema=schema)


def _arrow_type(pa: Any, kind: str) -> pa.DataType:
    return {"string": pa.string(), "int64": pa.int64(), "float64": pa.float64()}[kind]
