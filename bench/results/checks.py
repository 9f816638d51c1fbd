"""Whether a file is a record: its metadata, columns and types, before anything else looks at them.

A results folder may come from anywhere and hold anything. Non-records are left out, with the reason; one that was
read and is wrong (not: cannot be opened, or is a table of another program) counts as damaged, and a run sets it
aside.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from ..own_folder import read_regular
from ..plan.cell import id_of
from .files import COLUMNS, MEASURED, META_KEY, SCHEMA_VERSION, STATUSES, split_of

if TYPE_CHECKING:
    import pyarrow as pa

T = TypeVar("T")
MOST_ROWS = 1_000_000  # of a record: a few bytes of a file can encode any number of them
MOST_BYTES = 1 << 30  # of a record in memory
NAME = re.compile(r"[0-9a-f]{12}-[0-9a-f]{16}")
DIRECTIONS = ("lower", "higher", "reference")
# Columns that every version writes in every row.
NEEDED = (
    *("cell", "fingerprint", "task", "dataset", "sensor", "method", "variant", "seed", "threads", "device", "host"),
    *("case", "case_index", "status", "finished"),
)
OF_THE_CELL = ("split", "method", "seed", "threads", "device")  # columns that are in a cell's plain values
# The types of metadata, by path; all but the first three may be missing.
META_TYPES: dict[str, type | tuple[type, ...]] = {
    "cell_id": str,
    "fingerprint": str,
    "planned": int,
    "schema_version": int,
    "finished": str,
    "cell": dict,
    **{f"cell.{kind}": dict for kind in ("task", "dataset", "sensor", "method")},
    "cell.method.name": str,
    "cell.metrics": list,
    "cell.metrics.*": dict,
    **{f"cell.{key}": int for key in ("seed", "cases", "threads")},
    **{f"cell.{key}": str for key in ("split", "device")},
    "ingredients": dict,
    "settings": dict,
    "settings.limit": dict,
    "settings.limit.*": (int, float),
    "settings.plugins": list,
    "settings.plugins.*": str,
    "settings.outputs": str,
    "settings.profile": str,
    "provenance": dict,
    "provenance.host": str,
    "provenance.plugins": dict,
    "provenance.plugins.*": dict,
    "provenance.plugins.*.file": str,
    "references": dict,
    "references.*": str,
    "sources": dict,
    "sources.*": dict,
    "sources.*.sha256": str,
    "sources.*.text": (str, type(None)),
}
WHOLE = ("cell", "ingredients", "settings", "provenance", "finished")  # used by run, why and reproduce


class NoRecord(Exception):
    """A file that is left out.

    Attributes
    ----------
    damaged : bool
        Whether it was read and is invalid.
    """

    def __init__(self, reason: str, *, damaged: bool = True):
        super().__init__(reason)
        self.damaged = damaged


def read_record(path: Path) -> tuple[pa.Table, dict[str, Any]]:
    """The rows of a record, with the documented columns and types, and its metadata.

    Raises
    ------
    NoRecord
        If the file is not a record, or cannot be read.
    FileNotFoundError
        If it is gone.
    """

    def read() -> tuple[pa.Table, dict[str, Any]]:
        table, meta = _raw(path)
        return checked_rows(table, meta), meta

    return guarded(read)


def read_raw(path: Path) -> tuple[pa.Table, dict[str, Any]]:
    """As :func:`read_record`, but without checking the rows: :func:`checked_together` does that for many records."""
    return guarded(lambda: _raw(path))


def _raw(path: Path) -> tuple[pa.Table, dict[str, Any]]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    file = pq.ParquetFile(pa.BufferReader(read_content(path)), page_checksum_verification=True)
    meta = checked_meta((file.metadata.metadata or {}).get(META_KEY))
    size = sum(file.metadata.row_group(i).total_byte_size for i in range(file.metadata.num_row_groups))
    if file.metadata.num_rows > MOST_ROWS or size > MOST_BYTES:
        raise NoRecord(f"holds {file.metadata.num_rows:,} rows ({size / 1e6:,.0f} MB), more than any record")
    _check_name(path, meta)
    # Without pyarrow's threads: a record is small, and a thread that still ends when Python does can abort it.
    return file.read(use_threads=False), meta


def read_meta(path: Path) -> dict[str, Any]:
    """The metadata of a record; its rows are not read. Raises as :func:`read_record`."""
    import pyarrow.parquet as pq

    def read() -> dict[str, Any]:
        if not path.is_file():  # a FIFO would block
            raise NoRecord("is not a regular file", damaged=False)
        meta = checked_meta((pq.read_metadata(path).metadata or {}).get(META_KEY))
        _check_name(path, meta)
        return meta

    return guarded(read)


def read_content(path: Path) -> bytes:
    """The bytes of a file; one that cannot be opened is not damaged."""
    try:
        return read_regular(path)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise NoRecord(f"cannot be read: {error.strerror or error}", damaged=False) from error


def guarded(read: Callable[[], T]) -> T:
    """The result of ``read``; its exceptions for a file that is not a record become :class:`NoRecord`."""
    import pyarrow as pa

    try:
        return read()
    except (NoRecord, FileNotFoundError):
        raise
    except MemoryError as error:
        raise NoRecord("does not fit into memory", damaged=False) from error
    except (pa.ArrowException, OSError, ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise NoRecord(f"is not a complete Parquet file ({reason})") from error


# -- metadata ----------------------------------------------------------------------------------------------------------


def checked_meta(content: bytes | None) -> dict[str, Any]:
    """The metadata of a record.

    Raises
    ------
    NoRecord
        If they do not match :data:`META_TYPES`, or if the cell does not match its id.
    """
    if content is None:
        raise NoRecord("is not a record of detailbench (it lacks its metadata)", damaged=False)
    try:
        meta = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise NoRecord("its metadata are not JSON") from error
    if not isinstance(meta, dict):
        raise NoRecord("its metadata are not a JSON object")
    for key in ("cell_id", "fingerprint", "planned"):
        if key not in meta:
            raise NoRecord(f"its metadata lack {key!r}")
    for key, kind in META_TYPES.items():
        for value in _values(meta, key.split(".")):
            if not isinstance(value, kind) or isinstance(value, bool):
                raise NoRecord(f"its metadata hold {key} of the type {type(value).__name__}")
    if "name" not in meta.get("cell", {}).get("method", {"name": ""}):
        raise NoRecord("its metadata lack the name of the method")
    if meta.get("schema_version", 0) > SCHEMA_VERSION:
        raise NoRecord(
            f"is of schema version {meta['schema_version']}, of a later detailbench; this one reads versions up to "
            f"{SCHEMA_VERSION}",
            damaged=False,
        )
    if "cell" in meta and id_of(meta["cell"]) != meta["cell_id"]:
        raise NoRecord(f"its cell does not match its id {meta['cell_id'][:40]!r}")
    return meta


def _values(value: Any, path: list[str]) -> Iterable[Any]:
    """The values at a path; ``*`` is every entry."""
    if not path:
        return [value]
    key, *rest = path
    if isinstance(value, dict):
        inner = value.values() if key == "*" else [value[key]] if key in value else []
    else:
        inner = value if key == "*" and isinstance(value, list) else []
    return [found for one in inner for found in _values(one, rest)]


def lacks(meta: Mapping[str, Any]) -> list[str]:
    """The metadata that a record lacks, for instance one written by other software."""
    parts = ["limit"] if "limit" not in meta.get("settings", {}) else []
    return [key for key in WHOLE if key not in meta] + [f"settings.{key}" for key in parts if "settings" in meta]


def _check_name(path: Path, meta: Mapping[str, Any]) -> None:
    """Check that the file is named after its record, which is found by that name."""
    expected = f"{meta['cell_id']}-{meta['fingerprint']}"
    if path.stem != expected:
        reason = f"holds the record {expected[:40]}, which does not match its file name"
        raise NoRecord(reason, damaged=NAME.fullmatch(path.stem) is not None)


# -- rows --------------------------------------------------------------------------------------------------------------


def checked_rows(table: pa.Table, meta: Mapping[str, Any]) -> pa.Table:
    """The rows of a record with the documented columns, in their types; other columns are left out.

    Raises
    ------
    NoRecord
        If a column has another type or impossible values, or if the rows do not match the metadata.
    """
    table = checked_types(table)
    if not table.num_rows or table.num_rows != meta["planned"]:
        raise NoRecord("its rows do not match its metadata")
    if table["split"].null_count:  # rows of versions below 4
        place = table.column_names.index("split")
        table = table.set_column(place, "split", table["split"].fill_null(split_of(meta)))
    check_values(table)
    places = table["case_index"].unique().to_pylist()
    if len(places) < table.num_rows or min(places) < 0 or len(table["case"].unique()) < table.num_rows:
        raise NoRecord("two of its rows have the same case")
    wanted = {"cell": meta["cell_id"], "fingerprint": meta["fingerprint"]} | of_the_cell(meta.get("cell", {}))
    for name in ("cell", "fingerprint", *OF_THE_CELL):
        values = table[name].unique().to_pylist()
        if len(values) > 1 or values[0] != wanted.get(name, values[0]):
            raise NoRecord(f"its rows do not all belong to the cell of its metadata: {name} is {str(values)[:80]}")
    return table


def checked_together(entries: Sequence[tuple[pa.Table, Mapping[str, Any]]]) -> pa.Table | None:
    """:func:`checked_rows` of many records with the same columns at once, which takes a tenth of the time.

    Parameters
    ----------
    entries : rows and metadata of each record

    Returns
    -------
    Table
        Of all rows, in order; None if any record is invalid or unusual: each must then be
        checked by itself.
    """
    import numpy as np
    import pyarrow as pa
    import pyarrow.compute as pc

    lengths = np.array([table.num_rows for table, _ in entries])
    wanted = [
        {"cell": m["cell_id"], "fingerprint": m["fingerprint"]} | of_the_cell(m.get("cell", {})) for _, m in entries
    ]
    names = ("cell", "fingerprint", *OF_THE_CELL)
    if any(len(of) < len(names) for of in wanted) or not (lengths > 0).all():
        return None
    if lengths.tolist() != [meta["planned"] for _, meta in entries]:
        return None
    try:
        rows = checked_types(pa.concat_tables([table for table, _ in entries]).combine_chunks())
        if rows["split"].null_count:
            return None
        check_values(rows)
        for name in names:
            expected = np.repeat(np.array([of[name] for of in wanted], dtype=object), lengths)
            if not pc.all(pc.equal(rows[name], pa.array(expected, rows[name].type))).as_py():
                return None
    except (NoRecord, pa.ArrowException, ValueError, TypeError):
        return None
    record = np.repeat(np.arange(len(entries)), lengths)
    places = rows["case_index"].to_numpy()
    cases = rows["case"].dictionary_encode().combine_chunks()
    codes = (cases.chunk(0) if isinstance(cases, pa.ChunkedArray) else cases).indices.to_numpy()
    unique = all(len(set(zip(record.tolist(), of.tolist(), strict=True))) == len(of) for of in (places, codes))
    return rows if unique and (places >= 0).all() else None


def of_the_cell(cell: Mapping[str, Any]) -> dict[str, Any]:
    """The columns that describe the cell in every row, from its plain values."""
    return {key: cell[key]["name"] if key == "method" else cell[key] for key in OF_THE_CELL if key in cell}


def checked_types(table: pa.Table, columns: Iterable[str] = COLUMNS) -> pa.Table:
    """A table with the documented columns alone, all of the documented types; those that it lacks are empty.

    Raises
    ------
    NoRecord
        If a column has another type, if two have the same name, or if a text is not UTF-8.
    """
    import pyarrow as pa

    names = table.column_names
    chosen = [name for name in names if name in COLUMNS or name.startswith(MEASURED)]
    if len(set(chosen)) < len(chosen):
        raise NoRecord("has two columns of the same name")
    types = {"string": pa.string(), "int64": pa.int64(), "float64": pa.float64()}
    fields = []
    for name in chosen:
        kind, found = COLUMNS.get(name, "float64"), table.schema.field(name).type
        fits = {
            "string": pa.types.is_string(found) or pa.types.is_large_string(found),
            "int64": pa.types.is_integer(found),
            "float64": pa.types.is_floating(found) or pa.types.is_integer(found),
        }[kind]
        if not fits and not pa.types.is_null(found):
            raise NoRecord(f"its column {name} is of the type {found}; expected {kind}")
        fields.append(pa.field(name, types[kind]))
    table = table.select(chosen)
    table.validate(full=True)
    table = table.cast(pa.schema(fields))
    for name in columns:
        if name not in chosen:
            table = table.append_column(name, pa.nulls(table.num_rows, types[COLUMNS[name]]))
    return table


def check_values(table: pa.Table) -> None:
    """Check the columns that every row must have, and those whose text is parsed.

    Raises
    ------
    NoRecord
        For a value that no record can have.
    """
    for name in NEEDED:
        if table[name].null_count:
            raise NoRecord(f"its column {name} is missing, or empty in some rows")
    unknown = set(table["status"].unique().to_pylist()) - {*STATUSES}
    if unknown:
        raise NoRecord(f"a status is {str(unknown.pop())[:40]!r}; expected one of {', '.join(STATUSES)}")
    for text in table["directions"].unique().to_pylist():
        if text and not _is_directions(text):
            raise NoRecord(f"its column directions holds {text[:40]!r}")


def _is_directions(text: str) -> bool:
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        return False
    return isinstance(found, dict) and all(word in DIRECTIONS for word in found.values())
