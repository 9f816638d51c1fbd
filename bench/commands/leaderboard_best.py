"""`detailbench leaderboard --best`: the best parameters of each method, and a preset of the winner."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import UsageError

if TYPE_CHECKING:
    import pandas as pd

    from ..ranking.best import Best
    from .leaderboard import Output

NAME = re.compile(r"[a-z][a-z0-9_]*")


def show_best(
    rows: pd.DataFrame, output: Output, *, preset: str | None, folders: Sequence[str], by: str | None, **options: Any
) -> None:
    """Print the variants of each method, best first; with ``preset`` write the winner's parameters under a name.

    Raises
    ------
    UsageError
        If there is nothing to compare, or the preset cannot be written.
    """
    from ..ranking.best import best
    from ..ranking.report import in_format
    from ..ranking.report.best_tables import best_tables, frame_of
    from ..ranking.report.cells import csv, plain_texts

    if preset:
        check_preset(preset)
    found = best(plain_texts(rows), by=by or "task", **options)
    if preset:
        path = write_preset(preset, found, rows, folders)
        print(f"written to {path}: method={preset} finds it from this folder", file=sys.stderr)
    if output.format == "csv":
        output.give(csv(frame_of(found)))
    else:
        output.give(in_format(best_tables(found, output.look), output.format, output.look, output.width, output.color))


def check_preset(name: str) -> None:
    """Refuse a name that is invalid or in use.

    Raises
    ------
    UsageError
        With what to do.
    """
    from ..plugins.presets import files
    from ..plugins.registry import registry

    if not NAME.fullmatch(name):
        raise UsageError(f"--preset {name}: expected a name of small letters, digits and _, such as poisson_fine")
    if name in registry().names("method"):
        raise UsageError(f"--preset {name}: is a method itself; choose another name")
    if name in files("method"):
        raise UsageError(f"--preset {name}: {files('method')[name].path} already exists; choose another name")


def write_preset(name: str, found: Sequence[Best], rows: pd.DataFrame, folders: Sequence[str]) -> Path:
    """``conf/method/NAME.yaml`` in the working folder.

    Raises
    ------
    UsageError
        If several methods were compared, if there is no winner, or if it has the defaults.
    """
    import yaml

    from ..results.files import write_atomically

    if len(found) != 1:
        what = ", ".join(f"{one.method} ({' '.join(filter(None, one.group))})" for one in found)
        raise UsageError(
            f"--preset {name}: there are {len(found)} winners: {what}. Choose one with --method and --task"
        )
    (one,) = found
    winner = one.variants[0]
    if not math.isfinite(winner.mean):
        raise UsageError(f"--preset {name}: no setting of {one.method} is best: each failed somewhere at unknown cost")
    values = _changed(one.method, winner.variant, rows, folders)
    if not values:
        raise UsageError(f"--preset {name}: the defaults of {one.method} are best, and need no preset")
    text = (
        f"# The best of {len(one.variants)} settings of {one.method} on {one.shapes} {one.group[3]} shapes, by the "
        f"geometric mean of\n# {one.metric}: {winner.mean:.4g}. Written by `detailbench leaderboard --best`.\n"
        + yaml.safe_dump({"defaults": [one.method, "_self_"]}, default_flow_style=True).strip("{}\n")
        + "\n"
        + yaml.safe_dump(values, sort_keys=False)
    )
    path = Path("conf", "method", f"{name}.yaml")
    write_atomically(path, text.encode("utf-8"))
    return path


def _changed(method: str, variant: str, rows: pd.DataFrame, folders: Sequence[str]) -> dict[str, Any]:
    """The winner's parameters that are not default, exact, from a record of it.

    Raises
    ------
    UsageError
        If no record of it can be read.
    """
    from ..plugins.registry import registry
    from ..plugins.schema import defaults
    from ..results.store import Results

    own = rows[(rows["method"] == method) & (rows["variant"].fillna("") == variant)]
    usual: Mapping[str, Any] = {}
    if method in registry().names("method"):
        usual = defaults(registry().find("method", method))
    for cell, fingerprint in own[["cell", "fingerprint"]].drop_duplicates().itertuples(index=False):
        for folder in folders:
            record = Results(folder.removeprefix("results=")).read(cell, fingerprint)
            if record is not None:
                values = record.meta["cell"]["method"]["parameters"]
                return {key: value for key, value in values.items() if key not in usual or value != usual[key]}
    raise UsageError(f"no record of {method}[{variant}] can be read, so its parameters are not known exactly")
