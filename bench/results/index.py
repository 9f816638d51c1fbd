"""The index of a results folder: all rows in one file, so that the second leaderboard is quick.

``.index/rows.parquet`` holds the rows of every record, each with the name of its file; its metadata holds the size
and modification time of every file when it was read. Rows of changed or removed files are updated; a missing or
damaged index is made anew, and one that lies behind a link is left alone.
"""

from __future__ import annotations

import contextlib
import functools
import json
import os
import signal
import time
from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import StoreError
from ..own_folder import read_regular
from .checks import NoRecord, check_values, checked_rows, checked_together, checked_types, guarded, lacks, read_raw
from .files import COLUMNS, IDENTITY, NOT_INDEXED, ORDER, SCHEMA_VERSION, WRITTEN, newest, write_atomically

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

    from .store import Results

FILE = "__file"  # columns internal to this module
FOLDER = "__folder"
# The columns that decide whether a case must be run again.
STATE = ("case_index", "status", "stage", "message", "output", "limit_seconds", "limit_memory_gb")
MANY = 5000  # files, from which on two processes are worth starting
PART = 2000  # files after which such a process returns what it has read
BATCH = 256  # files whose small tables are merged at once: ten thousand separate ones are mostly overhead


def rows(folders: Sequence[Results], *, use_index: bool, of: Collection[tuple[str, str]] | None = None) -> pd.DataFrame:
    """Every row below the folders; if several records have one place in a table, the one in use.

    With ``of``, only those of these records (cell and fingerprint).
    """
    import pandas as pd

    frames = [_gathered(results, use_index).assign(**{FOLDER: i}) for i, results in enumerate(folders)]
    filled = [frame for frame in frames if len(frame)]
    frame = pd.concat(filled, ignore_index=True) if len(filled) > 1 else (filled or frames)[0]
    if of is not None:
        pairs = pd.MultiIndex.from_frame(frame[["cell", "fingerprint"]])
        frame = frame[pairs.isin(list(of))] if len(of) else frame.iloc[:0]
    several = frame.duplicated(list(IDENTITY), keep=False).to_numpy()
    if several.any():
        frame = newest(_weighed(frame, several, folders))
    return frame.drop(columns=[c for c in (FILE, WRITTEN, FOLDER, *ORDER) if c in frame]).reset_index(drop=True)


def states(results: Results) -> tuple[dict[tuple[str, str], list[dict[str, Any]]], set[str]]:
    """The columns of every record that decide whether a cell is finished: files in a current index are not opened.

    Returns
    -------
    rows : dict
        By cell and fingerprint, the columns :data:`STATE` of every row.
    lacking : set of str
        Names of the records whose metadata are incomplete (:func:`bench.results.checks.lacks`).
    """
    table, _, lacking = _merged(results, use_index=True)
    found: dict[tuple[str, str], list[dict[str, Any]]] = {}
    if table is not None:
        columns = [table[name].to_pylist() for name in ("cell", "fingerprint", *STATE)]
        for cell, mark, *values in zip(*columns, strict=True):
            found.setdefault((cell, mark), []).append(dict(zip(STATE, values, strict=True)))
    return found, lacking


def _gathered(results: Results, use_index: bool) -> pd.DataFrame:
    """Every row below one folder, with the name and the time of its file."""
    merged, files, _ = _merged(results, use_index)
    if merged is None:
        return _empty()
    frame = merged.to_pandas()
    return frame.assign(**{WRITTEN: frame[FILE].map({name: mtime / 1e9 for name, (_, mtime, _) in files.items()})})


Files = dict[str, tuple[Path, int, int]]


