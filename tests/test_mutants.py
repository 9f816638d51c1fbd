"""The script that plants mistakes: which it plants, and which of them it prints."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import mutants
import psutil
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


def never() -> None:
    os.kill(10, 9)
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
16: os.kill(10, 9) -> pass
"""


def test_what_is_planted(tmp_path, monkeypatch):
    monkeypatch.setattr(mutants, "ROOT", tmp_path)
    file = tmp_path / "part.py"
    file.write_text(CODE)
    found = mutants.mutants_of(file)
    lines = [f"{mutant.line}: {mutant.what.replace('  ->  ', ' -> ')}" for mutant in found]
    assert sorted(lines) == sorted(EXPECTED.strip().splitlines())


def test_each_is_behind_its_switch(monkeypatch):
    def outcome(source, on=None):
        monkeypatch.setitem(sys.modules, "bench._planted", SimpleNamespace(at=lambda number: number == on))
        names = {}
        exec(source, names)
        values = [[5, 1], [3, 1], [], [4]]
        return names["LIMIT"], [names["part"](v)[1] for v in values], values, names["part"]([4], True)

    source = mutants.planted(CODE, 10)
    as_it_is = outcome(CODE)
    assert outcome(source) == as_it_is
    assert [on for on in range(8, 27) if outcome(source, on) == as_it_is] == [8, 9, 24, 25, 26]


ROOM = {
    "bench/__init__.py": "",
    "bench/room/__init__.py": "",
    "bench/room/size.py": """import os
LIMIT = 10


def is_small(x):
    return x < LIMIT


def waits(x):
    while x > 0:
        x -= 2
    return x


def in_a_child():
    return 2


def ends(x):
    if x:
        os._exit(0)


def in_no_test():
    return 3
""",
    "tests/room/test_size.py": """import os, subprocess, sys
from bench.room.size import ends, is_small, waits


def test_sizes():
    assert is_small(3) and not is_small(12)


def test_waits():
    assert waits(2) == 0 and waits(1) == -1
    ends(False)


def test_what_a_child_says():
    sleeper = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"], start_new_session=True)
    with open(os.environ["SLEEPERS"], "a") as file:
        print(sleeper.pid, file=file)
    code = f"import sys; sys.path[:0] = {sys.path!r}; from bench.room.size import in_a_child; print(in_a_child())"
    assert subprocess.run([sys.executable, "-c", code], env={}, capture_output=True, text=True).stdout == "2\\n"
    sleeper.kill()
""",
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
    environment = os.environ | {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "SLEEPERS": str(checkout / "sleepers")}
    command = [sys.executable, "-c", code, *words]
    return subprocess.run(command, cwd=checkout, env=environment, capture_output=True, text=True)


def test_survivors_are_printed_and_what_hangs_is_killed(checkout):
    done = planted(checkout, "--sample", "0", "--jobs", "2")
    assert done.returncode == 3, done.stdout + done.stderr
    printed = done.stdout.splitlines()
    assert printed[0].startswith("12 mutants, 12 in the sample; tests pass in ")
    assert set(printed[1:-1]) == {
        "bench/room/size.py:2: 10  ->  11",
        "bench/room/size.py:6: x < LIMIT  ->  (x <= LIMIT)",
        "bench/room/size.py:21: os._exit(0)  ->  pass  (no test reaches it)",
        "bench/room/size.py:21: 0  ->  1  (no test reaches it)",
        "bench/room/size.py:25: 3  ->  4  (no test reaches it)",
    }
    assert printed[-1] == "12 of 12 tried: 7 killed, 5 survived"
    assert (checkout / "bench/room/size.py").read_text() == ROOM["bench/room/size.py"]
    sleepers = (checkout / "sleepers").read_text().split()
    assert len(sleepers) == 4 and not any(
        map(psutil.pid_exists, map(int, sleepers))
    )  # trace, control, 2 -> 3, 10 -> 11


def test_a_sample_is_of_its_seed_and_tests_have_to_pass(checkout):
    listed = [planted(checkout, "--list", "--sample", "3", "--seed", seed).stdout for seed in "112"]
    assert listed[0] == listed[1] != listed[2] and len(listed[0].splitlines()) == 3
    (checkout / "tests/room/test_size.py").write_text("def test_no():\n    assert False\n")
    done = planted(checkout)
    assert done.returncode == 1 and "the tests fail before anything is planted" in done.stderr
