"""Scenes (GLB, glTF, 3MF, COLLADA) as one mesh: trimesh reads them, and content that it would lose is refused."""

from __future__ import annotations

import importlib.util
import io
import json
import re
import zipfile
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote

import numpy as np

from ...errors import BadInput, MissingLibrary
from ...notices import notice
from .merging import merge_equal
from .plain import decoded
from .polygons import triangulate
from .raw import NO_FACES, RawGeometry

INSTALL = "pip install lxml networkx pycollada"  # the extra `scenes`
NEEDED = {"3mf": ("lxml", "networkx"), "dae": ("collada",), "glb": (), "gltf": ()}
TITLES = {"3mf": "3MF", "dae": "COLLADA", "glb": "GLB", "gltf": "glTF"}
# What a file may ask of its reader without a change of its surface.
HARMLESS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "KHR_mesh_quantization")
TRIANGLES, FANS = 4, 6  # modes of primitives
MOST_TIMES, MOST_BYTES = 200, 2**28  # of an archive: no compression of a mesh is better


class _Part(NamedTuple):
    """A mesh or a cloud in the frame of the scene."""

    vertices: np.ndarray
    faces: np.ndarray
    colors: np.ndarray | None


def read_glb(data: bytes, name: str) -> RawGeometry:
    """The meshes of a GLB file, see :func:`read_scene`."""
    if data[:4] != b"glTF" or len(data) < 20:
        raise BadInput(f"{name}: does not begin with 'glTF'; expected a GLB file (binary glTF 2.0)")
    if int.from_bytes(data[8:12], "little") > len(data):
        raise BadInput(f"{name}: ends early; the file is cut off, copy or export it again")
    _check_gltf(data[20 : 20 + int.from_bytes(data[12:16], "little")], len(data), name)
    return read_scene(data, name, "glb")


def read_gltf(data: bytes, name: str) -> RawGeometry:
    """The meshes of a glTF file and of the files that it names beside it, see :func:`read_scene`."""
    data = decoded(data)
    _check_gltf(data, None, name)
    return read_scene(data, name, "gltf")