def _merged(results: Results, use_index: bool) -> tuple[pa.Table | None, Files, set[str]]:
    """The rows of all records, None without any; all files; and the names of those with incomplete metadata."""
    import pyarrow as pa

    files = {p.name: (p, s.st_mtime_ns, s.st_size) for p, s in results._files()}
    folder = results.folder / ".index"
    known, lacking, table = _load(folder) if use_index else ({}, set(), None)
    seen = {name: [mtime, size] for name, (_, mtime, size) in files.items()}
    named = set(table[FILE].unique().to_pylist()) if table is not None else set()
    kept = {name for name in named if name in files and known.get(name) == seen[name]}

    tables = []
    if table is not None:
        if named - kept:
            import pyarrow.compute as pc

            table = table.filter(pc.is_in(table[FILE], value_set=pa.array(sorted(kept), pa.string())))
        tables.append(table)
    read, found = _read_all(results, [files[name][0] for name in sorted(files.keys() - kept)])
    lacking = (lacking & kept) | found
    tables.extend(read)
    if not tables:
        return None, files, lacking
    merged = pa.concat_tables(tables, promote_options="permissive") if len(tables) > 1 else tables[0]
    if use_index and (read or named - kept):
        _save(folder, seen, lacking, merged)
    return merged, files, lacking


def _weighed(frame: pd.DataFrame, several: np.ndarray, folders: Sequence[Results]) -> pd.DataFrame:
    """The rows with the columns ORDER: whether they are current, and when they were made.

    Only rows that share a place with others are checked.
    """
    from .current import Today, timestamp

    now, today = time.time(), Today()
    rivals = frame[several]
    _warn_of_the_future(rivals, folders, now)
    when = [timestamp(f, w, now) for f, w in zip(rivals["finished"], rivals[WRITTEN], strict=True)]
    others = rivals.drop_duplicates([*IDENTITY, "cell", "fingerprint"])
    others = others[others.duplicated(list(IDENTITY), keep=False)]  # two copies of one record do not count
    current = {
        (folders[folder].folder, cell, fingerprint)
        for folder, cell, fingerprint in dict.fromkeys(_keys(others))
        if today.is_current(folders[folder].meta(cell, fingerprint))
    }
    is_current = [(folders[f].folder, cell, fingerprint) in current for f, cell, fingerprint in _keys(rivals)]
    columns = {name: np.zeros(len(frame)) for name in ORDER}
    ordered: tuple[Sequence[float], ...] = (is_current, when)
    for name, values in zip(ORDER, ordered, strict=True):
        columns[name][several] = values
    return frame.assign(**columns)


def _keys(frame: pd.DataFrame) -> Iterator[tuple[int, str, str]]:
    return zip(frame[FOLDER], frame["cell"], frame["fingerprint"], strict=True)


def _warn_of_the_future(rivals: pd.DataFrame, folders: Sequence[Results], now: float) -> None:
    """Report the records with an impossible date."""
    from .current import seconds_of

    dated = rivals.drop_duplicates([FOLDER, FILE, "finished"])
    ahead = dated[[seconds_of(finished) > now for finished in dated["finished"]]].drop_duplicates([FOLDER, FILE])
    for folder, name, finished in zip(ahead[FOLDER], ahead[FILE], ahead["finished"], strict=True):
        folders[folder].damaged.append(
            f"{name}: is dated {finished}, in the future; the time of its file is used instead"
        )


def _read_all(results: Results, paths: list[Path]) -> tuple[list[pa.Table], set[str]]:
    """:func:`_read_some` of all files; very many are read by two processes, a part at a time.

    Half of the work is Python code, which threads cannot run in parallel.
    """
    if len(paths) < MANY or (os.cpu_count() or 1) < 2:
        return _read_some(results, paths, 4)
    parts = [paths[begin : begin + PART] for begin in range(0, len(paths), PART)]
    try:
        with ProcessPoolExecutor(2, get_context("spawn"), signal.signal, (signal.SIGINT, signal.SIG_IGN)) as pool:
            done = list(pool.map(_read_part, [results] * len(parts), parts))
    except (OSError, BrokenExecutor):  # no semaphores, too many processes, or one was killed
        return _read_some(results, paths, 4)
    known = len(results.damaged)
    tables, lacking = [], set()
    for of_part, lacking_there, read in done:
        tables += of_part
        lacking |= lacking_there
        results.damaged += read.damaged[known:]
        results._noted |= read._noted
    return tables, lacking


def _read_part(results: Results, paths: Sequence[Path]) -> tuple[list[pa.Table], set[str], Results]:
    """The work of another process, with its own list of files that were left out."""
    return *_read_some(results, paths, 1), results


