"""What lies in one results folder does not mix: tasks, versions of a source, machines, text that no file can hold."""

from __future__ import annotations

import json
import os
import shutil
from collections import Counter
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from conftest import TOYS

from bench.errors import UsageError
from bench.geometry.io.files import load_mesh, save
from bench.results.files import META_KEY
from bench.results.recorded import Stored
from bench.results.store import Results

TWINS = Path(__file__).with_name("twins.py")

# -- tasks -------------------------------------------------------------------------------------------------------------


def test_a_task_whose_cases_are_called_like_shapes_scores_as_in_a_folder_of_its_own(shell):
    """The exact answer scores at its floor, whatever task was here before, and has its own reference's file."""
    words = ("dataset=twins", "sensor=sparse", "method=knows", "metric=[chamfer_l1_mean]", "cases=1", "outputs=all")
    options = {"sweep": False, "plugins": (TWINS,)}
    alone = shell.folder / "alone"
    assert shell.run("task=swap", *words, f"results={alone}", **options).returncode == 0
    assert shell.run("task=reconstruct", *words, **options).returncode == 0
    assert shell.run("task=swap", *words, **options).returncode == 0
    swapped, expected = shell.rows(task="swap"), Results(alone).rows()
    assert (swapped["score.chamfer_l1_mean"] == expected["score.chamfer_l1_mean"]).all()
    assert (swapped["floor.chamfer_l1_mean"] == expected["floor.chamfer_l1_mean"]).all()
    assert (swapped["score.chamfer_l1_mean"] < 1.2 * swapped["floor.chamfer_l1_mean"]).all()
    results = Results(shell.results)
    for row in shell.rows().to_dict("records"):
        output, reference = load_mesh(results.output_of(row)), load_mesh(results.reference_of(row))
        extents = reference.extents if row["task"] == "swap" else 2 * np.ones(3)
        assert output.extents == pytest.approx(extents, rel=1e-9), row["task"]
    assert len(list(shell.results.glob("outputs/references/*"))) == 2  # the ball and the egg


# -- versions ----------------------------------------------------------------------------------------------------------


def leaderboard(shell, *words) -> str:
    """What `detailbench leaderboard` prints, on both channels, in a process that knows none of the toys."""
    done = shell.call("leaderboard", *words)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def edited_toys(text: str) -> str:
    """The toys with another ``fine``: its output is a hundred times as large."""
    old = "            time.sleep(self.take)\n        return cloud\n"
    assert text.count(old) == 1
    return text.replace(old, old.replace("return cloud", "return PointCloud(100 * cloud.points)"))


def board(text: str) -> float:
    """The one mean of a leaderboard."""
    (line,) = (line for line in text.splitlines() if line.startswith("fine"))
    return float(line.split()[2])


def test_the_table_of_a_run_is_of_that_run_after_an_edit_is_taken_back(shell):
    toys = Path(shutil.copy(TOYS, shell.folder / "toys.py"))
    words = {"sweep": False, "plugins": (toys,), "board": True}
    text = toys.read_text()
    first = board(shell.run("method=fine", **words).stdout)
    toys.write_text(edited_toys(text))
    edited = board(shell.run("method=fine", **words).stdout)
    assert edited == pytest.approx(100 * first, rel=1e-3)
    toys.write_text(text)
    reverted = shell.run("method=fine", **words)
    assert "0 run, 2 cached" in reverted.stderr
    assert board(reverted.stdout) == first
    # The plugin is no plugin of this installation, and its file is there to be compared with.
    assert board(leaderboard(shell, shell.results)) == first
    why = shell.call("why", shell.rows()["cell"].iloc[0], f"results={shell.results}", "--plugin", toys).stdout
    assert "it would not be run again" in why
    assert "2 records of this cell" in why
    shown = [line for line in why.splitlines() if line.endswith("shown in tables")]
    assert len(shown) == 1 and "current" in shown[0]
    assert sum("source of method fine was edited" in line for line in why.splitlines()) == 1
    toys.unlink()  # now nothing says which is current: the newest counts
    assert board(leaderboard(shell, shell.results)) == edited


def dated(file: Path, finished: str) -> None:
    """Rewrite a record as if the clock had said so."""
    table = pq.read_table(file)
    meta = json.loads(table.schema.metadata[META_KEY]) | {"finished": finished}
    place = table.column_names.index("finished")
    table = table.set_column(place, "finished", [[finished] * len(table)])
    pq.write_table(table.replace_schema_metadata({META_KEY: json.dumps(meta).encode()}), file)


