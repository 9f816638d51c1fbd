"""Files that strain a reader: each is refused in one short message that names it, or read in little time."""

from __future__ import annotations

import os
import struct
import time
from pathlib import Path

import numpy as np
import pytest

from bench import BadInput
from bench.commands.score import load
from bench.geometry.check import FARTHEST
from bench.geometry.io.files import load_cloud, load_mesh
from bench.geometry.io.ply import read_ply
from bench.notices import collected
from bench.text import shortened

CODES = {"uchar": "B", "char": "b", "ushort": "H", "int": "i", "uint": "I", "float": "f", "double": "d"}
VERTICES = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"


def refused(path: Path, load, *says: str) -> None:
    with pytest.raises(BadInput) as error:
        load(path)
    message = str(error.value)
    assert message.startswith(f"{path}: ") and len(message) < len(str(path)) + 600, message
    for part in says:
        assert part in message


def header(*lines: str, form: str = "ascii") -> bytes:
    axes = [f"property float {axis}" for axis in "xyz"]
    return "\n".join(["ply", f"format {form} 1.0", "element vertex 4", *axes, *lines, "end_header", ""]).encode()


FACE = ("element face 1", "property list uchar int vertex_indices")
NAMES = {
    "a column twice": header("property float x") + b"0 0 0 0\n" * 4,
    "a list twice": header(*FACE, "property list uchar int vertex_indices") + VERTICES.encode() + b"3 0 1 2 3 0 1 2\n",
    "a list and a column": header(*FACE, "property int vertex_indices") + VERTICES.encode() + b"3 0 1 2 7\n",
    "an element twice": header("element vertex 1", "property float x") + VERTICES.encode() + b"1\n",
}


@pytest.mark.parametrize("data", NAMES.values(), ids=NAMES)
@pytest.mark.parametrize("load", [load_mesh, load_cloud])
def test_a_header_that_declares_a_name_twice(tmp_path, data, load):
    (tmp_path / "twice.ply").write_bytes(data)
    refused(tmp_path / "twice.ply", load, "has two", "different names")


@pytest.mark.parametrize("count", ["²", "٣", "9" * 5000, "-1", "1e3", "4_0", "+4"])
def test_invalid_counts(tmp_path, count):
    data = header().replace(b"vertex 4", f"vertex {count}".encode()) + VERTICES.encode()
    (tmp_path / "count.ply").write_bytes(data)
    refused(tmp_path / "count.ply", load_cloud, "cannot read the line")


@pytest.mark.parametrize("size", ["-1", "nan", "inf", "2.5", "1e300"])
def test_invalid_sizes_of_lists(tmp_path, size):
    (tmp_path / "size.ply").write_bytes(header(*FACE) + f"{VERTICES}{size} 0 1 2\n".encode())
    refused(tmp_path / "size.ply", load_mesh, "row 1 of 'face' has a list whose size is none")


@pytest.mark.parametrize("index", ["0.5", "nan", "1e18", "300"])
def test_invalid_indices(tmp_path, index):
    """The header declares a type of one byte, too small for 300: the number as written counts, not its low byte."""
    for kind in ("uchar", "int", "float"):
        data = header(FACE[0], f"property list uchar {kind} vertex_indices") + f"{VERTICES}3 0 1 {index}\n".encode()
        (tmp_path / "index.ply").write_bytes(data)
        refused(tmp_path / "index.ply", load_mesh, "1 face corners name vertices that do not exist")


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".off", ".stl", ".xyz"])
@pytest.mark.parametrize("value", ["1e61", "-1e155", "1e308", "-1e308"])
def test_coordinates_whose_squares_are_infinite(tmp_path, suffix, value):
    points = [f"{value} 0 0", f"0 {value} 0", f"0 0 {value}"]
    facet = "".join(f"vertex {p}\n" for p in points)
    text = {
        ".ply": header(*FACE).decode().replace("vertex 4", "vertex 3") + "\n".join(points) + "\n3 0 1 2\n",
        ".obj": "".join(f"v {p}\n" for p in points) + "f 1 2 3\n",
        ".off": "OFF\n3 1 0\n" + "\n".join(points) + "\n3 0 1 2\n",
        ".stl": f"solid a\nfacet normal 0 0 1\nouter loop\n{facet}endloop\nendfacet\nendsolid\n",
        ".xyz": "\n".join(points) + "\n",
    }[suffix]
    path = tmp_path / f"far{suffix}"
    path.write_text(text)
    for read in (load_mesh, load_cloud) if suffix != ".xyz" else (load_cloud,):
        refused(path, read, "has coordinates up to", f"{FARTHEST:g}")


