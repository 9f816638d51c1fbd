"""Tables of points as text: whatever separates and names the columns, the numbers are those in the file."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from bench import BadInput, PointCloud
from bench.geometry.io.files import load_cloud
from bench.geometry.io.tables import as_utf8
from bench.notices import collected

RNG = np.random.default_rng(0)
P = RNG.normal(size=(80, 3)) * 10 + (3, 7, 11)
UNIT = P / np.linalg.norm(P, axis=1, keepdims=True)
BYTES = RNG.integers(0, 256, (80, 3))
LONE = RNG.normal(size=(80, 1)) * 100


@pytest.fixture
def read(tmp_path: Path):
    def read(text: str | bytes, name: str = "scan.txt") -> tuple[PointCloud, list[str]]:
        path = tmp_path / name
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        with collected() as notices:
            cloud = load_cloud(path)
        assert all(str(path) in text and "\n" not in text for text in notices)
        return cloud, notices

    return read


def table(*blocks: np.ndarray, separator: str = " ", decimal: str = ".", end: str = "\n") -> str:
    rows = np.concatenate([np.asarray(block, dtype=object) for block in blocks], axis=1).tolist()
    return "".join(separator.join(str(v).replace(".", decimal) for v in row) + end for row in rows)


# -- how the numbers are written ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r", " \n", "\n\n"])
@pytest.mark.parametrize("separator", [" ", "   ", "\t", ",", ", ", ";", " ; ", "|"])
def test_separators_and_line_ends(read, separator, end):
    cloud, notices = read(table(P, separator=separator, end=end))
    assert np.array_equal(cloud.points, P) and not notices
    assert np.array_equal(read(table(P, separator=separator, end=separator + end))[0].points, P)


@pytest.mark.parametrize("separator", [" ", "\t", ";", "; "])
@pytest.mark.parametrize("whole", [0, 70])
def test_decimal_commas(read, separator, whole):
    """Also where the first lines hold only whole numbers."""
    points = [[int(v) for v in row] for row in P[:whole]] + P[whole:].tolist()
    cloud, _ = read(table(np.array(points, dtype=object), separator=separator, decimal=","))
    assert np.array_equal(cloud.points, np.array(points, dtype=float))


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1"])
def test_encodings(read, encoding):
    text = "x y z Höhe\n" if encoding == "latin-1" else "x y z h\n"
    assert np.array_equal(read((text + table(P, LONE)).encode(encoding))[0].points, P)
    assert as_utf8("1 2\r3".encode(encoding), "x") == b"1 2\n3"


def test_comments_blank_lines_and_quotes(read):
    text = "// one\n; two\n% three\n\n1 2 3 # c\n4 5 6 // c\n#\n; c\n\n7 8 10\n"
    assert read(text)[0].points.tolist() == [[1, 2, 3], [4, 5, 6], [7, 8, 10]]
    quoted = '"x","y","z"\n"1","2","3"\n"4","5","6"\n"7","8","10"\n'
    assert read(quoted, "a.csv")[0].points.tolist() == [[1, 2, 3], [4, 5, 6], [7, 8, 10]]


@pytest.mark.parametrize("suffix", [".xyz", ".txt", ".asc", ".csv", ".pts", ".xyzn", ".pwn"])
def test_a_count_above_the_points(read, suffix):
    cloud, _ = read(f"80\n{table(P, UNIT)}", f"scan{suffix}")
    assert np.array_equal(cloud.points, P) and np.abs(cloud.normals - UNIT).max() < 1e-15


# -- what the columns are ----------------------------------------------------------------------------------------------

SCALES = {"8 bit": (BYTES, 255), "16 bit": (BYTES * 257, 65535), "0 to 1": (BYTES / 255, 1)}


@pytest.mark.parametrize("kind", SCALES)
def test_six_columns_that_are_colours(read, kind):
    values, scale = SCALES[kind]
    cloud, notices = read(table(P, values))
    assert cloud.normals is None and not cloud.scalars
    assert np.array_equal(cloud.colors, values / scale) and len(notices) == 1 and "colours" in notices[0]


def test_six_columns_that_are_normals_or_neither(read):
    unit = UNIT.copy()
    unit[5], unit[6] = 0, 1.03 * unit[6]
    cloud, notices = read(table(P, unit))
    assert cloud.colors is None and np.abs(cloud.normals[6] - UNIT[6]).max() < 1e-15
    assert ["1 of 80 normals" in text for text in notices] == [True]
    for other in (5 * UNIT, np.hstack([LONE, BYTES[:, :1], 1e6 + LONE])):
        cloud, notices = read(table(P, other))
        assert cloud.normals is None and cloud.colors is None and len(notices) == 1
        assert np.array_equal(np.stack(list(cloud.scalars.values()), axis=1), other)


@pytest.mark.parametrize("order", ["i", "ic", "ci", "nc", "cn", "icn", "nic", "ni", "in"])
def test_groups_of_columns_without_names(read, order):
    blocks = {"i": LONE, "c": BYTES, "n": UNIT}
    cloud, notices = read(table(P, *(blocks[key] for key in order)))
    assert np.array_equal(cloud.points, P) and len(notices) == 1
    assert (cloud.normals is None) == ("n" not in order) and (cloud.colors is None) == ("c" not in order)
    if "n" in order:
        assert np.abs(cloud.normals - UNIT).max() < 1e-15
    if "c" in order:
        assert np.array_equal(cloud.colors, BYTES / 255)
    assert [values.tolist() for values in cloud.scalars.values()] == [LONE[:, 0].tolist()] * ("i" in order)


@pytest.mark.parametrize(
    ("names", "order"),
    [
        ("x y z intensity r g b", "pic"),
        ("//X Y Z R G B Intensity", "pci"),
        ("# nx, ny, nz, x, y, z", "np"),
        ("X [m];Y [m];Z [m];Intensity [-];Red;Green;Blue", "pic"),
        ("Intensity,Easting,Northing,Height,normal_x,normal_y,normal_z", "ipn"),
        ('"Points:0","Points:1","Points:2","Normals:0","Normals:1","Normals:2"', "pn"),
        ("Rf\tGf\tBf\tX\tY\tZ", "cp"),
    ],
)
def test_names_of_columns(read, names, order):
    blocks = {"p": P, "n": 3 * UNIT, "c": BYTES, "i": LONE}
    cloud, notices = read(f"{names}\n{table(*(blocks[key] for key in order), separator=';')}")
    assert np.array_equal(cloud.points, P) and not notices
    assert cloud.colors is None if "c" not in order else np.array_equal(cloud.colors, BYTES / 255)
    assert cloud.normals is None if "n" not in order else np.abs(cloud.normals - UNIT).max() < 1e-15
    assert {key: values.tolist() for key, values in cloud.scalars.items()} == (
        {"intensity": LONE[:, 0].tolist()} if "i" in order else {}
    )


def test_unusual_but_unambiguous_tables(read):
    expected = [[1, 2, 3], [4, 5, 6], [7, 8, 10]]
    for text in (
        "Exported by X\nversion 2\n\nx y z\n1 2 3\n4 5 6\n7 8 10\n",
        "1D0 2.0d0 3D+0\n4 5 6\n7 8 1D1\n",
        "1,2,3\n4;5;6\n7 8 10\n",
        "1\u00a02\u00a03\n4\u00a05\u00a06\n7\u00a08\u00a010\n",
        "lon lat h\n1 2 3\n4 5 6\n7 8 10\n",
    ):
        cloud, notices = read(text)
        assert cloud.points.tolist() == expected and len(notices) == ("lon" in text)


def test_columns_of_text_and_missing_values(read):
    cloud, notices = read('x,y,z,class,time\n1,2,3,"roof, flat",5\n4,5,6,tree,\n7,8,10,roof,7\n', "a.csv")
    assert cloud.points.tolist() == [[1, 2, 3], [4, 5, 6], [7, 8, 10]] and set(cloud.scalars) == {"time"}
    assert np.array_equal(cloud.scalars["time"], [5, np.nan, 7], equal_nan=True) and "class" in notices[0]


def test_names_with_blanks_and_a_column_of_row_numbers(read):
    cloud, _ = read("//X Y Z Scalar field\n" + table(P, LONE))
    assert (
        np.array_equal(cloud.points, P) and list(cloud.scalars) == ["field"] or list(cloud.scalars) == ["scalar_field"]
    )
    cloud, _ = read(",x,y,z\n" + table(np.arange(80)[:, None], P, separator=","), "a.csv")
    assert np.array_equal(cloud.points, P) and not cloud.scalars


def test_a_long_number_takes_little_time(read):
    with pytest.raises(BadInput, match="line 81"):
        read(table(P, separator=",") + f'1,2,"{"x" * 1_000_000}"\n')
    begin = time.process_time()
    with pytest.raises(BadInput, match="line 81: '777"):
        read(table(P) + f"1 2 {'7' * 1_000_000}x\n")
    assert time.process_time() - begin < 2


def test_pwn_with_points_then_normals(read):
    for count in ("", "80\n"):
        cloud, _ = read(count + table(P) + table(UNIT), "a.pwn")
        assert np.array_equal(cloud.points, P) and np.abs(cloud.normals - UNIT).max() < 1e-15


def test_pts_of_several_scans(read):
    cloud, notices = read("2\n1 2 3 -5\n4 5 6 7\n1\n7 8 10 9\n", "a.pts")
    assert cloud.points.tolist() == [[1, 2, 3], [4, 5, 6], [7, 8, 10]]
    assert cloud.scalars["intensity"].tolist() == [-5, 7, 9] and len(notices) == 1


PTX = "4\n5\n1 2 3\n1 0 0\n0 1 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n10 20 30 1\n"


def test_ptx_moves_each_scan_by_its_matrix(read):
    """A quarter turn and a shift, then the identity; the first cell has no return."""
    grids = [np.hstack([P[:20], LONE[:20], BYTES[:20]]), np.hstack([P[20:40], LONE[20:40], BYTES[20:40]])]
    grids[0][0] = 0
    still = PTX.replace("0 1 0 0\n-1 0 0 0", "1 0 0 0\n0 1 0 0").replace("10 20 30 1", "0 0 0 1")
    cloud, notices = read(PTX + table(grids[0]) + still + table(grids[1]), "a.ptx")
    turned = P[1:20] @ [[0, 1, 0], [-1, 0, 0], [0, 0, 1]] + [10, 20, 30]
    assert np.abs(cloud.points - np.concatenate([turned, P[20:40]])).max() < 1e-12
    assert np.array_equal(cloud.colors, BYTES[1:40] / 255) and len(notices) == 2
    assert np.array_equal(cloud.scalars["intensity"], LONE[1:40, 0])
    assert np.array_equal(cloud.scalars["scan"], np.repeat([0, 1], [19, 20]))
    for text, says in (
        (PTX + table(grids[0][:19]), "scan 1 promises 20 cells, but the file holds 19"),
        (PTX + table(grids[0]) + "4\n", "line 31: a scan begins"),
        (PTX + table(grids[0]).replace("255", "red", 1), "is not a number"),
        ("x" + PTX, "line 1 is not part of a PTX header"),
    ):
        with pytest.raises(BadInput, match=says):
            read(text, "bad.ptx")


@pytest.mark.parametrize("value", ["nan", "-nan(ind)", "NaN", "inf", "1.#QNAN"])
def test_points_that_are_not_numbers_are_dropped_and_counted(read, value):
    cloud, notices = read(f"1 2 3 4\n{value} 1 {value} 2\n4 5 6 5\n7 8 10 6\n")
    assert cloud.points.tolist() == [[1, 2, 3], [4, 5, 6], [7, 8, 10]]
    assert cloud.scalars["column_4"].tolist() == [4, 5, 6] and any("1 of 4 points" in text for text in notices)


# -- what is damaged ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (table(P) + "1 2\n", "line 81 has 2 columns"),
        (table(P) + "1 2 3 4\n", "line 81 has 4 columns"),
        (table(P, separator=",") + "1,2\n" + table(P, separator=","), "line 81 has 2 columns"),
        (table(P, separator=";") + "1;2;3;4;5\n", "line 81 has 5 columns"),
        ("# c\nx y z\n" + table(P) + "1 2 three\n", "line 83: 'three' is not a number"),
        ("1 2 3\n\n1_0 2 3\n", "line 3: '1_0' is not a number"),
        ("1 2 3\n0x10 2 3\n", "line 2: '0x10' is not a number"),
        (f"81\n{table(P)}", "promises 81 points, but the file holds 80"),
        ("1 2\n3 4\n5 6\n", "has 2 columns"),
        ("x;y;z;i\n1.000,50;2;3;1\n4;5;6;2\n7;8;10;3\n", "'1.000,50' is not a number"),
        ("1.000,50;2.000,25;3.000,75\n" * 4, "'1.000,50' is not a number"),
        ("1,000.5 2 3\n" * 4, "'1,000.5' is not a number"),
        ('"1,000.5","2","3"\n' * 4, "'1,000.5' is not a number"),
        ("ncols 3\nnrows 2\n1 2 3\n4 5 6\n", "grid of heights"),
        ("x y z\none 2 3\n4 5 6\n", "line 2: 'one' is not a number"),
        ("3\nwater\nO 0 0 0\nH 0 1 0\nH 1 0 0\n", "line 3: 'O' is not a number"),
        (b"\x00\x01\x02" * 50, "is not text"),
        ("so much\nfor words\n", "holds no numbers"),
        (" ".join("1" * 200) + "\n", "has 200 columns"),
    ],
)
def test_text_that_is_not_a_table_is_refused_with_its_line(read, text, says):
    for name in ("bad.xyz", "bad.csv"):
        with pytest.raises(BadInput) as error:
            read(text, name)
        assert says in str(error.value) and name in str(error.value) and len(str(error.value)) < 500
