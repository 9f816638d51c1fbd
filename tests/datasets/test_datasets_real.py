"""Real shapes: fetching and finding them, with small packages made here and a local server as the network."""

from __future__ import annotations

import base64
import gzip
import hashlib
import http.server
import io
import json
import tarfile
import threading
import zipfile
import zlib

import numpy as np
import pytest
from trimesh import Trimesh
from trimesh.creation import icosphere

from bench import BadInput, MissingData, UsageError
from bench.cli import main
from bench.datasets import real
from bench.datasets.fetched import cortex, packages
from bench.datasets.fetched.archives import files_of_deb, files_of_wheel
from bench.datasets.fetched.download import Archive, fetch_archive
from bench.datasets.fetched.gifti import read_surface
from bench.datasets.fetched.packages import Package
from bench.datasets.real import Real
from bench.geometry.io.files import save
from bench.plan.cell import NotSolved, check_dataset
from bench.plugins.registry import registry

BALL = icosphere(subdivisions=1)


def quiet(line: str) -> None:
    pass


def sha(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def tar_of(files: dict[str, bytes], compression: str) -> bytes:
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode=f"w:{compression}") as tar:
        link = tarfile.TarInfo("./link.off")
        link.type, link.linkname = tarfile.SYMTYPE, "/etc/passwd"
        tar.addfile(link)
        for name, data in files.items():
            info = tarfile.TarInfo(name)
            info.size = len(data)
            tar.addfile(info, io.BytesIO(data))
    return out.getvalue()


def deb_of(data: bytes, name: str = "data.tar.xz") -> bytes:
    out = b"!<arch>\n"
    for member, content in (("debian-binary", b"2.0"), ("control.tar.xz", b"odd"), (name, data)):
        out += f"{member:<16}{0:<12}{0:<6}{0:<6}{'100644':<8}{len(content):<10}`\n".encode() + content
        out += b"\n" * (len(content) % 2)
    return out


# --- archives ---------------------------------------------------------------------------------------------------------


def test_only_requested_files_are_read_from_a_package(tmp_path):
    inner = tar_of({"data/a.off": b"A", "../../evil": b"E", "/abs": b"X"}, "gz")
    deb = tmp_path / "p.deb"
    deb.write_bytes(deb_of(tar_of({"./usr/other": b"O", "./usr/data.tar.gz": inner, "../up": b"U"}, "xz")))
    assert dict(files_of_deb(deb, {"usr/other"})) == {"usr/other": b"O"}
    assert dict(files_of_deb(deb, {"data/a.off", "gone"}, inner="usr/data.tar.gz")) == {"data/a.off": b"A"}
    assert dict(files_of_deb(deb, {"link.off"})) == {}  # a link is not a file
    assert [path.name for path in tmp_path.iterdir()] == ["p.deb"]


@pytest.mark.parametrize("compression", ["", "gz", "bz2", "xz"])
def test_all_compressions_used_by_packages(tmp_path, compression):
    deb = tmp_path / "p.deb"
    suffix = f".{compression}" if compression else ""
    deb.write_bytes(deb_of(tar_of({"./f": b"F" * 99}, compression), f"data.tar{suffix}"))
    assert dict(files_of_deb(deb, {"f"})) == {"f": b"F" * 99}


def test_damaged_packages_are_refused_by_name(tmp_path):
    whole = deb_of(tar_of({"./f": bytes(np.random.default_rng(0).bytes(9999))}, "xz"))
    cases = {
        "not a Debian package": b"PK\x03\x04",
        "damaged or cut off": whole[:-5000],
        "has no data.tar": whole[:8] + whole[8:72],
        "does not read": deb_of(b"", "data.tar.zst"),
    }
    for words, content in cases.items():
        (tmp_path / "p.deb").write_bytes(content)
        with pytest.raises(BadInput, match=words) as caught:
            list(files_of_deb(tmp_path / "p.deb", {"f"}))
        assert "p.deb" in str(caught.value)
    (tmp_path / "w.whl").write_bytes(b"nothing")
    with pytest.raises(BadInput, match=r"w\.whl"):
        list(files_of_wheel(tmp_path / "w.whl", {"f"}))


