"""Apply to many files: failures are told and the rest is done, nothing is made twice; and the lines that docs print."""

import json
import os
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh

from bench import PointCloud
from bench.cli import COMMANDS, main
from bench.commands import apply as apply_command
from bench.engine import application
from bench.engine.channel import Channel
from bench.errors import UsageError
from bench.geometry.io.files import save
from bench.sweep.overrides import check
from bench.sweep.request import Request

ROOT = Path(__file__).resolve().parents[2]


def sphere(count=300, seed=0):
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


@pytest.fixture
def here(tmp_path, monkeypatch):
    """An empty folder, in which calls are made in this process instead of a child of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("bench.engine.forkserver.prestart", lambda threads: None)
    monkeypatch.setattr(application, "Applier", InProcess)
    return tmp_path


class InProcess:
    """What an Applier does, without a child; ``made`` counts the calls."""

    made: list[str] = []

    def __init__(self, first):
        self.first = first

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        pass

    def __call__(self, job, on_event):
        self.made.append(job.output)
        ends, begins = os.pipe()
        channel = Channel(begins)
        spec = {"arguments": application._arguments(job), "threads": 1, "seconds": 100.0, "memory_gb": 8.0}
        application.call(spec, channel)
        channel._file.close()
        with os.fdopen(ends) as lines:
            events = [json.loads(line) for line in lines]
        for event in events:
            on_event(event)
        return events[-1]["row"]


def test_many_files_with_a_bad_one_and_nothing_is_made_twice(here, capsys):
    (here / "scans").mkdir()
    for name, seed in (("s1", 1), ("s10", 2), ("s2", 3)):
        np.savetxt(here / "scans" / f"{name}.xyz", 20 * sphere(seed=seed) + 100)
    (here / "scans" / "bad.xyz").write_text("hello\n")
    words = ["apply", "method=identity", "task=denoise", "scans/*.xyz", "out/"]
    InProcess.made.clear()
    assert main(words) == 3
    printed = capsys.readouterr()
    assert InProcess.made == [f"out/{name}.ply" for name in ("bad", "s1", "s2", "s10")]
    assert "[2/4] scans/s1.xyz -> out/s1.ply (300 points) in " in printed.err
    assert re.search(r"^scans/bad\.xyz +error$", printed.out, re.M)
    assert re.search(r"^scans/s10\.xyz +300 +300 ", printed.out, re.M)
    assert "  scans/bad.xyz: " in printed.out and "holds no numbers" in printed.out
    assert printed.out.endswith("identity: 3 of 4 files done\n")
    # What is there is left; another input, setting or --again makes it again.
    InProcess.made.clear()
    assert main(words) == 3
    assert InProcess.made == ["out/bad.ply"]
    assert "3 of 4 files done, 3 of them cached (--again makes them again)" in capsys.readouterr().out
    np.savetxt(here / "scans" / "s2.xyz", sphere(seed=9))
    os.unlink(here / "scans" / "bad.xyz")
    os.unlink(here / "out" / "s10.ply")
    for more, made in (
        ([], ["s2", "s10"]),
        (["seed=1"], ["s1", "s2", "s10"]),
        (["seed=1", "--again"], ["s1", "s2", "s10"]),
    ):
        InProcess.made.clear()
        assert main([*words, *more]) == 0
        assert InProcess.made == [f"out/{name}.ply" for name in made]


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("threads=0", "expected a whole number of at least 1"),
        ("seed=-1", "expected a whole number of at least 0"),
        ("device=cuda:x", "expected cpu, cuda or cuda:N"),
        ("limit.memory_gb=-1.5", "expected more than 0"),
    ],
)
def test_a_value_that_makes_no_sense_is_refused_before_a_process_is_started(here, capsys, word, said):
    (here / "scan.xyz").write_text("0 0 0\n")
    InProcess.made.clear()
    assert main(["apply", "method=identity", "task=denoise", word, "scan.xyz", "out.ply"]) == 1
    assert f"error: {word}: {said}" in capsys.readouterr().err and InProcess.made == []


def test_a_call_that_fails_reports_what_the_reader_of_its_file_noted(here, capsys):
    points = (20 * sphere(2000) + [500_000.0, 5_400_000.0, 350.0]).astype(np.float32)
    np.savetxt(here / "survey.xyz", points.astype(np.float64), "%.17g")
    words = ["method=external", "method.command='false {input} {output}'", "task=denoise"]
    assert main(["apply", *words, "survey.xyz", "out.ply"]) == 1
    printed = capsys.readouterr().err
    assert "exit" in printed and "note: survey.xyz: its coordinates have steps of 0.5" in printed


def test_a_mesh_is_simplified_and_coloured_and_says_what_that_costs(here, capsys):
    points = sphere()
    np.savetxt(here / "scan.xyz", np.hstack([points, np.rint((points + 1) * 127)]))
    assert main(["apply", "method=identity", "scan.xyz", "mesh.ply", "--simplify", "100", "--colors"]) == 0
    printed = capsys.readouterr()
    assert printed.err == "task=reconstruct; identity also solves task=denoise or task=upsample\n"
    assert re.search(
        r"note: .*simplified from [\d,]+ to 100 faces, at a distance of rms .* % of the diagonal", printed.out
    )
    mesh = trimesh.load(here / "mesh.ply", process=False)
    assert len(mesh.faces) == 100
    nearest = np.linalg.norm(mesh.vertices[:, None] - points, axis=2).argmin(axis=1)
    assert np.abs(mesh.visual.vertex_colors[:, :3] - np.rint((points[nearest] + 1) * 127)).max() <= 1
    assert "reading" in printed.out and "solving" in printed.out and "writing" in printed.out


def test_an_output_that_was_made_elsewhere_has_an_origin_and_no_times(here, capsys, plugin_file):
    Path("found.py").write_text(
        "from dataclasses import dataclass\nfrom bench import register\n"
        "@register('method')\n@dataclass(frozen=True)\nclass Found:\n    'Made by somebody else.'\n"
        "    def denoise(self, cloud, run):\n        run.external = 'a table of 2019'\n        return cloud\n"
    )
    plugin_file(here / "found.py")
    np.savetxt("a.xyz", sphere(20))
    assert main(["apply", "method=found", "a.xyz", "a.ply"]) == 0
    assert "\nfound: external: a table of 2019 (reading " in capsys.readouterr().out
    assert main(["apply", "method=found", "a.xyz", "out/"]) == 0
    assert "[1/1] a.xyz -> out/a.ply (20 points) external\n" in capsys.readouterr().err


def test_a_child_that_dies_leaves_the_others(shell):
    plugin = shell.folder / "moody.py"
    plugin.write_text(
        "import os\nfrom dataclasses import dataclass\nfrom bench import register\n"
        "@register('method')\n@dataclass(frozen=True)\nclass Moody:\n    'Dies of large clouds.'\n"
        "    def denoise(self, cloud, run):\n"
        "        if len(cloud) > 100:\n            os.kill(os.getppid(), 9)\n            os._exit(1)\n"
        "        return cloud\n"
    )
    for name, count in (("a", 50), ("b", 200), ("c", 60)):
        np.savetxt(shell.work / f"{name}.xyz", sphere(count))
    done = shell.apply("--plugin", plugin, "method=moody", "a.xyz", "b.xyz", "c.xyz", "out/*.xyz")
    assert done.returncode == 3, done.stderr
    assert sorted(path.name for path in (shell.work / "out").glob("*.xyz")) == ["a.xyz", "c.xyz"]
    assert "moody: 2 of 3 files done" in done.stdout


@pytest.mark.parametrize(
    ("word", "is_file"),
    [
        ("method.depth=9", False),
        ("training.weights=w.ply", False),
        ("hydra/launcher=a", False),
        ("dpeth=9", False),
        ("new=name.ply", True),
        ("./new=name.ply", True),
        ("there=1", True),
    ],
)
def test_names_of_files_with_a_sign_of_equality(here, word, is_file):
    (here / "there=1").touch()
    assert apply_command.is_file(word) == is_file


def test_a_bare_key_says_whose_parameter_it_is():
    for word, said in (("ratio=4", r"Did you mean task\.ratio\?"), ("depth=9", r"Did you mean method\.depth\?")):
        with pytest.raises(UsageError, match=f"there is no key '{word.partition('=')[0]}'. {said}"):
            check(Request.of(["method=poisson", word]))
    for command, said in (("apply", "takes one value for each key"), ("plan", "add -m: detailbench plan -m")):
        with pytest.raises(UsageError, match=said):
            check(Request.of(["method=poisson", "method.depth=8,9"], command))


# -- the lines that are printed ----------------------------------------------------------------------------------------


def printed_lines():
    """The lines of `apply` and `score` in the README and in the helps, as words; none with a name to be filled in."""
    texts = [(ROOT / "README.md").read_text()]
    texts += [(ROOT / "bench" / "commands" / f"{name}.py").read_text().split('"""')[1] for name in COMMANDS]
    found = [line.partition("#")[0] for text in texts for line in re.findall(r"^ +detailbench (.*)", text, re.M)]
    lines = [shlex.split(line) for line in found if line.startswith(("apply", "score")) and "NAME" not in line]
    return [words for words in lines if "OUTPUT" not in words and "--mask" not in words]  # see test_own_data_page.py


