"""PCD, NumPy's files and those of scanners: all fields are read, and damaged files are refused with a message."""

from __future__ import annotations

import io
import sys
import types
from pathlib import Path

import numpy as np
import open3d as o3d
import pytest

from bench import BadInput, PointCloud
from bench.geometry.io.files import load_cloud, save
from bench.geometry.io.pcd import _expanded
from bench.notices import collected

RNG = np.random.default_rng(0)
P = RNG.normal(size=(200, 3))
N = P / np.linalg.norm(P, axis=1, keepdims=True)
C = RNG.integers(0, 256, (200, 3))
I = RNG.normal(size=200).astype(np.float32)  # noqa: E741


@pytest.fixture
def read(tmp_path: Path):
    def read(content: bytes, name: str) -> tuple[PointCloud, list[str]]:
        (tmp_path / name).write_bytes(content)
        with collected() as notices:
            return load_cloud(tmp_path / name), notices

    return read


def refused(read, content: bytes, name: str, says: str) -> None:
    with pytest.raises(BadInput) as error:
        read(content, name)
    assert says in str(error.value) and name in str(error.value), str(error.value)


# -- PCD ---------------------------------------------------------------------------------------------------------------


def header(fields: str, size: str, kind: str, data: str, count: str = "", points: int = 200) -> bytes:
    count = count or " ".join("1" for _ in fields.split())
    return (
        f"# .PCD v0.7\nVERSION 0.7\nFIELDS {fields}\nSIZE {size}\nTYPE {kind}\nCOUNT {count}\n"
        f"WIDTH {points}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA {data}\n"
    ).encode()


@pytest.mark.parametrize("form", ["ascii", "binary", "compressed"])
def test_files_of_open3d(tmp_path, form):
    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(P.astype(np.float32)))
    cloud.point["normals"] = o3d.core.Tensor(N.astype(np.float32))
    cloud.point["colors"] = o3d.core.Tensor(C.astype(np.uint8))
    cloud.point["intensity"] = o3d.core.Tensor(I[:, None])
    how = {"write_ascii": form == "ascii", "compressed": form == "compressed"}
    assert o3d.t.io.write_point_cloud(str(tmp_path / "a.pcd"), cloud, **how)
    with collected() as notices:
        again = load_cloud(tmp_path / "a.pcd")
    least = 1e-6 if form == "ascii" else 0
    assert np.abs(again.points - P.astype(np.float32)).max() <= 10 * least and not notices
    assert np.abs(again.normals - N).max() < 1e-6 and np.array_equal(again.colors, C / 255)
    assert np.abs(again.scalars["intensity"] - I).max() <= 10 * least


@pytest.mark.parametrize("is_single", [True, False])
def test_our_files_come_back_and_open3d_reads_them(tmp_path, is_single):
    if is_single:
        cloud = PointCloud(P.astype(np.float32), N.astype(np.float32), C / 255, {"intensity": I, "gps time": 3 * I})
    else:
        cloud = PointCloud(P + 5e6, N, C / 255, {"intensity": I, "gps time": 3e8 + P[:, 0]})
    save(cloud, tmp_path / "a.pcd")
    assert (b"DATA binary" in (tmp_path / "a.pcd").read_bytes()) == is_single
    again = load_cloud(tmp_path / "a.pcd")
    assert np.array_equal(again.points, cloud.points) and np.array_equal(again.colors, cloud.colors)
    assert np.abs(again.normals - cloud.normals).max() < 1e-7
    assert np.array_equal(again.scalars["gps_time"], cloud.scalars["gps time"])
    theirs = o3d.io.read_point_cloud(str(tmp_path / "a.pcd"))
    assert np.array_equal(np.asarray(theirs.points), cloud.points)
    assert np.abs(np.asarray(theirs.colors) - C / 255).max() < 1e-12


