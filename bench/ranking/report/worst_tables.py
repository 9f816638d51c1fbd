"""The tables of the worst cases: the cases themselves, and the tags that they share."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ...text import counted, cut, one_line
from ..worst import FEWEST, SHARE, Tag, Worst
from .numbers import column_digits, plain, unit_exponent
from .table import Cell, Metric, Table
from .terminal import ARROWS

MOST_TAGS = 8
MOST_MESSAGE = 300  # characters


def worst_tables(found: Worst, count: int) -> list[Table]:
    """The worst ``count`` cases, and the tags that are more frequent among the bad shapes."""
    return [_cases(found, count), *([_tags(found)] if found.tags else [])]


def _cases(found: Worst, count: int) -> Table:
    shown = found.cases.head(count)
    values = [*shown["value"], *shown["best_value"]]
    exponent = unit_exponent(values)
    digits = column_digits(((value, math.nan, math.nan) for value in values), exponent)
    arrow = ARROWS["difference" if found.better == "reference" else found.better]
    unit = f" (1e{exponent})" if exponent else ""

    def texts(name: str) -> list[str]:
        return ["" if value is None or value != value else one_line(str(value)) for value in shown[name]]

    columns = {"dataset": texts("dataset"), "sensor": texts("sensor")}
    if found.cases["seed"].nunique() > 1:
        columns["seed"] = texts("seed")
    columns[found.method] = [plain(value, exponent, digits) for value in shown["value"]]
    columns["best other"] = [plain(value, exponent, digits) for value in shown["best_value"]]
    columns["which"] = texts("best_method")
    columns["ratio"] = [f"{ratio:.2f}" if math.isfinite(ratio) else "-" for ratio in shown["ratio"]]
    columns["tags"] = [tags.replace(",", ", ") for tags in texts("tags")]
    columns["status"] = texts("status")
    columns = {name: cells for name, cells in columns.items() if any(cells)}
    more = len(found.cases) - len(shown)
    by = "ratio to the best other method on the same case" if found.order == "ratio" else "score"
    notes = [
        f"The worst first, by the {by}; ratio: how many times worse than the best other.",
        *([f"{counted(more, 'more case')}: --count {len(found.cases)} shows all."] if more else []),
        *_tag_note(found),
    ]
    subject = f"{found.method} by {found.metric} {arrow}{unit}"
    return _table(found, "case", texts("case"), columns, notes, subject)


def _tag_note(found: Worst) -> list[str]:
    shapes = len(found.cases.drop_duplicates(["dataset", "case"]))
    if shapes < FEWEST:
        return [f"Only {counted(shapes, 'shape')}: a test of tags takes {FEWEST}."]
    return [] if found.tags else ["No tag is among the worst shapes, or all shapes have the same."]


def _tags(found: Worst) -> Table:
    shown = found.tags[:MOST_TAGS]
    first = shown[0]
    columns = {
        "among the worst": [f"{tag.bad}/{tag.of_bad}" for tag in shown],
        "among all": [f"{tag.shapes}/{tag.of_shapes}" for tag in shown],
        "p": [_p(tag.p) for tag in shown],
        "p, corrected": [_p(tag.p_holm) for tag in shown],
    }
    notes = [
        _finding(found.tags),
        f"the worst: {first.of_bad} of {first.of_shapes} shapes, one in {SHARE}. p: the chance of so many or more if "
        "tags did not matter (hypergeometric, as Fisher's exact test); corrected for the number of tags by Holm.",
    ]
    return _table(found, "tag", [one_line(tag.name) for tag in shown], columns, notes, f"{found.method}: tags")


def _finding(tags: Sequence[Tag]) -> str:
    significant = [tag.name for tag in tags if tag.p_holm <= 0.05]
    if significant:
        return f"Over-represented among the worst shapes: {', '.join(map(one_line, significant))}."
    return "No tag is significantly over-represented among the worst shapes; these shapes may be too few to tell."


def _p(value: float) -> str:
    return f"{value:.3f}" if value >= 0.001 else f"{value:.1g}"


def _column(name: str, cells: Sequence[str]) -> Metric:
    return Metric(one_line(name), "", 0, tuple(map(Cell, cells)), title=one_line(name))


def _table(
    found: Worst, head: str, names: Sequence[str], columns: dict[str, list[str]], notes: Sequence[str], subject: str
) -> Table:
    return Table(
        one_line(found.task),
        "",
        "",
        found.split,
        methods=tuple(names),
        metrics=tuple(_column(name, cells) for name, cells in columns.items()),
        notes=tuple(notes),
        head=head,
        subject=one_line(subject),
    )


def case_notes(found: Worst, count: int, commands: Sequence[str], outputs: Sequence[str]) -> list[str]:
    """For each case its failure, the command that runs its cell again, and the path of the output."""
    lines = []
    shown = found.cases.head(count).to_dict("records")
    for line, command, output in zip(shown, commands, outputs, strict=True):
        where = " ".join(filter(None, (line["dataset"], line["sensor"])))
        lines.append(one_line(f"{line['case']} ({where}, seed {line['seed']}): {command}"))
        if output:
            lines.append(one_line(f"  output: {output}"))
        if isinstance(line["message"], str) and line["message"]:
            lines.append(one_line(f"  {line['status']}: {cut(' '.join(line['message'].split()), MOST_MESSAGE)}"))
    return lines