# --- downloads --------------------------------------------------------------------------------------------------------

CONTENT = np.random.default_rng(1).bytes(300_000)


@pytest.fixture
def server():
    """Serves ``/good`` (resumes), ``/plain`` (does not), ``/other`` (other bytes), ``/short`` (ends early)."""
    log: list[tuple[str, str]] = []

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            wanted = self.headers.get("Range", "")
            log.append((self.path, wanted))
            start = int(wanted.removeprefix("bytes=").rstrip("-")) if wanted and self.path != "/plain" else 0
            data = {"/other": CONTENT[::-1] + b"more"}.get(self.path, CONTENT)[start:]
            if self.path == "/gone":
                self.send_error(404, "Not Found")
                return
            self.send_response(206 if start else 200)
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data[:1000] if self.path == "/short" else data)

        def log_message(self, *args: object) -> None:
            pass

    made = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=made.serve_forever, daemon=True)
    thread.start()
    made.log, made.at = log, f"http://127.0.0.1:{made.server_port}"
    yield made
    made.shutdown()
    made.server_close()
    thread.join()


def archive(server, *paths: str) -> Archive:
    urls = tuple(f"{server.at}/{path}" for path in paths)
    return Archive("p.deb", sha(CONTENT), len(CONTENT), urls, "apt-get download p")


def test_an_interrupted_download_is_resumed(server, tmp_path):
    (tmp_path / "p.deb.part").write_bytes(CONTENT[:123_456])
    assert fetch_archive(archive(server, "good"), tmp_path, quiet).read_bytes() == CONTENT
    assert server.log == [("/good", "bytes=123456-")]
    assert [path.name for path in tmp_path.iterdir()] == ["p.deb"]


def test_a_server_that_cannot_resume_sends_the_whole_file(server, tmp_path):
    (tmp_path / "p.deb.part").write_bytes(CONTENT[:1000])
    assert fetch_archive(archive(server, "plain"), tmp_path, quiet).read_bytes() == CONTENT


def test_a_partial_download_of_another_file_is_restarted(server, tmp_path):
    (tmp_path / "p.deb.part").write_bytes(b"x" * 1000)
    assert fetch_archive(archive(server, "good"), tmp_path, quiet).read_bytes() == CONTENT
    assert [wanted for _, wanted in server.log] == ["bytes=1000-", ""]


def test_a_file_with_other_content_is_discarded_and_the_next_address_tried(server, tmp_path):
    assert fetch_archive(archive(server, "gone", "other", "good"), tmp_path, quiet).read_bytes() == CONTENT
    assert [path for path, _ in server.log] == ["/gone", "/other", "/good"]


def test_an_interrupted_download_is_kept_for_the_next_run(server, tmp_path):
    with pytest.raises(UsageError, match=r"/short: .*\n.*no longer have it"):
        fetch_archive(archive(server, "short"), tmp_path, quiet)
    assert (tmp_path / "p.deb.part").read_bytes() == CONTENT[:1000]
    fetch_archive(archive(server, "good"), tmp_path, quiet)
    assert server.log[-1] == ("/good", "bytes=1000-")


def test_without_a_network_the_error_gives_advice(tmp_path):
    nobody = Archive("p.deb", sha(CONTENT), len(CONTENT), ("http://127.0.0.1:9/p.deb",), "apt-get download p")
    with pytest.raises(UsageError) as caught:
        fetch_archive(nobody, tmp_path, quiet)
    for words in ("http://127.0.0.1:9/p.deb: ", "apt-get download p", str(tmp_path), "run the same command again"):
        assert words in str(caught.value)
    (tmp_path / "p.deb").write_bytes(CONTENT)  # copied there by hand
    assert fetch_archive(nobody, tmp_path, quiet) == tmp_path / "p.deb"
    (tmp_path / "p.deb").write_bytes(CONTENT[1:])
    with pytest.raises(BadInput, match="another version"):
        fetch_archive(nobody, tmp_path, quiet)


# --- GIFTI and the two halves -----------------------------------------------------------------------------------------