@pytest.mark.parametrize("form", ["ascii", "binary"])
def test_fields_of_all_types(read, form):
    """A colour in the bits of a float, padding, a vector, a descriptor, points that are not numbers."""
    packed = ((C[:, 0] << 16) | (C[:, 1] << 8) | C[:, 2]).astype(np.uint32)
    kinds = [("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("_", "u1", 3), ("rgb", "<f4"), ("ring", "<u2"), ("v", "<i2", 2)]
    kinds += [("fpfh", "<f4", 33)]
    table = np.zeros(200, dtype=kinds)
    table["x"], table["y"], table["z"] = P.T
    table["x"][7] = np.nan
    table["rgb"], table["ring"], table["v"] = packed.view(np.float32), np.arange(200), C[:, :2] - 128
    head = header("x y z _ rgb ring v fpfh", "8 8 8 1 4 2 2 4", "F F F U F U I F", form, "1 1 1 3 1 1 2 33")
    lines = ((v for cell in row.item() for v in np.ravel(cell).tolist()) for row in table)
    text = "".join(" ".join(map(repr, line)) + "\n" for line in lines).encode()
    cloud, notices = read(head + (text if form == "ascii" else table.tobytes()), "a.pcd")
    good = np.arange(200) != 7
    assert np.array_equal(cloud.points, P[good]) and np.array_equal(cloud.colors, C[good] / 255)
    assert list(cloud.scalars) == ["ring", "v_1", "v_2"]
    assert np.array_equal(cloud.scalars["v_2"], C[good, 1] - 128.0)
    assert ["fpfh" in text for text in notices] == [True, False] and "1 of 200 points" in notices[1]


def test_lzf_copies_literals_and_repeats():
    assert _expanded(bytes([2]) + b"abc" + bytes([(1 << 5), 2]), 6, "x") == b"abcabc"
    assert _expanded(bytes([0]) + b"a" + bytes([(7 << 5), 11, 0]), 21, "x") == b"a" * 21  # an overlapping copy
    for data in (bytes([32, 5]), bytes([2]) + b"ab", bytes([0]) + b"a" + bytes([224])):
        with pytest.raises(BadInput, match="damaged"):
            _expanded(data, 6, "x")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"x y z\n", "has no line 'DATA"),
        (header("x y z", "4 4 4", "F F F", "binary") + b"\0" * 2399, "promises 200 points, but the file holds 199"),
        (header("x y z", "4 4 4", "F F F", "ascii") + b"1 2 3\n", "promises 200 points, but the file holds 1"),
        (header("x y z", "4 4 4", "F F F", "ascii") + b"1 2 3\n1 b 3\n", "'b' is not a number"),
        (header("x y", "4 4", "F F", "binary") + b"\0" * 1600, "expected x, y and z"),
        (header("x y z", "4 4 3", "F F F", "binary"), "the field 'z' has the type"),
        (header("x y z", "4 4", "F F F", "binary"), "for each of its fields"),
        (header("x y z", "4 4 4", "F F F", "binary_compressed") + b"\1\0\0\0\2\0\0\0a", "compressed data has 2 bytes"),
        (header("x y z", "4 4 4", "F F F", "binary", points=10**15), "promises 1,000,000,000,000,000 points"),
    ],
)
def test_a_damaged_pcd(read, content, says):
    refused(read, content, "bad.pcd", says)


# -- NumPy -------------------------------------------------------------------------------------------------------------


def npy(array: np.ndarray) -> bytes:
    sink = io.BytesIO()
    np.save(sink, array, allow_pickle=True)
    return sink.getvalue()


def npz(**arrays: np.ndarray) -> bytes:
    sink = io.BytesIO()
    np.savez_compressed(sink, **arrays)
    return sink.getvalue()


@pytest.mark.parametrize("change", [np.ascontiguousarray, np.asfortranarray, lambda a: a.astype(">f8")])
def test_arrays_of_points(read, change):
    assert np.array_equal(read(npy(change(P)), "a.npy")[0].points, P)
    cloud, _ = read(npy(change(np.hstack([P, C, N]))), "a.npy")
    assert np.array_equal(cloud.colors, C / 255) and np.abs(cloud.normals - N).max() < 1e-15