@pytest.fixture
def files(here):
    """Small files with the names of the lines; meshes for what has to be one."""
    ball = trimesh.creation.icosphere(2)
    (here / "scans").mkdir()
    for name in ("SCAN", "scan", "scans/one"):
        save(PointCloud(sphere(100)), here / f"{name}.ply")
    shutil.copy(ROOT / "methods" / "upsampling" / "weights" / "mpu.safetensors", here / "mine.safetensors")
    np.savetxt(here / "scan.xyz", sphere(100))
    np.savetxt(here / "clean.xyz", sphere(100, seed=1))
    for name in ("output", "reference", "source", "source_base", "target_base", "OUTPUT", "REFERENCE"):
        save(ball, here / f"{name}.ply")
    for name in ("deformed", "target", "rest"):
        save(ball, here / f"{name}.obj")


@pytest.mark.parametrize("words", printed_lines(), ids=" ".join)
def test_the_lines_of_the_readme_and_of_the_helps_run_as_printed(files, words, capsys):
    assert main([*words, *(["--samples", "500"] if words[0] == "score" else [])]) == 0, capsys.readouterr().err


def test_there_are_such_lines():
    lines = [" ".join(words) for words in printed_lines()]
    assert "apply method=poisson SCAN.ply MESH.ply" in lines and len(lines) > 8
