"""A leaderboard over 10,000 finished cells: linear in the cells, quick from the index, small.

Each measurement is a process of its own, as ``detailbench leaderboard`` is; the figures are ratios within one run.
"""

import itertools
import json
import os
import subprocess
import sys

import numpy as np
import pyarrow.parquet as pq
import pytest

from bench.results.files import META_KEY
from bench.results.store import Record, Results, _table

METHODS, CASES = 10, 4
METRICS = [f"metric_{i}" for i in range(10)]
MEASURE = """
import re, sys, time
start = time.perf_counter()
from bench.results.store import Results
from bench.ranking.leaderboard import leaderboard
from bench.ranking.report import render
imported = time.perf_counter()
rows = Results(sys.argv[1]).rows()
read = time.perf_counter()
board = leaderboard(rows)
ranked = time.perf_counter()
text = render(board, "terminal", rows=rows)
end = time.perf_counter()
# Not ru_maxrss: a child inherits that of the process that forked it.
peak = int(re.search(r"VmHWM:\\s+(\\d+)", open("/proc/self/status").read())[1]) / 1024
print(len(rows), len(board), imported - start, read - imported, ranked - read, end - ranked, peak)
"""


def write_cells(folder, datasets, seeds):
    """``datasets`` x 10 methods x ``seeds`` finished cells of four cases and ten metrics; one case in fifty failed."""
    rng, results = np.random.default_rng(0), Results(folder)
    directions = json.dumps(dict.fromkeys(METRICS, "lower"))
    cells = [Record(f"{i * 2654435761 % 2**32:08x}0000", f"{i:016x}", {}) for i in range(datasets * METHODS * seeds)]
    places = itertools.product(range(datasets), range(METHODS), range(seeds))
    rows = [
        common(record, f"d{dataset:02d}", f"m{method}", seed) | case_row(rng, case, method, directions)
        for record, (dataset, method, seed) in zip(cells, places, strict=True)
        for case in range(CASES)
    ]
    # All rows in one table, cut into files, and no Results.write: neither making 10,000 records nor waiting for the
    # disk as often is what is measured here.
    table = _table(Record("", "", {}, rows))
    for i, record in enumerate(cells):
        meta = {"cell_id": record.cell, "fingerprint": record.fingerprint, "planned": CASES}
        path = results.path(record.cell, record.fingerprint)
        path.parent.mkdir(parents=True, exist_ok=True)
        part = table.slice(i * CASES, CASES).replace_schema_metadata({META_KEY: json.dumps(meta)})
        pq.write_table(part, path, compression="zstd", write_page_checksum=True)
    return len(cells)


def common(record, dataset, method, seed):
    return {
        "schema_version": 1,
        "cell": record.cell,
        "fingerprint": record.fingerprint,
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
def test_ten_times_as_many_cells(tmp_path):
    # `make test` takes 50 and 500 cells, `make bench` 1,000 and 10,000.
    short = "DETAILBENCH_SHORT" in os.environ
    seeds = 1 if short else 20
    assert write_cells(tmp_path / "few", datasets=5, seeds=seeds) == 50 * seeds
    assert write_cells(tmp_path / "many", datasets=25, seeds=2 * seeds) == 500 * seeds
    small, first, second = measure(tmp_path / "few"), measure(tmp_path / "many"), measure(tmp_path / "many")
    for name, figures in (("few", small), ("ten times as many", first), ("again", second)):
        print(name, {key: round(value, 2) for key, value in figures.items()})
    assert first["rows"] == second["rows"] == 500 * seeds * CASES
    assert first["lines"] == second["lines"] == 25 * METHODS * len(METRICS)
    assert seconds(first) <= 12 * seconds(small)
    assert first["read"] >= 10 * second["read"]
    assert short or seconds(first) >= 5 * seconds(second)  # of few cells the table takes longest
    assert max(first["peak"], second["peak"]) < 500
