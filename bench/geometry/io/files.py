"""Geometry files: reads are complete and finite, or give one clear message; files are written whole.

Files that end early, name vertices that do not exist or hold NaN are refused with the name of the file, what was
expected, and what to do. Merely unpleasant defects are read unchanged: duplicate points, holes, non-manifold edges,
degenerate faces among good ones.
"""

from __future__ import annotations

import contextlib
import os
import re
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import BadInput, UsageError
from ...notices import notice
from ...text import one_line, shortened
from ..check import check_mesh, check_points
from ..cloud import PointCloud
from ..normals import completed
from ..suspicions import notice_suspicions
from ..used import used_vertices
from .npy import read_npy, read_npz
from .obj import read_obj
from .off import read_off
from .pcd import read_pcd, write_pcd
from .plain import decoded
from .ply import read_ply, write_ply
from .polygons import finite_triangles
from .ptx import read_ptx
from .raw import NO_FACES, RawGeometry
from .scans import read_e57, read_las
from .scenes import read_3mf, read_dae, read_glb, read_gltf
from .stl import read_stl
from .table_writer import lines, write_csv, write_xyz
from .tables import read_pts, read_pwn, read_table

if TYPE_CHECKING:
    from trimesh import Trimesh

MOST_MESSAGE = 400  # characters of a message besides the name of the file: a damaged word may have millions


class NoFaces(BadInput):
    """A file of points where a mesh is expected."""


def load_mesh(path: str | Path) -> Trimesh:
    """Read a triangle mesh from a PLY, OBJ, STL or OFF file, or from a scene (GLB, glTF, 3MF, COLLADA).

    Vertices and their order are the file's; polygons become triangles that keep their area; the corners of an STL file
    and of a scene become common vertices where they are exactly equal. Coordinates are float64. Vertices that are NaN
    or infinite, and the triangles that have one, are left out with a notice.

    Raises
    ------
    BadInput
        If the file cannot be read, is damaged, or holds no surface.
    """
    return _mesh(_read(path, MESH_READERS, "a mesh file"), str(path))


def load_cloud(path: str | Path) -> PointCloud:
    """Read a point cloud: from PLY, PCD, LAS, E57, NPY, tables as text, or the vertices of a mesh file.

    Normals, colours and scalars are those that the file itself stores for each point; none are computed. Columns
    without names are identified by their values, see :func:`bench.geometry.io.columns.geometry_of`. Points that are not
    finite are left out, with a notice (:mod:`bench.notices`).

    Normals are scaled to unit length. The few that have no direction (zero, NaN) become those of the nearest point that
    has one; if more than half have none, all are left out. A notice reports it.

    Raises
    ------
    BadInput
        If the file cannot be read, is damaged, or holds fewer than three points that differ.

    Example
    -------
    >>> import os, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = os.path.join(folder, "corners.xyz")
    ...     save(PointCloud(np.eye(3)), path)
    ...     load_cloud(path)
    PointCloud(3 points)
    """
    return _cloud(_read(path, CLOUD_READERS, "a point cloud or mesh file"), str(path))


def load_geometry(path: str | Path) -> Trimesh | PointCloud:
    """Read a file once: a mesh as :func:`load_mesh` does if it has faces, otherwise a cloud as :func:`load_cloud` does.

    Raises
    ------
    BadInput
        As these do.
    """
    raw = _read(path, CLOUD_READERS, "a point cloud or mesh file")
    return (_mesh if len(raw.faces) else _cloud)(raw, str(path))


def _mesh(raw: RawGeometry, name: str) -> Trimesh:
    from trimesh import Trimesh

    if not len(raw.faces):
        raise NoFaces(f"{name}: has {len(raw.vertices)} vertices but no faces; expected a triangle mesh")
    mesh = Trimesh(*finite_triangles(raw.vertices, raw.faces, name), process=False)
    check_mesh(mesh, name)
    notice_suspicions(used_vertices(mesh), name)
    return mesh


def _cloud(raw: RawGeometry, path: str) -> PointCloud:
    raw = _finite(raw, path)
    check_points(raw.vertices, path, at_least=3)
    notice_suspicions(raw.vertices, path)
    colors = raw.colors
    if colors is not None and not ((colors >= 0) & (colors <= 1)).all():
        notice(f"{path}: its colours are not in 0..1; they are left out")
        colors = None
    normals = None if raw.normals is None else completed(raw.vertices, raw.normals, path)
    return PointCloud(raw.vertices, normals, colors, raw.scalars or {})


