"""A leaderboard pivoted for people: one table per task, dataset and sensor, one line per method."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ...plugins.presets import TUNED as TIER_TUNED
from ...plugins.presets import tuned_variants
from ..headline import primary_metrics
from ..naming import is_called, naming
from ..order import metric_order
from ..places import BEST, SECOND, TIED
from ..resolution import EQUAL, FEWEST
from ..selection import matching
from . import standing
from .inputs import words_of_input
from .labels import hosts_note, setup, shown_setup, with_setup
from .look import BELOW, INSIDE, OTHERS, PLUSMINUS, Look
from .look import GIVEN as AS_GIVEN
from .numbers import column_digits, count, parts_with_interval, plain, unit_exponent
from .table import GIVEN, LEARNED, TUNED, Cell, Metric, Table
from .trained import trained

if TYPE_CHECKING:
    import pandas as pd

    from ..conventions import Convention
    from ..published import Published


GROUP = ["task", "dataset", "sensor", "split"]
CONTENDER = ["method", "variant", "threads", "device", "host"]
Line = dict[str, Any]  # one row of a board
FAILED = "†"  # behind a mean into which failed cases enter with the score of the worst pseudo-method
LEFT_OUT = "††"  # behind a mean that leaves failed cases out, since they have no known score
FAILED_NOTE = f"{FAILED} failed cases enter mean and rank with the score of the worst pseudo-method."
LEFT_OUT_NOTE = (
    f"{LEFT_OUT} the mean leaves failed cases out (no pseudo-method was scored on them); for the rank they are worse "
    "than any answer."
)
DIFFERENCE = "|diff|"  # behind a metric of which the difference to the reference's own value is shown
LATER: Line = {  # columns that a board of an earlier version lacks, with the value for "not known"
    "split": "test",
    "threads": 1,
    "device": "cpu",
    "host": "",
    "imputed": 0,
    "front": math.nan,
    "shapes": FEWEST,
    "not_run": 0,
    "undefined": 0,
    "versus_next": "",
    "detectable": math.nan,
    "more_shapes": math.nan,
    "versus_first": "",
    "place": "",
}


def tables(
    board: pd.DataFrame,
    rows: pd.DataFrame | None = None,
    metrics: Sequence[str] = (),
    convention: Convention | None = None,
    published: Published | None = None,
    look: Look | None = None,
) -> list[Table]:
    """The tables of a board, in its order; of a board in a convention, with its digits and its notes.

    A paper's own numbers, ``published``, are shown in a column beside ours; ``look`` is the user's choice of format.
    """
    look = look or Look()
    parameters, states, learned = _parameters(rows), _states(rows), trained(rows)
    said = {"level": 0.95, "equal": EQUAL, "pareto": ()} | board.attrs
    if "front" in board:
        board = board.assign(front=board["front"].astype("float64"))
    lines = [LATER | line for line in board.to_dict("records")]
    made = [
        _table(label, list(part), parameters, learned, metrics, said, convention, states.get(label), published, look)
        for label, part in itertools.groupby(lines, key=lambda line: tuple(line[name] for name in GROUP))
    ]
    return looking(made, look)


def looking(made: Sequence[Table], look: Look) -> list[Table]:
    """The tables with the user's columns, order and caption.

    Raises
    ------
    UsageError
        If no table has one of the columns.
    """
    titled = [replace(table, caption=look.caption) for table in made] if look.caption else list(made)
    if not look.columns or not titled:
        return titled
    known = list(dict.fromkeys([*(c.name for table in titled for c in table.columns), *OTHERS]))
    orders = {name: matching("columns", [name], known) for name in look.columns}
    found = [c for name in look.columns for c in orders[name]]
    return [replace(table, order=tuple(dict.fromkeys(found))) for table in titled]


def _table(
    group: tuple[str, str, str, str],
    lines: list[Line],
    parameters: dict[tuple, str],
    learned: dict[tuple, str],
    wanted: Sequence[str],
    said: dict[str, Any],
    convention: Convention | None,
    state: str | None,
    published: Published | None,
    look: Look,
) -> Table:
    shown = shown_setup(lines)
    lines, naming_notes = _labelled(lines, shown, look)
    names = metric_order(lines, wanted)
    by_metric: dict[str, dict[str, Line]] = {name: {} for name in names or [""]}
    for line in lines:
        if line["metric"] in by_metric:
            by_metric[line["metric"]][line["label"]] = line
    first = by_metric[names[0] if names else ""]
    methods = list(dict.fromkeys([*first, *(line["label"] for line in lines)]))  # methods without the score come last
    # The number of cases that a method solved, regardless of the metric: the maximum over metrics.
    most = {line["label"]: line for line in sorted(lines, key=lambda line: line["solved"])}
    if look.order == AS_GIVEN:
        methods = sorted(methods, key=lambda m: _place_given(most[m], m, look.methods))
    keys = {m: (*group, *(most[m][name] for name in CONTENDER)) for m in methods}
    counts = [parameters.get(keys[m], "-") for m in methods]
    marks = {m: f"{LEARNED if keys[m] in learned else ''}{GIVEN if _is_given(most[m]) else ''}" for m in methods}
    marks |= {m: marks[m] + TUNED for m in methods if tier_of(most[m])}
    digits = convention.digits if convention else {}
    lines_shown = [most[m] for m in methods]
    on_front = {line["label"] for line in lines if line["front"] == 1}
    criteria = (said["pareto"] or primary_metrics(group[0])) if on_front else ()
    alone = bool(on_front) and not said["pareto"] and not wanted  # the task has two primary metrics: no rank
    ranked = standing.is_ranked(list(first.values()))
    columns = _columns(names, by_metric, lines_shown, digits, published, look)
    return Table(
        *group,
        methods=tuple(f"{m} {marks[m]}".rstrip() for m in methods),
        ranks=() if alone else tuple(_rank(first.get(m)) if ranked else "-" for m in methods),
        fronts=tuple("1" if m in on_front else "" for m in methods) if on_front else (),
        metrics=tuple(columns),
        solved=tuple(f"{most[m]['solved']}/{most[m]['planned']}" for m in methods),
        seconds=_seconds([most[m]["seconds_median"] for m in methods], look),
        memory=tuple(_megabytes(most[m]["peak_rss_mb"]) for m in methods),
        parameters=tuple(counts) if any(c != "-" for c in counts) else (),
        notes=(
            *([state] if state else []),
            *(_rank_notes(names[0], first, said, look) if names and not alone else ()),
            *(standing.front(criteria, alone) if on_front else ()),
            *_notes(lines, columns, said["level"], look),
            *naming_notes,
            *(f"{LEARNED} {text}" for text in dict.fromkeys(learned[keys[m]] for m in methods if keys[m] in learned)),
            *hosts_note(lines, shown),
            *(convention.notes(names) if convention else ()),
            *(_published_notes(published, [(m["method"], m["variant"]) for m in lines_shown], group[2])),
        ),
        plugins=tuple(line["method"] for line in lines_shown),
    )


def _columns(
    names: Sequence[str],
    by_metric: dict[str, dict[str, Line]],
    methods: list[Line],
    digits: Mapping[str, int],
    published: Published | None,
    look: Look,
) -> list[Metric]:
    """A column for each metric, with that of a paper beside it."""
    columns: list[Metric] = []
    for name in names:
        columns.append(_metric(name, by_metric[name], methods, digits.get(name), look))
        columns.extend(_published(columns[-1], methods, published, digits.get(name)))
    return columns


def _labelled(lines: list[Line], shown: Sequence[str], look: Look) -> tuple[list[Line], tuple[str, ...]]:
    """The lines with the label of their method, and the notes about the labels."""
    called = naming(((line["method"], line["variant"]) for line in lines), look.names)
    names = [with_setup(called.labels[line["method"], line["variant"]], setup(line, shown)) for line in lines]
    return [line | {"label": name} for line, name in zip(lines, names, strict=True)], called.notes


def _place_given(line: Line, label: str, methods: Sequence[str]) -> int:
    """The position of a method in the user's list; methods not in it come last."""
    fitting = (i for i, m in enumerate(methods) if m == label or is_called(line["method"], line["variant"], m))
    return next(fitting, len(methods))


