"""Search for good parameters of a method, on train shapes alone, and write them as a preset.

  detailbench tune method=poisson --budget 30m
  detailbench tune method=poisson 'method.depth=range(6,10)' 'method.point_weight=log(0.3,10)' --trials 40
  detailbench tune method=apss task=denoise dataset=bumps,cad,knots sensor=noisy,scanned cases=4 --trials 25
  detailbench run -m method=apss,apss_tuned task=denoise dataset=bumps,cad sensor=noisy      measures the gain

Searched are the parameters that get range(5,9), interval(0.1,10), log(0.1,10) or a list of values; without any, those
with declared ranges or choices (`detailbench list method NAME`) and the grid of the experiment tune_METHOD. All other
overrides are those of `detailbench run`: each dataset, sensor and seed is a cell, and each trial runs all of them.
Settings are compared by the score of the task, or --score, as a geometric mean over cases; a failed case has the score
of the worst pseudo-method.

The first trial is the default, so the best is never worse than it on the trial cases. A trial that is significantly
worse than the best one after some of its cells (0.5 %, over shapes) is stopped. At the end the default and the best are
run on further train shapes (--held-out), which the search did not see: only these give a fair score of the setting. The
test split is refused.

Trials are ordinary cells in the results folder: nothing is computed twice, and after Ctrl-C the same command continues.
With --trials N and --seed the same trials come each time; with --budget how many there are depends on the machine.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ..cli import add_plugin_argument, warn_of_damaged
from ..errors import UsageError
from ..plugins.registry import load_plugins, registry
from ..text import counted, duration

if TYPE_CHECKING:
    from ..plan.cell import Cell, Settings
    from ..tuning.scores import Ratio
    from ..tuning.space import Axis
    from ..tuning.study import Search, Trial

PASSES_ON = True
USUAL_DATASETS = "bumps,cad,knots,tpms"  # round, sharp, thin and of high genus
USUAL_BUDGET = "30m"
UNITS = {"s": 1, "m": 60, "h": 3600, "d": 86400, "": 1}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument(
        "--budget", metavar="TIME", help="wall clock: 90s, 30m, 2h (default: 30m, or none with --trials)"
    )
    parser.add_argument("--trials", type=int, metavar="N", help="largest number of settings, the default one included")
    parser.add_argument(
        "--seed", type=int, default=0, metavar="N", help="seed of the search; the seed of the cells is seed=N"
    )
    parser.add_argument("--score", metavar="KEY", help="the score to optimise (default: the one that ranks the task)")
    parser.add_argument(
        "--held-out", type=int, metavar="N", help="further train shapes of each dataset at the end (default: cases)"
    )
    parser.add_argument("--preset", metavar="NAME", help="write conf/method/NAME.yaml (default: METHOD_tuned)")
    add_plugin_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Search, compare, write the preset."""
    from ..engine.runner import forget_servers
    from ..results.store import Results
    from ..tuning.space import declared_axes, named_axes, split_words
    from ..tuning.study import Bench, Search, imported
    from ..tuning.verdict import check_target

    imported()
    seconds = _checked(args)
    plugins = load_plugins(args.plugin)
    words, named = split_words(args.rest)
    words = _completed(words)
    configs, settings, folder = _configs(words, plugins)
    method = registry().find("method", configs[0]["method"]["_name_"])
    fixed = _fixed(words, configs[0]["method"])
    axes = named_axes(method, named, fixed) if named else declared_axes(method, fixed)
    path = check_target(args.preset or f"{method.name}_tuned", method.name, registry().names("method"))
    results = Results(folder, mends=True)
    results.prepare()
    held_out = configs[0]["cases"] if args.held_out is None else args.held_out
    _introduce(configs, axes, held_out)
    with _Shown(f"tune {method.name}") as shown:
        bench = Bench(configs, settings, shown.run_cell)
        search = Search(bench, axes, args.seed, args.trials, seconds, args.score, shown.trial)
        try:
            search.run(held_out)
            shown.begin("held-out cases")
            held = search.judged(held_out) if held_out and search.best is not search.default else None
        except KeyboardInterrupt:
            best = f"; the best so far: {search.best.text}" if search.done else ""
            print(f"interrupted: {counted(len(search.done), 'trial')} done{best}. The same command continues",
                  file=sys.stderr)  # fmt: skip
            raise
        finally:
            forget_servers()
    warn_of_damaged(results)
    return _report(search, held, path, args, fixed)


