"""Fit a learned method to a file of examples, on a machine that has numpy, torch and safetensors and no more.

  python -m bench.fit EXAMPLES WEIGHTS [--device cuda] [--seconds 900] [--set steps=20000]

EXAMPLES is made by ``detailbench train ... --export-examples FILE``. Run it in a copy of the checkout, or with the
package on PYTHONPATH. A training that was interrupted goes on from the checkpoint in the folder WEIGHTS.work.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path


def main(argv: Sequence[str] | None = None) -> int:
    """Fit, and write the weights; the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m bench.fit", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("examples", type=Path)
    parser.add_argument("weights", type=Path)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--seconds", type=float, default=900.0, help="of training, by the clock, at most")
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--set", action="append", default=[], metavar="PARAMETER=VALUE", help="of the method, as JSON")
    parser.add_argument("--plugin", action="append", default=[], metavar="FILE", help="where the method is in a file")
    parser.add_argument("--half", action="store_true", help="write numbers of 16 bits")
    args = parser.parse_args(argv)

    from .errors import DetailbenchError
    from .text import shown

    try:
        fit(args)
    except DetailbenchError as error:
        print(f"error: {shown(str(error))}", file=sys.stderr)
        return 1
    return 0


def fit(args: argparse.Namespace) -> None:
    """What :func:`main` does, with errors that are messages."""
    from .engine.devices import check_device
    from .engine.fitting import Fit
    from .errors import UsageError
    from .plugins.registry import load_plugins, registry
    from .plugins.schema import build
    from .plugins.weights import as_bytes, as_stored, facts_of, load

    check_device(args.device)
    facts = facts_of(args.examples)
    if "method" not in facts:
        raise UsageError(f"{args.examples}: expected a file that detailbench train --export-examples made")
    load_plugins(args.plugin, warn=False)
    plugin = registry().find("method", facts["method"])
    values = dict(facts["parameters"])
    for word in args.set:
        name, _, text = word.partition("=")
        if name not in values:
            raise UsageError(f"--set {word}: expected one of {', '.join(values)}")
        try:
            values[name] = json.loads(text)
        except ValueError:
            values[name] = text

    import torch

    torch.set_num_threads(args.threads)
    work = args.weights.with_suffix(".work")
    trained = Fit(
        build(plugin, values),
        work,
        {**facts, "parameters": values, "threads": args.threads},
        seconds=args.seconds,
        device=args.device,
        threads=args.threads,
        on_progress=_said(),
    )
    row = trained.run(as_stored(args.examples))
    path = work / "weights.safetensors"
    args.weights.write_bytes(as_bytes(load(path), facts_of(path), half=args.half))
    print(f"{args.weights}: {row['steps']:,} steps in {row['seconds']:.0f} s on {row['device']}")


def _said() -> Callable[[int, int], None]:
    shown = -1

    def say(done: int, total: int) -> None:
        nonlocal shown
        if (part := 100 * done // max(total, 1)) > shown:
            shown = part
            print(f"\r{done:,}/{total:,} steps", end="\n" if done == total else "", file=sys.stderr, flush=True)

    return say


if __name__ == "__main__":
    sys.exit(main())
