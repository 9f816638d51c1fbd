"""Scenes (GLB, glTF, 3MF, COLLADA): all meshes are where the transforms put them; unsupported files are refused."""

from __future__ import annotations

import importlib.util
import io
import json
import struct
import zipfile

import numpy as np
import pytest
import trimesh
from cube_files import QUADS, TRIANGLES, V, check_cube

from bench import BadInput, PointCloud, UsageError
from bench.commands.score import read as read_case
from bench.errors import MissingLibrary
from bench.geometry.io import scenes
from bench.geometry.io.files import MESH_READERS, load_geometry, load_mesh, save
from bench.geometry.io.suffixes import MESH_SUFFIXES, SCENES
from bench.notices import collected

CUBE = trimesh.Trimesh(V, TRIANGLES, process=False)
MOVE = trimesh.transformations.translation_matrix([5, 0, 0])


def three_cubes() -> trimesh.Scene:
    """One unchanged, one moved and twice as large, one moved and mirrored."""
    scene = trimesh.Scene(CUBE)
    scene.add_geometry(CUBE, transform=MOVE @ np.diag([2, 2, 2, 1.0]))
    scene.add_geometry(CUBE, transform=MOVE @ MOVE @ np.diag([1, -1, 1, 1.0]))
    return scene


def check_three(raw) -> None:
    mesh = trimesh.Trimesh(raw.vertices, raw.faces, process=False)
    assert len(mesh.vertices) == 24 and len(mesh.faces) == 36 and mesh.is_watertight
    assert mesh.area == pytest.approx(6 + 24 + 6) and mesh.volume == pytest.approx(1 + 8 + 1)
    assert mesh.bounds.tolist() == [[0, -1, 0], [11, 2, 2]]


def quiet(reader, data: bytes, name: str):
    with collected() as said:
        raw = reader(data, str(name))
    assert not said
    return raw


def patched(change) -> bytes:
    """The GLB of a cube with another JSON part."""
    data = CUBE.export(file_type="glb")
    size = int.from_bytes(data[12:16], "little")
    header = json.loads(data[20 : 20 + size])
    change(header)
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + size :]
    return b"glTF" + struct.pack("<3I", 2, 20 + len(text) + len(rest), len(text)) + b"JSON" + text + rest


def test_the_lists_of_suffixes():
    assert set(MESH_READERS) == set(MESH_SUFFIXES) and set(SCENES) < set(MESH_SUFFIXES)


def test_glb_and_gltf(tmp_path):
    check_cube(quiet(scenes.read_glb, CUBE.export(file_type="glb"), "a.glb"))
    check_three(quiet(scenes.read_glb, three_cubes().export(file_type="glb"), "a.glb"))
    for name, data in three_cubes().export(file_type="gltf").items():
        (tmp_path / name).write_bytes(data)
    path = tmp_path / "model.gltf"
    check_three(quiet(scenes.read_gltf, path.read_bytes(), path))
    next(tmp_path.glob("*.bin")).unlink()
    with pytest.raises(BadInput, match=r"names the file '.*\.bin', which is not there"):
        load_mesh(path)
    for device in ("/dev/zero", "x" * 5000, "\0"):
        header = json.loads(path.read_text())
        header["buffers"][0]["uri"] = device
        (tmp_path / "other.gltf").write_text(json.dumps(header))
        with pytest.raises(BadInput, match="which is not there"):
            load_mesh(tmp_path / "other.gltf")


def test_seams_are_closed_and_reported():
    apart = trimesh.Trimesh(CUBE.vertices[CUBE.faces.ravel()], np.arange(36).reshape(-1, 3), process=False)
    with collected() as said:
        check_cube(scenes.read_glb(apart.export(file_type="glb"), "a.glb"))
    assert len(said) == 1 and "a.glb: 28 vertices at the places of others" in said[0]


def test_points_are_a_cloud(tmp_path):
    cloud = trimesh.PointCloud(np.array(V, dtype=float), colors=np.tile([255, 51, 0, 255], (8, 1)))
    moved = trimesh.Scene()
    moved.add_geometry(cloud, transform=MOVE)
    (tmp_path / "a.glb").write_bytes(moved.export(file_type="glb"))
    points = load_geometry(tmp_path / "a.glb")
    assert isinstance(points, PointCloud) and np.array_equal(points.points, np.array(V) + [5.0, 0, 0])
    assert points.colors[0].tolist() == [1, 0.2, 0]


def test_a_written_file_can_be_scored(tmp_path):
    ball = trimesh.creation.icosphere(2)
    for name in ("a.glb", "a.ply"):
        save(ball, tmp_path / name)
    case, output = read_case(str(tmp_path / "a.glb"), str(tmp_path / "a.ply"))
    reference = case.reference.mesh
    assert np.array_equal(output.faces, reference.faces)
    assert np.abs(output.vertices - reference.vertices).max() < 1e-6