def _read_some(results: Results, paths: Sequence[Path], threads: int) -> tuple[list[pa.Table], set[str]]:
    """The tables of some record files, and the names of those with incomplete metadata.

    Files that are not records are left out and reported.
    """
    import pyarrow as pa

    lacking: set[str] = set()

    def read(path: Path) -> Entry | Exception:
        try:
            return path, *read_raw(path)
        except (NoRecord, FileNotFoundError) as error:
            return error

    merged = []
    with ThreadPoolExecutor(threads) as pool:
        for begin in range(0, len(paths), BATCH):
            batch, good = paths[begin : begin + BATCH], []
            for path, entry in zip(batch, pool.map(read, batch), strict=True):
                if isinstance(entry, NoRecord):
                    results.leave_out(path, entry)
                elif not isinstance(entry, Exception):
                    good.append(entry)
            lacking |= {path.name for path, _, meta in good if lacks(meta)}
            if tables := [table for alike in _alike(good) for table in _checked(results, alike)]:
                merged.append(pa.concat_tables(tables, promote_options="permissive").combine_chunks())
    return merged, lacking


Entry = tuple[Path, "pa.Table", dict[str, Any]]


def _alike(entries: Sequence[Entry]) -> Iterator[list[Entry]]:
    """The entries in groups of those whose tables have the same columns."""
    groups: list[tuple[pa.Schema, list[Entry]]] = []
    for path, table, meta in entries:
        table = table.replace_schema_metadata(None)
        alike = next((group for schema, group in groups if schema.equals(table.schema)), None)
        if alike is None:
            alike = []
            groups.append((table.schema, alike))
        alike.append((path, table, meta))
    return (group for _, group in groups)


def _checked(results: Results, entries: Sequence[Entry]) -> Iterator[pa.Table]:
    """The rows of records, with the names of their files; invalid ones are left out."""
    import pyarrow as pa

    together = checked_together([(table, meta) for _, table, meta in entries])
    if together is not None:
        names = [path.name for path, table, _ in entries for _ in range(table.num_rows)]
        yield _indexed(together).append_column(FILE, pa.array(names, pa.string()))
        return
    for path, table, meta in entries:
        try:
            rows = guarded(functools.partial(checked_rows, table, meta))
        except NoRecord as error:
            results.leave_out(path, error)
        else:
            yield _indexed(rows).append_column(FILE, pa.array([path.name] * rows.num_rows, pa.string()))


def _indexed(table: pa.Table) -> pa.Table:
    return table.drop_columns([c for c in NOT_INDEXED if c in table.column_names]).replace_schema_metadata(None)


def _load(folder: Path) -> tuple[dict[str, Any], set[str], pa.Table | None]:
    """The index as last saved, or nothing if it is unusable."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.ParquetFile(pa.BufferReader(read_regular(folder / "rows.parquet"))).read()
        known = dict(json.loads(table.schema.metadata[b"files"]))
        lacking = set(map(str, json.loads(table.schema.metadata[b"lacking"])))
        names = table[FILE].cast(pa.string())
        table = checked_types(table, [name for name in COLUMNS if name not in NOT_INDEXED])
        check_values(table)
        if known.pop("schema_version") != SCHEMA_VERSION or names.null_count:
            return {}, set(), None
    except (NoRecord, OSError, ValueError, KeyError, TypeError, RecursionError, pa.ArrowException):
        return {}, set(), None
    return known, lacking, table.replace_schema_metadata(None).append_column(FILE, names)


def _save(folder: Path, seen: dict[str, Any], lacking: set[str], table: pa.Table) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    sink = pa.BufferOutputStream()
    named = set(table[FILE].unique().to_pylist())
    files = {name: stamp for name, stamp in seen.items() if name in named}
    if folder.is_symlink():
        return
    meta = {
        b"files": json.dumps({"schema_version": SCHEMA_VERSION, **files}).encode(),
        b"lacking": json.dumps(sorted(lacking)).encode(),
    }
    pq.write_table(table.replace_schema_metadata(meta), sink, compression="zstd")
    with contextlib.suppress(StoreError):  # a leaderboard also works on a read-only folder
        write_atomically(folder / "rows.parquet", sink.getvalue().to_pybytes())


def _empty() -> pd.DataFrame:
    import pandas as pd

    return pd.DataFrame({name: [] for name in COLUMNS if name not in NOT_INDEXED})
