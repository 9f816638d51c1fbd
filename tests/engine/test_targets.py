"""Which files `apply` reads and writes: patterns, folders, names with signs, and what would be lost is refused."""

import re
from types import SimpleNamespace

import pytest

from bench.engine.targets import targets_of
from bench.errors import UsageError
from bench.tasks.denoise import Denoise
from bench.tasks.detail_transfer import DetailTransfer
from bench.tasks.multiview import Multiview
from bench.tasks.reconstruct import Reconstruct


@pytest.fixture(autouse=True)
def scans(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("scans/s1.ply", "scans/s2.xyz", "scans/s10.ply", "scans/notes.md", "scans/.hidden.ply", "a=b [1].ply"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("x")


def pairs(inputs, output, task=Reconstruct()):  # noqa: B008
    return [(*target.inputs, target.output) for target in targets_of(inputs, output, task)]


@pytest.mark.parametrize(
    ("inputs", "output", "expected"),
    [
        (["scans/s1.ply"], "m.stl", [("scans/s1.ply", "m.stl")]),
        (["scans/s1.ply"], "new/", [("scans/s1.ply", "new/s1.ply")]),
        (["scans/*.ply"], "new/", [("scans/s1.ply", "new/s1.ply"), ("scans/s10.ply", "new/s10.ply")]),
        (["scans/s10.ply", "scans/s1.ply"], "*_m.obj", [("scans/s10.ply", "s10_m.obj"), ("scans/s1.ply", "s1_m.obj")]),
        (["scans"], "x/*.off", [(f"scans/{n}", f"x/{n.split('.')[0]}.off") for n in ("s1.ply", "s2.xyz", "s10.ply")]),
        (["**/s2.*"], ".", [("scans/s2.xyz", "./s2.ply")]),
        (["**/a*.ply"], "x.ply", [("a=b [1].ply", "x.ply")]),  # no folder is enough for **
        (["a=b [1].ply"], "x=y.ply", [("a=b [1].ply", "x=y.ply")]),
    ],
)  # fmt: skip
def test_inputs_and_their_outputs(inputs, output, expected):
    assert pairs(inputs, output) == expected


def test_a_folder_of_images_is_one_input(tmp_path):
    assert pairs(["scans"], "m.ply", Multiview()) == [("scans", "m.ply")]
    assert pairs(["scans"], "new/", Multiview()) == [("scans", "new/scans.ply")]


def test_a_task_that_does_not_say_how_many_files_it_takes_takes_one():
    task = SimpleNamespace(takes="cloud", output="mesh")
    assert pairs(["scans/s1.ply"], "new/", task) == [("scans/s1.ply", "new/s1.ply")]
    with pytest.raises(UsageError, match="expected one input file"):
        pairs(["scans/s1.ply", "scans/s2.xyz"], "m.ply", task)


@pytest.mark.parametrize(
    ("inputs", "output", "task", "said"),
    [
        (["gone.ply"], "m.ply", Reconstruct(), "gone.ply: no such file"),
        (["gone*.ply"], "new/", Reconstruct(), "gone*.ply: no file matches this pattern"),
        (["scans/s1.ply", "scans/s2.xyz"], "m.ply", Reconstruct(), "expected one input file for m.ply, got 2"),
        (["scans/s1.ply", "./scans/s1.ply"], "new/", Reconstruct(), "would both become new/s1.ply"),
        (["scans/s1.ply"], "new/*.docx", Reconstruct(), "cannot write a mesh as '.docx'"),
        (["scans/s1.ply"], "new/*.obj", Denoise(), "cannot write a point cloud as '.obj'"),
        (["scans/s1.ply"], "new/*_*.obj", Reconstruct(), "expected one * for the name of the input"),
        (["scans"], "scans", Denoise(), "scans/s1.ply: is an input and would be overwritten"),
        (["scans/s1.ply"], "scans/../scans/s1.ply", Denoise(), "is an input and would be overwritten"),
        (["scans/s1.ply", "scans/s10.ply"], "new/", DetailTransfer(), "takes 2 or 3 files for one output"),
        (["new"], "m.ply", Reconstruct(), "new: no such file"),
    ],
)
def test_what_is_not_clear_or_would_be_lost_is_refused(inputs, output, task, said):
    with pytest.raises(UsageError, match=re.escape(said)):
        targets_of(inputs, output, task)


def test_a_folder_without_a_file_to_read_is_refused(tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(UsageError, match=r"empty: holds no file that can be read; expected some of \.ply"):
        targets_of(["empty"], "new/", Reconstruct())
