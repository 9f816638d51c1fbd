"""Run cells and print the leaderboard.

  detailbench run task=denoise dataset=bumps sensor=samples method=jet seed=0 results=DIR
  detailbench run -m method=poisson,rimls dataset=bumps,cad seed=0,1,2 results=DIR
  detailbench run -m method=poisson method.depth=7,8,9
  detailbench run experiment=demo
  detailbench run -m experiment=demo,first_table         one after the other
  detailbench run -m ... hydra/launcher=joblib hydra.launcher.n_jobs=2

Everything after the options is a Hydra override. The keys: task, dataset, sensor, method, metric (plugins, with their
parameters behind a dot), seed, cases, split, threads, device, results, outputs=none|first|all,
rerun=never|failed|always, convention (a paper's metrics, printed as its columns), limit.seconds, limit.memory_gb,
limit.setup_seconds, profile=quick|study|paper, experiment, verbose. `--cfg job` shows the values of all, and runs
nothing.

A finished case is never run twice: start the same command again after an interruption, or with more methods, and it
continues. `detailbench plan ...` with the same arguments shows what would run.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..cli import add_plugin_argument, reader_may_leave, warn_of_damaged
from ..engine import forkserver
from ..engine.affinity import available
from ..engine.devices import check_device
from ..errors import UsageError, code_of
from ..plan.cell import not_planned
from ..plugins import config_files
from ..plugins.registry import load_plugins
from ..results.earlier import told
from ..results.store import Results
from ..sweep import launch as sweep
from ..sweep.flags import split_words
from ..sweep.outlook import Outlook, look_ahead
from ..sweep.overrides import check, check_jobs, checked
from ..sweep.planned import Shelf
from ..sweep.progress import Bars, Follow, Lines
from ..sweep.request import Request, is_hydras
from ..text import counted

PASSES_ON = True  # Hydra's own flags are passed on


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("-m", "--multirun", action="store_true", help="a sweep: a=1,2 b=3,4 runs all combinations")
    parser.add_argument("--no-leaderboard", action="store_true", help="do not print the leaderboard at the end")
    add_plugin_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Run, print, and return an exit code: whether every case was solved."""
    plugins = load_plugins(args.plugin)
    overrides, flags = split_words(args.rest)
    if flags:
        return show_config(flags, Request.of(overrides), args.multirun)
    whole = checked(overrides, multirun=args.multirun, sweeps=True)
    requests = whole.parts()
    for request in requests:
        check_jobs(request.jobs)
    results = Results(whole.folder, mends=True)
    check_devices(requests, results)
    results.prepare()
    if word := whole.warning_of_threads(len(available())):
        print(f"warning: {word}", file=sys.stderr)
    codes = []
    for request in requests:
        if len(requests) > 1:
            print(f"experiment={request.experiments[0]}", file=sys.stderr)
        codes.append(_sweep(args, request, results, plugins))
        if codes[-1] > 128:  # interrupted
            return codes[-1]
    return 1 if 1 in codes else max(codes)


def _sweep(args: argparse.Namespace, request: Request, results: Results, plugins: tuple[str, ...]) -> int:
    """One sweep, or one job, from its launch to its report; the exit code."""
    jobs = request.jobs
    if request.launcher == "basic" and not any(map(is_hydras, request.overrides)):  # jobs with no environment
        forkserver.prestart(request.threads)
    ahead = look_ahead(jobs, request, results) if len(jobs) > 1 else None
    warn_of_damaged(results)
    if ahead and ahead.text:
        print(ahead.text, file=sys.stderr)
    session = sweep.Session.new(results.folder)
    private = [f"session='{session.name}'"]
    private += [f"plugins={_hydra_list(plugins)}"] if plugins else []
    private += [f"config_dirs={_hydra_list(named)}"] if (named := config_files.named()) else []
    with session.open():
        interrupted = None
        try:
            code = _launch(session, request, private, ahead)
        except KeyboardInterrupt as error:
            code = interrupted = code_of(error)
        finally:
            from ..engine.runner import forget_servers

            forget_servers()
        done = [*(ahead.ended.values() if ahead else ()), *session.read()]
    cells = list({d["cell"]: d for d in reversed(done) if d["kind"] == "cell"}.values())[::-1]
    # Each job is a cell, except pairs that do not fit, and duplicates.
    others = sum(entry["kind"] == "not_solved" for entry in done)
    others += sum(entry["kind"] == "cell" for entry in done) - len(cells)
    planned = len(jobs) - others
    if interrupted:
        print(
            f"interrupted: {len(cells)} of {len(jobs)} cells are finished and stored in {results.folder}; "
            "the same command continues",
            file=sys.stderr,
        )
        if cells:
            _show_board(args, results, cells, planned, request)
        return interrupted
    return _report(args, results, done, cells, planned, code, request)


