#!/usr/bin/env python
"""Compare every classical method with the plain call of the library that it wraps.

usage: python scripts/bare_library.py MESH|DATASET ... [--task reconstruct] [--methods a,b] [--levels 0,.5,1,2]
                                      [METHOD.PARAMETER=VALUE ...]

Shapes are mesh files, or names of procedural datasets (the first test shape of each). Each is sampled evenly with
exact normals, and Gaussian noise of so many percent of the radius of its bounding sphere is added. The table gives p2f
(output to reference) and s2f (reference to output), their mean, and the angle of the output's normals, of the method
and of the bare call, and the ratio of the means (of p2f where points are moved): above 1 the method is worse. The bare
calls are at the library's own defaults, or, where it has none, at the values of its example or manual: see the
functions in this file. METHOD.PARAMETER=VALUE changes the method, not the bare call.

    python scripts/bare_library.py bunny.off fandisk.off --task denoise --methods apss,rimls apss.filterscale=4
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from trimesh import Trimesh

from bench import PointCloud, Run, UsageError, generator
from bench.geometry.io.files import load_mesh
from bench.geometry.mesh_surface import MeshSurface
from bench.geometry.poisson_disk import CANDIDATES, eliminate
from bench.geometry.spacing import mean_spacing
from bench.plugins.registry import registry
from bench.plugins.schema import build

SAMPLES = 20_000  # of each surface, for the distances
RATIO = 4  # of upsampling

# -- the bare calls ----------------------------------------------------------------------------------------------------


def _open3d(cloud: PointCloud) -> Any:
    import open3d as o3d

    points = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.array(cloud.points)))
    if cloud.normals is not None:
        points.normals = o3d.utility.Vector3dVector(np.array(cloud.normals))
    return points


def _mesh(mesh: Any) -> Trimesh:
    return Trimesh(np.asarray(mesh.vertices), np.asarray(mesh.triangles), process=False)


def poisson(cloud: PointCloud) -> Trimesh:
    """Open3D's defaults: depth 8, point weight 2, 1.5 samples per node, scale 1.1; one thread, to be repeatable."""
    import open3d as o3d

    create = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson
    return _mesh(create(_open3d(cloud), depth=8, n_threads=1)[0])


def ipsr(cloud: PointCloud) -> Trimesh:
    """No library has it: Open3D's Poisson on its own estimated normals, 30 neighbours, as its tutorial has it."""
    points = _open3d(PointCloud(cloud.points))
    points.estimate_normals()
    points.orient_normals_consistent_tangent_plane(30)
    return poisson(PointCloud(cloud.points, np.asarray(points.normals)))


def ball_pivoting(cloud: PointCloud) -> Trimesh:
    """Radii of 1, 2 and 4 mean distances to the nearest neighbour: Open3D's tutorial doubles them, in fixed units."""
    import open3d as o3d

    points = _open3d(cloud)
    radii = np.mean(points.compute_nearest_neighbor_distance()) * np.array([1.0, 2.0, 4.0])
    create = o3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting
    return _mesh(create(points, o3d.utility.DoubleVector(radii)))


def alpha_shape(cloud: PointCloud) -> Trimesh:
    """Open3D's, with an alpha of two mean distances to the nearest neighbour; it has no default."""
    import open3d as o3d

    points = _open3d(cloud)
    alpha = 2 * np.mean(points.compute_nearest_neighbor_distance())
    return _mesh(o3d.geometry.TriangleMesh.create_from_point_cloud_alpha_shape(points, alpha))


def alpha_wrap(cloud: PointCloud) -> Trimesh:
    """CGAL's manual: alpha and offset relative to the diagonal of the bounding box, here 1/50 and 1/600."""
    from bench.methods.classical.alpha_wrap import wrap

    diagonal = np.linalg.norm(np.ptp(cloud.points, axis=0))
    return Trimesh(*wrap(cloud.points, diagonal / 50, diagonal / 600), process=False)


