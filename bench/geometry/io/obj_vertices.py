"""An OBJ file with other coordinates, and everything else unchanged: texture coordinates, groups, materials."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...errors import BadInput, UsageError
from .plain import decoded

if TYPE_CHECKING:
    from trimesh import Trimesh


def save_deformed(output: Trimesh, path: str | Path, source: str | Path) -> None:
    """Write a deformed mesh; from OBJ to OBJ, all of the source's file but coordinates and normals stays.

    Raises
    ------
    BadInput
        If the source's file cannot be read any more, or has another number of vertices.
    UsageError
        If the file cannot be written.
    """
    from .files import save

    if str(path).lower().endswith(".obj") and str(source).lower().endswith(".obj"):
        save_with_vertices(source, np.asarray(output.vertices), path)
    else:
        save(output, path)


def save_with_vertices(source: str | Path, vertices: np.ndarray, path: str | Path) -> None:
    """Write the OBJ file ``source`` to ``path`` with other coordinates of its vertices.

    All other lines stay in place (those that go on in the next one are joined), but for normals, which are made anew:
    each becomes the mean over the corners that name it of the normals of their faces, by area. Names of material files
    are rewritten to lead to the same files from the folder of ``path``. The file is written under another name and
    renamed.

    Parameters
    ----------
    source : path of an OBJ file that :func:`bench.geometry.io.files.load_mesh` reads
    vertices : (v, 3) array
        As many as the file has, in its order.
    path : where to write; may be ``source``

    Raises
    ------
    BadInput
        If the file cannot be read or has another number of vertices.
    UsageError
        If the file cannot be written.
    """
    source, path = Path(source), Path(path)
    try:
        text = decoded(source.read_bytes()).decode("utf-8", errors="surrogateescape")
    except OSError as error:
        raise BadInput(f"{source}: cannot be read ({error.strerror})") from None
    lines = text.replace("\\\r\n", " ").replace("\\\n", " ").splitlines()
    numbers = [k for k, line in enumerate(lines) if line.split()[:1] == ["v"]]
    if len(numbers) != len(vertices):
        raise BadInput(f"{source}: has {len(numbers)} vertices; expected the {len(vertices)} of the mesh to be written")
    for k, place in zip(numbers, np.asarray(vertices, dtype=np.float64), strict=True):
        rest = lines[k].split()[4:]  # colours, or a weight
        lines[k] = " ".join(["v", *(f"{value:.17g}" for value in place), *rest])
    _renew_normals(lines, np.asarray(vertices))
    for k, line in enumerate(lines):
        words = line.split(maxsplit=1)
        if words[:1] == ["mtllib"] and len(words) > 1:
            lines[k] = f"mtllib {_seen_from(path.parent, source.parent, words[1].strip())}"
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8", errors="surrogateescape")
        os.replace(temporary, path)
    except OSError as error:
        raise UsageError(f"{path}: cannot be written ({error.strerror})") from None
    finally:
        with contextlib.suppress(OSError):  # also of a folder that is none
            temporary.unlink()


def _seen_from(folder: Path, before: Path, names: str) -> str:
    """Names of files in the folder ``before`` as they are in ``folder``; one name may have blanks in it."""
    one = (before / names).exists()
    paths = ((before / name).resolve() for name in ([names] if one else names.split()))
    return " ".join(os.path.relpath(path, folder.resolve()) for path in paths)


def _renew_normals(lines: list[str], vertices: np.ndarray) -> None:
    """Replace the lines ``vn``, in place."""
    places = [k for k, line in enumerate(lines) if line.split()[:1] == ["vn"]]
    if not places:
        return
    total = np.zeros((len(places), 3))
    seen = [0, 0]  # lines v and vn above: negative numbers count back from there
    for line in lines:
        words = line.partition("#")[0].split()
        if words[:1] == ["v"]:
            seen[0] += 1
        elif words[:1] == ["vn"]:
            seen[1] += 1
        elif words[:1] in (["f"], ["fo"]):
            corners = [corner.split("/") for corner in words[1:]]
            index = [_number(corner[0], seen[0]) for corner in corners]
            polygon = vertices[index]
            area = np.cross(polygon - polygon[0], np.roll(polygon, -1, axis=0) - polygon[0]).sum(axis=0)
            for corner in corners:
                number = _number(corner[2], seen[1]) if len(corner) > 2 and corner[2] else -1
                if 0 <= number < len(total):  # readers of surfaces do not mind others
                    total[number] += area
    lengths = np.linalg.norm(total, axis=1)
    for k, normal, length in zip(places, total, lengths, strict=True):
        if length > 0:
            lines[k] = " ".join(["vn", *(f"{value:.9g}" for value in normal / length)])


def _number(word: str, above: int) -> int:
    number = int(word)
    return number - 1 if number > 0 else above + number