def _checked(args: argparse.Namespace) -> float | None:
    """The seconds of the budget; None for a search that ends with its trials."""
    if args.trials is not None and args.trials < 1:
        raise UsageError(f"--trials {args.trials}: expected 1 or more")
    if args.held_out is not None and args.held_out < 0:
        raise UsageError(f"--held-out {args.held_out}: expected 0 or more")
    if not 0 <= args.seed < 2**32:
        raise UsageError(f"--seed {args.seed}: expected a whole number of at least 0")
    if args.budget is None and args.trials is not None:
        return None
    return seconds_of(args.budget or USUAL_BUDGET)


def seconds_of(text: str) -> float:
    """``90s``, ``30m``, ``1.5h``, ``2d`` or plain seconds as seconds.

    Raises
    ------
    UsageError
        For anything else.
    """
    found = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([smhd]?)", text.strip())
    if not found or not float(found[1]):
        raise UsageError(f"--budget {text}: expected a time, for instance 90s, 30m or 2h")
    return float(found[1]) * UNITS[found[2]]


def _completed(words: Sequence[str]) -> list[str]:
    """The overrides with the method's task, the usual datasets and the train split where they are not given."""
    from ..plugins.presets import resolve
    from ..sweep.request import Request

    keys = {word.partition("=")[0].lstrip("+") for word in words}
    if "method" not in keys and "experiment" not in keys:
        raise UsageError("choose a method: detailbench tune method=NAME (detailbench list methods)")
    more = []
    if "experiment" not in keys:
        names = Request.of(words).chosen("method")
        if len(names) == 1 and "task" not in keys and resolve("method", names[0]) in registry().names("method"):
            plugin = registry().find("method", resolve("method", names[0]))
            solved = [task for task in registry().names("task") if plugin.solves(task)]
            more += [f"task={solved[0]}"] if len(solved) == 1 else []
        more += [] if "dataset" in keys else [f"dataset={USUAL_DATASETS}"]
    split = [word for word in words if word.partition("=")[0].lstrip("+") == "split"]
    if any(word.partition("=")[2] != "train" for word in split):
        raise UsageError(
            f"{split[-1]}: a search uses train shapes only; `detailbench run` scores its preset on test shapes"
        )
    return [*words, *more, *([] if split else ["split=train"])]


def _configs(words: list[str], plugins: tuple[str, ...]) -> tuple[list[dict[str, Any]], Settings, str]:
    """The composed values of every cell of a trial, how cells are run, and the folder of results."""
    from ..plan.cell import Cell, NotSolved, check_root, not_planned, settings_of
    from ..sweep.composition import resolved
    from ..sweep.overrides import check_jobs, checked

    request = checked(words, "tune", multirun=True)
    jobs = [job for part in request.parts() for job in part.jobs]
    check_jobs(jobs)
    configs, reasons = [], []
    for job in jobs:
        values = resolved(job)
        check_root(values)
        if values["split"] != "train":
            raise UsageError(f"split={values['split']}: a search uses train shapes only; leave it out")
        try:
            Cell.from_config(values)
            configs.append(values)
        except NotSolved as error:
            reasons.append(str(error))
    for line in not_planned(reasons):
        print(f"not planned: {line}", file=sys.stderr)
    if not configs:
        raise UsageError("nothing to run: no combination of these overrides is a cell")
    for key in ("task", "method"):
        if any(values[key] != configs[0][key] for values in configs):
            raise UsageError(f"{key}: a search takes one {key}; give one, with one value for each parameter")
    return configs, replace(settings_of(configs[0]), plugins=plugins), request.folder


def _fixed(words: Sequence[str], node: Mapping[str, Any]) -> dict[str, Any]:
    """The parameters of the method fixed by the overrides or its preset: those that are not the plugin's defaults."""
    from ..plugins.schema import defaults

    usual = defaults(registry().find("method", node["_name_"]))
    given = {word.partition("=")[0].lstrip("+") for word in words}
    return {k: node[k] for k in usual if k in node and (node[k] != usual[k] or f"method.{k}" in given)}


