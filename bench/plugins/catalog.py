"""The facts about the shapes of a dataset: exactness, tags, size, build time, and hashes that detect drift.

They require shapes to be built and measured, which a listing must not do. So the facts are stored in ``catalog.json``
beside the datasets' sources, written by ``python scripts/freeze.py``, and ``detailbench list datasets --measure``
measures again, on this machine and also for your own datasets.
"""

from __future__ import annotations

import hashlib
import json
import statistics
import time
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..geometry.traits import TAGS
from .registry import Plugin

if TYPE_CHECKING:
    from trimesh import Trimesh

FILE = "catalog.json"
LOOKED_AT = 16  # shapes whose exactness and kinds are read, which builds nothing
BUILT = 8  # shapes that are built and measured
HASHED = 4  # of which all measurements are stored
DIGITS = 6  # of a coordinate that count: the last ones differ between processors and versions of libraries


def measure(plugin: Plugin) -> dict[str, Any]:
    """The facts of a dataset at its default parameters, from its first test shapes.

    Returns
    -------
    dict
        ``exactness``, ``tags`` (measured) and ``kinds`` (declared) as lists, ``vertices`` ([least, most]), ``seconds``
        (median of a shape's build), and ``shapes``: id, tags, vertices, faces, hash and measures of the first ones.
    """
    shapes = list(islice(plugin.cls().shapes("test"), LOOKED_AT))
    built, seconds, tags = [], [], set()
    for shape in shapes[:BUILT]:
        start = time.perf_counter()
        mesh = shape.mesh
        seconds.append(time.perf_counter() - start)
        size = {"vertices": len(mesh.vertices), "faces": len(mesh.faces)}
        tags |= set(measured := shape.traits.tags)
        figures = {"hash": mesh_hash(mesh), "measures": mesh_measures(mesh)}
        built.append({"id": shape.id, "tags": list(measured), **size, **figures})
    sizes = [entry["vertices"] for entry in built]
    return {
        "exactness": sorted({shape.exactness for shape in shapes}),
        "tags": [tag for tag in TAGS if tag in tags],
        "kinds": sorted({tag for shape in shapes for tag in shape.tags} - set(TAGS)),
        "vertices": [min(sizes), max(sizes)],
        "seconds": round(statistics.median(seconds), 2),
        "shapes": built[:HASHED],
    }


def mesh_hash(mesh: Trimesh) -> str:
    """Sixteen hexadecimal digits over the faces and the vertices, these rounded to a millionth of the size."""
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    size = float(np.abs(vertices).max()) or 1.0
    rounded = np.round(vertices / size, DIGITS) + 0.0  # + 0: minus zero is zero
    total = hashlib.sha256(np.ascontiguousarray(rounded).tobytes())
    total.update(np.ascontiguousarray(mesh.faces, dtype=np.int64).tobytes())
    return total.hexdigest()[:16]


def mesh_measures(mesh: Trimesh) -> list[float]:
    """Area, volume, centre of the surface and its second moments: (11,) numbers that change little under small changes.

    A hash is equal or not. If mathematics libraries round differently, a pole or a threshold may move a vertex by
    more than its last digits; these numbers distinguish such a mesh from one of another shape.
    """
    middle = mesh.triangles_center
    second = np.einsum("f,fi,fj->ij", mesh.area_faces / mesh.area, middle, middle)[np.triu_indices(3)]
    return [round(float(x), 9) for x in (mesh.area, mesh.volume, *mesh.centroid, *second)]


def known(plugin: Plugin) -> dict[str, Any] | None:
    """The facts stored beside the source of a dataset; None if there are none."""
    return _read(plugin.file.parent / FILE).get(plugin.name)


def _read(path: Path) -> dict[str, Any]:
    if not path.is_file():
        return {}
    return json.loads(path.read_text(encoding="utf-8"))