def advancing_front(cloud: PointCloud) -> Trimesh:
    """CGAL's defaults: a ratio of radii of 5, beta of 0.52 radians."""
    from bench.methods.classical.front import advancing_front as front

    return Trimesh(*front(cloud.points, 5.0, 0.52), process=False)


def _meshlab(cloud: PointCloud) -> Any:
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    for _ in range(2):
        meshes.add_mesh(pymeshlab.Mesh(vertex_matrix=cloud.points, v_normals_matrix=cloud.normals))
    return meshes


def _marching_cubes(cloud: PointCloud, kind: str, **parameters: Any) -> Trimesh:
    meshes = _meshlab(cloud)
    meshes.set_current_mesh(0)
    meshes.apply_filter(f"generate_marching_cubes_{kind}", **parameters)
    mesh = meshes.current_mesh()
    vertices, faces = mesh.vertex_matrix(), mesh.face_matrix()
    return Trimesh(vertices, faces[np.isfinite(vertices).all(axis=1)[faces].all(axis=1)], process=False)


def _projected(cloud: PointCloud, kind: str) -> PointCloud:
    meshes = _meshlab(cloud)
    meshes.set_current_mesh(0)
    meshes.apply_filter(f"compute_mls_projection_{kind}", controlmesh=0, proxymesh=1)
    return PointCloud(meshes.mesh(1).vertex_matrix())


def apss(cloud: PointCloud, **parameters: Any) -> Trimesh:
    """MeshLab's defaults: support of 2 local spacings, 200 cells, 15 steps of projection."""
    return _marching_cubes(cloud, "apss", **parameters)


def rimls(cloud: PointCloud, **parameters: Any) -> Trimesh:
    """MeshLab's defaults: support of 2 local spacings, 200 cells, sigma_n .75."""
    return _marching_cubes(cloud, "rimls", **parameters)


def denoise_apss(cloud: PointCloud) -> PointCloud:
    """MeshLab's defaults."""
    return _projected(cloud, "apss")


def denoise_rimls(cloud: PointCloud) -> PointCloud:
    """MeshLab's defaults."""
    return _projected(cloud, "rimls")


def denoise_jet(cloud: PointCloud) -> PointCloud:
    """CGAL's example for scans: 24 neighbours."""
    from CGAL.CGAL_Point_set_processing_3 import jet_smooth_point_set

    from bench.methods.classical.point_sets import to_array, to_point_set

    points = to_point_set(cloud.points)
    jet_smooth_point_set(points, 24)
    return PointCloud(to_array(points))


def denoise_bilateral(cloud: PointCloud) -> PointCloud:
    """CGAL's example: 120 neighbours, 25 degrees, 3 passes."""
    from CGAL.CGAL_Point_set_processing_3 import bilateral_smooth_point_set

    from bench.methods.classical.point_sets import to_array, to_normals, to_point_set

    points = to_point_set(cloud.points, cloud.normals)
    for _ in range(3):
        bilateral_smooth_point_set(points, 120, 0.0, 25.0)
    return PointCloud(to_array(points), to_normals(points))


def denoise_wlop(cloud: PointCloud) -> PointCloud:
    """CGAL's 35 passes over all points, in a radius of 4 mean spacings; CGAL's own, of 8, is far worse."""
    from CGAL.CGAL_Point_set_3 import Point_set_3
    from CGAL.CGAL_Point_set_processing_3 import wlop_simplify_and_regularize_point_set

    from bench.methods.classical.point_sets import to_array, to_point_set

    output = Point_set_3()
    radius = 4 * mean_spacing(cloud.points)
    wlop_simplify_and_regularize_point_set(to_point_set(cloud.points), output, 100.0, radius, 35, False)
    return PointCloud(to_array(output))


def upsample_ear(cloud: PointCloud) -> PointCloud:
    """CGAL's example: 25 degrees, no sensitivity to edges; a radius of 3 mean spacings."""
    from CGAL.CGAL_Point_set_processing_3 import edge_aware_upsample_point_set

    from bench.methods.classical.point_sets import to_array, to_normals, to_point_set

    points = to_point_set(cloud.points, cloud.normals)
    edge_aware_upsample_point_set(points, 25.0, 0.0, 3 * mean_spacing(cloud.points), RATIO * len(cloud))
    return PointCloud(to_array(points), to_normals(points))


