"""What the engine adds to a cell whose method does nothing, and whether it grows with the sweep."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bench.results.store import Results

# `make test` is short, `make bench` is not. Within a few cells a machine may change its speed.
CELLS, LIMIT = (28, 2.0) if "DETAILBENCH_SHORT" in os.environ else (200, 1.5)
PART = CELLS // 4
PLUGIN = Path(__file__).with_name("nothing.py")


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """When each of the cells of one multirun was finished, in order, in seconds."""
    folder = tmp_path_factory.mktemp("engine")
    command = [
        *(sys.executable, "-m", "bench", "run", "-m", "--no-leaderboard", "--plugin", str(PLUGIN)),
        *("task=denoise", "dataset=tiny_balls", "sensor=tiny_samples", "method=nothing", "metric=[tiny_score]"),
        *("cases=1", f"seed=range(0,{CELLS})", f"results={folder}"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder, check=False)
    assert done.returncode == 0, done.stderr
    times = pd.to_datetime(Results(folder).rows(use_index=False)["finished"]).sort_values()
    assert len(times) == CELLS
    return (times - times.iloc[0]).dt.total_seconds().to_numpy()


def per_cell(finished, first, last):
    """Median seconds from one cell to the next, between two of them; a hiccup of the machine is no trend."""
    return float(np.median(np.diff(finished[first - 1 : last])))


def test_overhead_per_cell(finished, benchmark):
    seconds = per_cell(finished, 1, CELLS)
    benchmark.pedantic(lambda: None, rounds=1)
    benchmark.extra_info["seconds per cell"] = seconds
    print(f"\n{CELLS} cells that do nothing: {seconds:.3f} s per cell, Hydra's composition included (aim: 0.5)")


def test_overhead_does_not_grow_with_the_sweep(finished, benchmark):
    early, late = per_cell(finished, 1, PART), per_cell(finished, CELLS - PART + 1, CELLS)
    benchmark.pedantic(lambda: None, rounds=1)
    benchmark.extra_info["late to early"] = late / early
    ratio = late / early
    seconds = f"first {PART} cells: {early:.3f} s each, last {PART}: {late:.3f} s each"
    print(f"\n{seconds}, ratio {ratio:.2f} (limit {LIMIT})")
    assert ratio < LIMIT