def test_a_record_from_the_future_shadows_nothing(shell):
    toys = Path(shutil.copy(TOYS, shell.folder / "toys.py"))
    words = {"sweep": False, "plugins": (toys,), "board": True}
    text = toys.read_text()
    toys.write_text(edited_toys(text))
    shell.run("method=fine", **words)
    (file,) = shell.files()
    dated(file, "2999-01-01T00:00:00+00:00")
    toys.write_text(text)
    done = shell.run("method=fine", **words)
    assert "2 run" in done.stderr
    toys.unlink()  # what is newest counts, and that is told by the time of the file
    ranked = leaderboard(shell, shell.results)
    assert board(ranked) == board(done.stdout)
    assert f"{file.name}: is dated 2999-01-01T00:00:00+00:00, in the future" in ranked
    os.utime(file, (4e9, 4e9))  # a file of the year 2096 is older than all
    assert board(leaderboard(shell, shell.results)) == board(done.stdout)
    cell = shell.rows()["cell"].iloc[0]
    assert [record.fingerprint in file.name for record in Results(shell.results).records(cell)] == [False, True]


# -- text --------------------------------------------------------------------------------------------------------------

BAD_TEXT = '''
from dataclasses import dataclass
from trimesh.creation import icosphere
from bench import PointCloud, Shape, register

@register("dataset")
@dataclass(frozen=True)
class Odd:
    """Ids and tags that no file can hold."""
    def shapes(self, split):
        yield Shape("a\\udcff/\\0b", icosphere(subdivisions=1), tags=("t\\udcff",))
        yield Shape("..", icosphere(subdivisions=1), tags=("\\0",))

@register("sensor")
@dataclass(frozen=True)
class All:
    """The vertices."""
    def sense(self, shape, rng):
        return PointCloud(shape.mesh.vertices)

@register("method")
@dataclass(frozen=True)
class Says:
    """Raises or notes what cannot be encoded."""
    fails: bool = True
    def denoise(self, cloud, run):
        run.note("note \\udcff \\0 end")
        if self.fails:
            raise ValueError("bad \\ud800 \\udcff \\0 end")
        return cloud
'''


def test_text_that_no_file_can_hold_is_stored_escaped(shell):
    plugin = shell.folder / "odd.py"
    plugin.write_text(BAD_TEXT)
    words = ("dataset=odd", "sensor=all", "method=says", "method.fails=true,false", "outputs=all")
    done = shell.run(*words, plugins=(TOYS, plugin))
    assert done.returncode == 3, done.stderr
    assert "Traceback" not in done.stderr
    rows = shell.rows()
    assert set(rows["case"]) == {r"a\udcff/\x00b", ".."}
    assert set(rows["tags"]) == {r"smooth,t\udcff", r"smooth,\x00"}
    assert set(rows[rows["status"] == "error"]["message"]) == {
        r"ValueError: bad \ud800 \udcff \x00 end (note: note \udcff \x00 end)"
    }
    assert set(rows[rows["status"] == "ok"]["message"]) == {r"note \udcff \x00 end"}
    record = Results(shell.results).records(rows["cell"].iloc[0])[0]
    for row in record.rows:
        for value in row.values():
            str(value).encode()
    results = Results(shell.results)
    kept = [results.output_of(row) for row in rows.to_dict("records") if row["status"] == "ok"]
    assert all(path.parent.parent == shell.results / "outputs" for path in kept) and len(set(kept)) == 2


def test_a_partial_file_that_blocked_its_cell_is_read(shell):
    """As earlier versions left it: rows with a lone surrogate; and lines that are no rows at all."""
    shell.run("method=fine", "cases=3", sweep=False)
    (file,) = shell.files()
    record = Results(shell.results).records(file.name[:12])[0]
    rows = record.rows
    rows[0]["message"] = "torn \udcff"
    lines = [
        json.dumps(rows[0]).encode(),
        b"\xff\xfe no text",
        json.dumps({**rows[1], "status": None}).encode(),
        json.dumps({**rows[1], "case_index": "one"}).encode(),
        json.dumps({**rows[1], "seconds": "long"}).encode(),
        json.dumps([1, 2]).encode(),
        b'{"case_index": 2',
    ]
    file.unlink()
    partial = shell.results / ".partial" / f"{file.stem}.jsonl"
    partial.write_bytes(b"\n".join(lines))
    done = shell.run("method=fine", "cases=3", sweep=False)
    assert done.returncode == 0, done.stderr
    assert "2 run, 1 cached" in done.stderr
    assert shell.rows()["message"].iloc[0] == r"torn \udcff"
    assert Counter(shell.calls()) == {"fine 0 0": 1, "fine 0 1": 2, "fine 0 2": 2}


