"""The templates of ``detailbench new``: real files that tools check, and no part of what is installed as plugins."""

from __future__ import annotations

import ast
import subprocess
import sys
from fnmatch import fnmatch
from pathlib import Path

import house
import pytest

import bench
from bench.authoring.scaffold import FIRST_RUNS, first_run, plugin_and_test, template
from bench.errors import UsageError
from bench.plugins.registry import KINDS, registry

FOLDER = Path(bench.__file__).parent / "authoring" / "templates"
FILES = sorted(FOLDER.glob("[a-z]*.py"))


def test_every_kind_of_plugin_has_a_template():
    assert set(FIRST_RUNS) == set(KINDS)
    assert {file.stem for file in FILES} == {*KINDS, "test"}


def test_templates_can_be_imported_and_hold_one_plugin_of_their_kind():
    code = (
        "import importlib; from bench.plugins.registry import KINDS, registry\n"
        "found = registry(); before = {kind: set(found.names(kind)) for kind in KINDS}\n"
        "for name in (*KINDS, 'test'): importlib.import_module(f'bench.authoring.templates.{name}')\n"
        "print({kind: sorted(set(found.names(kind)) - before[kind]) for kind in KINDS})"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    expected = {kind: ["my_plugin"] for kind in KINDS}
    expected["method"].append("my_plugin_baseline")  # the task's
    assert ast.literal_eval(done.stdout) == expected


def test_templates_are_neither_plugins_nor_tests_nor_rooms():
    assert [kind for kind in KINDS if "my_plugin" in registry().names(kind)] == []
    assert [file.name for file in FILES if fnmatch(file.name, "test_*.py") or fnmatch(file.name, "*_test.py")] == []
    assert [name for name in house.modules() if "templates" in name] == []


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_templates_import_what_any_plugin_may(file):
    public = {f"bench.{name}" for name in bench.__all__}
    ours = [name for name in house.imports(file, "") if name.partition(".")[0] == "bench"]
    assert ours
    assert [
        name for name in ours if name not in public and not name.startswith(("bench.geometry.", "bench.testing."))
    ] == []


@pytest.mark.parametrize("kind", KINDS)
def test_the_names_are_filled_in_everywhere(kind):
    plugin, test = plugin_and_test(kind, "round_things_2")
    assert "my_plugin" not in (plugin + test + first_run(kind, "round_things_2")).lower().replace(
        "myplugin", "my_plugin"
    )
    classes = [node.name for node in ast.parse(plugin).body if isinstance(node, ast.ClassDef)]
    assert classes == ["RoundThings2"] + ["RoundThings2Baseline"] * (kind == "task")
    assert '"round_things_2.py"' in test
    assert plugin == template(kind).replace("my_plugin", "round_things_2").replace("MyPlugin", "RoundThings2")


def test_a_class_that_would_hide_an_import_is_refused():
    for kind, name in (("dataset", "shape"), ("method", "point_cloud"), ("task", "frame")):
        with pytest.raises(UsageError, match="choose another name"):
            plugin_and_test(kind, name)
    plugin_and_test("metric", "shape")  # its file imports no such class