def gifti(vertices: np.ndarray, faces: np.ndarray, endian: str = "LittleEndian") -> bytes:
    sign = {"LittleEndian": "<", "BigEndian": ">"}[endian]

    def array(intent: str, kind: str, values: np.ndarray) -> str:
        content = base64.b64encode(zlib.compress(values.tobytes())).decode()
        return (
            f'<DataArray Intent="{intent}" DataType="{kind}" ArrayIndexingOrder="RowMajorOrder" Dimensionality="2" '
            f'Dim0="{len(values)}" Dim1="3" Encoding="GZipBase64Binary" Endian="{endian}"><Data>{content}</Data>'
            "</DataArray>"
        )

    points = array("NIFTI_INTENT_POINTSET", "NIFTI_TYPE_FLOAT32", np.asarray(vertices, f"{sign}f4"))
    corners = array("NIFTI_INTENT_TRIANGLE", "NIFTI_TYPE_INT32", np.asarray(faces, f"{sign}i4"))
    return f"<GIFTI>{points}{corners}</GIFTI>".encode()


@pytest.mark.parametrize("endian", ["LittleEndian", "BigEndian"])
def test_a_surface_can_be_read(endian):
    for data in (gifti(BALL.vertices, BALL.faces, endian), gzip.compress(gifti(BALL.vertices, BALL.faces, endian))):
        vertices, faces = read_surface(data, "ball.gii")
        assert (vertices == np.float32(BALL.vertices)).all() and (faces == BALL.faces).all()
        assert vertices.dtype == np.float64 and faces.dtype == np.int64


@pytest.mark.parametrize(
    "data",
    [
        b"<GIFTI/>",
        b"no xml",
        b"\x1f\x8b cut",
        gifti(BALL.vertices, BALL.faces).replace(b"GZipBase64Binary", b"ASCII"),
        gifti(BALL.vertices, BALL.faces + 40),
        gifti(BALL.vertices, BALL.faces).replace(b'Dim0="42"', b'Dim0="43"'),
    ],
)
def test_a_file_that_is_not_a_surface_is_refused_by_name(data):
    with pytest.raises(BadInput, match=r"ball\.gii"):
        read_surface(data, "ball.gii")


def halves(surface: np.ndarray, order: np.ndarray) -> dict[str, cortex.Surface]:
    """A left half, and a right half that is its mirror image, with vertices in another order."""
    place = np.argsort(order)
    flipped = place[BALL.faces][:, ::-1]
    return {
        "sphere_left.gii.gz": (np.asarray(BALL.vertices), BALL.faces),
        "pial_left.gii.gz": (surface, BALL.faces),
        "sphere_right.gii.gz": ((BALL.vertices * cortex.MIRROR)[order], flipped),
        "pial_right.gii.gz": ((surface * cortex.MIRROR)[order], flipped),
    }


def test_the_mirrored_half_corresponds_vertex_by_vertex():
    rng = np.random.default_rng(2)
    surface = BALL.vertices * [1, 2, 3] + 0.1 * rng.standard_normal(BALL.vertices.shape)
    files = halves(surface, rng.permutation(len(BALL.vertices)))
    vertices, faces = cortex.mirrored_right("pial", files.__getitem__)
    assert vertices == pytest.approx(surface, abs=1e-9)
    assert (faces == BALL.faces).all()


# --- the dataset ------------------------------------------------------------------------------------------------------


