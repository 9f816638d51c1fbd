"""A results folder of somebody else: nothing of it runs, and nothing is written where its records say."""

import json
import shutil

import pyarrow as pa
import pytest
from conftest import TOYS
from records import rewritten

from bench.errors import UsageError
from bench.plan.cell import Cell, Choice, id_of
from bench.results.kept_outputs import found
from bench.results.recorded import Stored, writing_nothing
from bench.results.store import Results

WRITES = '''
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar
from bench import register

Path(__file__).with_name("imported").touch()

@register("method")
@dataclass(frozen=True)
class Writes:
    """Writes what it is told to."""

    log: str = ""
    writes: ClassVar[tuple[str, ...]] = ("log",)

    def denoise(self, cloud, run):
        if self.log:
            Path(self.log).write_text("overwritten")
        return cloud
'''


@pytest.fixture(scope="module")
def folder(shells):
    """A shell with the record of a method that may write, from a plugin file."""
    shell = shells("strangers")
    plugin = shell.folder / "writes.py"
    plugin.write_text(WRITES)
    done = shell.run("method=writes", "cases=1", sweep=False, plugins=(TOYS, plugin))
    assert done.returncode == 0, done.stderr
    return shell


@pytest.fixture
def copy(folder, tmp_path):
    """A copy of the results, which a test may change, and its one record file."""
    shutil.copytree(folder.results, tmp_path / "results")
    (file,) = tmp_path.glob("results/cells/*/*.parquet")
    (folder.folder / "imported").unlink(missing_ok=True)
    return file


def obeying(target):
    """Let the metadata of a record tell its method to write a file."""

    def change(meta):
        meta["cell"]["method"]["parameters"]["log"] = str(target)

    return change


def with_its_id(target):
    """The same, with all that says which cell it is changed alike."""

    def change(meta):
        obeying(target)(meta)
        meta["cell_id"] = id_of(meta["cell"])

    def table(old):
        made = dict(json.loads(old.schema.metadata[b"detailbench"]))
        change(made)
        return old.set_column(old.column_names.index("cell"), "cell", pa.array([made["cell_id"]] * len(old)))

    return change, table


@pytest.mark.parametrize("command", ["why", "reproduce"])
def test_no_plugin_that_a_record_names_is_imported(folder, copy, command):
    cell = copy.name[:12]
    plugin = folder.folder / "writes.py"
    for name in ("writes.py", "work/writes.py"):  # as an absolute path, and as a relative one
        file = rewritten(copy, lambda meta, name=name: meta["settings"].update(plugins=[str(TOYS), name]))
    done = folder.call(command, cell, f"results={file.parents[2]}")
    assert done.returncode == 1
    assert f"was run with the plugin {TOYS}" in done.stderr and f"{plugin} (method writes)" in done.stderr
    assert "--plugin FILE" in done.stderr and "--source` prints it" in done.stderr
    assert not (folder.folder / "imported").exists()
    if command == "why":
        assert "denoise ball dots writes seed=0" in done.stdout and "1/1 solved" in done.stdout
        assert "nothing differs, as far as can be told" in done.stdout


def test_the_file_that_is_named_is_compared_with_the_source_in_the_record(folder, copy):
    edited = copy.parents[3] / "writes.py"
    edited.write_text(WRITES.replace("        return cloud", "        pass\n        return cloud"))
    done = folder.call("why", copy.name[:12], f"results={copy.parents[2]}", "--plugin", TOYS, "--plugin", edited)
    assert done.returncode == 0, done.stderr
    line = WRITES.splitlines().index("        return cloud") + 1
    assert "source of method writes was edited" in done.stdout
    assert f"{edited} differs from the record's from line {line} on" in done.stdout
    assert f"{TOYS} differs" not in done.stdout