def _rank_notes(name: str, scored: dict[str, Line], said: dict[str, Any], look: Look) -> list[str]:
    """The meaning of the ranks, and their resolution."""
    lines, methods = list(scored.values()), list(scored)
    shown = not look.columns or "rank" in look.columns
    about = standing.rank_notes(name, said["level"]) if shown and standing.is_ranked(lines) else []
    return [*standing.resolution(name, lines), *standing.equality(lines, methods, said["equal"]), *about]


def _published_notes(published: Published | None, ours: list[tuple[str, str]], sensor: str) -> list[str]:
    """The source of a paper's numbers, and those without a line of ours beside them."""
    if published is None:
        return []
    others = published.others(ours, sensor)
    return [
        f"{published.short}: {published.source}.",
        *([f"{published.short}, not among ours: {'; '.join(others)}."] if others else []),
    ]


def _metric(name: str, scored: dict[str, Line], methods: list[Line], digits: int | None, look: Look) -> Metric:
    """One column; with ``digits`` given its title has the unit already, and no power of ten is taken out."""
    exponent = unit_exponent(line["mean"] for line in scored.values()) if digits is None else 0
    given = look.digits if look.digits is not None else digits
    floors = sorted({plain(line["floor"], exponent, given) for line in scored.values()} - {"-"}, key=float)
    floor = floors[0] if len(floors) == 1 else f"{floors[0]} to {floors[-1]}" if floors else ""
    better = next(iter(scored.values()))["better"]
    if better == "reference":
        better, floor = ("difference", f"ref {floor}" if floor else "") if digits is None else ("reference", floor)
    if given is None:
        shown = ((line["mean"], line["ci_low"], line["ci_high"]) for line in scored.values())
        given = column_digits(shown, exponent)
    cells = [_cell(scored.get(m["label"]), m, exponent, given, look.intervals) for m in methods]
    return Metric(name, better, exponent, tuple(_as_printed(cells)), floor, title=look.names.get(name, ""))