def _finite(raw: RawGeometry, name: str) -> RawGeometry:
    """The points whose coordinates are numbers; scanners write NaN where they saw nothing."""
    good = np.isfinite(raw.vertices).all(axis=1)
    if good.all() or not good.any():
        return raw
    bad = len(good) - int(good.sum())
    notice(f"{name}: {bad:,} of {len(good):,} points are NaN or infinite; they are left out")
    normals, colors = (None if array is None else array[good] for array in (raw.normals, raw.colors))
    scalars = None if raw.scalars is None else {key: values[good] for key, values in raw.scalars.items()}
    return RawGeometry(raw.vertices[good], NO_FACES, normals, colors, scalars)


def save(geometry: Trimesh | PointCloud, path: str | Path) -> None:
    """Write a mesh (.ply .obj .off .stl .glb) or a point cloud (.ply .pcd .xyz .txt .asc .csv).

    All but two keep float64, and clouds their normals, colours and scalars; STL and GLB are float32 by their nature.
    The file is written under a temporary name beside ``path`` and then renamed, so that it is never seen half written.

    Raises
    ------
    UsageError
        If the suffix is not one of these, or the file cannot be written.

    Example
    -------
    >>> import os, tempfile
    >>> from trimesh.creation import box
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = os.path.join(folder, "box.ply")
    ...     save(box(), path)
    ...     load_mesh(path).faces.shape
    (12, 3)
    """
    path = Path(path)
    content = _writer(path, "cloud" if isinstance(geometry, PointCloud) else "mesh")(geometry)
    with _beside(path) as temporary:
        temporary.write_bytes(content)
        os.replace(temporary, path)


def check_target(path: str | Path, kind: str) -> None:
    """Raise :class:`UsageError` where :func:`save` would, for a ``"mesh"`` or a ``"cloud"``, before it is made."""
    path = Path(path)
    check_suffix(path, kind)
    if path.is_dir():
        raise UsageError(f"{path}: is a folder; expected the name of a file")
    with _beside(path) as temporary:
        temporary.touch()


def check_suffix(path: str | Path, kind: str) -> None:
    """Raise :class:`UsageError` unless a ``"mesh"`` or a ``"cloud"`` can be written as a file of this suffix."""
    _writer(Path(path), kind)


def _writer(path: Path, kind: str) -> Callable[[Any], bytes]:
    writers = CLOUD_WRITERS if kind == "cloud" else MESH_WRITERS
    writer = writers.get(path.suffix.lower())
    if writer is None:
        what = "point cloud" if kind == "cloud" else "mesh"
        suffix = repr(path.suffix) if path.suffix else "a file without a suffix"
        raise UsageError(f"{path}: cannot write a {what} as {suffix}; expected one of {' '.join(writers)}")
    return writer


@contextlib.contextmanager
def _beside(path: Path) -> Iterator[Path]:
    """The name of a temporary file in the same folder, which is gone in the end."""
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
    except OSError as error:
        raise UsageError(
            f"{path}: cannot be written ({error.strerror or error}); the old file, if any, is intact"
        ) from error
    finally:
        with contextlib.suppress(OSError):  # of an invalid folder, or one that is not writable
            temporary.unlink()


# -- reading -----------------------------------------------------------------------------------------------------------


def _read(path: str | Path, readers: dict[str, Callable[[bytes, str], RawGeometry]], what: str) -> RawGeometry:
    path, name = Path(path), str(path)
    suffixes = " ".join(readers)
    if path.is_dir():
        raise BadInput(f"{name}: is a folder; expected {what} ({suffixes})")
    if path.suffix.lower() not in readers:
        raise BadInput(f"{name}: unknown suffix {path.suffix!r}; expected {what} ({suffixes})")
    try:
        if path.exists() and not path.is_file():
            raise BadInput(f"{name}: is a pipe or a device; expected {what} ({suffixes}). Copy it to a file first")
        data = path.read_bytes()
    except FileNotFoundError:
        raise BadInput(f"{name}: no such file; expected {what} ({suffixes})") from None
    except OSError as error:
        raise BadInput(f"{name}: cannot be read ({error.strerror or error}); check its permissions") from error
    if not data or data.isspace():
        raise BadInput(f"{name}: is empty ({len(data)} bytes); expected {what}. Copy or export it again")
    try:
        return readers[path.suffix.lower()](data, name)
    except BadInput as error:
        message, actual = shortened(one_line(str(error)), len(name) + MOST_MESSAGE), _suffix_of_content(data)
        if actual and actual != path.suffix.lower():
            message += f"\nBy its content it is {actual[1:].upper()}: rename it to {actual}"
        raise BadInput(message) from None