@pytest.mark.parametrize("scale", [1e-50, 1e50])
def test_very_small_and_very_large_coordinates_are_valid(tmp_path, scale):
    rows = [(0.0, 0.0, 0.0), (scale, 0.0, 0.0), (0.0, scale, 0.0)]
    (tmp_path / "m.obj").write_text("".join("v {!r} {!r} {!r}\n".format(*row) for row in rows) + "f 1 2 3\n")
    assert load_mesh(tmp_path / "m.obj").area == pytest.approx(scale**2 / 2, rel=1e-12)
    assert len(load_cloud(tmp_path / "m.obj")) == 3


WORD = "x" * 3_000_000


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("w.ply", header(*FACE).decode() + VERTICES + f"3 0 1 {WORD}\n"),
        ("w.ply", header(f"property float {WORD}").decode().replace("float x", "float", 1) + VERTICES),
        ("w.obj", f"v 0 0 {WORD}\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
        ("w.obj", f"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 {WORD}\n"),
        ("w.off", f"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 {WORD}\n3 0 1 2\n"),
        ("w.off", f"OFF\n3 {WORD} 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"),
        ("w.stl", "solid\n" + f"facet normal 0 0 1\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 {WORD}\n" + "endsolid"),
        ("w.xyz", f"0 0 0\n1 0 0\n0 1 {WORD}\n"),
    ],
)
def test_a_word_of_millions_of_letters_is_not_quoted(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    refused(tmp_path / name, load_cloud)


def test_one_long_number_in_an_stl_takes_little_memory(tmp_path):
    """An array of text would give every corner the length of the longest word: 27 GB here."""
    facet = "facet normal 0 0 1\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
    long = facet.replace("vertex 0 1 0", f"vertex 0 1.{'0' * 3_000_000} 0")
    (tmp_path / "long.stl").write_text(f"solid\n{facet * 1000}{long}endsolid")
    assert len(load_mesh(tmp_path / "long.stl").faces) == 1001


@pytest.mark.parametrize("text", ["# nothing\n\n# at all\n", "// x\n", "\n#\n\n"])
def test_a_table_of_comments_alone(tmp_path, text):
    (tmp_path / "none.xyz").write_text(text)
    refused(tmp_path / "none.xyz", load_cloud, "holds no numbers")


# -- not a regular file ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("load", [load_mesh, load_cloud, load])
@pytest.mark.parametrize("suffix", [".ply", ".stl"])
def test_pipes_and_devices_are_refused_at_once(tmp_path, load, suffix):
    """A read from a pipe without a writer blocks forever; /dev/zero never ends."""
    os.mkfifo(tmp_path / f"pipe{suffix}")
    for name in ("zero", "null"):
        (tmp_path / f"{name}{suffix}").symlink_to(f"/dev/{name}")
    for name in ("pipe", "zero", "null"):
        refused(tmp_path / f"{name}{suffix}", load, "is a pipe or a device", "Copy it to a file")


def test_a_link_to_a_file_is_read(tmp_path):
    (tmp_path / "a.xyz").write_text(VERTICES)
    (tmp_path / "b.xyz").symlink_to(tmp_path / "a.xyz")
    assert len(load_cloud(tmp_path / "b.xyz")) == 4


# -- rows of mixed sizes -----------------------------------------------------------------------------------------------


def ragged(form: str, count: int, types: tuple[str, str, str], seed: int = 0) -> tuple[bytes, list, list]:
    """A PLY file whose faces hold number, list, number, list; its first lists; the numbers of its last element."""
    rng = np.random.default_rng(seed)
    order, (length, index, other) = "<" if "little" in form else ">", types
    lists = [rng.integers(0, 4, size).tolist() for size in rng.choice([0, 1, 3, 4, 5, 9], count)]
    texture = [rng.random(size).tolist() for size in rng.choice([0, 6, 8], count)]
    lines = [f"element face {count}", "property double before", f"property list {length} {index} vertex_indices"]
    lines += [f"property {other} flag", f"property list {length} float texcoord"]
    last = f"element more {count}", "property uchar number"
    rows = [(0.5, len(a), *a, 7, len(b), *b) for a, b in zip(lists, texture, strict=True)]
    numbers = rng.integers(0, 255, count).tolist()
    if form == "ascii":
        body = VERTICES + "".join(" ".join(map(str, row)) + "\n" for row in rows) + "\n".join(map(str, numbers))
        return header(*lines, *last) + body.encode(), lists, numbers
    size, whole, flag = (CODES[kind] for kind in types)
    kinds = [f"{order}d{size}{len(a)}{whole}{flag}{size}{len(b)}f" for a, b in zip(lists, texture, strict=True)]
    body = struct.pack(f"{order}12f", *map(float, VERTICES.split()))
    body += b"".join(struct.pack(kind, *row) for kind, row in zip(kinds, rows, strict=True)) + bytes(numbers)
    return header(*lines, *last, form=form) + body, lists, numbers


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("types", [("uchar", "int", "uchar"), ("int", "uchar", "double"), ("ushort", "uint", "float")])
def test_rows_of_mixed_sizes_match_a_loop(form, types):
    from bench.geometry.io.ply import _header, _tables

    data, lists, numbers = ragged(form, 500, types)
    form, elements, at = _header(data, "name")
    with collected() as notices:
        _, face, more = _tables(data, at, form, elements, "name").values()
    assert face["vertex_indices"].sizes.tolist() == [len(one) for one in lists]
    assert face["vertex_indices"].values.tolist() == [value for one in lists for value in one]
    assert set(face["before"]) == {0.5} and set(face["flag"]) == {7}
    assert more["number"].tolist() == numbers and not notices


@pytest.mark.parametrize("form", ["ascii", "binary_big_endian"])
@pytest.mark.parametrize("there", [0, 1, 6, 9])
def test_the_message_of_a_truncated_table_counts_its_rows(form, there):
    """Cut within a row and right after one; 5 triangles and 5 quadrangles alternate."""
    rows = [(3, 0, 1, 2), (4, 0, 1, 3, 2)] * 5
    ascii_rows = [(" ".join(map(str, row)) + "\n").encode() for row in rows]
    binary_rows = [struct.pack(f">B{row[0]}i", *row) for row in rows]
    pieces = ascii_rows if form == "ascii" else binary_rows
    points = VERTICES.encode() if form == "ascii" else struct.pack(">12f", *map(float, VERTICES.split()))
    sound = header("element face 10", FACE[1], form=form) + points
    for part in (b"", pieces[there][:1], pieces[there][:-2]):
        with pytest.raises(BadInput, match=f"promises 10 of 'face', but the file holds {there}"):
            read_ply(sound + b"".join(pieces[:there]) + part, "name")
    assert len(read_ply(sound + b"".join(pieces), "name").faces) == 15


def test_a_hundred_thousand_faces_of_two_sizes_take_less_than_two_seconds(tmp_path):
    """Read in runs of equal rows, which are one face long here, they take seven seconds on an idle core."""
    triangle, quad = struct.pack("<B3i", 3, 0, 1, 2), struct.pack("<B4i", 4, 0, 1, 3, 2)
    count = 100_000
    lines = [f"element face {count}", FACE[1]]
    points = struct.pack("<12f", *map(float, VERTICES.split()))
    data = header(*lines, form="binary_little_endian") + points + (triangle + quad) * (count // 2)
    begin = time.process_time()
    raw = read_ply(data, "name")
    assert time.process_time() - begin < 2
    assert len(raw.faces) == count // 2 * 3 and (raw.faces[::3] == [0, 1, 2]).all()


def test_shortened_keeps_both_ends():
    for most in (10, 11, 50):
        text = shortened("abc" * 100 + "xyz", most)
        assert len(text) == most and text.startswith("abc") and text.endswith("xyz")
    assert shortened("abc", 3) == "abc"
