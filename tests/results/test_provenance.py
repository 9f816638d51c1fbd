"""What a result depends on: every ingredient changes the fingerprint, nothing else does."""

import copy
import os
import pickle
import time
from dataclasses import asdict, replace
from hashlib import sha256
from pathlib import Path

import pytest
from toy_cells import Method, config, node

from bench.errors import UsageError
from bench.plan.cell import Cell, Choice, Settings, settings_of
from bench.plan.limits import Limits
from bench.plugins.registry import registry
from bench.results import sources
from bench.results.provenance import (
    explain,
    fingerprint,
    ingredients,
    memory_keys,
    package_version,
    plugin_sources,
    source_closure,
    source_digest,
)

CELL = Cell.from_config(config())


def test_a_cell_survives_json():
    import json

    again = Cell.from_json(json.loads(json.dumps(CELL.to_json())))
    assert again == CELL and again.id == CELL.id and len(CELL.id) == 12


def test_a_default_that_is_given_makes_no_other_cell():
    assert Cell.from_config(config(method=node("method", "provenance_method", depth=8))).id == CELL.id


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 1},
        {"cases": 5},
        {"threads": 2},
        {"split": "train"},
        {"method": node("method", "provenance_method", depth=9)},
        {"dataset": node("dataset", "provenance_dataset", content="two")},
    ],
)
def test_what_is_asked_for_is_in_the_id(change):
    assert Cell.from_config(config(**change)).id != CELL.id


def test_the_label_shows_what_is_not_default():
    cell = Cell.from_config(config(method=node("method", "provenance_method", depth=9)))
    assert cell.method.label == "provenance_method[depth=9]"
    assert cell.title == "denoise provenance_dataset provenance_sensor provenance_method[depth=9] seed=0"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"cases": 0}, "cases=0: expected a whole number of at least 1"),
        ({"seed": -1}, "seed=-1"),
        ({"split": "tset"}, "Did you mean 'test'"),
        ({"device": "gpu"}, "device=gpu"),
        ({"metric": {}}, "none of the chosen metrics scores a cloud"),
        (
            {"task": node("task", "reconstruct")},
            "method provenance_method does not solve reconstruct: it solves denoise",
        ),
        ({"method": {}}, "choose a method by name"),
    ],
)
def test_what_cannot_be_run_is_refused(change, words):
    with pytest.raises(UsageError, match=words):
        Cell.from_config(config(**change))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"outputs": "some"}, "outputs=some"),
        ({"rerun": "nevre"}, "Did you mean 'never'"),
        ({"limit": {"seconds": 0}}, "limit.seconds=0"),
    ],
)
def test_wrong_settings_are_refused(changes, words):
    usual = {"results": "r", "outputs": "none", "rerun": "never", "verbose": False, "plugins": [], "profile": "quick"}
    assert settings_of(usual | {"limit": {}}) == Settings(results="r", limit=Limits())
    with pytest.raises(UsageError, match=words):
        settings_of({"limit": {}} | usual | changes)


def test_every_ingredient_changes_the_fingerprint():
    parts = ingredients(CELL)
    assert parts["version of metric provenance_metric"] == 1
    assert parts["file x.ply"] == "one"
    assert parts["package numpy"] == package_version("numpy")
    marks = {fingerprint(parts)} | {fingerprint(parts | {key: "other"}) for key in parts}
    assert len(marks) == len(parts) + 1
    assert fingerprint(ingredients(CELL)) == fingerprint(parts)


def test_tasks_share_the_memory_of_shapes_and_of_clouds_and_not_that_of_cases():
    keys = memory_keys(CELL)
    ratio = {ratio: memory_keys(replace(CELL, task=Choice("task", "upsample", {"ratio": ratio}))) for ratio in (2, 4)}
    for others in ratio.values():
        assert {key for key in keys if keys[key] != others[key]} == {"task"}
    assert ratio[2]["task"] != ratio[4]["task"]


def anew(cell):
    """The same cell, whose choices find their plugins again."""
    return Cell.from_json(cell.to_json())


def test_what_a_choice_has_found_is_no_part_of_it():
    """Of equality, JSON, copies and pickles."""
    choice = Choice("method", "provenance_method", {"depth": 9})
    cell = replace(CELL, method=choice)
    plain = Choice("method", "provenance_method", {"depth": 9}), cell.to_json(), pickle.dumps((choice, cell))
    facts = choice.plugin, choice.made, choice.parts, choice.variant, choice.label, cell.id, cell.choices
    assert facts[0].cls is Method and facts[1] == Method(9) and facts[3:5] == ("depth=9", "provenance_method[depth=9]")
    assert (choice, cell.to_json(), pickle.dumps((choice, cell))) == plain
    assert asdict(choice) == {"kind": "method", "name": "provenance_method", "parameters": {"depth": 9}}
    for other in (pickle.loads(pickle.dumps(cell)), copy.copy(cell), copy.deepcopy(cell), anew(cell)):
        assert other == cell and "id" not in vars(other) and other.id == cell.id
    assert replace(cell, seed=5).id != cell.id and replace(choice, parameters={}).label == "provenance_method"


