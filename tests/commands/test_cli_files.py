"""A folder of the user's meshes, good and bad, through the command line: each fails or is solved as its own case."""

import numpy as np
import pytest
import trimesh

from bench.geometry.io.files import save
from bench.results.store import Results

BALL = trimesh.creation.icosphere(3)


def mesh(vertices, faces):
    return trimesh.Trimesh(np.asarray(vertices, dtype=float), np.asarray(faces).reshape(-1, 3), process=False)


def moved(offset, scale=1.0):
    return mesh(BALL.vertices * scale + offset, BALL.faces)


def fins():
    """Three faces on one edge."""
    return mesh([[0, 0, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, 0, 0]], [[0, 1, 2], [0, 1, 3], [0, 1, 4]])


GOOD = {
    "ball": lambda path: save(BALL, path),
    "far_away": lambda path: save(moved([1e6, -1e6, 1e6]), path),
    "tiny_unit": lambda path: save(moved([0, 0, 0], 1e-6), path),
    "non_manifold": lambda path: save(fins(), path),
    "holes": lambda path: save(mesh(BALL.vertices, BALL.faces[::2]), path),
    "duplicates": lambda path: save(mesh(np.repeat(BALL.vertices, 2, axis=0), 2 * BALL.faces), path),
    "nan": lambda path: path.write_bytes(spoiled(path, np.nan)),
    "infinite": lambda path: path.write_bytes(spoiled(path, np.inf)),
    "zero_normals": lambda path: path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 4\n"
        + "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
        + "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
        + "0 0 0 0 0 0\n1 0 0 0 0 0\n0 1 0 0 0 0\n0 0 1 0 0 0\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"
    ),
}
GOOD["more"] = lambda path: (save(BALL, path), path.write_bytes(path.read_bytes() + b"more"))
BAD = {
    "empty": (lambda path: path.write_bytes(b""), "empty"),
    "text": (lambda path: path.write_text("dear diary\n"), "PLY"),
    "truncated": (lambda path: (save(BALL, path), path.write_bytes(path.read_bytes()[:-1000])), ""),
    "no_faces": (
        lambda path: path.write_text(
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
            "end_header\n0 0 0\n"
        ),
        "no faces",
    ),
    "one_place": (lambda path: path.write_bytes(flattened(path)), "coincide"),
}


def spoiled(path, value):
    """The ball with one vertex that is not a number; our own writer is asked for bytes, not for an opinion."""
    vertices = BALL.vertices.copy()
    vertices[7, 1] = value
    return mesh(vertices, BALL.faces).export(file_type="ply")


def flattened(path):
    return mesh(np.ones((3, 3)), [[0, 1, 2]]).export(file_type="ply")


@pytest.fixture(scope="module")
def swept(shells):
    shell = shells("files")
    folder = shell.work / "meshes"
    folder.mkdir()
    for name, write in GOOD.items():
        write(folder / f"{name}.ply")
    for name, (write, _) in BAD.items():
        write(folder / f"{name}.ply")
    count = len(GOOD) + len(BAD)
    done = shell.call(
        *("run", "task=denoise", "dataset=files", "dataset.path=meshes", "sensor=samples", "sensor.count=200"),
        *("method=identity", "metric=[p2f_mean]", f"cases={count}", f"results={shell.results}"),
    )
    return done, Results(shell.results).rows(use_index=False).set_index("case")


def test_the_sweep_ends_and_says_that_not_all_is_solved(swept):
    done, rows = swept
    assert done.returncode == 3, done.stderr
    assert "Traceback" not in done.stderr
    assert len(rows) == len(GOOD) + len(BAD)


def test_each_kind_of_error_and_each_note_is_printed_once(swept):
    done, rows = swept
    failed, _, noted = done.stdout.partition("Not solved")[2].partition("Solved, with a note")
    assert all(words in failed for _, words in BAD.values())
    assert failed.count(" error (") == len(BAD)
    assert "there is more in the file than its header says" in noted
    assert "more.ply: there is more in the file" in rows.loc["more"]["message"]
    assert "Warning" not in done.stderr


@pytest.mark.parametrize("name", GOOD)
def test_what_can_be_used_is_solved(swept, name):
    row = swept[1].loc[name]
    assert row["status"] == "ok", row["message"]
    assert 0 < row["score.p2f_mean"] < 0.02  # the noise of the sensor, in the frame of the case, whatever the unit


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_used_is_refused_by_name(swept, name):
    row = swept[1].loc[name]
    assert (row["status"], row["stage"]) == ("error", "case")
    assert name in row["message"] and BAD[name][1] in row["message"], row["message"]


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("nowhere", "no such file"),
        ("", "dataset.path is empty"),
        ("notes.txt", "unknown suffix"),
        (".", "no mesh file"),
    ],
)
def test_a_path_that_leads_to_no_mesh_is_refused_before_anything_runs(shell, path, words):
    (shell.work / "notes.txt").write_text("x")
    done = shell.call("run", "dataset=files", f"dataset.path='{path}'", "method=poisson", f"results={shell.results}")
    assert done.returncode == 1 and words in done.stderr and "Traceback" not in done.stderr
