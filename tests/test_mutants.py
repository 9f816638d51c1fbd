"""The script that plants mistakes: which it plants, and which of them it prints."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import mutants
import pytest

CODE = '''"""Words: 1 + 1."""
from __future__ import annotations
LIMIT: int = 3


def part(values: list[int] = [], more: bool = False) -> list[int]:
    """No 1 < 2 here."""
    found = sum(values) / 2 if values else 0
    if found < LIMIT and not more:
        values.sort()
        found = found - 1
    return "a" + "b", found
'''
EXPECTED = """
3: 3 -> 4
6: False -> True
8: sum(values) / 2 if values else 0 -> (0 if values else sum(values) / 2)
8: sum(values) / 2 -> (sum(values) * 2)
8: 2 -> 3
8: 0 -> 1
9: found < LIMIT and not more -> (not (found < LIMIT and (not more)))
9: found < LIMIT and not more -> (found < LIMIT or not more)
9: found < LIMIT -> (found <= LIMIT)
9: not more -> (more)
10: values.sort() -> pass
11: found = found - 1 -> pass
11: found - 1 -> (found + 1)
11: 1 -> 2
"""


def test_what_is_planted(tmp_path, monkeypatch):
    monkeypatch.setattr(mutants, "ROOT", tmp_path)
    file = tmp_path / "part.py"
    file.write_text(CODE)
    found = mutants.mutants_of(file)
    lines = {f"{mutant.line}: {mutant.what.replace('  ->  ', ' -> ')}" for mutant in found}
    assert lines == set(EXPECTED.strip().splitlines())
    for mutant in found:
        content = file.read_bytes()
        compile(content[: mutant.start] + mutant.new.encode() + content[mutant.end :], "mutant", "exec")


ROOM = {
    "bench/__init__.py": "",
    "bench/room/__init__.py": "",
    "bench/room/size.py": (
        "def is_small(x):\n    return x < 10\n\n\ndef waits(x):\n    while x > 0:\n        x -= 2\n    return x\n"
    ),
    "tests/room/test_size.py": (
        "from bench.room.size import is_small, waits\n\n\ndef test_sizes():\n"
        "    assert is_small(3) and not is_small(12)\n\n\ndef test_waits():\n"
        "    assert waits(2) == 0 and waits(1) == -1\n"
    ),
}


@pytest.fixture
def checkout(tmp_path):
    for name, text in ROOM.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    (tmp_path / "scripts").mkdir()
    shutil.copy(mutants.__file__, tmp_path / "scripts")
    return tmp_path


def planted(checkout: Path, *words: str) -> subprocess.CompletedProcess[str]:
    code = (
        "import sys; sys.path.insert(0, 'scripts'); import mutants\n"
        "mutants.COPIED, mutants.WARM, mutants.GRACE = ('bench', 'tests', 'scripts'), ('pytest',), 2.0\n"
        "sys.exit(mutants.main(['room', *sys.argv[1:]]))"
    )
    # The plugins of libraries, which pytest would load for each mutant, take longer than the tests.
    environment = os.environ | {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    command = [sys.executable, "-c", code, *words]
    return subprocess.run(command, cwd=checkout, env=environment, capture_output=True, text=True)


def test_survivors_are_printed_and_what_hangs_is_killed(checkout):
    done = planted(checkout, "--sample", "0")
    assert done.returncode == 3, done.stdout + done.stderr
    printed = done.stdout.splitlines()
    assert printed[0].startswith("7 mutants, 7 in the sample; tests pass in ")
    assert set(printed[1:-1]) == {
        "bench/room/size.py:2: x < 10  ->  (x <= 10)",
        "bench/room/size.py:2: 10  ->  11",
    }
    assert printed[-1] == "7 of 7 tried: 5 killed, 2 survived"
    assert (checkout / "bench/room/size.py").read_text() == ROOM["bench/room/size.py"]


def test_a_sample_is_of_its_seed_and_tests_have_to_pass(checkout):
    listed = [planted(checkout, "--list", "--sample", "3", "--seed", seed).stdout for seed in "112"]
    assert listed[0] == listed[1] != listed[2] and len(listed[0].splitlines()) == 3
    (checkout / "tests/room/test_size.py").write_text("def test_no():\n    assert False\n")
    done = planted(checkout)
    assert done.returncode == 1 and "the tests fail before anything is planted" in done.stderr
