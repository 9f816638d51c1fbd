r"""Tables for LaTeX with ``\usepackage{booktabs}`` in the preamble, a few metrics to a ``tabular``."""

from __future__ import annotations

from .tables import Metric, Table, any_best

ARROWS = {
    "lower": r"$\downarrow$",
    "higher": r"$\uparrow$",
    "reference": r"$\rightarrow$ref",
    "difference": r"$|$diff$|$ $\downarrow$",
}
FIRST, OTHERS = 2, 3  # metrics in a tabular: the first one has the costs beside them
_ESCAPES = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    "†": r"$^\dagger$",
    "‡": r"$^\ddagger$",
    "§": r"\S{}",
    "·": r"$\cdot$",
    **{c: "\\" + c for c in "#$%&_{}"},
}


def latex(tables: list[Table]) -> str:
    """One ``table`` environment per table; needs the package booktabs."""
    return "% needs \\usepackage{booktabs}\n" + "\n".join(map(_one, tables))


def escape(text: str) -> str:
    """Letters that LaTeX would take for commands; others beyond ASCII are left to ``inputenc``."""
    return "".join(_ESCAPES.get(letter, letter) for letter in text)


def _one(table: Table) -> str:
    rest = table.metrics[FIRST:]
    split = [table.metrics[:FIRST], *(rest[i : i + OTHERS] for i in range(0, len(rest), OTHERS))]
    tabulars = [_tabular(table, metrics, i == 0) for i, metrics in enumerate(split)]
    notes = " ".join(escape(note) for note in (*table.notes, *(["Bold: tied for first."] if any_best([table]) else [])))
    return "\n".join(
        [
            r"\begin{table}[htbp]",
            r"\centering\footnotesize",
            rf"\caption{{{escape(table.title)}. {notes}}}",
            "\n\n\\smallskip\n".join(tabulars),
            r"\end{table}",
            "",
        ]
    )


def _tabular(table: Table, metrics: tuple[Metric, ...], main: bool) -> str:
    places, costs = (table.places, table.costs) if main else ([], [])
    head = ["method", *(title for title, _ in places), *map(_heading, metrics), *(title for title, _ in costs)]
    columns = f"l{'l' * len(places)}{'l' * len(metrics)}{'r' * len(costs)}"
    lines = [rf"\begin{{tabular}}{{{columns}}}", r"\toprule", _line(head)]
    lines.append(r"\midrule")
    for i, method in enumerate(table.methods):
        rank = [_dash(cells[i]) for _, cells in places]
        scores = [_score(metric, i) for metric in metrics]
        lines.append(_line([escape(method), *rank, *scores, *(escape(cells[i]) for _, cells in costs)]))
    if any(metric.floor for metric in metrics):
        lines.append(r"\midrule")
        floors = [metric.floor for metric in metrics]
        lines.append(_line(["floor / reference", *("" for _ in places), *floors, *("" for _ in costs)]))
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"])


def _heading(metric: Metric) -> str:
    unit = rf" ($10^{{{metric.exponent}}}$)" if metric.exponent else ""
    return f"{escape(metric.name)} {ARROWS[metric.better]}{unit}"


def _score(metric: Metric, i: int) -> str:
    cell = metric.cells[i]
    text = cell.text.replace("-", "$-$") if cell.text != "-" else "--"
    return (rf"\textbf{{{text}}}" if cell.best and text else text) + escape(cell.mark)


def _dash(text: str) -> str:
    return text.replace("-", "--")


def _line(cells) -> str:
    return " & ".join(cells) + r" \\"
