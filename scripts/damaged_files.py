"""Sound geometry files, and mutations that damage them; see fuzz_files.py."""

import base64
import io
import json
import random
import re
import struct

import numpy as np

SOLID = [(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0), (0, 0, 1), (2, 0, 1), (2, 1, 1), (0, 1, 1), (1, 0.5, 2)]
POLYGONS = [(0, 3, 2, 1), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7), (4, 5, 8), (5, 6, 8), (6, 7, 8, 4)]
TRIANGLES = [(p[0], p[i], p[i + 1]) for p in POLYGONS for i in range(1, len(p) - 1)]
NUMBERS = [
    *b"nan inf -inf 1e80 1e155 1e200 1e308 -1e308 1e-320 -1 0 255 256 65536 4294967295 1000000000000".split(),
    *"0x10 1_0 ² 3.5 1,5 NaN(1)".encode().split(),
    *(b"7" * 4400, b"9" * 30, b"x" * 5000, b"", b"\xff\xfe", b"\x1b[2J"),
]
LINES = b"""
ply|format ascii 1.0|format binary_little_endian 1.0|format binary_big_endian 1.0|comment z|end_header
element vertex 9|element vertex 0|element face 8|element face 3000000|element x 1|property float x|property double y
property list uchar int vertex_indices|property list float int vertex_indices|property list uchar float x|property char
property uchar red|OFF|COFF|9 8 0|solid a|endsolid a|facet normal 0 0 1|v 1 2 3|f 1 2 3 4"""
LINES = re.split(rb"[\n|]", LINES)
COLUMNS = {"f": "float", "d": "double", "B": "uchar"}


def _ply(form: str, polygons: list[tuple[int, ...]], extras: str = "", kind: str = "f") -> bytes:
    """A PLY file; ``extras`` may name normals and colours."""
    name, order = {"a": ("ascii", ""), "<": ("binary_little_endian", "<"), ">": ("binary_big_endian", ">")}[form]
    columns = [(axis, kind) for axis in ("x", "y", "z", *(("nx", "ny", "nz") if "n" in extras else ()))]
    columns += [(color, "B") for color in ("red", "green", "blue")] if "c" in extras else []
    head = ["ply", f"format {name} 1.0", "comment sound", f"element vertex {len(SOLID)}"]
    head += [f"property {COLUMNS[k]} {column}" for column, k in columns]
    head += [f"element face {len(polygons)}", "property list uchar int vertex_indices"] if polygons else []
    rows = [(*p, *((0.0, 0.6, 0.8) if "n" in extras else ()), *((9, 99, 255) if "c" in extras else ())) for p in SOLID]
    if form == "a":
        body = "".join(f"{' '.join(map(str, row))}\n" for row in (*rows, *((len(p), *p) for p in polygons))).encode()
    else:
        body = b"".join(struct.pack(order + "".join(k for _, k in columns), *row) for row in rows)
        body += b"".join(struct.pack(f"{order}B{len(p)}i", len(p), *p) for p in polygons)
    return "\n".join([*head, "end_header", ""]).encode() + body


def _strips(form: str) -> bytes:
    """A PLY file of triangle strips with a restart."""
    sound = (
        _ply(form, TRIANGLES[:1]).replace(b"element face 1", b"element tristrips 1").replace(b"list uchar", b"list int")
    )
    strip = (0, 1, 3, 2, -1, 4, 5, 8, 6, 7)
    if form == "a":
        return sound[: sound[:-1].rindex(b"\n") + 1] + f"{len(strip)} {' '.join(map(str, strip))}\n".encode()
    return sound[:-13] + struct.pack(f"{form}{len(strip) + 1}i", len(strip), *strip)


def _binary_off() -> bytes:
    body = b"".join(struct.pack(f">{len(p) + 2}i", len(p), *p, 0) for p in POLYGONS)
    places = struct.pack(f">{3 * len(SOLID)}f", *(x for p in SOLID for x in p))
    return b"OFF BINARY\n" + struct.pack(">3i", len(SOLID), len(POLYGONS), 0) + places + body