def test_a_file_whose_name_is_no_text(shell):
    folder = shell.folder / "scans"
    folder.mkdir()
    save(load_ball(), folder / "good.ply")
    (Path(os.fsdecode(os.fsencode(folder) + b"/bad\xff.ply"))).write_bytes(b"ply\nnonsense")
    words = ("dataset=files", f"dataset.path={folder}", "sensor=samples", "method=fine", "cases=2")
    done = shell.run(*words, sweep=False)
    assert done.returncode == 3, done.stderr
    assert "Traceback" not in done.stderr
    assert sorted(shell.rows()["status"]) == ["error", "ok"]
    assert r"bad\udcff.ply" in shell.rows()["message"].dropna().str.cat()


def load_ball():
    from trimesh.creation import icosphere

    return icosphere(subdivisions=2)


# -- elsewhere ---------------------------------------------------------------------------------------------------------


def test_a_folder_that_was_moved_with_its_data_and_its_plugin(shell):
    """Outputs are found, and the cell is explained and repeated, with the new places given."""
    data, toys = shell.folder / "data", Path(shutil.copy(TOYS, shell.folder / "toys.py"))
    data.mkdir()
    for name in ("one", "two"):
        save(load_ball(), data / f"{name}.ply")
    words = ("dataset=files", f"dataset.path={data}", "sensor=samples", "method=fine", "cases=2", "outputs=all")
    done = shell.run(*words, sweep=False, plugins=(toys,))
    assert done.returncode == 0, done.stderr
    cell = shell.rows()["cell"].iloc[0]
    away = shell.folder / "away"
    away.mkdir()
    source = toys.read_text()
    for old in (data, toys, shell.results):
        shutil.move(old, away / old.name)
    here = f"results={away / 'results'}"
    results = Results(away / "results")
    for row in results.rows().to_dict("records"):
        assert not Path(row["output"]).is_absolute()
        assert results.output_of(row).is_file() and results.reference_of(row).is_file()

    lost = shell.call("reproduce", cell, here)
    assert lost.returncode == 1
    assert f"was run with the plugin {toys}" in lost.stderr and "--plugin FILE" in lost.stderr
    assert "--source" in lost.stderr and "Traceback" not in lost.stderr
    printed = shell.call("why", cell, here, "--source")
    assert source.strip() in printed.stdout
    plugin = ("--plugin", away / "toys.py")
    unplaced = shell.call("why", cell, here, *plugin)
    assert unplaced.returncode == 1
    assert "no such file or folder" in unplaced.stderr and "dataset.path=PATH" in unplaced.stderr
    found = shell.call("why", cell, here, *plugin, f"dataset.path={away / 'data'}")
    assert found.returncode == 0, found.stderr
    assert "current: " in found.stdout and "it would not be run again" in found.stdout
    again = shell.call("reproduce", cell, here, *plugin, f"dataset.path={away / 'data'}")
    assert again.returncode == 0, again.stderr + again.stdout
    assert "reproduced" in again.stdout and "differs" not in again.stdout
    (away / "toys.py").write_text(source + "\n# edited\n")
    save(load_ball().apply_scale(2.0), away / "data" / "two.ply")
    edited = shell.call("why", cell, here, *plugin, f"dataset.path={away / 'data'}").stdout
    assert "source of method fine was edited" in edited and "file two (two.ply) has other content" in edited
    record = results.records(cell)[0]
    with pytest.raises(UsageError, match="Did you mean 'path'"):
        Stored(results, [record], record, {"pth": "x"}).cell  # noqa: B018


def test_absolute_paths_of_earlier_versions_are_found_in_a_folder_that_was_moved(shell):
    from bench.plan.cell import reference_name

    shell.run("method=fine", "outputs=all", sweep=False)
    (file,) = shell.files()
    table = pq.read_table(file)
    meta = json.loads(table.schema.metadata[META_KEY])
    place = table.column_names.index("output")
    absolute = [str(shell.results / value.as_py()) for value in table["output"]]
    table = table.set_column(place, "output", [absolute])
    for case, path in meta.pop("references").items():
        (shell.results / path).rename(shell.results / "outputs/references" / reference_name("ball", case))
    pq.write_table(table.replace_schema_metadata({META_KEY: json.dumps(meta).encode()}), file)
    copy = shell.folder / "copy"
    shutil.copytree(shell.results, copy)
    for folder in (shell.results, copy):
        results = Results(folder)
        for row in results.rows().to_dict("records"):
            assert results.output_of(row).is_relative_to(folder)
            assert results.reference_of(row).is_relative_to(folder) and results.reference_of(row).is_file()
    assert "0 run" in shell.run("method=fine", "outputs=all", sweep=False).stderr
    shutil.rmtree(copy / "outputs")  # the folder alone was copied: no path of a record leads outside
    assert Results(copy).output_of(Results(copy).rows().iloc[0]) is None


