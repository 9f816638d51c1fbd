"""`make quick`, the tests of ``quick.txt``: every room and every family of plugins has at least one among them."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
ROOT = TESTS.parent
LINES = (TESTS / "quick.txt").read_text(encoding="utf-8").splitlines()
PLUGINS = ("methods", "datasets", "metrics", "conf")  # links in bench/


def folders(folder: Path) -> list[Path]:
    """The packages in a folder."""
    return sorted(file.parent for file in folder.glob("*/__init__.py"))


ROOMS = [f"tests/{room.name}/" for room in folders(ROOT / "bench") if room.name not in PLUGINS]
FAMILIES = [f"tests/methods/{family.name}/" for family in folders(ROOT / "methods")]
OTHERS = ["tests/datasets/test_", "tests/datasets/sensors/", "tests/metrics/", "tests/faults/"]


def test_there_are_rooms_and_families():
    assert {"tests/ranking/", "tests/engine/", "tests/commands/"} <= set(
        ROOMS
    ) and "tests/methods/classical/" in FAMILIES


@pytest.mark.parametrize("place", [*ROOMS, *FAMILIES, *OTHERS])
def test_each_place_is_touched(place):
    assert any(line.startswith(place) for line in LINES), f"add a quick test of {place} to tests/quick.txt"


@pytest.mark.parametrize("line", LINES)
def test_each_line_is_a_test(line):
    """A wrong file would end `make quick`; a wrong name of a test, too."""
    file, _, name = line.partition("::")
    tests = {
        node.name for node in ast.parse((ROOT / file).read_text("utf-8")).body if isinstance(node, ast.FunctionDef)
    }
    assert name in tests or not name
    assert any(test.startswith("test_") for test in tests)
