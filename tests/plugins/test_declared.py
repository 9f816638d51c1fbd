"""What a module registers is read from its text, and is what its import registers."""

from __future__ import annotations

import importlib.metadata

import pytest

from bench.plugins.declared import declared
from bench.plugins.registry import KINDS, Registry, registry

METHOD = '@register("method"{options})\n@dataclass(frozen=True)\nclass {name}:\n    """A method."""\n'
HEAD = "from dataclasses import dataclass\nfrom bench import register\n\n"
SOLVES = "    def denoise(self, cloud):\n        return cloud\n"


def test_every_shipped_plugin_is_read_as_it_is_imported():
    shipped = [plugin for kind in KINDS for plugin in registry().all(kind) if plugin.origin.startswith("detailbench")]
    assert len(shipped) > 150
    for plugin in shipped:
        assert (plugin.kind, plugin.name) in declared(plugin.file), plugin.file


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (METHOD.format(options="", name="MyMethod"), [("method", "my_method")]),
        (METHOD.format(options=', name="other"', name="MyMethod"), [("method", "other")]),
        (METHOD.format(options=', "other"', name="MyMethod"), [("method", "other")]),
        (METHOD.format(options=',\n    cite="A (1999)",\n    requires=("torch",),\n', name="A"), [("method", "a")]),
        (METHOD.format(options="", name="A") + METHOD.format(options="", name="B"), [("method", "a"), ("method", "b")]),
        (METHOD.format(options=", name=NAME", name="A"), None),
        (METHOD.format(options="", name="A").replace('"method"', "KIND"), None),
        ('for cls in SOME:\n    register("method")(cls)\n', None),
        ("if TORCH:\n    " + METHOD.format(options="", name="A").replace("\n", "\n    "), None),
        (METHOD.format(options="", name="A") + 'register("method", name="b")(A)\n', None),
        ("", []),
    ],
)
def test_what_a_text_tells(tmp_path, text, found):
    file = tmp_path / "module.py"
    file.write_text(text)
    assert declared(file) == found


def test_what_cannot_be_read_is_left_to_the_import(tmp_path):
    (tmp_path / "latin.py").write_bytes(b'x = "\xe9"\n@register("method")\nclass A: pass\n')
    assert declared(tmp_path / "latin.py") is None and declared(tmp_path / "none.py") is None


class Entry:
    """An entry point of an installed package."""

    name, dist = "theirs", None

    def __init__(self, module):
        self.module = module


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Makes an installed package of these modules: a registry that has discovered it alone."""

    def make(name, **modules):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "__init__.py").touch()
        for module, text in modules.items():
            (folder / f"{module}.py").write_text(text)
        monkeypatch.syspath_prepend(str(tmp_path))
        monkeypatch.setattr(importlib.metadata, "entry_points", lambda group: [Entry(name)])
        found = Registry()
        found.discover()
        return found

    return make


def test_a_module_is_imported_when_its_plugin_is_asked_for(package):
    fails = METHOD.format(options="", name="Fails") + "raise ImportError('no such library')\n"
    found = package("quiet_plugins", fails=HEAD + fails, other="raise AssertionError  # registers nothing")
    assert found.names("method") == ["fails"] and found.broken == []
    with pytest.raises(Exception, match="no method is called 'fails'.*\n.*no such library"):
        found.find("method", "fails")
    assert found.names("method") == []


def test_a_module_whose_text_does_not_tell_is_imported_at_once(package):
    found = package("loud_plugins", broken="register(\n", computed=f"NAME = 'x'\n{HEAD}raise OSError('register(')\n")
    assert sorted(broken.reason.partition(":")[0] for broken in found.broken) == ["OSError", "SyntaxError"]


def test_what_one_process_alone_has_loaded_is_not_in_the_cached_listing(tmp_path, monkeypatch):
    from bench.plugins import listing as module

    kept = []
    monkeypatch.setattr(registry(), "broken", [])  # what it is after this test
    monkeypatch.setattr(registry(), "files", set())
    monkeypatch.setattr(module, "kept_listing", lambda stamp: None)
    monkeypatch.setattr(module, "keep", lambda stamp, found: kept.append(found))
    broken = tmp_path / "broken.py"
    broken.write_text("raise ValueError('of this process')\n")
    registry().load_file(broken)
    assert any(entry["file"] == str(broken) for entry in module.listing()["broken"]) and kept == []