# -- outputs of finished cells -----------------------------------------------------------------------------------------


def test_outputs_that_are_asked_for_later_are_made(shell):
    words = ("method=fine", "cases=3")
    shell.run(*words, sweep=False)
    (file,) = shell.files()
    before = file.read_bytes()
    first = shell.run(*words, "outputs=first", sweep=False)
    assert "1 run (1 of them again, for their outputs), 2 cached" in first.stderr
    plan = shell.run(*words, "outputs=all", sweep=False, act=lambda _, *rest, **options: shell.call("plan", *rest))
    assert "no outputs" in plan.stdout and "3 cases, 1 finished, 2 to do" in plan.stdout
    every = shell.run(*words, "outputs=all", sweep=False)
    assert "2 run (2 of them again, for their outputs), 1 cached" in every.stderr
    assert len(list(shell.results.glob("outputs/*/ball-test-*.ply"))) == 3
    rows = Results(shell.results).records(file.name[:12])[0].rows
    next(shell.results.glob("outputs/*/ball-test-001.ply")).unlink()
    assert "1 run (1 of them again" in shell.run(*words, "outputs=all", sweep=False).stderr
    assert Counter(shell.calls()) == {"fine 0 0": 2, "fine 0 1": 3, "fine 0 2": 2}
    # A run that was killed between its last case and its record: the next one writes that record.
    file.write_bytes(before)
    partial = shell.results / ".partial" / f"{file.stem}.jsonl"
    partial.write_text("\n".join(map(json.dumps, rows)))
    assert "0 run, 3 cached" in shell.run(*words, "outputs=all", sweep=False).stderr
    assert len(shell.calls()) == 7
    assert (shell.rows()["output"] != "").all() and not partial.exists()


# -- one folder --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["run", "plan"])
def test_results_of_one_run_go_into_one_folder_or_nothing_runs(shell, command):
    done = shell.call(
        command, "-m", "--plugin", TOYS, "task=denoise", "method=fine", "seed=0,1", "results='out_${seed}'"
    )
    assert done.returncode == 1
    assert "expected one folder" in done.stderr and "Traceback" not in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert shell.calls() == [] and list(shell.work.iterdir()) == []


def test_a_folder_from_the_environment_is_one_folder(shell, monkeypatch):
    monkeypatch.setenv("SCRATCH", str(shell.folder / "it's here"))
    done = shell.run("method=fine", "results=${oc.env:SCRATCH}/x", "seed=0,1", "cases=1")
    assert done.returncode == 0, done.stderr
    assert len(Results(shell.folder / "it's here" / "x").rows()) == 2
    assert "2/2 cases solved" in done.stderr and list(shell.work.iterdir()) == []


# -- nothing solved ----------------------------------------------------------------------------------------------------


def test_a_run_in_which_nothing_was_solved_ends_with_its_table(shell):
    """Also under a convention, and where the folder has scores of other cells."""
    plugin = shell.folder / "fails.py"
    plugin.write_text(
        "from dataclasses import dataclass\nfrom bench import register\n@register('method')\n@dataclass(frozen=True)\n"
        "class Fails:\n    'Solves nothing.'\n    a: int = 0\n"
        "    def denoise(self, cloud, run):\n        raise ValueError('no')\n"
    )
    words = ("method=fails", "method.a=0,1", "convention=score_denoise")
    options = {"plugins": (TOYS, plugin), "board": True}
    for others in (False, True):
        if others:
            shell.run("method=fine", "cases=1", sweep=False)
        done = shell.run(*words, "rerun=always", **options)
        assert done.returncode == 3, done.stderr
        assert "\nerror:" not in done.stderr and "0/4 cases solved" in done.stderr
        assert "fails (a=1)" in done.stdout and "0/2" in done.stdout
    assert "fails (a=1)" in leaderboard(shell, shell.results, "--method", "fails", *words[2:])
    assert "fails (a=1)" in leaderboard(shell, shell.results, "--method", "fails")
