"""The index of a results folder: all rows in one file, so that the second leaderboard is quick.

``.index/rows.parquet`` holds the rows of every record, each with the name of its file; its metadata holds the size
and modification time of every file when it was read. Rows of files that changed or went are read again; a missing or
damaged index is made anew.
"""

from __future__ import annotations

import contextlib
import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .errors import StoreError
from .store import COLUMNS, META_KEY, NOT_INDEXED, SCHEMA_VERSION, newest, split_of, write_atomically

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

    from .store import Results

FILE = "__file"
BATCH = 256  # files read before their small tables are made one: ten thousand of them are mostly overhead


def rows(results: Results, *, use_index: bool) -> pd.DataFrame:
    """Every row below ``results``, the newest record of each."""
    import pyarrow as pa

    files = {p.name: (p, s.st_mtime_ns, s.st_size) for p, s in results._files()}
    folder = results.folder / ".index"
    known, table = _load(folder) if use_index else ({}, None)
    seen = {name: [mtime, size] for name, (_, mtime, size) in files.items()}
    fresh = [name for name in files if known.get(name) != seen[name]]
    gone = [name for name in known if name not in files or name in set(fresh)]

    tables = []
    if table is not None:
        if gone:
            import pyarrow.compute as pc

            table = table.filter(pc.invert(pc.is_in(table[FILE], value_set=pa.array(gone))))
        tables.append(table)
    tables.extend(_read_all(results, [files[name][0] for name in sorted(fresh)]))
    if not tables:
        return _empty()
    merged = pa.concat_tables(tables, promote_options="permissive") if len(tables) > 1 else tables[0]
    if use_index and (fresh or gone):
        _save(folder, seen, merged)
    return newest(merged.drop_columns([FILE]).to_pandas())


def _read_all(results: Results, paths: list[Path]) -> list[pa.Table]:
    """The tables of some record files; a damaged one is set aside and reported."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    def read(path: Path) -> pa.Table | Exception:
        try:
            table = pq.ParquetFile(path, page_checksum_verification=True).read()
            if "fingerprint" not in table.column_names or not table.num_rows:
                raise ValueError("it is no record of detailbench")
            if "split" not in table.column_names:
                split = split_of(json.loads((table.schema.metadata or {}).get(META_KEY, b"{}")))
                table = table.append_column("split", pa.array([split] * table.num_rows, pa.string()))
        except (pa.ArrowException, OSError, ValueError) as error:
            return error
        table = table.drop_columns([c for c in NOT_INDEXED if c in table.column_names]).replace_schema_metadata(None)
        return table.append_column(FILE, pa.array([path.name] * table.num_rows, pa.string()))

    merged = []
    with ThreadPoolExecutor(4) as pool:
        for begin in range(0, len(paths), BATCH):
            batch, good = paths[begin : begin + BATCH], []
            for path, table in zip(batch, pool.map(read, batch), strict=True):
                if isinstance(table, FileNotFoundError):
                    continue
                if isinstance(table, Exception):
                    results._set_aside(path, table)
                else:
                    good.append(table)
            if good:
                merged.append(pa.concat_tables(good, promote_options="permissive").combine_chunks())
    return merged


def _load(folder: Path) -> tuple[dict[str, Any], pa.Table | None]:
    """The index as it was left, or nothing when it cannot be used."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.ParquetFile(folder / "rows.parquet").read()
        known = json.loads(table.schema.metadata[b"files"])
        if known.pop("schema_version") != SCHEMA_VERSION:
            return {}, None
    except (OSError, ValueError, KeyError, TypeError, pa.ArrowException):
        return {}, None
    return known, table.replace_schema_metadata(None)


def _save(folder: Path, seen: dict[str, Any], table: pa.Table) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    sink = pa.BufferOutputStream()
    named = set(table[FILE].unique().to_pylist())
    files = {name: stamp for name, stamp in seen.items() if name in named}
    meta = {b"files": json.dumps({"schema_version": SCHEMA_VERSION, **files}).encode()}
    pq.write_table(table.replace_schema_metadata(meta), sink, compression="zstd")
    with contextlib.suppress(StoreError):  # results that can only be read still make a leaderboard
        write_atomically(folder / "rows.parquet", sink.getvalue().to_pybytes())


def _empty() -> pd.DataFrame:
    import pandas as pd

    return pd.DataFrame({name: [] for name in COLUMNS if name not in NOT_INDEXED})
