"""Stored outputs and their references: the names of their files, and how they are found again.

::

    DIR/outputs/CELL-FINGERPRINT/CASE.ply               an output; its row names it, relative to DIR
    DIR/outputs/references/DATASET-CASE-CONTENT.ply     a reference; the metadata of the record name it

A results folder can be moved, copied or shared: nothing in it names a place outside. Rows of earlier versions hold
absolute paths, and are found below their present folder. References are named by their content, so that two tasks,
seeds or splits whose cases share an id share a file only if it is the same.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from ..plan.cell import digest, reference_name

if TYPE_CHECKING:
    from ..contract.shape import Shape

FOLDER = "outputs"
LONGEST = 120  # characters of a file's name; file systems allow 255 bytes with the suffixes of temporary files


def file_name(id: str, suffix: str = ".ply") -> str:
    """A file's name for the id of a case: the id itself if every file system allows it.

    Characters that plain file names lack become ``_``, and a digest keeps such names distinct.
    """
    plain = re.sub(r"[^\w.+=@,-]", "_", id.encode("utf-8", "replace").decode(), flags=re.ASCII).lstrip(".")[:LONGEST]
    return f"{plain}{suffix}" if plain and plain == id else f"{plain}-{digest(id)[:8]}{suffix}"


def reference_file(dataset: str, case: str, reference: Shape) -> str:
    """The path of a case's reference, relative to the results folder: another shape has another name."""
    from ..contract.identity import shape_digest

    return f"{FOLDER}/references/{file_name(f'{dataset}-{case}', f'-{shape_digest(reference)[:8]}.ply')}"


def found(folder: Path, stored: str | None) -> Path | None:
    """The file below a results folder that a stored path means, None if there is none.

    Parameters
    ----------
    folder : Path
        The results folder, wherever it is now.
    stored : str or None
        Relative to the folder; or absolute, as earlier versions stored it: then the file of the same name below the
        folder's own ``outputs`` is meant, since the folder may have been moved or copied. A record may be somebody
        else's, so a path that leads elsewhere means none.
    """
    if not isinstance(stored, str) or not stored or ".." in PurePosixPath(stored).parts:
        return None
    path, parts = Path(stored), PurePosixPath(stored).parts
    if path.is_absolute():
        if FOLDER not in parts:
            return None
        path = Path(*parts[len(parts) - 1 - parts[::-1].index(FOLDER) :])
    return folder / path if (folder / path).is_file() else None


def found_reference(folder: Path, meta: Mapping[str, Any], row: Mapping[str, Any]) -> Path | None:
    """The file of the reference that a row's output is compared with, None where there is none.

    Parameters
    ----------
    folder : Path
        The results folder.
    meta : mapping
        The metadata of the row's record.
    row : mapping
        With ``dataset`` and ``case``.
    """
    named = (meta.get("references") or {}).get(row["case"])
    # The name in earlier versions.
    return found(folder, named or f"{FOLDER}/references/{reference_name(row['dataset'], row['case'])}")
