"""Digests of sources: equal wherever files stand, another for every change of what they say."""

import subprocess
import sys
from pathlib import Path

import pytest

from bench.results import sources
from bench.results.sources import source_closure, source_digest

BODY = '''

def f(x):
    """Two
    lines."""
    return x + 1
'''


def write(folder: Path, files: dict[str, str | bytes]) -> Path:
    """Write files below a folder; the folder of each becomes a package where it has an ``__init__``."""
    for name, text in files.items():
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(text.encode() if isinstance(text, str) else text)
    return folder


def digest(tmp_path: Path, text: str | bytes, name: str = "plugin.py", **beside: str) -> str:
    """The digest of a file in a new folder, with others beside it."""
    folder = tmp_path / str(len(list(tmp_path.iterdir())))
    write(folder, {name: text} | {f"{other}.py": content for other, content in beside.items()})
    return source_digest(folder / name)


# -- what changes nothing ----------------------------------------------------------------------------------------------


def test_files_that_are_moved_with_their_import_lines_keep_their_digest(tmp_path):
    flat = {
        "family/__init__.py": "",
        "family/plugin.py": f"import numpy as np\nfrom .helper import f, g as h\nfrom .other import (\n  k,\n)\n{BODY}",
        "family/helper.py": "from . import ground\nf = g = ground.x\n",
        "family/other.py": "def k():\n    from .ground import x\n\n    return x\n",
        "family/ground.py": "x = 1\n",
    }
    deep = {
        "family/__init__.py": '"""A family."""\n',
        "family/top/__init__.py": '"""Its plugins."""\n',
        "family/low/__init__.py": "",
        "family/low/deep/__init__.py": "",
        "family/top/renamed.py": (
            "from ..low.second import (f,\n  g as h)\nfrom family.low.deep.third import k\n\n"
            f"import numpy as np\n{BODY}"
        ),
        "family/low/second.py": "from .deep import floor as ground\nf = g = ground.x\n",
        "family/low/deep/third.py": "def k():\n    from .floor import x\n    return x\n",
        "family/low/deep/floor.py": "x = 1\n",
    }
    before = source_digest(write(tmp_path / "flat", flat) / "family/plugin.py")
    assert source_digest(write(tmp_path / "deep", deep) / "family/top/renamed.py") == before


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("import a\nimport b\n", "import b\n\n\nimport a\n"),
        ("from os import path, sep\n", "from os import sep\nfrom os import path\n"),
        ("x = 1\n", "\n\nx = 1\n\n"),
        ("x = 1\n", "x = 1\r\n"),
        ("from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from helper import f\nx = 1\n", "x = 1\n"),
        ("if typing.TYPE_CHECKING:\n    import helper\nx = 1\n", "if typing.TYPE_CHECKING:\n    import other\nx = 1\n"),
        ("if TYPE_CHECKING:\n    import helper\nelse:\n    x = 1\n", "if TYPE_CHECKING:\n    pass\nelse:\n    x = 1\n"),
    ],
)
def test_what_changes_nothing(tmp_path, one, other):
    beside = {"helper": "f = 1\n", "other": "f = 2\n"}
    assert digest(tmp_path, one, **beside) == digest(tmp_path, other, **beside)


def test_a_link_to_a_folder_of_plugins_is_that_folder(tmp_path):
    write(tmp_path / "real", {"plugin.py": "from helper import f\n", "helper.py": BODY})
    (tmp_path / "link").symlink_to(tmp_path / "real", target_is_directory=True)
    assert source_closure(tmp_path / "link/plugin.py") == source_closure(tmp_path / "real/plugin.py")
    assert source_digest(tmp_path / "link/plugin.py") == source_digest(tmp_path / "real/plugin.py")


# -- what changes it ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("from helper import f\n", "from other import f\n"),  # another text under the same name
        ("from helper import f\n", "from helper import g as f\n"),
        ("from helper import f\n", "from helper import f as g\n"),
        ("from helper import f\n", "from helper import *\n"),
        ("import helper as h\n", "import other as h\n"),
        ("import numpy\n", "import scipy\n"),
        ("from numpy import sin\n", "from numpy import cos\n"),
        ("import os\nx = 1\n", "x = 1\n"),
        ("x = 1\n", "x = 1  # a word\n"),
        ('x = """\nimport a\n"""\n', 'x = """\nimport b\n"""\n'),  # text that looks like an import
        ('x = """a\n\nb"""\n', 'x = """a\nb"""\n'),
        ("x = f'''a\n\nb{1}'''\n", "x = f'''a\nb{1}'''\n"),
        (
            "def a():\n    from helper import f\n    return f\ndef b():\n    from other import f\n    return f\n",
            "def a():\n    from other import f\n    return f\ndef b():\n    from helper import f\n    return f\n",
        ),
        (
            "try:\n    from helper import f\nexcept ImportError:\n    from other import f\n",
            "try:\n    from other import f\nexcept ImportError:\n    from helper import f\n",
        ),
        ("import os; x = 1\n", "import os; x = 2\n"),
        ("if not TYPE_CHECKING:\n    import helper\n", "if not TYPE_CHECKING:\n    import other\n"),
        ("from bench import Run\n", "from bench import Case\n"),
        ("def f(:\n    import a\n", "def f(:\n    import b\n"),  # no Python: every byte counts
        (b"# caf\xe9\n", b"# caf\xe8\n"),
        (b"# coding: latin-1\nx = 'caf\xe9'\n", b"# coding: latin-1\nx = 'caf\xe8'\n"),
        (b"x = 1\0\n", b"x = 2\0\n"),
    ],
)
def test_what_changes_the_digest(tmp_path, one, other):
    beside = {"helper": "f = g = 1\n", "other": "f = g = 2\n"}
    assert digest(tmp_path, one, **beside) != digest(tmp_path, other, **beside)


