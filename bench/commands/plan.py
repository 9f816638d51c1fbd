"""Say what a run would do: which cells, how many of their cases are finished, how long the rest may take.

  detailbench plan -m method=poisson,rimls dataset=bumps,cad seed=0,1,2 results=DIR

takes the words of `detailbench run` and runs nothing. Times are estimated from finished cells in the same folder.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from ..cli import add_plugin_argument
from ..errors import UsageError
from ..registry import load_plugins

PASSES_ON = True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("-m", "--multirun", action="store_true", help="a sweep: a=1,2 b=3,4 plans all combinations")
    add_plugin_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Compose every job, look each cell up, print the table."""
    from ..config import enumerate_jobs, is_sweep
    from ..destination import destination, settled
    from ..hydra_flags import split_words
    from ..overrides import check_overrides
    from ..store import Results

    plugins = load_plugins(args.plugin)
    overrides, flags = split_words(args.rest)
    if flags:
        raise UsageError(f"{flags[0]}: no option of plan; `detailbench run {' '.join(flags)} ...` shows a config")
    folder = destination(overrides)
    overrides = settled(overrides, folder)
    multirun = args.multirun or is_sweep(overrides)
    check_overrides(overrides, multirun=multirun)
    results = Results(folder)
    pace = seconds_per_case(results)
    lines, totals, refused = [], {"cells": 0, "planned": 0, "finished": 0, "seconds": 0.0, "unknown": 0}, []
    for cell, settings in cells_of(enumerate_jobs(overrides, multirun), refused):
        finished, state = look_up(results, cell, settings)
        to_do = cell.cases - finished
        known = pace.get((cell.task.label, cell.method.name, cell.dataset.label)) or pace.get(
            (cell.task.label, cell.method.name, None)
        )
        totals["cells"] += 1
        totals["planned"] += cell.cases
        totals["finished"] += finished
        totals["seconds"] += to_do * (known or 0)
        totals["unknown"] += to_do if known is None else 0
        guess = f"{to_do * known:.3g} s" if known is not None and to_do else "?" if to_do else ""
        lines.append((cell.id, cell.title, f"{finished}/{cell.cases}", state, guess))
    width = max([len(line[1]) for line in lines], default=0)
    for cell_id, title, count, state, guess in lines:
        print(f"{cell_id}  {title:<{width}}  {count:>7}  {state:<10} {guess}".rstrip())
    for message in refused:
        print(f"not planned: {message}")
    if not lines:
        raise UsageError("nothing to run: no combination of these words is a cell")
    rest = totals["planned"] - totals["finished"]
    about = f", about {totals['seconds']:.3g} s" if totals["unknown"] < rest else ""
    unknown = f" and {totals['unknown']} cases never timed" if totals["unknown"] else ""
    done = f"{totals['planned']} cases, {totals['finished']} finished"
    print(f"{totals['cells']} cells, {done}, {rest} to do{about}{unknown}")
    if plugins:
        print(f"with the plugins of {', '.join(plugins)}")
    return 0


def cells_of(jobs: list[list[str]], refused: list[str]) -> Any:
    """The cell and settings of every job; method and task that do not fit are noted in ``refused``."""
    from omegaconf import OmegaConf

    from ..config import compose
    from ..plan import Cell, NotSolved, check_root, settings_of

    for job in jobs:
        values = OmegaConf.to_container(compose(job), resolve=True)
        check_root(values)
        try:
            yield Cell.from_config(values), settings_of(values)
        except NotSolved as error:
            if str(error) not in refused:
                refused.append(str(error))


def look_up(results: Any, cell: Any, settings: Any) -> tuple[int, str]:
    """How many cases of a cell need not be run again, and in a word how it stands."""
    from ..provenance import fingerprint, ingredients
    from ..runner import finished_rows, lacks_output

    mark = fingerprint(ingredients(cell))
    rows, stored = finished_rows(results, cell, mark, settings)
    count = min(len(rows), cell.cases)
    if stored and count == len(stored.rows):
        failed = sum(row["status"] != "ok" for row in stored.rows)
        return cell.cases, f"{failed} failed" if failed else "finished"
    if stored and settings.rerun != "always" and any(lacks_output(results, row, settings) for row in stored.rows):
        return count, "no outputs"
    if count:
        return count, "begun"
    return 0, "changed" if results.records(cell.id) else "new"


def seconds_per_case(results: Any) -> Mapping[tuple[str, str, str | None], float]:
    """Median seconds of finished cases by task, method and dataset, and by task and method."""
    rows = results.rows()
    if rows.empty:
        return {}
    timed = rows[rows["seconds"].notna()]
    by_dataset = timed.groupby(["task", "method", "dataset"])["seconds"].median()
    by_method = timed.groupby(["task", "method"])["seconds"].median()
    pace: dict[tuple[str, str, str | None], float] = {key: float(v) for key, v in by_dataset.items()}
    return pace | {(task, method, None): float(v) for (task, method), v in by_method.items()}
