"""Geometry files: a damaged file is refused with one clear message, a valid one comes back unchanged."""

from __future__ import annotations

import os
import struct
import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh

from bench import BadInput, PointCloud, UsageError
from bench.geometry.io.files import load_cloud, load_mesh, save

BALL = trimesh.creation.icosphere(2)
MESHES = (".ply", ".obj", ".stl", ".off")
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


@pytest.fixture
def write(tmp_path: Path):
    def write(name: str, content: str | bytes) -> Path:
        path = tmp_path / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write


@pytest.fixture(autouse=True)
def no_warning_unless_expected():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def ply(
    vertices: str, faces: str = "", *, count: int | None = None, columns: str = "x y z", kind: str = "double"
) -> str:
    rows, polygons = vertices.strip().splitlines(), faces.strip().splitlines()
    header = ["ply", "format ascii 1.0", "comment made by hand", f"element vertex {count or len(rows)}"]
    header += [f"property {kind} {column}" for column in columns.split()]
    if polygons:
        header += [f"element face {len(polygons)}", "property list uchar int vertex_indices"]
    return "\n".join([*header, "end_header", *rows, *polygons, ""])


def contents(suffix: str) -> bytes:
    return (
        BALL.export(file_type=suffix[1:]) if suffix in (".stl", ".ply") else BALL.export(file_type=suffix[1:]).encode()
    )


def ascii_ply() -> bytes:
    return trimesh.exchange.ply.export_ply(BALL, encoding="ascii")


def ascii_stl() -> bytes:
    return trimesh.exchange.stl.export_stl_ascii(BALL).encode()


def refused(path: Path, *says: str, load=load_mesh) -> str:
    with pytest.raises(BadInput) as error:
        load(path)
    message = str(error.value)
    assert message.startswith(str(path))
    for part in says:
        assert part in message, message
    return message


# -- bad input ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("load", [load_mesh, load_cloud])
@pytest.mark.parametrize("suffix", MESHES)
def test_a_missing_an_empty_and_a_blank_file(write, tmp_path, suffix, load):
    refused(tmp_path / f"gone{suffix}", "no such file", "expected", load=load)
    refused(write(f"empty{suffix}", b""), "is empty", "expected", load=load)
    refused(write(f"blank{suffix}", b" \n\n"), "is empty", load=load)


def test_a_folder(tmp_path):
    refused(tmp_path, "is a folder", "expected a mesh file")
    (tmp_path / "x.ply").mkdir()
    refused(tmp_path / "x.ply", "is a folder")


@pytest.mark.parametrize("name", ["mesh.foo", "mesh", "mesh.txt"])
def test_an_unknown_suffix(write, name):
    refused(write(name, "v 0 0 0"), "unknown suffix", ".ply .obj .stl .off")


def test_an_unreadable_file(write, monkeypatch):
    path = write("secret.ply", contents(".ply"))

    def refuse(self):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "read_bytes", refuse)  # a test that runs as root may read everything
    refused(path, "Permission denied", "check its permissions")


@pytest.mark.parametrize("suffix", MESHES)
@pytest.mark.parametrize("text", ["hello world\n" * 20, "<html><body>404</body></html>", "1 2 3\n4 5 6\n" * 30])
def test_text_that_is_not_a_mesh(write, suffix, text):
    refused(write(f"text{suffix}", text), "expected")


@pytest.mark.parametrize("suffix", MESHES)
def test_bytes_that_are_not_a_mesh(write, suffix):
    refused(write(f"noise{suffix}", np.random.default_rng(0).bytes(4000)), "expected") if suffix != ".stl" else refused(
        write("noise.stl", np.random.default_rng(0).bytes(4000)), "ends early"
    )


@pytest.mark.parametrize("right", MESHES)
@pytest.mark.parametrize("wrong", MESHES)
def test_a_wrong_suffix_names_the_right_one(write, right, wrong):
    if right != wrong:
        message = refused(write(f"mesh{wrong}", contents(right)))
        assert f"rename it to {right}" in message


