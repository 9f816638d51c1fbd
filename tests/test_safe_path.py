"""Modules in the working folder replace none of ours, and processes that cannot start are no method's fault."""

import os
import sys

import pytest
from conftest import TOYS

from bench.engine.runner import must_rerun
from bench.plan.cell import Settings
from bench.safe_path import OURS, SAFE_PATH, environment, isolate_imports, safe_children

SHADOWS = ("random.py", "json.py", "typing.py", "bench/__init__.py")


def cast_shadows(folder, names=SHADOWS) -> None:
    for name in names:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text("open('imported', 'w')\nraise RuntimeError('shadowed')\n")


def test_modules_in_the_working_folder_are_not_imported(shell):
    """Not by the front door, the processes of a launcher, or the fork servers of both.

    Nor by a plugin's file that lies there and finds its neighbours.
    """
    cast_shadows(shell.work, (*SHADOWS, "wave.py"))  # the last is a module that nothing has imported yet
    (shell.work / "neighbour.py").write_text("import wave\nscale = len([wave.open]) + 1\n")
    mine = shell.work / "mine.py"
    mine.write_text(
        "from dataclasses import dataclass\nfrom bench import PointCloud, register\nimport neighbour\n"
        '@register("method")\n@dataclass(frozen=True)\nclass Mine:\n    """Mine."""\n'
        "    def denoise(self, cloud, run):\n        return PointCloud(cloud.points * neighbour.scale)\n"
    )
    done = shell.run("method=fine,mine", launcher="joblib", plugins=(TOYS, mine), act=shell.start)
    out, err = done.communicate(timeout=120)
    assert done.returncode == 0, err
    rows = shell.rows()
    assert (rows["status"] == "ok").all()
    spread = rows.groupby("method")["score.spread"].mean()
    assert spread["mine"] == pytest.approx(2 * spread["fine"])
    assert not (shell.work / "imported").exists()


def test_python_m_bench_leaves_the_working_folder_out(shell):
    """But for a folder bench/, which Python itself takes for the one that is asked for."""
    cast_shadows(shell.work, SHADOWS[:-1])
    done = shell.run("method=fine", sweep=False, act=shell.call, command=[sys.executable, "-m", "bench"])
    assert done.returncode == 0, done.stderr
    assert not (shell.work / "imported").exists()


def test_processes_that_cannot_start_end_the_run_with_one_line_and_no_row(shell, tmp_path):
    """A library that every worker needs is broken: that says nothing of the methods."""
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "scipy.py").write_text("raise RuntimeError('broken on purpose')\n")
    before = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = str(tmp_path / "lib")
    try:
        done = shell.run("method=fine", "method.salt=1,2", launcher="joblib")
    finally:
        os.environ.pop("PYTHONPATH") if before is None else os.environ.update(PYTHONPATH=before)
    assert done.returncode == 1
    errors = [line for line in done.stderr.splitlines() if line.startswith("error:")]
    assert len(errors) == 1 and "cannot start" in errors[0] and "broken on purpose" in errors[0], done.stderr
    assert "Traceback" not in done.stderr
    assert not shell.files() and not list(shell.results.glob(".partial/*"))
    again = shell.run("method=fine", "method.salt=1", sweep=False)
    assert again.returncode == 0 and "2 run" in again.stderr, again.stderr


def test_rows_of_workers_that_never_began_are_run_again():
    row = {"status": "crashed", "stage": "start", "limit_seconds": 60.0, "limit_memory_gb": 4.0}
    assert must_rerun(row, Settings(), {})
    assert not must_rerun(row | {"stage": "method"}, Settings(), {})


# -- the functions ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pythonpath", "stays"),
    [(None, True), ("/lib", True), ("{here}", True), (":/lib", False), ("/lib:", False), (":{here}", True)],
)
def test_what_pythonpath_names_is_kept_and_what_it_leaves_empty_is_not(tmp_path, monkeypatch, pythonpath, stays):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", ["", str(tmp_path), "/lib"])
    monkeypatch.delenv("PYTHONPATH", raising=False)
    if pythonpath is not None:
        monkeypatch.setenv("PYTHONPATH", pythonpath.format(here=tmp_path))
    isolate_imports()
    assert sys.path == ([str(tmp_path)] if stays else []) + ["/lib"]


def test_children_are_safe_inside_and_as_before_outside(monkeypatch):
    monkeypatch.delenv(SAFE_PATH, raising=False)
    monkeypatch.setenv("PYTHONPATH", ":/lib:")
    with safe_children():
        assert os.environ[SAFE_PATH] == OURS and os.environ["PYTHONPATH"] == "/lib"
        assert SAFE_PATH not in environment()  # scripts of a method see what they would see elsewhere
    assert SAFE_PATH not in os.environ and os.environ["PYTHONPATH"] == ":/lib:"
    monkeypatch.setenv(SAFE_PATH, "1")  # the user's own
    with safe_children():
        assert environment()[SAFE_PATH] == "1"
