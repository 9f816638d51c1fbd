"""Show what a run would do: which cells, how many of their cases are finished, how long the rest may take.

  detailbench plan -m method=poisson,rimls dataset=bumps,cad seed=0,1,2 results=DIR

takes the overrides of `detailbench run` and runs nothing. Times are estimated from finished cells in the same folder,
or, if no similar cell was timed, from the parameter `seconds` of the method.
"""

from __future__ import annotations

import argparse
from typing import Any

from ..cli import add_plugin_argument, warn_of_damaged
from ..errors import UsageError
from ..plugins.registry import load_plugins
from ..text import counted, duration

PASSES_ON = True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("-m", "--multirun", action="store_true", help="a sweep: a=1,2 b=3,4 plans all combinations")
    add_plugin_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Compose every job, look up each cell, print the table."""
    from ..engine.affinity import available
    from ..engine.devices import check_device
    from ..plan.cell import not_planned
    from ..results.earlier import told
    from ..results.store import Results
    from ..sweep.flags import only_overrides
    from ..sweep.forecast import Pace, seconds_to_do, summary, workers_of
    from ..sweep.overrides import check_jobs, checked
    from ..sweep.planned import Shelf

    plugins = load_plugins(args.plugin)
    overrides = only_overrides(args.rest, "not an option of plan; `detailbench run --cfg job ...` shows a config")
    request = checked(overrides, "plan", multirun=args.multirun, sweeps=True)
    results = Results(request.folder)
    pace = Pace.of(results)
    lines, seconds, stale = [], [], []
    refused: list[str] = []
    planned = finished = unknown = 0
    devices = set()
    trainings: dict[str, str] = {}
    jobs = [job for part in request.parts() for job in part.jobs]
    check_jobs(jobs)
    shelf = Shelf(results)
    for cell, settings, mark in cells_of(jobs, refused):
        there, state, reasons = look_up(shelf, cell, settings, mark)
        rest = seconds_to_do(cell, there, pace)
        guess = "" if there == cell.planned else "?" if rest is None else duration(rest)
        lines.append(
            (cell.id, cell.title, f"{there}/{cell.planned}", state, "; ".join(filter(None, (guess, cell.left_out))))
        )
        seconds.append(rest)
        stale.append(reasons)
        devices |= {cell.device} if there < cell.planned and request.runs_here else set()
        planned, finished = planned + cell.planned, finished + there
        if cell.training and there < cell.planned and (line := line_of_training(results, cell.training)):
            trainings[cell.training.id] = line
        unknown += cell.planned - there if rest is None else 0
    warn_of_damaged(results)
    width = max([len(line[1]) for line in lines], default=0)
    for cell_id, title, count, state, guess in lines:
        print(f"{cell_id}  {title:<{width}}  {count:>7}  {state:<10} {guess}".rstrip())
    for line in not_planned(refused):
        print(f"not planned: {line}")
    if not lines:
        raise UsageError("nothing to run: no combination of these overrides is a cell")
    workers = workers_of(request, request.threads)
    for line in trainings.values():
        print(line)
    print(f"{counted(len(lines), 'cell')}, {summary(planned, finished, seconds, unknown, workers)}")
    if line := told(stale):
        print(line)
    if word := request.warning_of_threads(len(available())):
        print(word)
    if plugins:
        print(f"with the plugins of {', '.join(plugins)}")
    for device in sorted(devices):
        check_device(device)  # `detailbench run` ends with the same message
    return 0


def cells_of(jobs: list[list[str]], refused: list[str]) -> Any:
    """The cell, settings and fingerprint of every job, each cell once.

    Method and task that do not fit are noted in ``refused``.
    """
    from ..sweep.planned import planned_jobs

    seen: set[str] = set()
    reasons = dict.fromkeys(refused)
    for one in planned_jobs(jobs):
        if one.cell is None:
            if one.reason not in reasons:
                reasons[one.reason] = None
                refused.append(one.reason)
        elif one.cell.id not in seen:
            seen.add(one.cell.id)
            yield one.cell, one.settings, one.mark


def line_of_training(results: Any, training: Any) -> str:
    """The training needed before a cell can run, with its time limit; empty if there is none."""
    from ..engine.training import state_of
    from ..plan.training import TRAINED

    if training.weights != TRAINED or (state := state_of(results, training)) == "finished":
        return ""
    return f"first: {training.title}  {state}  at most {duration(training.seconds)} on {training.device}"


def look_up(shelf: Any, cell: Any, settings: Any, mark: str) -> tuple[int, str, tuple[str, ...]]:
    """How many cases of a cell need no new run, its state in one word, and why its records are not current.

    Parameters
    ----------
    shelf : a :class:`bench.sweep.planned.Shelf`
    mark : the cell's fingerprint
    """
    from ..engine.runner import lacks_output

    if not shelf.has_any(cell):  # of thousands of new cells, no folder is looked into
        return 0, "new", ()
    stands = shelf.look_up(cell, settings, mark)
    if stands.complete:
        failed = sum(row["status"] != "ok" for row in stands.rows)
        return cell.planned, f"{failed} failed" if failed else "finished", ()
    count = min(len(stands.rows), cell.planned)
    if settings.rerun != "always" and any(lacks_output(shelf.results, row, settings) for row in stands.stored):
        return count, "no outputs", ()
    if count:
        return count, "begun", stands.stale
    if stands.stored:
        return 0, "failed", ()
    return 0, "changed" if shelf.results.records(cell.id) else "new", stands.stale