@pytest.fixture
def small(tmp_path, monkeypatch, server):
    """``real`` with three meshes of two packages from a local server; the folder that they are fetched to."""
    files = {}
    for name, mesh in (("a", BALL), ("b", icosphere(subdivisions=2)), ("c", icosphere(subdivisions=1, radius=2))):
        save(mesh, tmp_path / f"{name}.off")
        files[f"{name}.off"] = (tmp_path / f"{name}.off").read_bytes()
    brain = {
        name: gzip.compress(gifti(*s), mtime=0) for name, s in halves(np.asarray(BALL.vertices), np.arange(42)).items()
    }
    for kind in ("white", "infl"):
        brain |= {f"{kind}_{half}.gii.gz": brain[f"pial_{half}.gii.gz"] for half in ("left", "right")}
    deb = deb_of(tar_of({"./data.tar.gz": tar_of({f"data/{k}": v for k, v in files.items()}, "gz")}, "xz"))
    wheel = io.BytesIO()
    with zipfile.ZipFile(wheel, "w") as made:
        for name, data in brain.items():
            made.writestr(f"brain/{name}", data)
        made.writestr("info/LICENSE", "free")
    monkeypatch.setitem(packages.PACKAGES, "libcgal-demo", _package("p.deb", deb, "data/", inner="data.tar.gz"))
    monkeypatch.setitem(
        packages.PACKAGES, "nilearn", _package("p.whl", wheel.getvalue(), "brain/", notices=("info/LICENSE",))
    )

    def line(name: str, group: str, package: str, file: str, content: bytes) -> dict:
        facts = {"vertices": 0, "faces": 0, "genus": 0, "about": "a ball", "sha256": sha(content)}
        return {"name": name, "group": group, "package": package, "file": file, **facts}

    meshes = [
        line("one", "closed", "libcgal-demo", "a.off", files["a.off"]),
        line("cortex", "closed", "nilearn", "pial_left.gii.gz", brain["pial_left.gii.gz"]),
        line("two", "open", "libcgal-demo", "b.off", files["b.off"]),
    ]
    table = tmp_path / "real.json"
    table.write_text(json.dumps({"meshes": meshes, "cortex": {name: sha(data) for name, data in brain.items()}}))
    monkeypatch.setattr(real, "TABLE", table)
    read = real._table
    read.cache_clear()
    folder = tmp_path / "data"
    for name, content in (("p.deb", deb), ("p.whl", wheel.getvalue())):
        (folder / "downloads").mkdir(parents=True, exist_ok=True)
        (folder / "downloads" / name).write_bytes(content)
    yield folder
    read.cache_clear()


def _package(name: str, content: bytes, inside: str, **more) -> Package:
    known = Archive(name, sha(content), len(content), (), f"get {name}")
    return Package(known, inside, source=f"source of {name}", licence=f"licence of {name}", notice="A notice.", **more)


def test_fetched_shapes_are_listed_in_order_with_their_origin(small):
    dataset = Real(path=str(small))
    said: list[str] = []
    dataset.fetch(said.append)
    assert [s.id for s in dataset.shapes("test")] == ["real-one", "real-cortex"]
    one, cortical = dataset.shapes("test")
    assert (one.mesh.faces == BALL.faces).all() and len(cortical.mesh.vertices) == 42
    assert one.exactness == "mesh"
    assert one.info["licence"] == "licence of p.deb" and one.info["file"] == "libcgal-demo/a.off"
    assert (small / "nilearn" / "LICENSE").read_text() == "free"
    assert "source of p.whl" in (small / "LICENCES.txt").read_text() and "A notice." in "\n".join(said)
    assert not (small / "libcgal-demo" / "c.off").exists()  # not in the table
    assert sorted(p.name for p in (small / "downloads").iterdir()) == ["p.deb", "p.whl"]  # copied by hand: not deleted


def test_only_missing_or_wrong_files_are_fetched(small):
    dataset = Real(path=str(small))
    dataset.fetch(quiet)
    for file in (small / "downloads").iterdir():
        file.unlink()
    dataset.fetch(quiet)  # nothing is missing, so no request is sent
    (small / "libcgal-demo" / "a.off").write_text("OFF\n0 0 0\n")
    one = next(dataset.shapes("test"))
    with pytest.raises(BadInput, match=r"a\.off: is not the file.*make real"):
        one.mesh  # noqa: B018
    with pytest.raises(UsageError, match=r"p\.deb could not be downloaded"):
        dataset.fetch(quiet)


def test_a_package_with_a_missing_or_different_file_is_refused(small, monkeypatch):
    meshes, brain = real._table()
    monkeypatch.setattr(real, "_table", lambda: ((meshes[0]._replace(sha256="0" * 64),), brain))
    with pytest.raises(BadInput, match=r"its a\.off differs from the published one"):
        Real(path=str(small)).fetch(quiet)
    monkeypatch.setattr(real, "_table", lambda: ((meshes[0]._replace(file="z.off"),), brain))
    with pytest.raises(BadInput, match=r"lacks z\.off"):
        Real(path=str(small)).fetch(quiet)