def test_a_record_whose_cell_is_not_that_of_its_id_is_refused_everywhere(folder, copy):
    mine = copy.parents[3] / "mine.txt"
    mine.write_text("precious")
    file = rewritten(copy, obeying(mine))
    here, plugins = f"results={file.parents[2]}", ("--plugin", TOYS, "--plugin", folder.folder / "writes.py")
    for command in ("why", "reproduce"):
        done = folder.call(command, file.name[:12], here, *plugins)
        assert done.returncode == 1 and "its cell does not match its id" in done.stderr, done.stderr
        assert "Traceback" not in done.stderr
    board = folder.call("leaderboard", file.parents[2])
    assert board.returncode == 1 and board.stderr.count(file.name) == board.stderr.count("warning: ") == 1
    assert file.exists()
    again = folder.run("method=writes", "cases=1", here, sweep=False, plugins=(TOYS, folder.folder / "writes.py"))
    assert "1 run" in again.stderr and again.stderr.count(str(file)) == 1, again.stderr
    assert (file.parents[2] / "damaged" / file.name).exists() and Results(file.parents[2]).read(*file.stem.split("-"))
    assert mine.read_text() == "precious"


def test_what_a_record_would_write_is_not_written(folder, copy):
    mine = copy.parents[3] / "mine.txt"
    mine.write_text("precious")
    file = rewritten(copy, *with_its_id(mine))
    plugins = ("--plugin", TOYS, "--plugin", folder.folder / "writes.py")
    done = folder.call("reproduce", file.name[:12], f"results={file.parents[2]}", *plugins)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"not written: method.log={mine}" in done.stdout and "reproduced" in done.stdout
    assert mine.read_text() == "precious"


def test_what_the_parts_of_a_plugin_would_write_is_not_written():
    steps = ["wlop", {"chain": {"steps": ["wlop", {"siren": {"save": "x.safetensors", "load": "y"}}]}}]
    cell = Cell(
        task=Choice("task", "reconstruct", {}),
        dataset=Choice("dataset", "bumps", {}),
        sensor=Choice("sensor", "samples", {}),
        method=Choice("method", "chain", {"steps": steps}),
        metrics=(Choice("metric", "p2f_mean", {}),),
    )
    cleared, outputs = writing_nothing(cell)
    assert outputs == ["siren.save=x.safetensors"]
    left = [part.made for part in cleared.method.made._parts[-1].made._parts]
    assert (left[-1].save, left[-1].load) == ("", "y")
    assert writing_nothing(cleared) == (cleared, [])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda meta: meta.pop("settings"), "its metadata lack settings"),
        (lambda meta: meta["settings"].pop("limit"), "its metadata lack settings.limit"),
        (lambda meta: meta["settings"].update(limit={"seconds": -1.0}), "limit.seconds=-1.0: expected more than 0"),
        (lambda meta: meta["settings"].update(limit={"seconds": "soon"}), r"limit\.\* of the type str"),
        (lambda meta: meta.update(provenance=[1]), "provenance of the type list"),
        (lambda meta: meta.update(sources={"a.py": {"sha256": 5}}), "sha256 of the type int"),
        (lambda meta: meta.update(schema_version=99), "of a later detailbench"),
    ],
)
def test_metadata_of_any_kind_are_reported_in_words(copy, change, said):
    file = rewritten(copy, change)
    with pytest.raises(UsageError, match=said):
        Stored.of(file.name[:12], [f"results={file.parents[2]}"]).settings  # noqa: B018


def test_stored_outputs_are_looked_for_in_the_folder_alone(tmp_path):
    for name in ("outputs/a.ply", "mine/outputs/b.ply", "c.ply"):
        (tmp_path / "results" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "results" / name).write_text("")
        (tmp_path / name.rpartition("/")[2]).write_text("")
    folder = tmp_path / "results"
    assert found(folder, "outputs/a.ply") == found(folder, "/elsewhere/outputs/a.ply") == folder / "outputs/a.ply"
    for stored in (str(tmp_path / "c.ply"), "../c.ply", "/x/outputs/../../c.ply", str(folder / "mine/outputs/b.ply")):
        assert found(folder, stored) is None


def test_what_metadata_may_lack(copy):
    def change(meta):
        meta["provenance"].clear()
        for key in ("outputs", "profile", "plugins"):
            del meta["settings"][key]

    file = rewritten(copy, change)
    stored = Stored.of(file.name[:12], [f"results={file.parents[2]}"])
    assert stored.settings.plugins == () and stored.missing
