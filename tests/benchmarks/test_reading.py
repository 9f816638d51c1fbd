"""Files of a million faces are read in at most twice the time of Open3D, and clouds in four times their memory."""

import os
import subprocess
import sys

import numpy as np
import open3d as o3d
import pytest
from turns import medians_by_turns

from bench.geometry.io.files import load_mesh
from bench.geometry.io.ply import read_ply

SHORT = "DETAILBENCH_SHORT" in os.environ
SIDE = 150 if SHORT else 708  # vertices along a side of the surface: 500,000, and a million faces
ROUNDS = 2 if SHORT else 5
POINTS = 1_000_000 if SHORT else 5_000_000
TIMES, MEMORY = 3.0 if SHORT else 2.0, 4.0  # small files are mostly the opening of a file


@pytest.fixture(scope="module")
def surface():
    place = np.stack(np.meshgrid(np.arange(SIDE), np.arange(SIDE), indexing="ij"), axis=-1).reshape(-1, 2)
    height = np.sin(place[:, 0] / 50) * np.cos(place[:, 1] / 40)
    number = np.arange(SIDE**2).reshape(SIDE, SIDE)
    a, b, c, d = (part.ravel() for part in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return np.column_stack([place / SIDE, height]), faces


def rows(form: str, table: np.ndarray) -> str:
    return (form * len(table)) % tuple(table.ravel().tolist())


@pytest.mark.parametrize("corner", ["v", "v//n"])
def test_an_obj_file_against_open3d(surface, corner, tmp_path, benchmark, capsys):
    vertices, faces = surface
    text = rows("v %.8f %.8f %.8f\n", vertices)
    if corner == "v":
        text += rows("f %d %d %d\n", faces + 1)
    else:
        text += rows("vn %.4f %.4f %.4f\n", np.tile([0.0, 0.6, 0.8], (len(vertices), 1)))
        text += rows("f %d//%d %d//%d %d//%d\n", np.repeat(faces + 1, 2, axis=1))
    path = tmp_path / "surface.obj"
    path.write_text(text)
    calls = {"ours": lambda: load_mesh(path), "open3d": lambda: o3d.io.read_triangle_mesh(str(path))}
    medians = medians_by_turns(calls, ROUNDS)
    ratio = medians["ours"] / medians["open3d"]
    with capsys.disabled():
        print(
            f"\nOBJ of {path.stat().st_size / 1e6:.0f} MB, corners {corner}: {medians['ours']:.2f} s, open3d "
            f"{medians['open3d']:.2f} s, ratio {ratio:.2f} (limit {TIMES})"
        )
    benchmark.extra_info["ratio"] = ratio
    mesh = benchmark.pedantic(load_mesh, args=(path,), rounds=1)
    assert np.array_equal(mesh.faces, faces) and np.abs(mesh.vertices - vertices).max() < 1e-8
    assert ratio <= TIMES


# The peak of ru_maxrss would be that of the parent, which a child begins with.
CHILD = """
import sys
from bench.geometry.io.files import load_cloud
import scipy.spatial, trimesh
def memory(what):
    return next(int(line.split()[1]) * 1024 for line in open("/proc/self/status") if line.startswith(what))
open("/proc/self/clear_refs", "w").write("5")
before = memory("VmRSS")
cloud = load_cloud(sys.argv[1])
arrays = [a for a in (cloud.points, cloud.normals, cloud.colors) if a is not None]
print(len(cloud), sum(a.nbytes for a in arrays), memory("VmHWM") - before)
"""


@pytest.mark.parametrize("kind", ["float", "double"])
def test_the_memory_of_a_cloud(kind, tmp_path, capsys, benchmark):
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {POINTS}\n"
    head += "".join(f"property {kind} {axis}\n" for axis in "xyz") + "end_header\n"
    points = np.random.default_rng(0).normal(size=(POINTS, 3)).astype("<f4" if kind == "float" else "<f8")
    path = tmp_path / "cloud.ply"
    path.write_bytes(head.encode() + points.tobytes())
    done = benchmark.pedantic(
        lambda: subprocess.run([sys.executable, "-c", CHILD, str(path)], capture_output=True, text=True, check=False),
        rounds=1,
    )
    assert done.returncode == 0, done.stderr
    count, arrays, peak = map(int, done.stdout.split())
    ratio = peak / arrays
    with capsys.disabled():
        print(f"\n{count:,} points ({kind}): {arrays / 2**20:.0f} MB of arrays, peak {peak / 2**20:.0f} MB")
    benchmark.extra_info["ratio"] = ratio
    assert count == POINTS and arrays == 24 * POINTS
    assert 1 < ratio <= MEMORY


def test_rows_of_many_sizes(benchmark, capsys):
    """A step of Python a row is all that triangles and quadrangles in turn may cost; Open3D does not read them."""
    count = 240_000
    size = np.tile([3, 4], count // 2)
    values = np.arange(size.sum(), dtype="<i4") % 1000
    ends = np.cumsum(size)
    body = b"".join(bytes([n]) + values[e - n : e].tobytes() for n, e in zip(size.tolist(), ends.tolist(), strict=True))
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 1000\n" + "".join(
        f"property float {a}\n" for a in "xyz"
    )
    head += f"element face {count}\nproperty list uchar int vertex_indices\nend_header\n"
    points = np.random.default_rng(0).normal(size=(1000, 3)).astype("<f4")
    data = head.encode() + points.tobytes() + body

    def loop():
        at, rows = len(head) + points.nbytes, 0
        while at < len(data):
            at += 1 + 4 * data[at]
            rows += 1
        return rows

    medians = medians_by_turns({"ours": lambda: read_ply(data, "name"), "a bare loop": loop}, ROUNDS)
    with capsys.disabled():
        print(f"\n{count:,} polygons of two sizes: {medians['ours']:.2f} s, a bare loop {medians['a bare loop']:.2f} s")
    raw = benchmark.pedantic(read_ply, args=(data, "name"), rounds=1)
    assert len(raw.faces) == count // 2 * 3 and loop() == count
    assert medians["ours"] <= 10 * medians["a bare loop"]
