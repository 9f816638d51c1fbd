"""Train a learned method, and save its weights.

  detailbench train method=mpu training=quick results=DIR
  detailbench train method=mpu dataset=files dataset.path=FOLDER dataset.train_share=1 --save mine.safetensors
  detailbench apply method=mpu training.weights=mine.safetensors scan.ply dense.ply task.ratio=16

A run trains what its cells need, once, with the same overrides; this command trains in advance and prints more. The
keys of the group: training.weights, training.dataset and training.sensor (default: those of the cell; always shapes of
the train split), training.cases, training.seed, training.seconds, training.threads, training.device. Further keys:
those of `detailbench run` for one cell, such as task, method.PARAMETER, limit.train_memory_gb, results, rerun=always.

An interrupted training continues from its last checkpoint when the same command is given again.

On a machine that has a GPU, and torch and numpy alone:
  detailbench train method=mpu training=quick --export-examples mpu.safetensors       here: makes the examples
  python -m bench.fit mpu.safetensors weights.safetensors --device cuda               there, in a copy of the checkout
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..cli import add_plugin_argument, warn_of_damaged
from ..errors import DetailbenchError, UsageError
from ..plugins.registry import load_plugins
from ..text import duration

if TYPE_CHECKING:
    from ..plan.training import Training

PASSES_ON = True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("--save", metavar="FILE", help="also write the weights to FILE (safetensors)")
    parser.add_argument("--half", action="store_true", help="with --save: write 16-bit numbers, as in shipped files")
    parser.add_argument("--export-examples", metavar="FILE", help="only make the examples, and write them to FILE")
    parser.add_argument("--examples", metavar="FILE", help="train on the examples of FILE instead of making some")
    add_plugin_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Compose, train in a child process, report what was made."""
    from ..engine.training import Extra, TrainingFailed, forget, state_of, weights_for
    from ..results.store import Results

    plugins = load_plugins(args.plugin)
    overrides = list(args.rest)
    if args.half and not args.save:
        raise UsageError("--half: is for --save FILE")
    for target in (args.save, args.export_examples):
        if target and not Path(os.path.expanduser(target)).absolute().parent.is_dir():
            raise UsageError(f"{target}: no such folder: {Path(os.path.expanduser(target)).absolute().parent}")
    if args.examples and not Path(os.path.expanduser(args.examples)).is_file():
        raise UsageError(f"--examples {args.examples}: no such file")
    training, settings, folder = job_of(overrides, plugins)
    results = Results(folder, mends=True)
    results.prepare()
    if settings.rerun == "always" and not args.export_examples:  # which trains nothing in its place
        forget(results, training)
    state = state_of(results, training)
    print(f"{training.title}: {state}", file=sys.stderr)
    extra = Extra(str(Path(os.path.expanduser(args.examples))) if args.examples else "", bool(args.export_examples))
    try:
        with Shown(training) as shown:
            weights = weights_for(training, settings, results, shown.event, extra=extra)
    except TrainingFailed as failed:
        if args.plugin and failed.row.get("traceback"):
            print(failed.row["traceback"], file=sys.stderr)
        raise DetailbenchError(str(failed)) from failed
    except KeyboardInterrupt:
        print("interrupted: the same command continues from the last checkpoint", file=sys.stderr)
        return 130
    finally:
        warn_of_damaged(results)
    if args.export_examples:
        shutil.copyfile(weights.path, Path(os.path.expanduser(args.export_examples)))
        size = weights.path.stat().st_size / 1e6
        print(f"{args.export_examples}: {weights.facts.get('cases', '?')} cases, {size:.1f} MB")
        return 0
    report(weights.facts, weights.path)
    if args.save:
        save(weights.path, Path(os.path.expanduser(args.save)), args.half)
    return 0


def job_of(overrides: list[str], plugins: tuple[str, ...]) -> tuple[Training, Any, str]:
    """The training that the overrides describe, the settings, and the folder of results; it is ``trained`` here."""
    from dataclasses import replace

    from ..plan.cell import Cell, check_root, settings_of
    from ..plan.training import AUTO, TRAINED
    from ..plugins.presets import resolve
    from ..plugins.registry import registry
    from ..sweep.overrides import checked

    request = checked([word for word in overrides if not word.startswith("task.")], "train")
    if not any(word.startswith("method=") for word in overrides):
        raise UsageError("choose a method: detailbench train method=NAME (detailbench list methods)")
    if not any(word.startswith("task=") for word in overrides):
        method = registry().find("method", resolve("method", request.chosen("method")[0]))
        solves = [task for task in registry().names("task") if method.solves(task)]
        if len(solves) != 1:
            raise UsageError(f"method {method.name} solves {', '.join(solves) or 'no task'}: add task=NAME")
        overrides = [*overrides, f"task={solves[0]}"]
    request = checked(overrides, "train")
    values = request.values
    check_root(values)
    weights = values["training"]["weights"]
    if weights not in (AUTO, TRAINED):
        raise UsageError(f"training.weights={weights}: this command trains new weights; leave the key out")
    values["training"]["weights"] = TRAINED
    values["split"] = "train"  # a test split is not required
    cell = Cell.from_config(values)
    if cell.training is None:
        raise UsageError(f"method {cell.method.name} is not a learned method: there is nothing to train")
    return cell.training, replace(settings_of(values), plugins=plugins), request.folder


class Shown:
    """A bar on a terminal; elsewhere an occasional line."""

    EVERY = 10  # lines of progress, at most

    def __init__(self, training: Training):
        from ..sweep.progress import Steps

        self._steps, self._said = Steps(training.title), -1
        self._stage = ""

    def __enter__(self) -> Shown:
        self._steps.__enter__()
        return self

    def __exit__(self, *exception: object) -> None:
        self._steps.__exit__(*exception)

    def event(self, event: Mapping[str, Any]) -> None:
        """Show one event of the training."""
        self._steps.event(event)
        if event["event"] == "begin":
            self._stage, self._said = {"examples": "examples", "method": "steps"}.get(event["stage"], ""), -1
        elif event["event"] == "waits":
            print(f"{event['title']}: another process trains it; waiting", file=sys.stderr)
        elif event["event"] == "progress" and not sys.stderr.isatty():
            tenth = self.EVERY * event["done"] // max(event["total"], 1)
            if tenth > self._said:
                self._said = tenth
                print(f"  {self._stage} {event['done']:,}/{event['total']:,}", file=sys.stderr)


def report(facts: Mapping[str, Any], path: Path) -> None:
    """What was made, in a few lines, with the curve of the validation."""
    print(f"weights {path}")
    print(
        f"{facts['method']}: {facts['steps']:,} steps in {duration(facts['seconds'])} "
        f"({facts['cpu_seconds']:.0f} CPU s, {facts['device']}) on {facts['cases']} train shapes of "
        f"{facts['dataset']}, seed {facts['seed']}"
    )
    curve = facts.get("curve") or []
    if curve:
        first, best, last = curve[0], min(curve, key=lambda point: point[2]), curve[-1]
        print(
            f"validation: {first[2]:.4g} at step {first[1]:,}, best {best[2]:.4g} at step {best[1]:,}, "
            f"{last[2]:.4g} at the end"
        )


def save(path: Path, target: Path, half: bool) -> None:
    """Copy weights to a file of the user, as float16 on request."""
    from ..plugins.weights import as_bytes, facts_of, load
    from ..results.files import write_atomically

    content = as_bytes(load(path), facts_of(path), half=True) if half else path.read_bytes()
    write_atomically(target, content)
    print(f"saved {target} ({len(content) / 1e6:.2f} MB)")