BARE: dict[str, dict[str, Callable[..., Any]]] = {
    "reconstruct": {
        f.__name__: f for f in (poisson, ipsr, ball_pivoting, alpha_shape, alpha_wrap, advancing_front, apss, rimls)
    },
    "denoise": {"apss": denoise_apss, "rimls": denoise_rimls, "jet": denoise_jet, "bilateral": denoise_bilateral}
    | {"wlop": denoise_wlop},
    "upsample": {"ear": upsample_ear},
}
# The parameters at which each method is the bare call, for ball_pivoting up to the farthest hundredth of the distances,
# which mean spacings leave out. alpha_wrap takes spacings, not diagonals; alpha_shape and ipsr are not the library's.
AS_BARE: dict[tuple[str, str], dict[str, Any]] = {
    ("reconstruct", "poisson"): {
        "depth": 8,
        "point_weight": 2.0,
        "samples_per_node": 1.5,
        "scale": 1.1,
        "linear_fit": False,
    },
    ("reconstruct", "ball_pivoting"): {"radii": [1.0, 2.0, 4.0]},
    ("reconstruct", "advancing_front"): {"radius_ratio": 5.0, "beta": 0.52},
    ("reconstruct", "apss"): {"filterscale": 2.0, "resolution": 200, "steps": 15, "reach": 0.0},
    ("reconstruct", "rimls"): {"filterscale": 2.0, "sigma_n": 0.75, "resolution": 200, "steps": 15, "reach": 0.0},
    ("denoise", "apss"): {"filterscale": 2.0, "steps": 15},
    ("denoise", "rimls"): {"filterscale": 2.0, "sigma_n": 0.75, "steps": 15},
    ("denoise", "jet"): {"k": 24},
    ("denoise", "bilateral"): {"k": 120, "angle": 25.0, "iterations": 3},
    ("denoise", "wlop"): {"radius": 4.0, "iterations": 35},
    ("upsample", "ear"): {"sharpness_angle": 25.0, "edge_sensitivity": 0.0, "radius": 3.0, "passes": 0},
}

# -- the measurement ---------------------------------------------------------------------------------------------------


def shape_of(name: str) -> tuple[str, Trimesh]:
    """A name for the table and the mesh in its frame: the radius of its bounding sphere is 1."""
    from bench import Shape

    if Path(name).is_file():
        shape = Shape(Path(name).stem, load_mesh(name))
    else:
        shape = next(iter(registry().find("dataset", name).cls().shapes("test")))
    return shape.id, shape.framed()[0].mesh


def clouds(mesh: Trimesh, levels: list[float], count: int, seed: int) -> Iterator[tuple[float, PointCloud]]:
    """The same even samples with exact normals at every level of noise, in percent of the radius."""
    rng = generator(seed, "bare library")
    points, normals = eliminate(*MeshSurface(mesh).sample(CANDIDATES * count, rng), mesh, count)
    noise = rng.standard_normal(points.shape)
    for level in levels:
        yield level, PointCloud(points + level / 100 * noise, normals)


def measure(output: Any, mesh: Trimesh) -> dict[str, float]:
    """p2f, s2f, their mean, and the mean angle between unoriented normals at closest points, in degrees."""
    reference = MeshSurface(mesh)
    points, normals = _samples(output)
    foot, truth = reference.closest(points)
    p2f = float(np.linalg.norm(points - foot, axis=1).mean())
    samples = reference.sample(SAMPLES, np.random.default_rng(0))[0]
    if isinstance(output, PointCloud):
        from scipy.spatial import cKDTree

        s2f = float(cKDTree(points).query(samples)[0].mean())
    else:
        s2f = float(np.linalg.norm(MeshSurface(output).closest(samples)[0] - samples, axis=1).mean())
    angle = float("nan")
    if normals is not None:
        cosines = np.abs(np.einsum("ni,ni->n", normals, truth)) / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)
        angle = float(np.degrees(np.arccos(np.clip(cosines, 0, 1))).mean())
    return {"p2f": p2f, "s2f": s2f, "mean": (p2f + s2f) / 2, "angle": angle}


