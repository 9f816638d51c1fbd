"""Does the memory of the front door stay flat over a sweep of very many cells?

  python scripts/many_cells.py CELLS FOLDER

runs ``detailbench run -m`` with as many seeds. The first cell is run; of the others each is taken for that one, and
given its config, since Hydra takes a tenth of a second to compose one. All else that a job passes through
is the real thing: the overrides of all jobs, Hydra's sweeper and launcher with what they return, the files that jobs
leave, the lines of progress, the report. Prints the resident memory of the process in MB after each tenth of the cells.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import psutil
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from omegaconf import OmegaConf

from bench.cli import main
from bench.commands import run as command
from bench.sweep import launch

ROOT = Path(__file__).resolve().parents[1]
WORDS = ("task=denoise", "method=nothing", "dataset=superquadrics", "cases=1", "metric=p2f_mean", "threads=1")


def few_compositions() -> None:
    """Let jobs have the first one's config, with their own overrides."""
    compose, made = ConfigLoaderImpl.load_sweep_config, []

    def composed(self: Any, master_config: Any, sweep_overrides: list[str]) -> Any:
        if not made:
            made.append(compose(self, master_config, sweep_overrides))
        for node in (made[0], made[0].hydra):
            OmegaConf.set_readonly(node, False)
        OmegaConf.update(made[0], "hydra.overrides.task", sweep_overrides)
        return made[0]

    ConfigLoaderImpl.load_sweep_config = composed
    command.look_ahead = lambda *_: None  # a forecast composes every job once more


def count_cells(cells: int) -> None:
    """Run the first cell; the others leave what it left, under names of their own."""
    run_cell, left = launch._run, []

    def run(values: Any, *rest: Any) -> dict[str, Any]:
        if not left:
            left.append(run_cell(values, *rest))
            count_cells.done = 0
        count_cells.done += 1
        done = count_cells.done
        if done * 10 % cells < 10:
            print(f"{done:>8,} cells {psutil.Process().memory_info().rss / 2**20:8.1f} MB", flush=True)
        return left[0] | ({"cell": f"{done:012x}"} if done > 1 else {})

    launch._run = run


if __name__ == "__main__":
    count, folder = int(sys.argv[1]), sys.argv[2]
    few_compositions()
    count_cells(count)
    plugin = str(ROOT / "tests" / "benchmarks" / "nothing.py")
    code = main(["run", "-m", "--plugin", plugin, *WORDS, f"seed=range(0,{count})", f"results={folder}"])
    print(f"{'at the end':>14} {psutil.Process().memory_info().rss / 2**20:8.1f} MB")
    sys.exit(code)