def show_config(flags: Mapping[str, str], request: Request, multirun: bool) -> int:
    """Let Hydra print what its flags request; nothing is run or written."""
    if multirun:
        raise UsageError(f"{next(iter(flags))} shows the config of one run: leave out -m, and give each key one value")
    check(request)
    return sweep.show(flags, request)


def _launch(session: sweep.Session, request: Request, private: list[str], ahead: Outlook | None) -> int:
    """Launch what is not finished; the exit code."""
    forecast, ended = (ahead.forecast, ahead.ended) if ahead else (None, {})
    total = len(request.jobs)
    places = [place for place in range(total) if place not in ended]
    with contextlib.ExitStack() as stack:
        shown = stack.enter_context(Bars(total, forecast)) if sys.stderr.isatty() else Lines(total, forecast)
        shown.ended_before(ended)
        if not places:
            return 0
        stack.enter_context(Follow(session, shown, places))
        sweep.PROGRESS = shown
        configs = ahead.configs.at(places) if ahead and ahead.configs else None
        return sweep.launch_all(session, request, [[*request.jobs[place], *private] for place in places], configs)


def _report(
    args: argparse.Namespace,
    results: Results,
    done: list[dict[str, Any]],
    cells: list[dict[str, Any]],
    planned_cells: int,
    code: int,
    request: Request,
) -> int:
    """Notes, the leaderboard of this run (beside a paper's table, or in the conventions named), and the exit code."""
    for line in not_planned(entry["message"] for entry in done if entry["kind"] == "not_solved"):
        print(f"not planned: {line}", file=sys.stderr)
    refused: dict[str, list[str]] = {}
    for entry in done:
        if entry["kind"] == "usage":
            refused.setdefault(entry["message"], []).append(entry["title"])
        elif entry["kind"] == "stopped":
            print(f"error: {entry['message']}", file=sys.stderr)
            code = 1
    for message, titles in refused.items():
        more = f" and {len(titles) - 1} more cells" if len(titles) > 1 else ""
        print(f"error: {titles[0]}{more}: {message}", file=sys.stderr)
        code = code or 1
    if not cells:
        return code or 1
    if line := told(entry["stale"] for entry in cells):
        print(f"run again: {line}", file=sys.stderr)
    _show_board(args, results, cells, planned_cells, request)
    solved, planned = sum(c["solved"] for c in cells), sum(c["planned"] for c in cells)
    cached, for_outputs = sum(c["cached"] for c in cells), sum(c["for_outputs"] for c in cells)
    again = f" ({for_outputs} of them again, for their outputs)" if for_outputs else ""
    print(
        f"{counted(len(cells), 'cell')}, {solved}/{planned} cases solved, {planned - cached} run{again}, "
        f"{cached} cached; results in {results.folder}",
        file=sys.stderr,
    )
    return code or (0 if solved == planned else 3)


def _show_board(
    args: argparse.Namespace, results: Results, cells: list[dict[str, Any]], planned: int, request: Request
) -> None:
    """The leaderboard of the cells that are finished, which says how many of the planned ones are missing."""
    if args.no_leaderboard:
        return
    from ..ranking.published import has_published
    from .leaderboard import show, what_is_missing

    rows = results.rows(of={(c["cell"], c["fingerprint"]) for c in cells})
    warn_of_damaged(results)
    missing = what_is_missing(len(cells), planned)
    tables = [name for name in request.experiments if has_published(name)]
    with reader_may_leave():
        for experiment in tables:
            show(rows, published=experiment, missing=missing)
        chosen: list[str | None] = [] if tables else [*conventions_of(request)] or [None]
        for convention in chosen:
            show(rows, convention=convention, missing=missing)


def conventions_of(request: Request) -> list[str]:
    """The conventions that the overrides, or the experiment that they name, choose."""
    from omegaconf import OmegaConf

    named = [name for name in request.chosen("convention") if name not in ("None", "null", "")]
    if named or request.hydra is None:
        return list(dict.fromkeys(named))
    name = OmegaConf.select(request.hydra, "convention.name")
    return [name] if name else []


def check_devices(requests: list[Request], results: Results) -> None:
    """Refuse a device that is not on this machine before anything is run, unless all its cells are finished.

    Raises
    ------
    UsageError
        If cells would run here. Cells that a launcher runs elsewhere are checked there.
    """
    from .plan import cells_of, look_up

    for request in requests:
        if not request.runs_here:
            continue
        try:
            for device in request.devices:
                check_device(device)
        except UsageError:
            shelf = Shelf(results)
            for cell, settings, mark in cells_of(request.jobs, []):
                if look_up(shelf, cell, settings, mark)[0] < cell.planned:
                    check_device(cell.device)


def _hydra_list(values: tuple[str, ...]) -> str:
    quoted = ",".join("'" + str(Path(v)).replace("\\", "\\\\").replace("'", "\\'") + "'" for v in values)
    return f"[{quoted}]"
