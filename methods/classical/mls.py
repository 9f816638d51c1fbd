"""Moving least squares surfaces, by MeshLab: what APSS and RIMLS share.

MeshLab's filters are reached by name; ``kind`` is ``"apss"`` or ``"rimls"``, and further keyword arguments are the
filter's own. Both need oriented normals. The support of a point is ``filterscale`` times its local spacing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from bench import BadInput, PointCloud

from .inputs import distinct_oriented

if TYPE_CHECKING:
    from trimesh import Trimesh

AT_LEAST = 20  # MeshLab measures the local spacing from 16 neighbours


def project(cloud: PointCloud, kind: str, **parameters: Any) -> PointCloud:
    """Every point projected to the surface; one beyond the support of the others stays where it is.

    Raises
    ------
    BadInput
        See :func:`distinct_points`.
    """
    import pymeshlab

    points, normals, inverse = distinct_oriented(cloud, kind, AT_LEAST)
    meshes = pymeshlab.MeshSet(verbose=False)
    for _ in ("control", "proxy"):
        meshes.add_mesh(pymeshlab.Mesh(vertex_matrix=points, v_normals_matrix=normals))
    # The filter crashes when the current mesh is the proxy, which it is after being added.
    meshes.set_current_mesh(0)
    meshes.apply_filter(f"compute_mls_projection_{kind}", controlmesh=0, proxymesh=1, **parameters)
    moved = meshes.mesh(1).vertex_matrix()
    good = np.isfinite(moved).all(axis=1)
    return PointCloud(np.where(good[:, None], moved, points)[inverse])


def isosurface(cloud: PointCloud, kind: str, **parameters: Any) -> Trimesh:
    """The surface by marching cubes; open where points are missing.

    Raises
    ------
    BadInput
        See :func:`distinct_points`; or if the field has no surface.
    """
    import pymeshlab
    from trimesh import Trimesh

    points, normals, _ = distinct_oriented(cloud, kind, AT_LEAST)
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertex_matrix=points, v_normals_matrix=normals))
    try:
        meshes.apply_filter(f"generate_marching_cubes_{kind}", **parameters)
    except pymeshlab.PyMeshLabException as error:
        raise BadInput(f"{kind}: MeshLab cannot make a surface of these {len(points)} points ({error})") from error
    mesh = meshes.current_mesh()
    vertices, faces = mesh.vertex_matrix(), mesh.face_matrix()
    faces = faces[np.isfinite(vertices).all(axis=1)[faces].all(axis=1)]
    used, faces = np.unique(faces, return_inverse=True)
    return Trimesh(vertices[used], faces.reshape(-1, 3), process=False)
