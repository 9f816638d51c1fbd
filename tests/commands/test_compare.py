"""The gate: what its exit codes are, on real runs, and the recipe of docs/compare.md line by line."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from bench.commands.compare import share
from bench.errors import UsageError

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "compare.md"
sys.path.insert(0, str(ROOT / "scripts"))
from compare_bar import PLUGIN  # noqa: E402

TOYS = ROOT / "tests" / "faults" / "toys.py"
WORDS = (
    *("task=denoise", "method=planted,restless", "dataset=ball", "cases=4", "sensor=samples", "sensor.count=300"),
    *("sensor.noise=0.01", "seed=0", "metric=[p2f_mean]"),
)


@pytest.fixture(scope="module")
def runs(shells):
    """A run, the same again, and one that lost 5 %."""
    shell = shells("compared")
    plugin = shell.work / "planted_methods.py"

    def run(name: str, loss: float) -> Path:
        plugin.write_text(PLUGIN.format(loss=loss, work=0))
        folder = shell.folder / name
        done = shell.run(*WORDS, f"results={folder}", plugins=(TOYS, plugin))
        assert done.returncode in (0, 3), done.stderr
        return folder

    shell.then, shell.again = run("then", 0.0), run("again", 0.0)
    shell.lost = run("lost", 0.05)
    return shell


def test_the_same_again_passes(runs):
    done = runs.call("compare", runs.then, runs.again)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "nothing is significantly worse" in done.stderr and "quality: 8 pairs of cases" in done.stdout


def test_five_percent_less_do_not(runs):
    done = runs.call("compare", runs.then, runs.lost)
    assert done.returncode == 3
    assert "worse: planted: p2f_mean by 5.0 %" in done.stderr and "restless" not in done.stderr
    assert runs.call("compare", runs.then, runs.lost, "--fail-worse", "10%").returncode == 0
    assert runs.call("compare", runs.lost, runs.then).returncode == 0


def test_cases_that_fail_now_do_not_pass(runs, tmp_path):
    import pyarrow.parquet as pq

    folder = tmp_path / "failed"
    shutil.copytree(runs.then, folder, ignore=shutil.ignore_patterns(".*"))
    path = next(path for path in folder.glob("cells/*/*.parquet"))
    table = pq.read_table(path)
    status = table["status"].to_pylist()
    status[0] = "timeout"
    place = table.column_names.index("status")
    pq.write_table(table.set_column(place, table.schema.field("status"), [status]), path)
    done = runs.call("compare", runs.then, folder)
    assert done.returncode == 3 and "1 cases failed that were solved before" in done.stderr
    assert "failed now, solved then" in done.stdout
    assert runs.call("compare", runs.then, folder, "--most-failed", "1", "--fail-worse", "900%").returncode == 0


def test_cases_that_are_gone_fail_where_it_is_asked_for(runs, tmp_path):
    folder = tmp_path / "part"
    shutil.copytree(runs.then, folder, ignore=shutil.ignore_patterns(".*"))
    next(folder.glob("cells/*/*.parquet")).unlink()
    assert runs.call("compare", runs.then, folder).returncode == 0
    done = runs.call("compare", runs.then, folder, "--fail-gone")
    assert done.returncode == 3 and "4 cases are missing in the new results" in done.stderr


def test_usage_errors(runs):
    for words, message in (
        ((runs.then, runs.folder / "nowhere"), "no such folder"),
        ((runs.then, runs.again, "--fail-worse", "much"), "expected a share such as 2% or 0.02"),
        ((runs.then, runs.again, "--metric", "p2f_man"), "p2f_mean"),
    ):
        done = runs.call("compare", *words)
        assert done.returncode == 1 and message in done.stderr


def test_an_edited_dataset_is_another_question(shell):
    plugin = shell.work / "own.py"
    text = TOYS.read_text()
    folders = [shell.folder / name for name in ("a", "b")]
    for folder, extra in zip(folders, ("", "\n# another dataset\n"), strict=True):
        plugin.write_text(text + extra)
        shell.run("method=fine", plugins=(plugin,), act=shell.call, sweep=False)
        shutil.move(shell.results, folder)
    done = shell.call("compare", *folders)
    assert "the settings differ: source of dataset ball was edited" in done.stderr


@pytest.mark.parametrize(("text", "value"), [("2%", 0.02), ("0.02", 0.02), ("0", 0.0), ("150 %", 1.5)])
def test_shares(text, value):
    assert share("--x", text) == pytest.approx(value)


@pytest.mark.parametrize("text", ["-1%", "x", "", "nan", "2000%"])
def test_what_is_no_share_is_refused(text):
    with pytest.raises(UsageError, match="--x"):
        share("--x", text)


# --- the recipe -------------------------------------------------------------------------------------------------------


def test_the_recipe_works_as_printed(shell):
    (block,) = re.findall(r"```yaml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    recipe = yaml.safe_load(block)
    job = recipe["jobs"]["compare"]
    assert job["defaults"]["run"]["shell"] == "bash"
    steps = {step.get("name"): step["run"] for step in job["steps"] if "run" in step}
    assert list(steps) == ["install", "run", "compare", "make the next baseline"]
    summary = shell.folder / "summary.md"
    environment = shell.environment() | {"GITHUB_STEP_SUMMARY": str(summary)}
    environment["PATH"] = os.pathsep.join([str(Path(sys.prefix) / "bin"), environment["PATH"]])

    def act(name: str) -> int:
        # As GitHub runs a step with `shell: bash`.
        words = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", steps[name]]
        return subprocess.run(words, cwd=shell.work, env=environment, capture_output=True, check=False).returncode

    assert shell.call("new", "method", "my_method").returncode == 0
    # The first push to main: there is no baseline yet.
    assert [act(name) for name in ("run", "compare", "make the next baseline")] == [0, 0, 0]
    assert not summary.exists() and list((shell.work / "baseline").glob("cells/*/*.parquet"))
    # A pull request that makes nothing worse, and one that does; the first finds its cells as results of the same.
    assert [act("run"), act("compare")] == [0, 0]
    assert "| my_method |" in summary.read_text() or "the same" in summary.read_text()
    plugin = shell.work / "my_method.py"
    plugin.write_text(plugin.read_text().replace("PointCloud(points,", "PointCloud(points * 1.1,"))
    assert [act("run"), act("compare")] == [0, 3]
    assert "worse" in (shell.work / "report.md").read_text()