@pytest.mark.parametrize("keep", [0.1, 0.3, 0.5, 0.9, 0.999])
@pytest.mark.parametrize(
    ("name", "whole"),
    [
        ("binary.ply", lambda: contents(".ply")),
        ("ascii.ply", ascii_ply),
        ("binary.stl", lambda: contents(".stl")),
        ("ascii.stl", ascii_stl),
        ("mesh.off", lambda: contents(".off")),
    ],
)
@pytest.mark.parametrize("load", [load_mesh, load_cloud])
def test_a_truncated_file(write, name, whole, keep, load):
    data = whole().rstrip(b"\n")
    if (name, keep) == ("ascii.ply", 0.999):
        data = data[: data.rindex(b" ")]  # the whole last number: a missing digit cannot be detected
        keep = 1
    refused(write(name, data[: int(keep * len(data))]), load=load)


def test_the_message_of_a_truncated_ply_counts_the_faces(write):
    data = contents(".ply")
    refused(
        write("cut.ply", data[: -10 * 13]), "promises 320 of 'face', but the file holds 310", "copy or export it again"
    )


def test_an_obj_that_ends_within_a_line(write):
    refused(write("cut.obj", TRIANGLE[:-3]), "line 4", "fewer than 3 corners")
    refused(write("cut.obj", "v 0 0 0\nv 1 0"), "line 2", "2 numbers where 3 belong")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("points.ply", ply("0 0 0\n1 0 0\n0 1 0\n")),
        ("points.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n"),
        ("points.off", "OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n"),
    ],
)
def test_a_mesh_without_faces(write, name, content):
    path = write(name, content)
    refused(path, "3 vertices but no faces")
    assert len(load_cloud(path)) == 3


def test_an_stl_without_facets(write):
    refused(write("none.stl", "solid x\nendsolid x\n"), "no faces")
    refused(write("none.stl", b"\0" * 84), "no faces")


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "NaN"])
def test_vertices_that_are_not_finite(write, value):
    """In a mesh their triangles are left out; see test_stl_kinds.py for all formats."""
    rows = f"0 0 0\n1 0 0\n0 1 0\n0 {value} 1\n"
    with pytest.warns(UserWarning, match="1 of 4 vertices are NaN or infinite; they and the 1 of 2 triangles"):
        assert load_mesh(write("bad.ply", ply(rows, "3 0 1 2\n3 0 1 3\n"))).faces.tolist() == [[0, 1, 2]]
    for path in (write("bad.ply", ply(rows, "3 0 1 2\n")), write("bad.xyz", rows)):
        with pytest.warns(UserWarning, match="1 of 4 points are NaN or infinite; they are left out"):
            assert load_cloud(path).points.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


@pytest.mark.parametrize("load", [load_mesh, load_cloud])
def test_all_points_equal(write, load):
    same = "1 2 3\n" * 4
    refused(write("same.ply", ply(same, "3 0 1 2\n3 0 1 3\n")), "coincide", load=load)
    refused(write("same.off", f"OFF\n4 1 0\n{same}3 0 1 2\n"), "coincide", load=load)


def test_two_points(write):
    refused(write("two.xyz", "0 0 0\n1 1 1\n"), "2 points; expected at least 3", load=load_cloud)
    refused(write("two.ply", ply("0 0 0\n1 1 1\n")), "no faces")
    refused(write("two.obj", "v 0 0 0\nv 1 1 1\nf 1 2 2\n"), "degenerate")


def test_a_mesh_without_area(write):
    refused(write("line.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"), "all 1 faces are degenerate")


@pytest.mark.parametrize("index", [3, 99, -1])
def test_faces_whose_vertices_do_not_exist(write, index):
    rows = "0 0 0\n1 0 0\n0 1 0\n"
    refused(write("out.ply", ply(rows, f"3 0 1 {index}\n")), "name vertices that do not exist", f"{index}")
    refused(write("out.off", f"OFF\n3 1 0\n{rows}3 0 1 {index}\n"), "name vertices that do not exist")
    if index >= 0:
        refused(write("out.obj", TRIANGLE + f"f 1 2 {index + 1}\n"), "name vertices that do not exist")
    refused(write("out.obj", TRIANGLE + "f 1 2 0\n"), "name vertices that do not exist")
    refused(write("out.obj", TRIANGLE + "f 1 2 -9\n"), "name vertices that do not exist")