def _gltf() -> tuple[bytes, bytes]:
    """The same mesh as glTF with its data inside, and as GLB."""
    data = struct.pack(f"<{3 * len(SOLID)}f", *(x for p in SOLID for x in p))
    data += struct.pack(f"<{3 * len(TRIANGLES)}I", *(c for t in TRIANGLES for c in t))
    views = [{"buffer": 0, "byteOffset": 0, "byteLength": 12 * len(SOLID)}]
    views.append({"buffer": 0, "byteOffset": 12 * len(SOLID), "byteLength": 12 * len(TRIANGLES)})
    accessors = [{"bufferView": 0, "componentType": 5126, "count": len(SOLID), "type": "VEC3"}]
    accessors.append({"bufferView": 1, "componentType": 5125, "count": 3 * len(TRIANGLES), "type": "SCALAR"})
    document = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "bufferViews": views}
    document |= {"nodes": [{"mesh": 0, "translation": [1, 2, 3]}], "accessors": accessors}
    document["meshes"] = [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}]
    inside = {"uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}
    text = json.dumps(document | {"buffers": [{"byteLength": len(data)} | inside]}).encode()
    head = json.dumps(document | {"buffers": [{"byteLength": len(data)}]}).encode()
    head += b" " * (-len(head) % 4)
    size = 28 + len(head) + len(data)
    chunks = struct.pack("<I", len(head)) + b"JSON" + head + struct.pack("<I", len(data)) + b"BIN\0" + data
    return text, b"glTF" + struct.pack("<2I", 2, size) + chunks


def _lines(rows: list, before: str = "") -> str:
    return "".join(f"{before}{' '.join(map(str, row))}\n" for row in rows)


def corpus() -> list[tuple[str, bytes]]:
    """Sound files, each with its suffix."""
    found = [(".ply", _ply(f, p, e, k)) for f in "a<>" for p, e, k in ((POLYGONS, "nc", "f"), (TRIANGLES, "", "d"))]
    found += [(".ply", _ply("<", [], "c")), (".ply", _ply("a", [], "n"))]
    obj = "mtllib a.mtl\n" + _lines(SOLID, "v ") + "vn 0 0 1\nvt 0 0\ng sides # all\n"
    found.append((".obj", (obj + _lines([[f"{c + 1}/1/1" for c in p] for p in POLYGONS], "f ")).encode()))
    found.append((".obj", (_lines(SOLID, "v ") + _lines([[c - 9 for c in t] for t in TRIANGLES], "f ")).encode()))
    polygons = _lines([(len(p), *p) for p in POLYGONS])
    found.append((".off", f"OFF\n{len(SOLID)} {len(POLYGONS)} 0\n{_lines(SOLID)}{polygons}".encode()))
    words = "\n".join(f"{len(SOLID)} {len(TRIANGLES)} 0 {_lines(SOLID)}{_lines([(3, *t) for t in TRIANGLES])}".split())
    found += [(".off", f"OFF{words}\n".encode()), (".off", _binary_off())]
    colored = _lines([(*p, 9, 99, 255, 1) for p in SOLID])
    found.append((".off", f"COFF\n{len(SOLID)} {len(POLYGONS)} 0\n{colored}{polygons}".encode()))
    found += [(".ply", _strips("a")), (".ply", _strips("<")), (".obj", found[9][1].decode().encode("utf-16"))]
    found += zip((".gltf", ".glb"), _gltf(), strict=True)
    corners = [[SOLID[c] for c in t] for t in TRIANGLES]
    facets = [f"facet normal 0 0 1\nouter loop\n{_lines(t, 'vertex ')}endloop\nendfacet\n" for t in corners]
    found.append((".stl", f"solid a\n{''.join(facets)}endsolid a\n".encode()))
    binary = [struct.pack("<12fH", 0, 0, 1, *(x for p in t for x in p), 0) for t in corners]
    found.append((".stl", b"\0" * 80 + struct.pack("<I", len(corners)) + b"".join(binary)))
    table = [(*p, 0, 0, 1) for p in SOLID]
    found += [(s, t.encode()) for s, t in ((".xyz", _lines(table)), (".txt", _lines(SOLID)))]
    return [*found, *_scans()]


def _scans() -> list[tuple[str, bytes]]:
    """Tables of several kinds, PCD in three forms, and an array of numpy."""
    rich = [(*(v + 0.5 for v in p), 40 * k - 7, 9 * k, 200, 31 * k % 256) for k, p in enumerate(SOLID)]
    tables = [
        (".csv", "x,y,z,intensity,r,g,b\n" + _lines(rich).replace(" ", ",")),
        (".csv", "X [m];Y [m];Z [m];I;R;G;B\n" + _lines(rich).replace(" ", ";").replace(".", ",")),
        (".pts", f"{len(rich)}\n{_lines(rich)}"),
        (".ptx", "3\n3\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n5 0 0 1\n" + _lines(rich)),
        (".asc", "//X Y Z I R G B\n" + _lines(rich)),
    ]
    fields = "FIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\n"
    head = f"# .PCD v0.7\nVERSION 0.7\n{fields}WIDTH {len(SOLID)}\nHEIGHT 1\nPOINTS {len(SOLID)}\nDATA "
    rows = [(*map(float, p), 70_000 * k) for k, p in enumerate(SOLID)]
    binary = b"".join(struct.pack("<3fI", *row) for row in rows)
    columns = b"".join(struct.pack(f"<{len(rows)}{'fffI'[k]}", *(row[k] for row in rows)) for k in range(4))
    pieces = [columns[k : k + 32] for k in range(0, len(columns), 32)]
    packed = b"".join(bytes([len(piece) - 1]) + piece for piece in pieces)  # LZF that repeats nothing
    sizes = struct.pack("<II", len(packed), len(columns))
    bodies = (f"ascii\n{_lines(rows)}".encode(), b"binary\n" + binary, b"binary_compressed\n" + sizes + packed)
    stream = io.BytesIO()
    np.save(stream, np.array(SOLID, dtype="<f8"))
    arrays = [(".npy", stream.getvalue())]
    return [*((s, t.encode()) for s, t in tables), *((".pcd", head.encode() + body) for body in bodies), *arrays]


# -- mutations: each takes the content and a random.Random, and returns another content --------------------------------


def flip_bits(data: bytes, rng: random.Random) -> bytes:
    """One to eight bits are inverted."""
    changed = bytearray(data)
    for _ in range(rng.randint(1, 8) if data else 0):
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def truncate(data: bytes, rng: random.Random) -> bytes:
    """The end is missing."""
    return data[: rng.randint(0, len(data))]


def repeat_or_drop(data: bytes, rng: random.Random) -> bytes:
    """A piece is there several times, or is gone."""
    begin = rng.randint(0, len(data))
    end = min(begin + rng.randint(1, 200), len(data))
    return data[:begin] + data[begin:end] * rng.choice((0, 0, 2, 3, 50)) + data[end:]


def _at_token(data: bytes, rng: random.Random, pattern: bytes, new: bytes) -> bytes:
    places = list(re.finditer(pattern, data))
    if not places:
        return data
    place = rng.choice(places)
    return data[: place.start()] + new + data[place.end() :]


def replace_number(data: bytes, rng: random.Random) -> bytes:
    """A number becomes an odd one."""
    return _at_token(data, rng, rb"[-+.\de]*\d[-+.\de]*", rng.choice(NUMBERS))


def drop_token(data: bytes, rng: random.Random) -> bytes:
    """A word is gone, or stands there twice."""
    return _at_token(data, rng, rb"\S+", rng.choice((b"", b"vertex", b"list uchar", b"3 0 1 2", b"#", b"/", b"//0")))


def edit_lines(data: bytes, rng: random.Random) -> bytes:
    """A line, mostly of the header, is gone, is there twice, has another place, or is another one."""
    lines = data.split(b"\n")
    place = rng.randrange(min(len(lines), rng.choice((14, 14, len(lines)))))
    line = lines.pop(place)
    kind = rng.randrange(4)
    new = ((), (line, line), (), (rng.choice(LINES),))[kind]
    lines[place:place] = new
    if kind == 2:
        lines.insert(rng.randint(0, min(len(lines), 14)), line)
    return (b"\r\n" if rng.random() < 0.02 else b"\n").join(lines)


def overwrite(data: bytes, rng: random.Random) -> bytes:
    """Four or eight bytes become those of an odd binary number."""
    new = struct.pack(rng.choice("<>") + rng.choice("fd"), rng.choice((np.nan, np.inf, 1e38, -1e38, 1e-38, 0.5)))
    new = rng.choice((new, b"\xff" * 4, b"\0" * 4, b"\x7f\xff\xff\xff"))
    begin = rng.randint(0, len(data))
    return data[:begin] + new + data[begin + len(new) :]


MUTATIONS = (flip_bits, truncate, repeat_or_drop, replace_number, replace_number, drop_token, edit_lines, overwrite)


def mutated(count: int, seed: int, only: str = ""):
    """So many damaged files, as pairs of suffix and content."""
    rng = random.Random(seed)
    sound = [pair for pair in corpus() if only in pair[0]]
    for _ in range(count):
        suffix, data = rng.choice(sound)
        for _ in range(rng.choice((1, 1, 1, 2, 3, 4))):
            data = rng.choice(MUTATIONS)(data, rng)
        yield (rng.choice(sound)[0] if rng.random() < 0.02 else suffix), data
