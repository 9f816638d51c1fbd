"""Damaged command lines, by chance and by hand: none ends in a traceback, and the fuzzer sees one that does."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "scripts" / "fuzz_commands.py"
# Each was a traceback once. Words that open or end as they stand are for the shell's sake.
BY_HAND = r"""
plan seed=???
plan ~seed
plan ~limit
plan experiment=nan
plan hydra/launcher=1e400
plan seed=${oc.env:NOTHING}
apply method=poisson task=reconstruct cloud.xyz out.ply method.depth=${nope}
fetch real dataset.path=${oc.env:NOTHING}
leaderboard ~nobody_of_that_name
LONG leaderboard
LONG why 0123
LONG score cloud.xyz
LONG new method x --folder
"""


@pytest.fixture(scope="module")
def fuzzed(tmp_path_factory):
    """Counts and worst lines of 28 damaged lines and of those by hand, in a process of its own: it forks."""
    folder = tmp_path_factory.mktemp("fuzz")
    code = f"""
import json, sys
sys.path.insert(0, {str(SCRIPT.parent)!r})
from fuzz_commands import fuzz, mutated
from pathlib import Path
by_hand = [line.split() for line in {BY_HAND!r}.strip().splitlines()]
by_hand = [[*words[1:], "x" * 5000] if words[0] == "LONG" else words for words in by_hand]
lines = [*mutated(28, 3), *by_hand]
counts, kept = fuzz(lines, Path({str(folder)!r}))
import fuzz_commands
def broken(words): raise ValueError("no message for people")
import bench.cli
bench.cli._main = broken
seen = fuzz_commands.outcome(["plan"], Path({str(folder)!r}) / "work")[0]
bench.cli._main = lambda words: 7
codes = fuzz_commands.outcome(["plan"], Path({str(folder)!r}) / "work")[0]
print(json.dumps([counts, kept, seen, codes]))
"""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, timeout=300)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_every_line_is_refused_in_words_or_does_what_it_says(fuzzed):
    counts, kept, _, _ = fuzzed
    assert kept == {} and set(counts) <= {"exit 0", "exit 1", "exit 3"}
    assert sum(counts.values()) == 28 + len(BY_HAND.strip().splitlines())
    assert counts["exit 1"] > 20


def test_the_fuzzer_sees_a_traceback_and_an_odd_exit_code(fuzzed):
    _, _, seen, code = fuzzed
    assert seen.startswith("traceback: ValueError: no message for people")
    assert code == "exit code 7"