@pytest.mark.parametrize(
    ("header", "says"),
    [
        ("ply\nformat ascii 1.0\nelement vertex 3\n", "header has no end"),
        ("ply\nelement vertex 3\nproperty float x\nend_header\n", "names no format"),
        ("ply\nformat morse 1.0\nend_header\n", "'format morse 1.0'"),
        ("ply\nformat ascii 1.0\nelement vertex many\nend_header\n", "'element vertex many'"),
        ("ply\nformat ascii 1.0\nelement vertex 1\nproperty quark x\nend_header\n", "'property quark x'"),
        ("ply\nformat ascii 1.0\nelement vertex 1\nend_header\n", "without properties"),
        ("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n", "no vertices with x, y and z"),
        ("ply\nformat ascii 1.0\nend_header\n", "no vertices with x, y and z"),
    ],
)
def test_a_broken_ply_header(write, header, says):
    refused(write("head.ply", header), says)


def test_a_list_of_absurd_length(write):
    head = b"ply\nformat binary_little_endian 1.0\nelement vertex 3\n"
    head += b"".join(b"property float %c\n" % axis for axis in b"xyz")
    head += b"element face 1\nproperty list uint int vertex_indices\nend_header\n" + struct.pack("<9f", *range(9))
    refused(write("long.ply", head + struct.pack("<I3i", 2**32 - 1, 0, 1, 2)), "ends early")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("1 2 3\n4 5\n", "line 2 has 2 columns"),
        ("1 2\n3 4\n5 6\n", "has 2 columns; expected 3"),
        ("1 2 3\n4 5 six\n", "line 2: 'six' is not a number"),
        ("x y z\n", "holds no numbers"),
    ],
)
def test_text_that_is_not_a_cloud(write, text, says):
    refused(write("cloud.xyz", text), says, load=load_cloud)
    refused(write("cloud.txt", text), says, load=load_cloud)


# -- unusual but valid -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", MESHES)
def test_files_of_another_library(write, suffix):
    mesh = load_mesh(write(f"ball{suffix}", contents(suffix)))
    assert (len(mesh.vertices), len(mesh.faces)) == (162, 320)
    assert mesh.is_watertight and mesh.volume == pytest.approx(BALL.volume, rel=1e-6)


def test_ascii_stl_and_ply_of_another_library(write):
    for name, data in (("a.stl", ascii_stl()), ("a.ply", ascii_ply())):
        mesh = load_mesh(write(name, data))
        assert mesh.is_watertight and mesh.volume == pytest.approx(BALL.volume, rel=1e-6)


def test_a_big_endian_ply_with_other_elements(write):
    head = b"ply\r\nformat binary_big_endian 1.0\r\nobj_info x\r\nelement camera 1\r\nproperty float f\r\n"
    head += b"element vertex 3\r\nproperty float x\r\nproperty uchar flag\r\nproperty float y\r\nproperty float z\r\n"
    head += b"element face 1\r\nproperty uchar flag\r\nproperty list uchar uint vertex_index\r\nend_header\r\n"
    body = struct.pack(">f", 7) + b"".join(
        struct.pack(">fBff", x, 1, y, z) for x, y, z in [(0, 0, 5), (1, 0, 5), (0, 1, 5)]
    )
    with pytest.warns(UserWarning, match="big.ply: not read from it: flag of faces, element camera$"):
        mesh = load_mesh(write("big.ply", head + body + struct.pack(">BB3I", 9, 3, 0, 1, 2)))
    assert mesh.vertices.tolist() == [[0, 0, 5], [1, 0, 5], [0, 1, 5]] and mesh.faces.tolist() == [[0, 1, 2]]