def read_3mf(data: bytes, name: str) -> RawGeometry:
    """The meshes of a 3MF file, see :func:`read_scene`."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            size = sum(part.file_size for part in archive.infolist())
    except (zipfile.BadZipFile, ValueError, NotImplementedError) as error:
        raise BadInput(f"{name}: is not a complete archive ({error}); expected a 3MF file") from None
    if size > max(MOST_TIMES * len(data), MOST_BYTES):
        raise BadInput(f"{name}: promises {size:,} bytes in an archive of {len(data):,}; the file is damaged")
    return read_scene(data, name, "3mf")


def read_dae(data: bytes, name: str) -> RawGeometry:
    """The meshes of a COLLADA file, see :func:`read_scene`."""
    if b"<COLLADA" not in data[:4096]:
        raise BadInput(f"{name}: does not begin with a COLLADA element; expected a COLLADA file (.dae)")
    raw = read_scene(data, name, "dae")
    counts = b" ".join(re.findall(rb"<vcount>([^<]*)<", data)).split()
    if b"<polygons" in data or any(count not in (b"0", b"1", b"2", b"3") for count in counts):
        notice(f"{name}: polygons of more than three corners become fans, which is wrong where they are not convex")
    return raw


def read_scene(data: bytes, name: str, kind: str) -> RawGeometry:
    """All meshes of a scene where its transforms put them, as one; its points where it has no mesh.

    Vertices of a mesh at exactly equal places become one: where texture or normals change abruptly, these formats store
    a place several times. Coordinates are in the units and along the axes of the file.

    Raises
    ------
    BadInput
        If it cannot be read, or holds anything but triangles, lines and points.
    MissingLibrary
        If the library that reads this format is not installed.
    """
    for library in NEEDED[kind]:
        if importlib.util.find_spec(library) is None:
            library = {"collada": "pycollada"}.get(library, library)
            raise MissingLibrary(library, INSTALL, f"reads {TITLES[kind]} files such as {name}, and is not installed")
    try:
        parts = _parts(data, name, kind)
    except BadInput:
        raise
    except Exception as error:  # a parser raises whatever comes of a damaged file
        raise BadInput(
            f"{name}: cannot be read as {TITLES[kind]} ({type(error).__name__}: {error}); the file is damaged, or not "
            "of this kind. Export it again, or as PLY"
        ) from error
    meshes = [part for part in parts if len(part.faces)]
    if not meshes:
        points = np.concatenate([np.empty((0, 3)), *(part.vertices for part in parts)])
        colors = [part.colors for part in parts if part.colors is not None]
        whole = len(colors) == len(parts) > 0
        return RawGeometry(points, NO_FACES, None, np.concatenate(colors) if whole else None)
    merged = [merge_equal(part.vertices, part.faces) for part in meshes]
    fewer = sum(len(part.vertices) - len(raw.vertices) for part, raw in zip(meshes, merged, strict=True))
    if fewer:
        notice(
            f"{name}: {fewer} vertices at the places of others (where texture or normals change) are merged with these"
        )
    before = np.cumsum([0, *(len(raw.vertices) for raw in merged)])
    faces = np.concatenate([raw.faces + begin for raw, begin in zip(merged, before, strict=False)])
    return RawGeometry(np.concatenate([raw.vertices for raw in merged]), faces)


def _parts(data: bytes, name: str, kind: str) -> list[_Part]:
    import trimesh

    where = Path(name)
    resolver = trimesh.resolvers.FilePathResolver(str(where)) if where.parent.is_dir() else None
    options: dict[str, Any] = {"skip_materials": True} if kind in ("glb", "gltf") else {}
    scene = trimesh.load_scene(io.BytesIO(data), file_type=kind, resolver=resolver, process=False, **options)
    parts = []
    for node in scene.graph.nodes_geometry:
        transform, title = scene.graph[node]
        part = _part(scene.geometry[title], np.asarray(transform, dtype=np.float64), name)
        if part:
            parts.append(part)
    return parts


def _part(geometry: Any, transform: np.ndarray, name: str) -> _Part | None:
    """A mesh or cloud of trimesh, moved; None for lines."""
    is_mesh, is_cloud = hasattr(geometry, "faces"), hasattr(geometry, "colors") and not hasattr(geometry, "entities")
    if not is_mesh and not is_cloud:
        return None
    linear, shift = transform[:3, :3], transform[:3, 3]
    with np.errstate(invalid="ignore", over="ignore"):  # of places that are not finite, which go later
        vertices = np.asarray(geometry.vertices, dtype=np.float64) @ linear.T + shift
        mirrored = np.linalg.det(linear) < 0
    if is_cloud:
        colors = np.asarray(geometry.colors)
        return _Part(vertices, NO_FACES, colors[:, :3] / 255 if len(colors) == len(vertices) else None)
    corners = np.asarray(geometry.faces, dtype=np.int64)
    faces = triangulate(np.full(len(corners), 3), corners.ravel(), vertices, name)
    return _Part(vertices, faces[:, ::-1] if mirrored else faces, None)


def _check_gltf(text: bytes, most: int | None, name: str) -> None:
    """Refuse content that trimesh would silently leave out or read wrongly."""
    try:
        header = json.loads(text)
        needed = [word for word in header.get("extensionsRequired", []) if not word.startswith(HARMLESS)]
        accessors = header.get("accessors", [])
        primitives = [p for mesh in header.get("meshes", []) for p in mesh["primitives"]]
        modes = {p.get("mode", TRIANGLES) for p in primitives}
        places = [accessors[p["attributes"]["POSITION"]] for p in primitives]
        scaled = any(place.get("normalized") for place in places)
        files = [buffer["uri"] for buffer in header.get("buffers", []) if "uri" in buffer]
        gone = [file for file in files if not file.startswith("data:") and not _is_beside(file, name)]
        empty = max((int(a["count"]) for a in accessors if "bufferView" not in a), default=0)
    except (ValueError, KeyError, TypeError, AttributeError, IndexError, RecursionError) as error:
        raise BadInput(f"{name}: cannot read its JSON ({error!r}); expected glTF 2.0. The file is damaged") from None
    if gone:
        raise BadInput(f"{name}: names the file {gone[0][:200]!r}, which is not there; expected it beside this one")
    if needed or scaled:
        what = ", ".join(needed) or "places as fractions of whole numbers"
        raise BadInput(f"{name}: needs what is not read here ({what}); export it without compression, or as PLY")
    if FANS in modes:
        raise BadInput(f"{name}: holds triangle fans, which are not read; export it as triangles, or as PLY")
    if empty > max(most or 0, 10_000_000):
        raise BadInput(f"{name}: promises {empty} values that it does not hold; the file is damaged, export it again")


def companions(path: Path) -> list[Path]:
    """The files of buffers that a ``.gltf`` names and that are there; of a damaged one none."""
    try:
        header = json.loads(path.read_bytes())
        names = [buffer["uri"] for buffer in header.get("buffers", []) if "uri" in buffer]
        return [
            path.parent / unquote(uri) for uri in names if not uri.startswith("data:") and _is_beside(uri, str(path))
        ]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return []


def _is_beside(file: str, name: str) -> bool:
    """Whether it is a file, and no device or pipe, seen from the folder of the scene."""
    try:
        return (Path(name).parent / unquote(file)).is_file()
    except (OSError, ValueError):  # a name that no file can have
        return False
