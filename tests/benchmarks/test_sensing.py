"""Sampling and scanning cost hardly more than the library calls that they cannot do without."""

import os

import numpy as np
import open3d as o3d
import pytest
import trimesh
from turns import medians_by_turns

from bench import Shape, generator
from bench.plugins.registry import registry

SHORT = "DETAILBENCH_SHORT" in os.environ
ROUNDS = 2 if SHORT else 7
COUNT = 12_000 if SHORT else 20_000
PIXELS = 400 if SHORT else 1_000  # along an image: a million rays
LIMITS = {"sampling": 1.5, "scanning": 3.0}  # scanning: hits in float64 with exact incidence, which no library gives


@pytest.fixture(scope="module")
def shape():
    sphere = trimesh.creation.icosphere(6)
    x, y, z = sphere.vertices.T
    scale = 1 + 0.15 * np.sin(5 * x) * np.cos(4 * y) * np.cos(3 * z)
    return Shape("bumpy", trimesh.Trimesh(sphere.vertices * scale[:, None], sphere.faces, process=False)).framed()[0]


def report(capsys, title, medians):
    ours, library = medians.values()
    with capsys.disabled():
        print(f"\n{title}: {ours * 1e3:.1f} ms, the library alone {library * 1e3:.1f} ms, ratio {ours / library:.2f}")
    return ours / library


def test_poisson_disk_sampling(shape, benchmark, capsys):
    sensor = registry().find("sensor", "poisson_disk").cls(count=COUNT)
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(shape.mesh.vertices), o3d.utility.Vector3iVector(shape.mesh.faces)
    )
    mesh.compute_vertex_normals()
    calls = {
        "ours": lambda: sensor.sense(shape, generator(0)),
        "library": lambda: mesh.sample_points_poisson_disk(COUNT),
    }
    medians = medians_by_turns(calls, ROUNDS)
    ratio = report(capsys, f"{COUNT:,} Poisson-disk points", medians)
    benchmark.extra_info["ratio"] = ratio
    cloud = benchmark.pedantic(sensor.sense, args=(shape, generator(0)), rounds=1)
    assert len(cloud) == COUNT
    assert ratio <= LIMITS["sampling"]


def test_scanning(shape, benchmark, capsys):
    sensor = registry().find("sensor", "depth_camera").cls(views=1, resolution=PIXELS, max_points=0, normals="exact")
    vertices = np.asarray(shape.mesh.vertices, dtype=np.float32)
    faces = np.asarray(shape.mesh.faces, dtype=np.uint32)

    def library():
        scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        scene.add_triangles(o3d.core.Tensor(vertices), o3d.core.Tensor(faces))
        rays = scene.create_rays_pinhole(
            fov_deg=39.0, center=[0, 0, 0], eye=[3, 0, 0], up=[0, 0, 1], width_px=PIXELS, height_px=PIXELS
        )
        return scene.cast_rays(rays, nthreads=1)["t_hit"].numpy()

    medians = medians_by_turns({"ours": lambda: sensor.sense(shape, generator(0)), "library": library}, ROUNDS)
    ratio = report(capsys, f"a depth image of {PIXELS**2:,} pixels with exact normals", medians)
    benchmark.extra_info["ratio"] = ratio
    cloud = benchmark.pedantic(sensor.sense, args=(shape, generator(0)), rounds=1)
    # Both filled their image: the bounding sphere does.
    assert len(cloud) == pytest.approx(np.isfinite(library()).sum(), rel=0.1)
    assert ratio <= LIMITS["scanning"]
