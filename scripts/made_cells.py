"""What a folder with very many results costs: a sweep that finds all finished, and the first leaderboard.

  python scripts/made_cells.py CELLS FOLDER

runs one cell, and writes CELLS records beside it that a run would find finished: of ten methods, ten datasets, five
sensors and as many seeds as it takes, with the first one's columns and other scores. Then, each in a process of its
own, with its wall-clock and processor seconds and its largest memory:

  detailbench leaderboard FOLDER      the first, without an index, and the second
  detailbench plan -m ...             the same sweep: all is finished
  detailbench run -m ...              and nothing is run
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pyarrow as pa

from bench.cli import main
from bench.plugins.registry import load_plugins
from bench.results.checks import read_record
from bench.results.store import Record, Results
from bench.sweep.planned import planned_jobs
from bench.sweep.request import Request

AXES = (
    "method=identity,noise,jet,wlop,bilateral,rimls,apss,statistical_outlier,radius_outlier,empty",
    "dataset=bumps,cad,superquadrics,supershapes,fbm,blobs,tpms,knots,reliefs,branches",
    "sensor=samples,clean,noisy,scanned,no_normals",
)
REST = ("task=denoise", "cases=1", "threads=1")


def sweep(cells: int) -> list[str]:
    """The overrides of a sweep of that many cells."""
    return [*REST, *AXES, f"seed=range(0,{cells // 500})"]


def write_all(cells: int, folder: Path) -> None:
    """Write a record of every cell of the sweep."""
    main(["run", *REST, "method=identity", "dataset=bumps", f"results={folder}", "--no-leaderboard"])
    results = Results(folder)
    (path, *_) = sorted(path for path, _ in results._files())
    table, meta = read_record(path)
    rng = np.random.default_rng(0)
    jobs = Request.of([*sweep(cells), f"results={folder}"], multirun=True).jobs
    with ThreadPoolExecutor(4) as pool:
        for _ in pool.map(lambda job: _write(results, table, meta, *job), _numbered(jobs, rng)):
            pass


def _numbered(jobs: list[list[str]], rng: np.random.Generator):
    for one in planned_jobs(jobs):
        yield one, rng.lognormal(0, 0.3)


def _write(results: Results, table: pa.Table, meta: dict, one, factor: float) -> None:
    cell = one.cell
    row = table.to_pylist()[0]
    row |= {key: factor * value for key, value in row.items() if key.startswith("score.") and value is not None}
    row |= {
        "cell": cell.id,
        "fingerprint": one.mark,
        "dataset": cell.dataset.label,
        "sensor": cell.sensor.label,
        "method": cell.method.name,
        "variant": cell.variant,
        "seed": cell.seed,
        "case": f"{cell.dataset.name}-{cell.seed}",
    }
    values = meta | {"cell_id": cell.id, "cell": cell.to_json(), "fingerprint": one.mark}
    results.write(Record(cell.id, one.mark, values, [row]))


def measured(*arguments: str) -> None:
    """Run a command; print what it took."""
    begin = time.perf_counter()
    with open(os.devnull, "w") as nowhere:
        process = subprocess.Popen([sys.executable, "-m", "bench", *arguments], stdout=nowhere)
        _, status, usage = os.wait4(process.pid, 0)
    wall, cpu = time.perf_counter() - begin, usage.ru_utime + usage.ru_stime
    name = " ".join(arguments)[:60]
    print(
        f"{name:<62} exit {status >> 8}  {wall:6.1f} s  {cpu:6.1f} s CPU  {usage.ru_maxrss / 1024:6.0f} MB", flush=True
    )


if __name__ == "__main__":
    count, folder = int(sys.argv[1]), Path(sys.argv[2]).absolute()
    load_plugins([])
    if not folder.exists():
        write_all(count, folder)
    (folder / ".index" / "rows.parquet").unlink(missing_ok=True)
    measured("leaderboard", str(folder))
    measured("leaderboard", str(folder))
    measured("plan", "-m", *sweep(count), f"results={folder}")
    measured("run", "-m", *sweep(count), f"results={folder}", "--no-leaderboard")
