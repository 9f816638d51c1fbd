"""The outputs of ``detailbench apply`` on many files: a small record of each, so that no output is made twice.

The record of ``OUT/NAME.ply`` is ``OUT/.detailbench/NAME.ply.json``: a fingerprint of all its dependencies,
and the line of the summary. An output that somebody has changed since stays as it is, until its input or the settings
change.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from .. import __version__
from ..plan.choice import digest
from ..results.files import write_atomically
from ..results.provenance import depends_on, weights_of
from .application import Application

FOLDER = ".detailbench"


def fingerprint(job: Application) -> str:
    """A digest over the contents of the inputs, the settings, and the sources and packages that make the output."""
    return digest(
        {
            "version": __version__,
            "task": asdict(job.task),
            "method": asdict(job.method),
            "inputs": [_content(Path(path)) for path in job.inputs],
            "settings": [job.seed, job.device.partition(":")[0], job.normals, job.simplify, job.colors],
            "weights": weights_of(job.training) if job.training else None,
            "made_by": depends_on((job.task, job.method)),
        }
    )


def recorded(job: Application, mark: str) -> dict[str, Any] | None:
    """The summary of an existing output with this fingerprint; None without one."""
    if not os.path.isfile(job.output):
        return None
    with contextlib.suppress(OSError, ValueError):  # an unreadable record counts as missing: the output is made again
        record = json.loads(_path(job).read_bytes())
        if isinstance(record, dict) and record.get("fingerprint") == mark and isinstance(record.get("row"), dict):
            return record["row"]
    return None


def record(job: Application, mark: str, row: Mapping[str, Any]) -> None:
    """Write the record of an output that was made."""
    kept = {key: value for key, value in row.items() if key != "traceback"}
    content = json.dumps({"fingerprint": mark, "input": list(job.inputs), "row": kept}, indent=1)
    write_atomically(_path(job), content.encode())


def _path(job: Application) -> Path:
    output = Path(job.output)
    return output.parent / FOLDER / f"{output.name}.json"


def _content(path: Path) -> Any:
    """A digest over a file, or over those of a folder."""
    if path.is_dir():
        files = sorted(inner for inner in path.rglob("*") if inner.is_file())
        return [[str(inner.relative_to(path)), _content(inner)] for inner in files]
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:  # the next reader reports what is wrong with the file
        return f"cannot be read: {error.strerror or error}"
