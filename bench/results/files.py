"""The columns of a record, and files that are written wholly or not at all."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import StoreError

if TYPE_CHECKING:
    import pandas as pd


# Column version. 5: without reference_seconds, exchange_seconds and external; 4: and without those of weights and
# trainings; 3: and without split and worst.<key>; 2: and without active_parameters; 1: and without true_distances; all
# are read.
SCHEMA_VERSION = 6
META_KEY = b"detailbench"
STATUSES = ("ok", "error", "timeout", "oom", "crashed", "invalid", "skipped")

# Columns of every file, in order; measurements follow as input.<key>, score.<key>, floor.<key>, worst.<key>.
COLUMNS = {
    "schema_version": "int64",
    "cell": "string",
    "fingerprint": "string",
    "task": "string",
    "dataset": "string",
    "sensor": "string",
    "split": "string",
    "method": "string",
    "variant": "string",
    "seed": "int64",
    "threads": "int64",
    "device": "string",
    "host": "string",
    "case": "string",
    "case_index": "int64",
    "tags": "string",
    "status": "string",
    "stage": "string",
    "message": "string",
    "traceback": "string",
    "seconds": "float64",
    "cpu_seconds": "float64",
    "peak_rss_mb": "float64",
    "rss_before_mb": "float64",
    "peak_device_mb": "float64",
    "reference_seconds": "float64",
    "exchange_seconds": "float64",
    "external": "string",
    "parameters": "int64",
    "active_parameters": "int64",
    "true_distances": "int64",
    "weights": "string",
    "weights_from": "string",
    "train_seconds": "float64",
    "train_cpu_seconds": "float64",
    "train_device": "string",
    "train_data": "string",
    "train_cases": "int64",
    "train_steps": "int64",
    "output_points": "int64",
    "output_faces": "int64",
    "output": "string",
    "artefacts": "string",
    "trace": "string",
    "directions": "string",
    "limit_seconds": "float64",
    "limit_memory_gb": "float64",
    "started": "string",
    "finished": "string",
}
MEASURED = ("input.", "score.", "floor.", "worst.")
# Needed only by readers of a single record.
NOT_INDEXED = ("traceback", "trace", "artefacts")
# One result per place in a table; ORDER decides which of several records is used.
ORDER = ("__current", "__when")
WRITTEN = "__written"  # when the file was written: a record with rows taken from an earlier one has their times
IDENTITY = ("task", "dataset", "sensor", "split", "method", "variant", "seed", "threads", "device", "case")


def write_atomically(path: Path, content: bytes) -> None:
    """Write ``content`` under a temporary name beside ``path``, flush it to the disk, and rename it.

    Raises
    ------
    StoreError
        If the folder cannot be written or the disk is full. An existing file is untouched.
    """
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=".", suffix=".tmp", dir=path.parent)
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, path)
    except OSError as error:
        if temporary:
            with contextlib.suppress(OSError):
                os.unlink(temporary)
        raise StoreError(
            f"cannot write {path}: {error.strerror or error}. Earlier results are intact; free some space or choose "
            "another folder with results=DIR, then run the same command again: finished cells are not run twice"
        ) from error


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def split_of(meta: Mapping[str, Any]) -> str:
    """The split of a record's cases by its metadata: rows of versions below 4 lack the column."""
    cell = meta.get("cell")
    return cell.get("split", "test") if isinstance(cell, dict) else "test"


def newest(frame: pd.DataFrame) -> pd.DataFrame:
    """Of several rows for one place in a table, the one in use, and the results of other machines for that cell.

    The last by ``frame[ORDER]`` where these columns are given (current or not, and when it was made; see
    :mod:`bench.results.index`), by ``finished`` otherwise.
    """
    ordered = frame.sort_values([name for name in (*ORDER, WRITTEN) if name in frame] or "finished", kind="stable")
    last = ordered.drop_duplicates(subset=list(IDENTITY), keep="last")
    if frame["host"].nunique() > 1:
        current = last.set_index([*IDENTITY, "fingerprint"]).index
        same = ordered[ordered.set_index([*IDENTITY, "fingerprint"]).index.isin(current)]
        last = same.drop_duplicates(subset=[*IDENTITY, "host"], keep="last")
    return last.sort_index().reset_index(drop=True)