def test_records_and_archives(read):
    table = np.zeros(200, dtype=[("x", "f4"), ("y", "f4"), ("z", "f4"), ("red", "u2"), ("green", "u2"), ("blue", "u2")])
    for names, values in ((("x", "y", "z"), P), (("red", "green", "blue"), C * 257)):
        for name, column in zip(names, values.T, strict=True):
            table[name] = column
    cloud, notices = read(npy(table), "a.npy")
    assert np.array_equal(cloud.points, P.astype(np.float32)) and np.abs(cloud.colors - C / 255).max() < 1e-15
    cloud, notices = read(npz(points=P, normals=2 * N, colors=C.astype(np.uint8), label=I, scale=np.ones(3)), "a.npz")
    assert np.array_equal(cloud.points, P) and np.array_equal(cloud.colors, C / 255) and not notices[1:]
    assert np.abs(cloud.normals - N).max() < 1e-15 and list(cloud.scalars) == ["label"] and "scale" in notices[0]


@pytest.mark.parametrize(
    ("content", "name", "says"),
    [
        (npy(np.array([{}, 1], dtype=object)), "a.npy", "Python objects"),
        (npy(P)[:-8], "a.npy", "ends early"),
        (npy(P.T), "a.npy", "shape (3, 200)"),
        (npy(P[:, :2]), "a.npy", "shape (200, 2)"),
        (npy(P.astype(complex)), "a.npy", "complex128"),
        (b"1 2 3\n", "a.npy", "is not a numpy array"),
        (npz(a=P, b=P), "a.npz", "one called points"),
        (npz(points=np.array([{}], dtype=object)), "a.npz", "Python objects"),
        (npz(points=P)[:-100], "a.npz", "is not a numpy archive"),
    ],
)
def test_a_damaged_file_of_numpy(read, content, name, says):
    refused(read, content, name, says)


# -- scanners ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "line"), [("a.las", 'pip install "laspy[lazrs]"'), ("a.e57", "pip install pye57")])
def test_a_missing_library_is_named(read, monkeypatch, name, line):
    monkeypatch.setitem(sys.modules, "laspy", None)
    monkeypatch.setitem(sys.modules, "pye57", None)
    refused(read, b"LASF", name, line)


class Las(dict):
    """A stand-in for the result of laspy."""

    def __init__(self, scale: int, promised: int = 200):
        red, green, blue = (C * scale).astype(np.uint16).T
        super().__init__(red=red, green=green, blue=blue, intensity=np.arange(200), user_data=np.zeros(200))
        self.x, self.y, self.z = (P + 5e6).T
        self.point_format = types.SimpleNamespace(dimension_names=[*self, "X"], extra_dimension_names=["deviation"])
        self.header = types.SimpleNamespace(point_count=promised)
        self["deviation"] = I


@pytest.mark.parametrize("scale", [1, 257])
def test_las_with_a_stand_in_for_laspy(read, monkeypatch, scale):
    monkeypatch.setitem(sys.modules, "laspy", types.SimpleNamespace(read=lambda stream: Las(scale)))
    cloud, _ = read(b"LASF", "a.laz")
    assert np.array_equal(cloud.points, P + 5e6) and np.abs(cloud.colors - C / 255).max() < 1e-15
    assert list(cloud.scalars) == ["intensity", "deviation"]  # a constant field carries no information
    monkeypatch.setitem(sys.modules, "laspy", types.SimpleNamespace(read=lambda stream: Las(scale, 300)))
    refused(read, b"LASF", "a.las", "promises 300 points, but the file holds 200")


def test_e57_with_a_stand_in_for_its_library(read, monkeypatch):
    """Two scans, of which one has colours."""

    class File:
        scan_count = 2

        def __init__(self, name):
            assert Path(name).read_bytes() == b"ASTM-E57"

        def read_scan(self, number, **how):
            assert how["transform"]
            found = {f"cartesian{axis}": P[:, k] + number for k, axis in enumerate("XYZ")} | {"intensity": I}
            colors = {f"color{word}": C[:, k] for k, word in enumerate(("Red", "Green", "Blue"))}
            return found | (colors if number else {})

    monkeypatch.setitem(sys.modules, "pye57", types.SimpleNamespace(E57=File))
    cloud, notices = read(b"ASTM-E57", "a.e57")
    assert np.array_equal(cloud.points, np.concatenate([P, P + 1])) and cloud.colors is None
    assert np.array_equal(cloud.scalars["scan"], np.repeat([0, 1], 200)) and "2 scans" in notices[0]
    assert np.array_equal(cloud.scalars["intensity"], np.tile(I, 2))