def test_a_choice_finds_its_plugin_once_and_builds_a_new_object_for_each_case(monkeypatch):
    lookups = []
    find = registry().find
    monkeypatch.setattr(
        type(registry()), "find", lambda self, *names, **also: lookups.append(names) or find(*names, **also)
    )
    choice = Choice("method", "provenance_method", {"depth": 9})
    assert choice.build() is not choice.build() and choice.made is choice.made
    assert choice.build() == choice.made == Method(9)
    assert [choice.parts, choice.variant, choice.label, choice.plugin] and lookups == [("method", "provenance_method")]


def test_only_plugins_from_files_have_their_sources_in_the_record(tmp_path, monkeypatch):
    assert plugin_sources(CELL) == {}
    file, neighbour = tmp_path / "mine.py", tmp_path / "helper.py"
    file.write_text("import helper\nfrom bench.geometry.sampling import sample_uniform\n")
    neighbour.write_bytes(b"# caf\xe9\n")
    (tmp_path / "unrelated.py").write_text("")
    known = registry().find("method", "provenance_method")
    mine = replace(known, file=file, origin=str(file))
    monkeypatch.setitem(registry()._plugins["method"], "provenance_method", mine)
    kept = plugin_sources(anew(CELL))
    assert kept == {
        str(file): {"sha256": sha256(file.read_bytes()).hexdigest(), "text": file.read_text()},
        str(neighbour): {"sha256": sha256(b"# caf\xe9\n").hexdigest(), "text": "# caf\\xe9\n"},
    }
    neighbour.write_text("#" * (1 << 17))
    assert plugin_sources(anew(CELL))[str(neighbour)]["text"] is None


def test_a_raised_metric_version_is_an_other_result(monkeypatch):
    before = fingerprint(ingredients(CELL))
    known = registry().find("metric", "provenance_metric")
    monkeypatch.setitem(registry()._plugins["metric"], "provenance_metric", replace(known, options={"version": 2}))
    assert fingerprint(ingredients(anew(CELL))) != before


def test_explain_lists_the_differences():
    then = {"package torch": "2.5", "source of method a": "1", "file a": "1", "file b": "1", "version of metric m": 1}
    now = {"package torch": None, "source of method a": "2", "file a": "2", "file c": "1", "version of metric m": 2}
    assert explain(then, now) == [
        "file a has other content",
        "file b is gone",
        "file c is new",
        "package torch: 2.5 -> not installed",
        "source of method a was edited",
        "version of metric m: 1 -> 2",
    ]
    assert explain(then, then) == []


def test_the_source_of_a_plugin_is_its_file_and_what_it_imports_beside_it(tmp_path):
    plugin, neighbour, stranger = (tmp_path / name for name in ("plugin.py", "helper.py", "unrelated.py"))
    plugin.write_text("import numpy\nfrom helper import f\nfrom bench.geometry.sampling import sample_uniform\n")
    neighbour.write_text("x = 1\n")
    stranger.write_text("y = 1\n")
    names = {path.name for path in source_closure(plugin)}
    assert {"plugin.py", "helper.py", "sampling.py"} <= names and "unrelated.py" not in names
    before = source_digest(plugin)
    stranger.write_text("y = 2\n")
    assert source_digest(plugin) == before
    neighbour.write_text("x = 22\n")
    assert source_digest(plugin) != before


def test_relative_imports_of_a_package_count(tmp_path):
    package = tmp_path / "family"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "block.py").write_text("")
    (package / "plugin.py").write_text("from .block import x\nfrom . import block\nimport family.other\n")
    assert {path.name for path in source_closure(package / "plugin.py")} == {"plugin.py", "block.py", "__init__.py"}


def test_versions_of_packages():
    import numpy

    assert package_version("numpy") == numpy.__version__
    assert package_version("igl")
    assert package_version("there_is_no_such_package") is None


def test_choices_are_checked_and_completed():
    choice = Choice.of("method", node("method", "provenance_method"))
    assert choice.parameters == {"depth": 8}
    assert choice.build() == Method()


def test_a_source_is_read_again_when_it_was_edited_and_only_then(tmp_path, monkeypatch):
    """Also an edit that keeps its size, that puts its time back, or that comes within one tick of the clock."""
    plugin, block = tmp_path / "plugin.py", tmp_path / "block.py"
    plugin.write_text("import block\n")
    block.write_text("a = 1\n")
    seen = [source_digest(plugin)]
    block.write_text("a = 2\n")  # at once
    seen.append(source_digest(plugin))
    monkeypatch.setattr(sources, "TICK_NS", -1)  # as if all were long ago
    assert source_digest(plugin) == seen[-1]
    reads = []
    read_bytes = Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda path: reads.append(path.name) or read_bytes(path))
    assert source_digest(plugin) == seen[-1] and reads == []
    time.sleep(0.05)  # more than a tick
    before = block.stat()
    block.write_text("a = 3\n")
    os.utime(block, ns=(before.st_atime_ns, before.st_mtime_ns))
    seen.append(source_digest(plugin))
    block.unlink()
    seen.append(source_digest(plugin))
    assert len(set(seen)) == len(seen) and "block.py" in reads