def _published(ours: Metric, methods: list[Line], published: Published | None, digits: int | None) -> list[Metric]:
    """The paper's column beside ours, if it has a number for one of the methods."""
    if published is None:
        return []
    values = [published.value(ours.name, m["method"], m["variant"], m["sensor"]) for m in methods]
    if all(value is None for value in values):
        return []
    cells = tuple(Cell("" if value is None else plain(value, 0, digits)) for value in values)
    return [Metric(f"{ours.name}, {published.short}", ours.better, 0, cells, "")]


def _cell(line: Line | None, most: Line, exponent: int, digits: int, style: str) -> Cell:
    if line is None:
        return Cell("")
    mark = ""
    if 0 < line["solved"] < line["planned"]:
        usual = (line["solved"], line["planned"]) == (most["solved"], most["planned"])
        sign = FAILED if line["solved"] + line["imputed"] == line["planned"] else LEFT_OUT
        mark = sign if usual else f"{sign}{line['solved']}/{line['planned']}"
    text, below = parts_with_interval(line["mean"], line["ci_low"], line["ci_high"], exponent, digits, style)
    place = str(line["place"]).split()
    return Cell(text, BEST in place, mark, second=SECOND in place, tied=TIED in place, below=below)


def _as_printed(cells: Sequence[Cell]) -> list[Cell]:
    """The cells such that the same printed mean is the best everywhere: a reader cannot see further digits."""
    means = {cell.text.partition(" ")[0] for cell in cells if cell.best}
    made = [replace(c, best=c.text.partition(" ")[0] in means and not c.mark) for c in cells]
    alone = sum(cell.best for cell in made) == 1
    return [replace(c, second=c.second and alone and not c.best, tied=c.tied and not c.best) for c in made]