def _suffix_of_content(data: bytes) -> str:
    """The suffix that the first bytes imply, if any."""
    head = decoded(data[:1024]).lstrip()
    if head[:4] == b"glTF":
        return ".glb"
    if head[:3] == b"ply":
        return ".ply"
    if head.split(None, 1)[:1] and head.split(None, 1)[0].upper() in (b"OFF", b"COFF", b"NOFF", b"STOFF"):
        return ".off"
    if len(data) >= 84 and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little"):
        return ".stl"
    if head[:5].lower() == b"solid" and b"facet" in data[:4096]:
        return ".stl"
    return ".obj" if re.search(rb"^v\s+[-+.\d]", head, re.MULTILINE) else ""


Reader = Callable[[bytes, str], RawGeometry]
MESH_READERS: dict[str, Reader] = {".ply": read_ply, ".obj": read_obj, ".stl": read_stl, ".off": read_off}
MESH_READERS |= {".glb": read_glb, ".gltf": read_gltf, ".3mf": read_3mf, ".dae": read_dae}
CLOUD_READERS: dict[str, Reader] = MESH_READERS | {
    **dict.fromkeys((".xyz", ".txt", ".asc", ".csv", ".tsv", ".dat", ".xyzn", ".xyzrgb"), read_table),
    ".pts": read_pts,
    ".ptx": read_ptx,
    ".pwn": read_pwn,
    ".pcd": read_pcd,
    ".npy": read_npy,
    ".npz": read_npz,
    **dict.fromkeys((".las", ".laz"), read_las),
    ".e57": read_e57,
}


# -- writing -----------------------------------------------------------------------------------------------------------


def _raw(geometry: Trimesh | PointCloud) -> RawGeometry:
    if isinstance(geometry, PointCloud):
        return RawGeometry(geometry.points, NO_FACES, geometry.normals, geometry.colors, dict(geometry.scalars))
    vertices, faces = np.asarray(geometry.vertices, dtype=np.float64), np.asarray(geometry.faces)
    return RawGeometry(vertices, faces, None, vertex_colors(geometry))


def vertex_colors(mesh: Trimesh) -> np.ndarray | None:
    """The colours of a mesh's vertices, (v, 3) in 0..1, if it has any."""
    visual: Any = mesh.visual  # of colours, or of a texture
    return visual.vertex_colors[:, :3] / 255 if visual.kind == "vertex" else None


def _write_obj(mesh: Trimesh) -> bytes:
    colors = vertex_colors(mesh)
    table = np.asarray(mesh.vertices) if colors is None else np.hstack([mesh.vertices, colors])
    return lines("v" + " %.17g" * table.shape[1], table) + lines("f %d %d %d", np.asarray(mesh.faces) + 1)


def _write_off(mesh: Trimesh) -> bytes:
    _notice_of_colors(mesh, "OFF")
    head = f"OFF\n{len(mesh.vertices)} {len(mesh.faces)} 0\n".encode()
    return head + lines("%.17g %.17g %.17g", np.asarray(mesh.vertices)) + lines("3 %d %d %d", np.asarray(mesh.faces))


def _notice_of_colors(mesh: Trimesh, kind: str) -> None:
    if vertex_colors(mesh) is not None:
        notice(f"{kind} holds no colours of vertices; they are left out. PLY, OBJ and GLB keep them")


def _exported(kind: str) -> Callable[[Trimesh], bytes]:
    def export(mesh: Trimesh) -> bytes:
        if kind == "stl":
            _notice_of_colors(mesh, "STL")
        extent, furthest = np.ptp(mesh.vertices, axis=0).max(), np.abs(mesh.vertices).max()
        if furthest * np.finfo(np.float32).eps > 1e-4 * extent:
            notice(
                f"{kind.upper()} rounds to float32, which at {furthest:.3g} from the origin is visible on a mesh "
                f"{extent:.3g} across; write a PLY, or move the mesh to the origin"
            )
        written = mesh.export(file_type=kind)
        assert isinstance(written, bytes)  # text, and a mapping, are those of kinds that we write ourselves
        return written

    return export


MESH_WRITERS: dict[str, Callable[[Trimesh], bytes]] = {
    ".ply": lambda mesh: write_ply(_raw(mesh)),
    ".obj": _write_obj,
    ".off": _write_off,
    ".stl": _exported("stl"),
    ".glb": _exported("glb"),
}
CLOUD_WRITERS: dict[str, Callable[[PointCloud], bytes]] = {
    ".ply": lambda cloud: write_ply(_raw(cloud)),
    **dict.fromkeys((".xyz", ".txt", ".asc"), write_xyz),
    ".csv": write_csv,
    ".pcd": write_pcd,
}
