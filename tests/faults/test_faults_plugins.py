"""Plugins that are broken, that collide, that are edited; and a new task from a plugin file."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

TOYS = Path(__file__).with_name("toys.py")
PAIRS = Path(__file__).with_name("pairs.py")
SYMMETRIC = '''
from dataclasses import dataclass
from bench import register

@register("method", name="{name}")
@dataclass(frozen=True)
class {cls}:
    """A method of the tests."""

    def denoise(self, cloud, run):
        return cloud
'''


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    return path


# -- broken ------------------------------------------------------------------------------------------------------------

BROKEN = {
    "raises_on_import.py": ("raise RuntimeError('no licence for register(')", "RuntimeError: no licence"),
    "no_python.py": ("def register(:\n", "SyntaxError"),
    "exits_on_import.py": ("import sys; sys.exit('gone')", "SystemExit: gone"),
    "wants_too_much.py": ("import no_such_library_at_all", "ModuleNotFoundError"),
    "no_dataclass.py": (
        "from bench import register\n@register('method')\nclass Plain:\n    'x'\n",
        "put @dataclass(frozen=True) between",
    ),
    "no_default.py": (
        "from dataclasses import dataclass\nfrom bench import register\n"
        "@register('method')\n@dataclass(frozen=True)\nclass Bare:\n    'A method.'\n    size: int\n",
        "parameter 'size' needs a default",
    ),
}


def test_broken_plugins_are_listed_with_their_reasons_and_everything_else_works(shell):
    files = [written(shell.folder, name, text) for name, (text, _) in BROKEN.items()]
    flags = [part for file in files for part in ("--plugin", file)]
    listing = json.loads(shell.call("list", "--json", *flags).stdout)
    assert len(listing["broken"]) == len(BROKEN)
    for name, (_, reason) in BROKEN.items():
        (entry,) = (b for b in listing["broken"] if Path(b["file"]).name == name)
        assert reason in entry["reason"]
    assert {"identity", "noise"} <= {plugin["name"] for plugin in listing["method"]}
    human = shell.call("list", *flags)
    assert human.returncode == 0
    assert "Traceback" not in human.stdout + human.stderr
    for name in BROKEN:
        assert any(line.startswith("broken: ") and name in line for line in human.stdout.splitlines())
    # Nor do they stop the processes of joblib.
    done = shell.run("method=fine", "method.salt=1,2", launcher="joblib", plugins=(*files, TOYS))
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert "no_python.py is broken: SyntaxError" in done.stderr
    rows = shell.rows()
    assert len(rows) == 4 and (rows["status"] == "ok").all()


def test_asking_for_a_method_of_a_broken_file_says_why_it_is_not_there(shell):
    file = written(shell.folder, "mine.py", SYMMETRIC.format(name="mine", cls="Mine") + "\nraise RuntimeError('oh')\n")
    other = written(shell.folder, "other.py", "raise RuntimeError('oh')\n")
    done = shell.run("method=others_method", sweep=False, plugins=(TOYS, other))
    assert done.returncode == 1
    assert f"{other}: RuntimeError: oh" in done.stderr
    check = shell.call("check", file)
    assert check.returncode == 3
    assert "FAIL" in check.stdout
    assert "RuntimeError: oh" in check.stdout


# -- collisions --------------------------------------------------------------------------------------------------------


def test_a_name_that_a_built_in_has_names_both_sides(shell):
    file = written(shell.folder, "mine.py", SYMMETRIC.format(name="identity", cls="Mine"))
    done = shell.run("method=identity", sweep=False, plugins=(TOYS, file))
    assert done.returncode == 1
    assert "two methods are called 'identity'" in done.stderr
    assert str(file) in done.stderr
    assert "methods/pseudo/identity.py" in done.stderr
    assert "Mine" in done.stderr
    assert "Traceback" not in done.stderr
    assert shell.calls() == []


def test_two_files_with_one_name_name_both_sides(shell):
    files = [written(shell.folder, f"{n}.py", SYMMETRIC.format(name="ours", cls=n.title())) for n in ("left", "right")]
    done = shell.run("method=ours", sweep=False, plugins=(TOYS, *files))
    assert done.returncode == 1
    for file in files:
        assert str(file) in done.stderr
    assert "Traceback" not in done.stderr


def test_one_file_named_twice_is_no_collision(shell):
    done = shell.run("method=fine", sweep=False, plugins=(TOYS, TOYS))
    assert done.returncode == 0, done.stderr
    assert (shell.rows()["status"] == "ok").all()


# -- edits -------------------------------------------------------------------------------------------------------------


def test_an_edited_plugin_is_run_again_and_why_reports_it(shell):
    toys = Path(shutil.copy(TOYS, shell.folder / "toys.py"))
    words = {"sweep": False, "plugins": (toys,)}
    assert "2 run" in shell.run("method=fine", **words).stderr
    assert "0 run, 2 cached" in shell.run("method=fine", **words).stderr
    cell = shell.rows()["cell"].iloc[0]
    current = shell.call("why", cell[:6], f"results={shell.results}", "--plugin", str(toys))
    assert current.returncode == 0
    assert "current:" in current.stdout
    toys.write_text(toys.read_text() + "\n# a remark\n")
    why = shell.call("why", cell, f"results={shell.results}", "--plugin", str(toys))
    assert "source of method fine was edited" in why.stdout
    assert "not current" in why.stdout
    assert "changed" in shell.run("method=fine", act=_plan(shell), **words).stdout
    assert "2 run, 0 cached" in shell.run("method=fine", **words).stderr
    assert "current:" in shell.call("why", cell, f"results={shell.results}", "--plugin", str(toys)).stdout
    assert len(shell.rows()) == 2  # the newest of each


def _plan(shell):
    return lambda command, *words, **options: shell.call("plan", *words, **options)


def test_a_metric_s_version_and_an_added_metric_are_run_again(shell):
    toys = Path(shutil.copy(TOYS, shell.folder / "toys.py"))
    words = {"sweep": False, "plugins": (toys,)}
    shell.run("method=fine", **words)
    text = toys.read_text()
    # Of another size, too: Python takes a file of the same second and size for the one that it has compiled.
    toys.write_text(text.replace('@register("metric", version=1', '@register("metric", version=2') + "# edited\n")
    cell = shell.rows()["cell"].iloc[0]
    why = shell.call("why", cell, f"results={shell.results}", "--plugin", str(toys))
    assert "version of metric spread: 1 -> 2" in why.stdout
    assert "2 run" in shell.run("method=fine", **words).stderr
    more = shell.run("method=fine", "metric=[spread,spacing_variation]", **words)
    assert more.returncode == 0, more.stderr
    assert "2 run" in more.stderr
    rows = shell.rows()
    assert len(rows) == 2
    assert rows["score.spacing_variation"].notna().all()
    assert rows["score.spread"].notna().all()


# -- what is run again on request --------------------------------------------------------------------------------------


def test_a_raised_limit_runs_the_timeouts_again_and_nothing_else(shell):
    words = ("method=fine", "method.take=1.5", "method.at=1", "cases=3")
    done = shell.run(*words, "limit.seconds=0.7", sweep=False)
    assert done.returncode == 3
    assert list(shell.rows()["status"]) == ["ok", "timeout", "ok"]
    same = shell.run(*words, "limit.seconds=0.7", sweep=False)
    assert same.returncode == 3  # what is stored is not solved
    assert len(shell.calls()) == 3
    lower = shell.run(*words, "limit.seconds=0.5", sweep=False)
    assert lower.returncode == 3
    assert len(shell.calls()) == 3
    more = shell.run(*words, "limit.seconds=30", sweep=False)
    assert more.returncode == 0, more.stderr
    assert shell.calls()[3:] == ["fine 0 1"]
    assert list(shell.rows()["status"]) == ["ok"] * 3


def test_a_method_may_fail_and_take_too_long_before_it_is_called(shell):
    """What it does there is off the clock, has a limit of its own, and is tried again where that was raised."""
    words = ("method=prepared", "cases=2", "limit.seconds=1")
    assert shell.run(*words, "method.fail=true", sweep=False).returncode == 3
    failed = shell.rows()
    assert list(failed["status"]) == ["error", "error"]
    assert list(failed["stage"]) == ["prepare", "prepare"]
    assert set(failed["message"]) == {"OSError: no weights can be had"}
    slow = (*words, "method.take=1.5")
    assert shell.run(*slow, "limit.setup_seconds=1", sweep=False).returncode == 3
    late = shell.rows(variant="take=1.5")
    assert list(late["status"]) == ["timeout", "timeout"]
    assert set(late["message"]) == {"preparing the method took longer than limit.setup_seconds=1"}
    same = shell.run(*slow, "limit.setup_seconds=1", sweep=False)
    assert "0 run, 2 cached" in same.stderr
    assert shell.calls() == []
    more = shell.run(*slow, "limit.setup_seconds=60", sweep=False)
    assert more.returncode == 0, more.stderr
    assert list(shell.rows(variant="take=1.5")["status"]) == ["ok", "ok"]
    assert (shell.rows(variant="take=1.5")["seconds"] < 1).all()


def test_rerun_failed_and_always(shell):
    from test_faults_methods import MISBEHAVING

    words = {"plugins": (TOYS, MISBEHAVING)}
    shell.run("method=raises,returns_nan", **words)
    assert len(shell.calls()) == 4
    assert shell.run("method=raises,returns_nan", "rerun=failed", **words).returncode == 3
    assert sorted(shell.calls()[4:]) == ["raises 0 1", "returns_nan 0 1"]
    shell.run("method=raises,returns_nan", "rerun=always", **words)
    assert len(shell.calls()) == 6 + 4
    assert len(shell.rows()) == 4


def test_a_library_that_was_installed_since_is_no_longer_missing(shell, monkeypatch):
    """Skipped cases are tried again whenever the command is."""
    from test_faults_methods import MISBEHAVING

    words = {"plugins": (TOYS, MISBEHAVING), "sweep": False}
    assert shell.run("method=declared_missing", **words).returncode == 3
    (shell.folder / "no_such_library_declared.py").write_text("")
    monkeypatch.setenv("PYTHONPATH", f"{shell.folder}:{os.environ.get('PYTHONPATH', '')}")
    done = shell.run("method=declared_missing", **words)
    assert done.returncode == 0, done.stderr
    assert list(shell.rows()["status"]) == ["ok", "ok"]


# -- a task of one's own -----------------------------------------------------------------------------------------------


def test_a_new_task_over_pairs_needs_no_change_of_the_engine(shell):
    words = ("task=morph", "dataset=eggs", "sensor=samples", "metric=[vertex_distance]", "cases=2")
    done = shell.run(*words, "method=stay,follow", plugins=(PAIRS,), board=True)
    assert done.returncode == 0, done.stderr
    rows = shell.rows()
    assert len(rows) == 2 * 2
    assert (rows["status"] == "ok").all()
    assert rows["case"].iloc[0] == "egg-0-to-egg-1"
    score = rows.groupby("method")["score.vertex_distance"].mean()
    assert score["follow"] < 1e-12 < 0.01 < score["stay"]
    assert (rows["floor.vertex_distance"] == 0).all()
    board = done.stdout
    assert board.index("follow") < board.index("stay")
    refused = shell.run(*words, "method=identity", sweep=False, plugins=(PAIRS,))
    assert refused.returncode == 1
    assert "identity does not solve morph" in refused.stderr
    assert "follow, stay" in refused.stderr
    wrong = shell.run(*words[:1], "dataset=ball", "sensor=samples", *words[3:], "method=stay", plugins=(PAIRS, TOYS))
    assert "has no pairs" in wrong.stderr
    assert "Traceback" not in wrong.stderr