def test_a_folder_that_cannot_be_written_is_named(small):
    (small.parent / "file").write_text("")
    with pytest.raises(UsageError, match=r"file.*dataset\.path=FOLDER"):
        Real(path=str(small.parent / "file")).fetch(quiet)


def test_without_the_data_the_command_is_named_and_cells_are_left_out(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for ask in (Real().check, lambda: list(Real().shapes("test")), lambda: Real().pairs("test")):
        with pytest.raises(MissingData, match=rf"are not in {tmp_path}.*fetch them with: make real") as caught:
            ask()
        assert isinstance(caught.value, BadInput) and isinstance(caught.value, UsageError)
    with pytest.raises(MissingData, match=r"detailbench fetch real dataset\.path=elsewhere"):
        Real(path="elsewhere").check()
    with pytest.raises(NotSolved, match="make real"):
        check_dataset(Real(), "test")
    assert main(["fetch"]) == 0
    assert "real: dataset real: 50 of its 50 files are not in" in capsys.readouterr().out
    assert main(["plan", "dataset=real"]) == 1
    assert "not planned: dataset real" in capsys.readouterr().out


def test_the_train_split_is_refused_with_a_reason():
    for ask in (lambda: Real().check("train"), lambda: list(Real().shapes("train")), lambda: Real().pairs("train")):
        with pytest.raises(UsageError, match="split=train has no meshes.*nothing is tuned"):
            ask()


def test_the_command_fetches_and_refuses_unknown_names(small, capsys):
    assert main(["fetch", "real", f"dataset.path={small}"]) == 0
    assert "A notice." in capsys.readouterr().err
    for words, message in ((["fetch", "reel"], "'real'"), (["fetch", "real", "method.x=1"], "dataset.KEY=VALUE")):
        assert main(words) == 1
        assert message in capsys.readouterr().err


def test_the_choice_of_meshes(small):
    def names(which) -> list[str]:
        Real(path=str(small)).fetch(quiet)
        return [s.id.removeprefix("real-") for s in Real(which=which, path=str(small)).shapes("test")]

    assert names("all") == ["one", "cortex", "two"]
    assert names("open") == ["two"]
    assert names(["two", "one"]) == names("two,one") == ["one", "two"]  # in the order of the table
    for wrong in ("", [], "one,three"):
        with pytest.raises(ValueError, match="which: expected closed, crossing, open, all, or names of meshes"):
            Real(which=wrong)


def test_pairs_share_their_faces_and_have_the_inflated_half_as_base(small):
    dataset = Real(path=str(small))
    dataset.fetch(quiet)
    pairs = list(dataset.pairs("test"))
    assert [p.id for p in pairs] == [
        f"real-cortex-{kind}-{way}" for way in ("left-to-right", "right-to-left") for kind in ("pial", "white")
    ]
    pairs += Real(path=str(small), pairing="surfaces").pairs("test")
    assert len({p.id for p in pairs}) == len(pairs) == 10
    for pair in pairs:
        assert (pair.source.mesh.faces == pair.target.mesh.faces).all()
        for shape in (pair.source, pair.target):
            assert isinstance(shape.mesh, Trimesh) and shape.mesh.volume > 0
            assert shape.attributes["base_vertices"].shape == shape.mesh.vertices.shape


# --- the shipped table ------------------------------------------------------------------------------------------------


def test_the_table_names_each_mesh_and_each_file_once():
    meshes, brain = real._table()
    assert len({m.name for m in meshes}) == len({(m.package, m.file) for m in meshes}) == len(meshes) == 43
    assert [m.group for m in meshes] == sorted((m.group for m in meshes), key=real.GROUPS.index)
    assert sum(m.group == "closed" for m in meshes) == 31
    assert all(m.package in packages.PACKAGES and len(m.sha256) == 64 for m in meshes)
    assert len(brain) == 8 and set(Real().state().values()) == {*(m.sha256 for m in meshes), *brain.values()}
    assert "real" in registry().names("dataset")