def _samples(output: Any) -> tuple[np.ndarray, np.ndarray | None]:
    if isinstance(output, PointCloud):
        return output.points, output.normals
    return MeshSurface(output).sample(SAMPLES, np.random.default_rng(1))


def overrides(words: list[str]) -> tuple[list[str], dict[str, dict[str, Any]]]:
    """Shapes, and the parameters of each method, from the arguments."""
    shapes, parameters = [], {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or Path(word).is_file():
            shapes.append(word)
            continue
        method, dot, parameter = key.partition(".")
        if not dot:
            raise UsageError(f"{word}: expected METHOD.PARAMETER=VALUE")
        parameters.setdefault(method, {})[parameter] = yaml.safe_load(value)
    return shapes, parameters


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("words", nargs="+", metavar="SHAPE|METHOD.PARAMETER=VALUE")
    parser.add_argument("--task", default="reconstruct,denoise", help="of reconstruct, denoise, upsample")
    parser.add_argument("--methods", default="", help="all that have a bare call, unless some are named")
    parser.add_argument("--levels", default="0,.5,1,2", help="noise in percent of the radius")
    parser.add_argument("--points", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--as-bare", action="store_true", help="the methods with the parameters of the bare call")
    args = parser.parse_intermixed_args()
    shapes, parameters = overrides(args.words)
    levels = [float(level) for level in args.levels.split(",")]
    heads = [
        "task",
        "method",
        "shape",
        "noise%",
        "p2f",
        "bare",
        "s2f",
        "bare",
        "mean",
        "bare",
        "ratio",
        "angle",
        "bare",
        "s",
        "bare",
    ]
    print("distances in 1e-3 of the radius, angles in degrees, times in seconds\n\n| " + " | ".join(heads) + " |")
    print("| --- " * 3 + "| --: " * 12 + "|")
    worse = []
    for name in shapes:
        id, mesh = shape_of(name)
        for level, cloud in clouds(mesh, levels, args.points, args.seed):
            for task in args.task.split(","):
                for method in BARE[task]:
                    if args.methods and method not in args.methods.split(","):
                        continue
                    given = (AS_BARE.get((task, method), {}) if args.as_bare else {}) | parameters.get(method, {})
                    ratio = _line(task, method, id, level, cloud, mesh, given)
                    if ratio > 1.005:
                        worse.append(f"{task} {method} {id} {level:g} %: {ratio:.2f}")
    print(f"\n{len(worse)} where the method is worse than the bare call" + "".join(f"\n  {line}" for line in worse))


def _line(
    task: str, method: str, id: str, level: float, cloud: PointCloud, mesh: Trimesh, given: dict[str, Any]
) -> float:
    """Print one line, and return the ratio that counts: of p2f where points are moved, else of the two-way mean."""
    plugin = build(registry().find("method", method), given)
    begin = time.perf_counter()
    arguments = (cloud, RATIO, Run()) if task == "upsample" else (cloud, Run())
    ours = getattr(plugin, task)(*arguments)
    middle = time.perf_counter()
    bare = BARE[task][method](cloud)
    end = time.perf_counter()
    a, b = measure(ours, mesh), measure(bare, mesh)
    counts = "p2f" if task == "denoise" else "mean"
    cells = " | ".join(f"{1e3 * a[key]:.2f} | {1e3 * b[key]:.2f}" for key in ("p2f", "s2f", "mean"))
    ratio = a[counts] / b[counts] if b[counts] > 0 else float("inf") if a[counts] > 0 else 1.0
    print(
        f"| {task} | {method} | {id} | {level:g} | {cells} | {ratio:.2f} | {a['angle']:.1f} | {b['angle']:.1f} | "
        f"{middle - begin:.1f} | {end - middle:.1f} |",
        flush=True,
    )
    return ratio


if __name__ == "__main__":
    main()
