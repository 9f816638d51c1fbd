"""The result of a search: the default and the tuned setting side by side, and the preset of the latter."""

from __future__ import annotations

import math
import os
import shlex
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from .. import __version__
from ..errors import UsageError
from ..plugins.presets import TIER, TUNED, content_of
from ..results.files import write_atomically
from .scores import Case, Ratio, Scores, ratio
from .study import Search, imported

HEAD = ("", "default", "tuned", "tuned / default [95 %]")


def table(search: Search, held: tuple[Scores, Scores] | None) -> list[str]:
    """The lines of the comparison: on the cases of the search, and on those that it did not see."""
    lines = [HEAD, _line("trial cases", search.default.scores, search.best.scores)]
    if held is not None:
        lines.append(_line("held-out cases", *held))
    widths = [max(len(line[column]) for line in lines) for column in range(len(HEAD))]
    return ["  ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)).rstrip() for line in lines]


def _line(name: str, default: Scores, tuned: Scores) -> tuple[str, str, str, str]:
    cases = _shared(default, tuned)
    return (
        f"{len(cases)} {name}{_failed(default, tuned)}",
        f"{default.mean(cases):.4g}",
        f"{tuned.mean(cases):.4g}",
        ratio(tuned, default, cases).text,
    )


def _shared(one: Scores, other: Scores) -> list[Case]:
    return sorted({*one.solved, *one.failed} & {*other.solved, *other.failed})


def _failed(default: Scores, tuned: Scores) -> str:
    counts = len(default.failed), len(tuned.failed)
    return f" (failed: {counts[0]}, {counts[1]})" if any(counts) else ""


def verdict(held: Ratio | None) -> str:
    """One sentence: the result on the cases that the search did not see."""
    if held is None or not held.shapes:
        return "No held-out case: the trial cases alone flatter the tuned setting, which was chosen on them."
    if not math.isfinite(held.low):
        return f"{held.shapes} held-out shapes are too few to say more; add cases or datasets."
    if held.high < 1:
        return "On held-out cases the tuned setting is better."
    if held.low > 1:
        return "On held-out cases the tuned setting is worse than the default: the search overfitted its trial cases."
    return "On held-out cases no difference is significant: use the default, or search on more cases."


def parameters(search: Search) -> list[str]:
    """A line for each searched parameter: default, tuned, and searched values; with a note at an edge."""
    lines = []
    for axis in search.axes:
        value = search.best.changed.get(axis.name, axis.default)
        edge = axis.edge(value)
        note = f"; at the {edge} end: the best may lie beyond" if edge else ""
        lines.append(f"{axis.name}: {axis.default} -> {value}  (searched: {axis.text}{note})")
    return lines


def check_target(name: str, method: str, taken: Sequence[str]) -> Path:
    """The file of a preset, which may exist only if an earlier search wrote it.

    Raises
    ------
    UsageError
        For a name that cannot be one, that a plugin has, or a file of the user's own.
    """
    path = Path("conf") / "method" / f"{name}.yaml"
    if not name.replace("-", "_").isidentifier():
        raise UsageError(f"--preset {name}: expected letters, digits, - and _, as in {method}_tuned")
    if name in taken:
        raise UsageError(f"--preset {name}: a method has this name; choose another one, for instance {method}_tuned")
    if path.exists():
        content = content_of(str(path), path.read_text(encoding="utf-8"))
        if content.get(TIER) != TUNED:
            raise UsageError(f"--preset {name}: {path} already exists, and no search wrote it; choose another name")
    return path


def write_preset(
    path: Path, search: Search, held: Ratio | None, command: Sequence[str], facts: Mapping[str, Any]
) -> None:
    """Write the tuned setting as a preset of the method.

    Parameters
    ----------
    path : file
    search : the finished search
    held : tuned over default on held-out cases
    command : the arguments of the command
    facts : further facts, by name: a comment each
    """
    import yaml

    method = search.bench.configs[0]["method"]["_name_"]
    fixed = facts.get("fixed", {})
    said = f", {held.text} times the default's on held-out train shapes" if held and held.shapes else ""
    help = f"{method} tuned for {search.bench.task} by {search.metric}{said}."
    comments = [
        f"Made by: detailbench tune {shlex.join(command)}",
        f"{len(search.done)} trials, seed {search.seed}, {datetime.now(UTC):%Y-%m-%d}; detailbench {__version__}, "
        f"optuna {imported().__version__}.",
        *(f"{name}: {text}" for name, text in facts.items() if name != "fixed"),
    ]
    values = {**fixed, **search.best.changed}
    # Comments that are not at the beginning of a line are not shown by `detailbench list`.
    text = "\n".join([f"# {help}", *(f"  # {' '.join(line.split())}" for line in comments)])
    body = yaml.safe_dump({"defaults": [method], TIER: TUNED, **values}, sort_keys=False, allow_unicode=True)
    write_atomically(Path(os.path.abspath(path)), f"{text}\n{body}".encode())