def places(header):
    return header["accessors"][header["meshes"][0]["primitives"][0]["attributes"]["POSITION"]]


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"hello" * 30, "does not begin with 'glTF'"),
        (CUBE.export(file_type="glb")[:-30], "cut off"),
        (patched(lambda h: h.update(extensionsRequired=["KHR_draco_mesh_compression"])), "KHR_draco_mesh_compression"),
        (patched(lambda h: h["meshes"][0]["primitives"][0].update(mode=6)), "triangle fans"),
        (patched(lambda h: places(h).update(normalized=True)), "without compression"),
        (patched(lambda h: places(h).update(count=10**9)), "cannot be read as GLB"),
        (patched(lambda h: h["accessors"].append({"count": 10**12})), "promises 1000000000000 values"),
        (patched(lambda h: h["meshes"][0].pop("primitives")), "cannot read its JSON"),
        (CUBE.export(file_type="glb").replace(b"BIN\0", b"BIN\0\xff\xff\xff\x7f"), "name vertices that do not exist"),
    ],
)
def test_invalid_files_are_refused(tmp_path, data, says):
    (tmp_path / "a.glb").write_bytes(data)
    with pytest.raises(BadInput) as error:
        load_mesh(tmp_path / "a.glb")
    assert str(error.value).startswith(f"{tmp_path / 'a.glb'}: ") and says in str(error.value)


def test_harmless_extensions_are_accepted():
    check_cube(scenes.read_glb(patched(lambda h: h.update(extensionsRequired=["KHR_materials_unlit"])), "a.glb"))


# -- formats of optional libraries -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("suffix", "library"), [(".3mf", "lxml"), (".dae", "pycollada")])
def test_a_missing_library_is_named_with_its_install_command(tmp_path, monkeypatch, suffix, library):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    data = io.BytesIO(b"<COLLADA>")
    if suffix == ".3mf":
        zipfile.ZipFile(data, "w").close()
    (tmp_path / f"a{suffix}").write_bytes(data.getvalue())
    expected = rf"^{library} reads .*a\{suffix}.*pip install lxml networkx pycollada"
    with pytest.raises(MissingLibrary, match=expected) as error:
        load_mesh(tmp_path / f"a{suffix}")
    assert not isinstance(error.value, UsageError)


def test_3mf(tmp_path, monkeypatch):
    check_three(quiet(scenes.read_3mf, three_cubes().export(file_type="3mf"), "a.3mf"))
    monkeypatch.setattr(scenes, "MOST_BYTES", 1_000_000)
    bomb, empty = io.BytesIO(), io.BytesIO()
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", b" " * 1_000_001)
    zipfile.ZipFile(empty, "w").close()
    sound = three_cubes().export(file_type="3mf")
    files = [(bomb.getvalue(), "promises 1,000,001 bytes"), (empty.getvalue(), "cannot be read as 3MF")]
    for data, says in [*files, (b"solid", "not a complete archive"), (sound[:-30], "not a complete archive")]:
        (tmp_path / "a.3mf").write_bytes(data)
        with pytest.raises(BadInput, match=says):
            load_mesh(tmp_path / "a.3mf")


def collada() -> str:
    def source(name, numbers, params):
        accessor = f"<accessor source='#{name}-a' count='{len(numbers) // len(params)}' stride='{len(params)}'>"
        accessor += "".join(f"<param name='{p}' type='float'/>" for p in params) + "</accessor>"
        array = f"<float_array id='{name}-a' count='{len(numbers)}'>{' '.join(map(str, numbers))}</float_array>"
        return f"<source id='{name}'>{array}<technique_common>{accessor}</technique_common></source>"

    corners = " ".join(str(c) for q in QUADS for c in q)
    polygons = f"<polylist count='6'><input semantic='VERTEX' source='#v' offset='0'/><vcount>{'4 ' * 6}</vcount>"
    mesh = source("p", [x for v in V for x in v], "XYZ")
    mesh += "<vertices id='v'><input semantic='POSITION' source='#p'/></vertices>" + polygons + f"<p>{corners}</p>"
    places = (
        "",
        "<translate>5 0 0</translate><scale>2 2 2</scale>",
        "<translate>10 0 0</translate><scale>1 -1 1</scale>",
    )
    nodes = "".join(f"<node id='n{k}'>{p}<instance_geometry url='#g'/></node>" for k, p in enumerate(places))
    return (
        "<?xml version='1.0'?><COLLADA xmlns='http://www.collada.org/2005/11/COLLADASchema' version='1.4.1'>"
        f"<asset><up_axis>Z_UP</up_axis></asset><library_geometries><geometry id='g'><mesh>{mesh}</polylist></mesh>"
        f"</geometry></library_geometries><library_visual_scenes><visual_scene id='s'>{nodes}</visual_scene>"
        "</library_visual_scenes><scene><instance_visual_scene url='#s'/></scene></COLLADA>"
    )


def test_collada(tmp_path):
    with collected() as said:
        check_three(scenes.read_dae(collada().encode(), "a.dae"))
    assert len(said) == 1 and "a.dae: polygons of more than three corners become fans" in said[0]
    triangles = collada().replace("4 4 4 4 4 4 ", "3 3 3 3 3 3 3 3 ").replace("count='6'>", "count='8'>")
    assert len(quiet(scenes.read_dae, triangles.encode(), "a.dae").faces) == 24
    for text, says in (("solid", "does not begin with a COLLADA"), ("<COLLADA>", "cannot be read as COLLADA")):
        (tmp_path / "a.dae").write_text(text)
        with pytest.raises(BadInput, match=says):
            load_mesh(tmp_path / "a.dae")