SQUARE = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n.5 2 0\n"


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_polygons_comments_and_line_endings(write, ending):
    polygons = "4 0 1 2 3\n3 3 2 4\n5 0 1 2 4 3\n"
    vertices = "".join(f"v {row}\n" for row in SQUARE.splitlines())
    obj = f"# c\no thing\n{vertices}vt 0 0\ns off\nf 1/1 2/1 3/1 4/1 # c\nf 4 3 \\\n 5\nusemtl x\nf -5 -4 -3 -1 -2\n"
    off = f"# c\nOFF\n# c\n\n5 3 0\n{SQUARE.replace('1 1 0', '1 1 0 # c')}{polygons}"
    expected = [[0, 1, 2], [0, 2, 3], [3, 2, 4], [0, 1, 2], [0, 2, 4], [0, 4, 3]]
    for name, text in (("a.obj", obj), ("a.off", off), ("a.ply", ply(SQUARE, polygons))):
        mesh = load_mesh(write(name, text.replace("\n", ending)))
        assert mesh.faces.tolist() == expected
        assert len(mesh.vertices) == 5


def test_polygons_of_many_sizes_in_a_binary_ply(write):
    """Convex polygons of points on a circle, against a plain loop."""
    rng = np.random.default_rng(0)
    polygons = [np.sort(rng.choice(50, size, replace=False)) for size in rng.choice([3, 3, 3, 4, 5], size=500)]
    angle = 2 * np.pi * np.arange(50) / 50
    head = b"ply\nformat binary_little_endian 1.0\nelement vertex 50\n"
    head += b"".join(b"property double %c\n" % axis for axis in b"xyz")
    head += b"element face 500\nproperty list uchar int vertex_indices\nend_header\n"
    body = np.column_stack([np.cos(angle), np.sin(angle), np.cos(angle)]).tobytes()
    body += b"".join(struct.pack(f"<B{len(p)}i", len(p), *p) for p in polygons)
    expected = [[p[0], p[k], p[k + 1]] for p in polygons for k in range(1, len(p) - 1)]
    assert np.array_equal(load_mesh(write("many.ply", head + body)).faces, expected)


def test_a_face_of_two_corners_is_left_out_with_a_warning(write):
    with pytest.warns(UserWarning, match="fewer than 3 corners"):
        mesh = load_mesh(write("edge.ply", ply("0 0 0\n1 0 0\n0 1 0\n", "2 0 1\n3 0 1 2\n")))
    assert mesh.faces.tolist() == [[0, 1, 2]]


def test_more_than_the_header_declares_is_ignored_with_a_warning(write):
    with pytest.warns(UserWarning, match="more in the file"):
        assert len(load_mesh(write("more.ply", ply("0 0 0\n1 0 0\n0 1 0\n", "3 0 1 2\n") + "1 2 3\n")).faces) == 1


def test_texture_seams_do_not_cut_an_obj(write):
    """Each corner has its own texture vertex and normal, as exporters write them."""
    text = "".join(f"v {x:.9f} {y:.9f} {z:.9f}\n" for x, y, z in BALL.vertices)
    text += "".join(f"vt {i} 0\nvn 0 0 1\n" for i in range(3 * len(BALL.faces)))
    text += "".join(
        "f " + " ".join(f"{v + 1}/{3 * i + k + 1}/{3 * i + k + 1}" for k, v in enumerate(face)) + "\n"
        for i, face in enumerate(BALL.faces)
    )
    assert load_mesh(write("seams.obj", text)).is_watertight


def test_duplicate_points_stay(write):
    path = write("twice.obj", TRIANGLE + TRIANGLE.replace("f 1 2 3", "f 4 5 6"))
    assert len(load_mesh(path).vertices) == 6 and len(load_cloud(path)) == 6


def test_coordinates_around_a_million_keep_every_digit(write, tmp_path):
    far = trimesh.Trimesh(BALL.vertices + [1e6, -2e6, 3e6], BALL.faces, process=False)
    for suffix in (".ply", ".obj", ".off"):
        save(far, tmp_path / f"far{suffix}")
        assert np.array_equal(load_mesh(tmp_path / f"far{suffix}").vertices, far.vertices)
    # An ASCII file may declare float and hold more digits.
    mesh = load_mesh(
        write("f.ply", ply("1000000.0625 0 0\n1000001.0625 0 0\n1000000.0625 1.001 0", "3 0 1 2", kind="float"))
    )
    assert mesh.vertices[0, 0] == 1000000.0625 and mesh.vertices[2, 1] == 1.001


