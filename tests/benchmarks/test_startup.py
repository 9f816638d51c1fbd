"""Starting: help and listings are quick, against the start of Hydra alone, interleaved in one run."""

import os
import statistics
import subprocess
import sys
import time

import pytest

ROUNDS = 4 if "DETAILBENCH_SHORT" in os.environ else 7
COMMANDS = {
    "import hydra": ["-c", "import hydra"],
    "detailbench --help": ["-m", "bench", "--help"],
    "detailbench list": ["-m", "bench", "list"],
}


def wall(arguments):
    begin = time.perf_counter()
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
    return time.perf_counter() - begin


@pytest.fixture(scope="module")
def seconds():
    for arguments in COMMANDS.values():
        wall(arguments)  # files come into the cache
    rounds = [{name: wall(arguments) for name, arguments in COMMANDS.items()} for _ in range(ROUNDS)]
    return {name: [r[name] for r in rounds] for name in COMMANDS}


@pytest.mark.parametrize("command", ["detailbench --help", "detailbench list"])
def test_starts_within_twice_the_import_of_hydra(seconds, command, benchmark):
    benchmark.pedantic(wall, args=(COMMANDS[command],), rounds=1)
    ratios = [ours / hydra for ours, hydra in zip(seconds[command], seconds["import hydra"], strict=True)]
    ratio = statistics.median(ratios)
    benchmark.extra_info["ratio to import hydra"] = ratio
    print(f"\n{command}: {ratio:.2f} x import hydra (limit 2)")
    assert ratio <= 2
