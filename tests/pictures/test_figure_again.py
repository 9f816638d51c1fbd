"""Figures of results that kept no outputs: cells are run again, for the picture alone."""

import sys
from pathlib import Path

import pytest
from conftest import TOYS

LEARNER = Path(__file__).parents[1] / "engine" / "toy_learner.py"
FIGURE = ("--plugin", TOYS, "--size", "40", "--width", "column", "--no-insets")


def draw(shell, results, name, *words):
    return shell.call("figure", results, "-o", name, *FIGURE, *words)


@pytest.fixture
def plugin(shell):
    """A method that does another thing as soon as a file is there."""
    path = shell.folder / "fickle.py"
    path.write_text(
        "from dataclasses import dataclass\nfrom pathlib import Path\nfrom bench import PointCloud, register\n"
        "@register('method')\n@dataclass(frozen=True)\nclass Fickle:\n    'Moves the cloud, or fails.'\n"
        "    def denoise(self, cloud, run):\n"
        f"        told = Path({str(shell.folder / 'told')!r})\n"
        "        if told.exists() and told.read_text() == 'fail':\n            raise ValueError('not today')\n"
        "        return PointCloud(cloud.points + (0.5 if told.exists() else 0.0))\n"
    )
    return path


def test_a_figure_of_results_without_outputs_is_that_of_results_with_them(shell):
    kept = shell.folder / "kept"
    words = ("method=fine,identity", "dataset.stretch=1.5")
    shell.run(*words, "outputs=all", f"results={kept}")
    shell.run(*words, "outputs=none")
    files = {path: path.read_bytes() for path in shell.files()}
    before = len(shell.calls())
    assert draw(shell, kept, "kept.png", "--case", "1", "--recompute").returncode == 0
    assert len(shell.calls()) == before  # nothing is run where outputs are kept
    done = draw(shell, shell.results, "again.png", "--case", "1", "--recompute")
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("running 1 case again") == 2 and "no output is saved" not in done.stdout
    assert shell.calls()[before:] == ["fine 0 1"]  # the other case is left alone
    pictures = [(shell.work / name).read_bytes() for name in ("kept.png", "again.png")]
    assert pictures[0] == pictures[1]
    assert {path: path.read_bytes() for path in shell.files()} == files
    assert not shell.left_over()


def test_what_differs_today_is_reported(shell, plugin):
    shell.run("method=fickle", "outputs=none", sweep=False, plugins=(TOYS, plugin))
    (shell.folder / "told").write_text("move")
    done = draw(shell, shell.results, "moved.png", "--plugin", plugin, "--recompute")
    assert done.returncode == 0, done.stderr
    assert "ball-test-000: spread was" in done.stderr
    (shell.folder / "told").write_text("fail")
    done = draw(shell, shell.results, "failed.png", "--plugin", plugin, "--recompute")
    assert done.returncode == 0, done.stderr
    assert "ball-test-000, fickle: error: run again: ValueError: not today" in done.stdout


def test_a_plugin_file_of_a_record_is_not_imported_and_a_program_not_started(shell, plugin):
    shell.run("method=fickle", "outputs=none", sweep=False, plugins=(TOYS, plugin))
    done = draw(shell, shell.results, "strange.png", "--recompute")
    assert done.returncode == 1 and "--plugin FILE" in done.stderr and "fickle.py" in done.stderr
    touched, program, other = shell.folder / "touched", shell.folder / "program.py", shell.folder / "other"
    program.write_text(
        f"#!{sys.executable}\nimport shutil, sys\nopen({str(touched)!r}, 'w')\nshutil.copy(sys.argv[1], sys.argv[2])\n"
    )
    program.chmod(0o755)
    command = f"method.command='{program} {{input}} {{output}}'"
    done = shell.run("method=external", command, "outputs=none", f"results={other}", sweep=False)
    assert done.returncode == 0, done.stderr
    touched.unlink()
    done = draw(shell, other, "program.png", "--recompute")
    assert done.returncode == 1 and "--allow-program" in done.stderr and not touched.exists()
    done = draw(shell, other, "program.png", "--recompute", "--allow-program")
    assert done.returncode == 0, done.stderr
    assert touched.exists() and "no output is saved" not in done.stdout


def test_trained_weights_are_taken_along(shell, monkeypatch):
    log = shell.folder / "learner.log"
    monkeypatch.setenv("TOY_LEARNER_LOG", str(log))
    words = ("method=toy_learner", "training.cases=2", "training.dataset={ball: {stretch: 1.5}}", "training.threads=1")
    done = shell.run(*words, "outputs=none", sweep=False, plugins=(TOYS, LEARNER))
    assert done.returncode == 0, done.stderr
    trained = log.read_text()
    done = draw(shell, shell.results, "learned.png", "--plugin", LEARNER, "--recompute")
    assert done.returncode == 0, done.stderr
    assert "running 1 case again" in done.stderr and "spread" not in done.stderr and log.read_text() == trained