def test_non_manifold_holes_and_degenerate_faces(write):
    fan = "v 0 0 0\nv 0 0 1\nv 1 0 0\nv 0 1 0\nv -1 0 0\nf 1 2 3\nf 1 2 4\nf 1 2 5\n"
    assert len(load_mesh(write("fan.obj", fan)).faces) == 3
    assert len(load_mesh(write("flat.obj", fan + "f 1 1 2\nf 3 3 3\n")).faces) == 5
    holes = trimesh.Trimesh(BALL.vertices, BALL.faces[::2], process=False)
    mesh = load_mesh(write("holes.ply", holes.export(file_type="ply")))
    assert len(mesh.faces) == 160 and not mesh.is_watertight
    assert len(mesh.vertices) == 162  # vertices without faces stay too


# -- clouds ------------------------------------------------------------------------------------------------------------


def test_three_and_six_columns(write):
    three = load_cloud(write("a.xyz", "# c\n0 0 0\n1 0 0 # c\n\n0 1 0\n"))
    assert three.points.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]] and three.normals is None
    six = load_cloud(write("a.txt", "0,0,0,0,0,1.02\n1;0;0;0;-.6;.8\n0,1,0,1,0,0\n"))
    assert np.allclose(six.normals, [[0, 0, 1], [0, -0.6, 0.8], [1, 0, 0]], atol=1e-15) and six.colors is None
    with pytest.warns(UserWarning, match="columns 4-6 for colours"):
        color = load_cloud(write("b.xyz", "0 0 0 255 0 0\n1 0 0 0 51 0\n0 1 0 0 0 0\n"))
    assert color.normals is None and color.colors.tolist() == [[1, 0, 0], [0, 0.2, 0], [0, 0, 0]]


def test_normals_and_colours_of_a_ply(write):
    rows = "0 0 0 0 0 2\n1 0 0 0 1 0\n0 1 0 1 0 0\n"
    cloud = load_cloud(write("n.ply", ply(rows, columns="x y z nx ny nz")))
    assert cloud.normals.tolist() == [[0, 0, 1], [0, 1, 0], [1, 0, 0]]
    colored = ply("0 0 0 255 0 51\n1 0 0 0 0 0\n0 1 0 0 0 0\n", columns="x y z red green blue")
    for channel in ("red", "green", "blue"):
        colored = colored.replace(f"double {channel}", f"uchar {channel}")
    assert load_cloud(write("c.ply", colored)).colors[0].tolist() == [1, 0, 0.2]


@pytest.mark.parametrize("bad", ["0 0 0", "nan 0 0"])
def test_a_normal_without_a_direction_becomes_that_of_the_nearest_point(write, bad):
    rows = f"0 0 0 0 0 1\n1 0 0 {bad}\n0 1.5 0 1 0 0\n"
    for path in (write("z.ply", ply(rows, columns="x y z nx ny nz")), write("z.xyz", rows)):
        with pytest.warns(UserWarning, match="1 of 3 normals have no direction; those of the nearest"):
            cloud = load_cloud(path)
        assert cloud.normals.tolist() == [[0, 0, 1], [0, 0, 1], [1, 0, 0]]


def test_normals_are_left_out_with_a_warning_when_most_have_no_direction(write):
    rows = "0 0 0 0 0 1\n1 0 0 0 0 0\n0 1 0 0 0 0\n"
    with pytest.warns(UserWarning, match="2 of 3 normals have no direction; all normals are left out"):
        cloud = load_cloud(write("z.ply", ply(rows, columns="x y z nx ny nz")))
    assert cloud.normals is None and len(cloud) == 3


@pytest.mark.parametrize("red", [-0.5, 70000.5])
def test_colours_out_of_range_are_left_out_with_a_warning(write, red):
    with pytest.warns(UserWarning, match="colours"):
        rows = f"0 0 0 {red} 0 0\n1 0 0 0 0 0\n0 1 0 0 0 0\n"
        cloud = load_cloud(write("c.ply", ply(rows, columns="x y z red green blue")))
    assert cloud.colors is None