def _notes(lines: list[Line], columns: Sequence[Metric], level: float, look: Look) -> tuple[str, ...]:
    notes = []
    if columns:
        notes.append(numbers_note(level, look))
    if any(c.exponent for c in columns):
        notes.append("A power of ten beside a metric: its numbers are in that unit.")
    marks = {cell.mark.rstrip("0123456789/") for c in columns for cell in c.cells}
    if FAILED in marks:
        notes.append(FAILED_NOTE)
    if LEFT_OUT in marks:
        notes.append(LEFT_OUT_NOTE)
    if any(map(_is_given, lines)):
        notes.append(
            f"{GIVEN} trained on true distances of the reference, which the other methods are not given: no answer to "
            "the same question."
        )
    if any(map(tier_of, lines)):
        notes.append(
            f"{TUNED} tuned: a search on train shapes chose its parameters (detailbench tune). It is no fair rival of "
            "methods that have their defaults."
        )
    if any(column.better == "difference" for column in columns):
        notes.append(f"{DIFFERENCE}: mean absolute difference to the reference's own value, which is in the last line.")
    notes.extend(standing.coverage(lines, [column.name for column in columns]))
    if any(line["shapes"] < 2 and math.isfinite(line["mean"]) and not math.isfinite(line["ci_low"]) for line in lines):
        notes.append("No interval: only one case.")
    return tuple(notes)


def numbers_note(level: float, look: Look) -> str:
    """The meaning of the numbers in a table."""
    means = {
        INSIDE: f"mean [{level:.0%} interval over shapes]",
        BELOW: f"mean, and below it the {level:.0%} interval over shapes",
        PLUSMINUS: f"mean ± half the width of the {level:.0%} interval over shapes, which need not be symmetric",
    }
    costs = {"seconds": "seconds: median", "peak_mb": "peak MB: largest"}
    shown = [text for name, text in costs.items() if not look.columns or name in look.columns]
    parts = [means.get(look.intervals, "mean over shapes"), *shown]
    return f"{'; '.join(parts)}{', of solved cases' if shown else ''}."


def tier_of(line: Line) -> str:
    """How the parameters of a method were chosen: ``tuned`` by a search, by a preset of the user, or empty."""
    return TIER_TUNED if line["variant"] in tuned_variants("method", line["method"]) else ""


def _is_given(line: Line) -> bool:
    """Whether the method requested true distances of the reference."""
    return line.get("true_distances", 0) > 0


def _states(rows: pd.DataFrame | None) -> dict[tuple[str, str, str, str], str]:
    """The measured conditions of the inputs of each table, in words: see the ``describe`` of the tasks."""
    if rows is None:
        return {}
    from ..selection import completed

    columns = [column for column in rows.columns if column.startswith("input.")]
    states = {}
    for group, part in completed(rows).groupby(GROUP) if columns else ():
        medians = {name.removeprefix("input."): float(value) for name, value in part[columns].median().items()}
        states[group] = words_of_input(group[0], {key: value for key, value in medians.items() if math.isfinite(value)})
    return {group: state for group, state in states.items() if state}


def _rank(line: Line | None) -> str:
    if line is None or not line["solved"]:
        return "-"
    low, high = line["rank_low"], line["rank_high"]
    return str(low) if low == high else f"{low}-{high}"


def _seconds(values: Sequence[float], look: Look) -> tuple[str, ...]:
    """The times of a column, with the same number of decimals."""
    digits = look.digits
    if digits is None:
        digits = column_digits((value, math.nan, math.nan) for value in values)
    return tuple(plain(value, 0, digits) for value in values)


def _megabytes(value: float) -> str:
    return "-" if not math.isfinite(value) else f"{value:,.0f}"


def _parameters(rows: pd.DataFrame | None) -> dict[tuple, str]:
    """The numbers of parameters of learned methods: ``1.35M``, or ``1.35M (420k active)``."""
    if rows is None:
        return {}
    from ..leaderboard import costs

    learned = costs(rows)[["parameters", "active_parameters"]].astype(float)
    learned = learned[learned["parameters"] > 0]
    return {
        key: count(total) + (f" ({count(active)} active)" if active > 0 else "")
        for key, total, active in zip(learned.index, *learned.to_numpy().T, strict=True)
    }
