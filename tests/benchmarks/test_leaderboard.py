"""A leaderboard over 10,000 finished cells: linear in the cells, quick from the index, small.

Each measurement is a process of its own, as ``detailbench leaderboard`` is; the figures are ratios within one run.
"""

import json
import subprocess
import sys

import numpy as np
import pyarrow.parquet as pq
import pytest

from bench.store import Record, Results, _table

METHODS, SEEDS, CASES = 10, 40, 4
METRICS = [f"metric_{i}" for i in range(10)]
MEASURE = """
import resource, sys, time
start = time.perf_counter()
from bench.store import Results
from bench.leaderboard import leaderboard
from bench.report import render
imported = time.perf_counter()
rows = Results(sys.argv[1]).rows()
read = time.perf_counter()
board = leaderboard(rows)
ranked = time.perf_counter()
text = render(board, "terminal", rows=rows)
end = time.perf_counter()
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
print(len(rows), len(board), imported - start, read - imported, ranked - read, end - ranked, peak)
"""


def write_cells(folder, datasets):
    """``datasets`` x 400 finished cells of four cases and ten metrics, one case in fifty failed."""
    rng, results = np.random.default_rng(0), Results(folder)
    directions = json.dumps(dict.fromkeys(METRICS, "lower"))
    number = 0
    for dataset in range(datasets):
        for method in range(METHODS):
            for seed in range(SEEDS):
                cell, fingerprint = f"{number * 2654435761 % 2**32:08x}0000", f"{number:016x}"
                rows = [
                    common(cell, fingerprint, f"d{dataset:02d}", f"m{method}", seed)
                    | case_row(rng, case, method, directions)
                    for case in range(CASES)
                ]
                path = results.path(cell, fingerprint)
                path.parent.mkdir(parents=True, exist_ok=True)
                # Not Results.write: waiting for the disk 10,000 times is not what is measured here.
                meta = {"cell_id": cell, "fingerprint": fingerprint, "planned": CASES}
                pq.write_table(_table(Record(cell, fingerprint, meta, rows)), path, compression="zstd")
                number += 1
    return number


def common(cell, fingerprint, dataset, method, seed):
    return {
        "schema_version": 1,
        "cell": cell,
        "fingerprint": fingerprint,
        "task": "reconstruct",
        "dataset": dataset,
        "sensor": "samples",
        "method": method,
        "variant": "",
        "seed": seed,
        "threads": 1,
        "device": "cpu",
        "host": "host",
        "tags": "sharp,thin",
        "stage": "",
        "finished": "2024-01-01T00:00:00",
    }


def case_row(rng, case, method, directions):
    row = {"case": f"case{case}", "case_index": case, "seconds": rng.random(), "peak_rss_mb": 100 + rng.random()}
    if rng.random() < 0.02:
        return row | {"status": "error", "message": "boom", "directions": ""}
    scores = np.exp(0.3 * rng.normal(size=len(METRICS))) * (1 + 0.1 * method) * (1 + case)
    row |= {f"score.{m}": float(s) for m, s in zip(METRICS, scores, strict=True)}
    return row | {f"floor.{m}": 0.1 for m in METRICS} | {"status": "ok", "message": "", "directions": directions}


def measure(folder):
    done = subprocess.run([sys.executable, "-c", MEASURE, str(folder)], capture_output=True, text=True, check=True)
    rows, lines, *figures = done.stdout.split()
    names = ("import", "read", "rank", "print", "peak")
    return {"rows": int(rows), "lines": int(lines)} | dict(zip(names, map(float, figures), strict=True))


def seconds(figures):
    return figures["read"] + figures["rank"] + figures["print"]


@pytest.mark.slow
def test_ten_thousand_cells(tmp_path):
    few, many = write_cells(tmp_path / "few", 2), write_cells(tmp_path / "many", 25)
    assert (few, many) == (800, 10_000)
    small, first, second = measure(tmp_path / "few"), measure(tmp_path / "many"), measure(tmp_path / "many")
    for name, figures in (("800 cells", small), ("10,000 cells", first), ("again", second)):
        print(name, {key: round(value, 2) for key, value in figures.items()})
    assert first["rows"] == second["rows"] == 40_000
    assert first["lines"] == second["lines"] == 25 * METHODS * len(METRICS)
    assert seconds(first) / seconds(small) <= 12 * many / few / 10
    assert seconds(first) / seconds(second) >= 5
    assert max(first["peak"], second["peak"]) < 500