def _introduce(configs: Sequence[Mapping[str, Any]], axes: Sequence[Axis], held_out: int) -> None:
    for axis in axes:
        print(f"searched: {axis.name} in {axis.text}; default {axis.default}", file=sys.stderr)
    cases = sum(values["cases"] for values in configs)
    print(
        f"each trial: {counted(len(configs), 'cell')}, {counted(cases, 'case')} of the train split; at the end "
        f"{held_out} further shapes of each dataset",
        file=sys.stderr,
    )


class _Shown:
    """Progress: a line per trial, and a bar on a terminal."""

    def __init__(self, title: str):
        from ..sweep.progress import Steps

        self._title, self._steps = title, Steps(title)
        self._trial, self._best = 0, ""

    def __enter__(self) -> _Shown:
        self._steps.__enter__()
        return self

    def __exit__(self, *exception: object) -> None:
        self._steps.__exit__(*exception)

    def begin(self, what: str) -> None:
        """Show what is running now."""
        self._steps.begin(f"{self._title}: {what}{self._best}")

    def run_cell(self, cell: Cell, settings: Settings) -> list[dict[str, Any]]:
        """Run one cell, or take what is stored."""
        from ..engine.runner import run_cell

        self.begin(f"trial {self._trial}: {cell.title}")
        outcome = run_cell(cell, settings, self)
        for note in outcome.notes:
            self._steps.show(f"warning: {note}")
        return outcome.record.rows

    def cell_begins(self, cell: Cell, planned: int, done: int) -> None:
        """Do nothing."""

    def event(self, event: Mapping[str, Any]) -> None:
        """Move the bar."""
        self._steps.event(event)

    def trial(self, trial: Trial, best: Trial, left: float | None) -> None:
        """A line on a trial that ended."""
        self._trial = trial.number + 1
        self._best = f"; best {best.scores.mean():.4g}"
        failed = f", {len(trial.scores.failed)} failed" if trial.scores.failed else ""
        stopped = f", stopped after {counted(len(trial.scores.losses()), 'case')}" if trial.stopped else ""
        star = " *" if trial is best else ""
        rest = f"; about {duration(left)} left" if left else ""
        self._steps.show(
            f"[{trial.number}] {trial.scores.mean():.4g}{star}  {trial.text}  "
            f"({duration(trial.seconds)}{failed}{stopped}; best {best.scores.mean():.4g}{rest})"
        )


def _report(search: Search, held: Any, path: Any, args: argparse.Namespace, fixed: Mapping[str, Any]) -> int:
    """The comparison and the preset; 3 if the best setting still fails on a trial case."""
    from ..tuning.scores import ratio
    from ..tuning.verdict import parameters, table, verdict, write_preset

    ended = " (there are no others)" if search.exhausted else ""
    print(f"{counted(len(search.done), 'trial')}{ended}, by {search.metric} ({search.default.scores.better} is better)")
    if search.best is search.default:
        print("The defaults are the best of them: no preset is written.")
        return 3 if search.default.scores.failed else 0
    for line in (*parameters(search), "", *table(search, held), ""):
        print(line)
    one: Ratio | None = ratio(held[1], held[0], held[1].index) if held else None
    print("The trial cases chose the setting, so their ratio flatters it.")
    print(verdict(one))
    names = {key: sorted({values[key]["_name_"] for values in search.bench.configs}) for key in ("dataset", "sensor")}
    facts = {
        "fixed": fixed,
        "Budget": " ".join(filter(None, (args.budget, f"--trials {args.trials}" if args.trials else "")))
        or USUAL_BUDGET,
        "On": f"{', '.join(names['dataset'])}; {', '.join(names['sensor'])}",
        "Searched": "; ".join(parameters(search)),
    }
    options = {"--budget": args.budget, "--trials": args.trials, "--seed": args.seed, "--score": args.score}
    options |= {"--held-out": args.held_out, "--preset": args.preset}
    given = [part for key, value in options.items() if value is not None for part in (key, str(value))]
    write_preset(path, search, one, [*args.rest, *given], facts)
    print(f"wrote {path}: method={path.stem} uses it")
    return 3 if search.best.scores.failed else 0