def test_an_edit_of_what_is_imported_at_any_depth_changes_the_digest(tmp_path):
    text = "import os; from helper import f\n"
    helper = "def f():\n    if True:\n        from deep import (\n            x,\n        )\n    return x\n"
    before = digest(tmp_path, text, helper=helper, deep="x = 1\n")
    assert digest(tmp_path, text, helper=helper, deep="x = 1\n") == before
    assert digest(tmp_path, text, helper=helper, deep="x = 2\n") != before


def test_a_file_of_another_encoding_is_read_in_it(tmp_path):
    text = "# coding: latin-1\nx = 'é'; from helper import f\n".encode("latin-1")
    one, other = (digest(tmp_path, text, helper=f"f = {value}\n") for value in (1, 2))
    assert one != other


def test_names_that_a_package_passes_on(tmp_path):
    files = {
        "p/__init__.py": "from .core import f\n",
        "p/core.py": "f = 1\n",
        "p/sub/__init__.py": "",
        "p/sub/plugin.py": "from .. import f\n",
    }
    plugin = write(tmp_path, files) / "p/sub/plugin.py"
    before = source_digest(plugin)
    assert {path.name for path in source_closure(plugin)} == {"plugin.py", "__init__.py", "core.py"}
    (tmp_path / "p/core.py").write_text("f = 22\n")
    edited = source_digest(plugin)
    assert edited != before
    (tmp_path / "p/__init__.py").write_text("from .core import f\nf += 1\n")
    assert source_digest(plugin) not in (before, edited)


# -- what counts of bench ----------------------------------------------------------------------------------------------


@pytest.fixture
def house(tmp_path, monkeypatch):
    """A small bench with its plugin folders beside it, linked as in a checkout."""
    files = {
        "bench/__init__.py": "from .contract.case import Case\n",
        "bench/errors.py": "class UsageError(Exception): ...\n",
        "bench/seeds.py": "seed = 1\n",
        "bench/plugins/registry.py": "def register(): ...\n",
        "bench/contract/case.py": "from ..seeds import seed\nfrom ..errors import UsageError\nclass Case: ...\n",
        "bench/geometry/near.py": "from ..errors import UsageError\n",
        "bench/tasks/look.py": "from ..plugins.registry import register\nfrom ..contract.case import Case\n",
        "methods/__init__.py": "",
        "methods/family/__init__.py": "",
        "methods/family/deep/__init__.py": "",
        "methods/family/deep/part.py": "y = 1\n",
        "methods/family/plugin.py": "from bench import Case, register\nfrom bench.geometry.near import n\n"
        "from .deep.part import y\n",
    }
    write(tmp_path, files)
    for name in ("methods", "datasets", "metrics"):
        (tmp_path / name).mkdir(exist_ok=True)
        (tmp_path / "bench" / name).symlink_to(tmp_path / name, target_is_directory=True)
    monkeypatch.setattr(sources, "BENCH", tmp_path / "bench")
    return tmp_path


@pytest.mark.parametrize(
    ("edited", "counts"),
    [
        ("bench/errors.py", ""),
        ("bench/__init__.py", ""),
        ("bench/plugins/registry.py", ""),
        ("bench/seeds.py", "task"),
        ("bench/contract/case.py", "task"),
        ("bench/tasks/look.py", "task"),
        ("bench/geometry/near.py", "method"),
        ("methods/family/deep/part.py", "method"),
        ("methods/family/plugin.py", "method"),
    ],
)
def test_of_bench_what_makes_a_case_counts(house, edited, counts):
    files = {"task": house / "bench/tasks/look.py", "method": house / "bench/methods/family/plugin.py"}
    before = {kind: source_digest(file) for kind, file in files.items()}
    (house / edited).write_text((house / edited).read_text() + "# edited\n")
    assert [kind for kind, file in files.items() if source_digest(file) != before[kind]] == ([counts] if counts else [])


def test_a_room_of_bench_may_be_moved(house):
    task, method = house / "bench/tasks/look.py", house / "methods/family/plugin.py"
    before = source_digest(task), source_digest(method)
    (house / "bench/engine").mkdir()
    (house / "bench/plugins/registry.py").rename(house / "bench/engine/catalog.py")
    (house / "bench/geometry/io").mkdir()
    (house / "bench/geometry/near.py").rename(house / "bench/geometry/io/far.py")
    (house / "bench/geometry/io/far.py").write_text("from ...errors import UsageError\n")
    (house / "methods/learned").mkdir()
    (house / "methods/family/deep/part.py").rename(house / "methods/learned/part.py")
    task.write_text("from ..engine.catalog import register\nfrom ..contract.case import Case\n")
    method.write_text(
        "from bench import Case, register\nfrom bench.geometry.io.far import n\n\nfrom ..learned.part import y\n"
    )
    assert (source_digest(task), source_digest(method)) == before
    assert house / "methods/learned/part.py" in source_closure(method)


def test_a_name_above_the_package_is_not_ours(house):
    file = house / "methods/family/plugin.py"
    file.write_text("from ......somewhere import x\n")
    assert source_closure(file) == {file}


def test_the_digest_does_not_depend_on_the_version_of_python():
    """All that is taken from the syntax tree are the lines and columns of statements, and of strings."""
    text = Path(sources.__file__).read_text()
    assert "ast.dump" not in text and "ast.unparse" not in text and "tokenize.generate_tokens" not in text


def test_the_module_needs_the_standard_library_alone():
    code = f"import runpy, sys; runpy.run_path({sources.__file__!r}); print('bench' in sys.modules)"
    done = subprocess.run([sys.executable, "-S", "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
