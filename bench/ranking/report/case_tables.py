"""Tables with a line for each case and a column for each method."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..naming import is_called, naming
from ..places import BEST, SECOND, TIED
from .labels import setup, shown_setup, with_setup
from .look import GIVEN, Look
from .numbers import column_digits, plain, unit_exponent
from .table import Cell, Metric, Table
from .tables import CONTENDER, FAILED, FAILED_NOTE, GROUP, LEFT_OUT, LEFT_OUT_NOTE
from .terminal import ARROWS

if TYPE_CHECKING:
    import pandas as pd

FOOT = ("mean", "wins")


def case_tables(scores: pd.DataFrame, board: pd.DataFrame, look: Look | None = None) -> list[Table]:
    """The tables of :func:`bench.ranking.by_case.by_case`: one per group and metric."""
    look = look or Look()
    tables = []
    for group, lines in scores.groupby([*GROUP, "metric"], sort=False):
        means = board[(board[[*GROUP, "metric"]] == list(group)).all(axis=1)]
        tables.append(_table(group, lines, means.to_dict("records"), look))
    return tables


def _table(group: tuple, scores: pd.DataFrame, means: list[Mapping[str, Any]], look: Look) -> Table:
    shown = shown_setup(means)
    called = naming(((line["method"], line["variant"]) for line in means), look.names)
    by_case = {(line["case"], *(line[name] for name in CONTENDER)): line for line in scores.to_dict("records")}
    cases = list(dict.fromkeys(scores["case"]))
    exponent = unit_exponent(scores["value"])
    digits = look.digits
    if digits is None:
        digits = column_digits(((value, float("nan"), float("nan")) for value in scores["value"]), exponent)
    ordered = _ordered(means, look)
    found = [[by_case.get((case, *(line[name] for name in CONTENDER))) for case in cases] for line in ordered]
    wins = [sum(one["best"] for one in column if one) for column in found]
    columns = []
    for line, column, won in zip(ordered, found, wins, strict=True):
        place = str(line["place"]).split()
        mean = Cell(plain(line["mean"], exponent, digits), BEST in place, second=SECOND in place, tied=TIED in place)
        name = with_setup(called.labels[line["method"], line["variant"]], setup(line, shown))
        cells = tuple(_cell(one, exponent, digits) for one in column)
        columns.append(Metric(name, "", 0, cells, feet=(mean, Cell(str(won), won == max(wins) > 0)), title=name))
    better = means[0]["better"]
    arrow = ARROWS["difference" if better == "reference" else better]
    unit = f" (1e{exponent})" if exponent else ""
    metric = look.names.get(group[-1], group[-1])
    task, dataset, sensor, split = group[:-1]
    return Table(
        task,
        dataset,
        sensor,
        split,
        methods=tuple(_short(cases)),
        metrics=tuple(columns),
        notes=_notes(scores, called.notes),
        head="case",
        foot=FOOT,
        subject=f"{metric} {arrow}{unit}",
        caption=look.caption,
    )


def _short(cases: list[str]) -> list[str]:
    """The ids without the dataset before them, if all are from one."""
    datasets = {case.rpartition("/")[0] for case in cases}
    return [case.rpartition("/")[2] for case in cases] if len(datasets) == 1 else cases


def _ordered(means: list[Mapping[str, Any]], look: Look) -> list[Mapping[str, Any]]:
    if look.order != GIVEN:
        return means

    def place(line: Mapping[str, Any]) -> int:
        fitting = (i for i, name in enumerate(look.methods) if is_called(line["method"], line["variant"], name))
        return next(fitting, len(look.methods))

    return sorted(means, key=place)


def _cell(line: Mapping[str, Any] | None, exponent: int, digits: int) -> Cell:
    if line is None:
        return Cell("")
    failed = line["planned"] - line["solved"]
    mark = "" if not failed else FAILED if line["imputed"] == failed else LEFT_OUT
    return Cell(plain(line["value"], exponent, digits), bool(line["best"]), mark)


def _notes(scores: pd.DataFrame, others: tuple[str, ...]) -> tuple[str, ...]:
    failed = scores["planned"] - scores["solved"]
    several = scores["planned"].max() > 1
    return (
        *(["mean of a case over its seeds and sensors."] if several else []),
        "wins: on how many cases a method is the best; a tie counts for each.",
        *([FAILED_NOTE] if (failed.gt(0) & (scores["imputed"] == failed)).any() else []),
        *([LEFT_OUT_NOTE] if (failed.gt(0) & (scores["imputed"] != failed)).any() else []),
        *others,
    )