def test_the_vertices_of_a_mesh_have_normals_only_if_the_file_has_them(write):
    for suffix in MESHES:
        cloud = load_cloud(write(f"ball{suffix}", contents(suffix)))
        assert len(cloud) == 162 and cloud.normals is None
    with_normals = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 2\nf 1//1 2//1 3//1\n"
    assert load_cloud(write("vn.obj", with_normals)).normals.tolist() == [[0, 0, 1]] * 3
    # A crease gives a vertex two normals: then the vertex has no normal of its own.
    crease = with_normals + "v 0 0 1\nvn 0 1 0\nf 1//2 2//2 4//2\n"
    assert load_cloud(write("crease.obj", crease)).normals is None
    of_points = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nvn 0 1 0\nvn 1 0 0\n"
    assert load_cloud(write("p.obj", of_points)).normals.tolist() == [[0, 0, 1], [0, 1, 0], [1, 0, 0]]


# -- writing -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".off"])
def test_a_mesh_comes_back_bit_for_bit(tmp_path, suffix):
    mesh = trimesh.Trimesh(BALL.vertices * np.pi, BALL.faces, process=False)
    save(mesh, tmp_path / f"m{suffix}")
    again = load_mesh(tmp_path / f"m{suffix}")
    assert np.array_equal(again.vertices, mesh.vertices) and np.array_equal(again.faces, mesh.faces)


def test_stl_and_glb_can_be_read_by_others(tmp_path):
    for suffix in (".stl", ".glb", ".ply", ".obj", ".off"):
        save(BALL, tmp_path / f"m{suffix}")
        again = trimesh.load(tmp_path / f"m{suffix}", force="mesh")
        assert len(again.faces) == 320 and again.volume == pytest.approx(BALL.volume, rel=1e-6)


def test_float32_formats_warn_far_from_the_origin(tmp_path):
    far = trimesh.Trimesh(BALL.vertices + 1e6, BALL.faces, process=False)
    with pytest.warns(UserWarning, match="float32"):
        save(far, tmp_path / "far.stl")


def test_a_cloud_comes_back(tmp_path):
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(50, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    cloud = PointCloud(rng.normal(size=(50, 3)) + 1e6, normals, rng.integers(0, 256, size=(50, 3)) / 255)
    for name in ("c.ply", "c.xyz"):
        save(cloud, tmp_path / name)
        again = load_cloud(tmp_path / name)
        assert np.array_equal(again.points, cloud.points)
        assert np.abs(again.normals - normals).max() < 1e-15
    assert np.array_equal(load_cloud(tmp_path / "c.ply").colors, cloud.colors)
    save(PointCloud(cloud.points), tmp_path / "bare.xyz")
    assert load_cloud(tmp_path / "bare.xyz").normals is None


def test_another_library_reads_our_cloud(tmp_path):
    import open3d as o3d

    points = np.random.default_rng(0).normal(size=(50, 3)) + 1e6
    save(PointCloud(points, np.tile([0, 0, 1.0], (50, 1)), np.full((50, 3), 0.2)), tmp_path / "c.ply")
    cloud = o3d.io.read_point_cloud(str(tmp_path / "c.ply"))
    assert np.array_equal(np.asarray(cloud.points), points)
    assert np.asarray(cloud.normals)[0].tolist() == [0, 0, 1] and np.asarray(cloud.colors)[0] == pytest.approx(
        [0.2] * 3
    )


def test_writing_is_atomic_and_makes_folders(tmp_path, monkeypatch):
    path = tmp_path / "new" / "m.ply"
    save(BALL, path)
    before = path.read_bytes()

    def fail(*args):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(UsageError, match="No space left"):
        save(trimesh.creation.box(), path)
    assert path.read_bytes() == before
    assert [file.name for file in path.parent.iterdir()] == ["m.ply"]


@pytest.mark.parametrize(("geometry", "name"), [(BALL, "m.xyz"), (BALL, "m"), (PointCloud(np.eye(3)), "c.stl")])
def test_a_suffix_that_cannot_be_written(tmp_path, geometry, name):
    with pytest.raises(UsageError, match="expected one of .ply"):
        save(geometry, tmp_path / name)
    assert not list(tmp_path.iterdir())
