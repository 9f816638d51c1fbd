"""A unit cube, whose area is 6 and whose volume is 1, in many kinds of files."""

import numpy as np
import trimesh

V = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
QUADS = [(0, 3, 2, 1), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7), (4, 5, 6, 7)]
TRIANGLES = [(q[0], q[i], q[i + 1]) for q in QUADS for i in (1, 2)]
NORMALS = np.asarray(V) * 2.0 - 1


def lines(rows, before=""):
    """Each row on a line of its own."""
    return "".join(f"{before}{' '.join(map(str, row))}\n" for row in rows)


def spread(rows):
    """Each number on a line of its own."""
    return "\n".join(str(number) for row in rows for number in row) + "\n"


def sized(polygons, *more):
    """Rows that begin with the number of corners."""
    return [(len(polygon), *polygon, *more) for polygon in polygons]


def with_parts(*parts):
    """The vertices, each followed by the same further numbers."""
    return [(*v, *parts) for v in V]


def ply(columns="x y z", rows=V, polygons=QUADS, *, more=(), body="", kind="float"):
    """An ASCII PLY file; ``columns`` may name types as ``uchar:red``."""
    words = [column.rpartition(":") for column in columns.split()]
    head = ["ply", "format ascii 1.0", f"element vertex {len(rows)}"]
    head += [f"property {form or kind} {column}" for form, _, column in words]
    head += [f"element face {len(polygons)}", "property list uchar int vertex_indices"] if polygons else []
    return "\n".join([*head, *more, "end_header", ""]) + lines(rows) + lines(sized(polygons)) + body


def check_cube(raw, vertices=8, times=1):
    """Checks that it is the cube, or ``times`` cubes, with all faces outward."""
    mesh = trimesh.Trimesh(raw.vertices, raw.faces, process=False)
    assert (len(raw.vertices), len(raw.faces)) == (vertices, 12 * times)
    assert abs(mesh.area - 6 * times) < 1e-12 and abs(mesh.volume - times) < 1e-12
    assert raw.vertices.dtype == np.float64 and raw.faces.dtype == np.int64
    return raw
