r"""Tables for LaTeX with ``\usepackage{booktabs}`` in the preamble, as wide as one column of a paper.

A table is folded until it fits: titles into several lines, long names of methods, and, where there are more
columns than fit, into several ``tabular`` below each other. The width is that of a column of ``article`` in two
columns, or with ``wide`` that of its page in one column, which any wider page has too; :mod:`widths` measures.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import zip_longest

from .look import Look
from .table import TIED, Cell, Column, Metric, Table, folded, standing_notes
from .titles import in_words
from .widths import widest, width_of

ARROWS = {
    "lower": r"$\downarrow$",
    "higher": r"$\uparrow$",
    "reference": r"$\rightarrow$ref",
    "difference": r"$|$diff$|$ $\downarrow$",
    "": "",
}
COLUMN, PAGE = 229.0, 344.0  # points: article in two columns, article in one
GAP = 6.0  # between columns: two of \tabcolsep
NARROW = 34.0  # titles need not be narrower
LABELS = 0.36  # of the width at most for the names of the methods, which are folded if possible
CUT = "…"  # in a name that is shortened, which a note gives in full
# The beginnings of notes that readers need, not only authors.
LEGENDS = (
    *("†", "‡", "§", "¶", "|diff|", "mean", "Only", "Methods were run", "All methods", "wins", "ratio"),
    *("one parameter", "geometric", "place", "tau:", "spread"),
)
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
    "¶": r"\P{}",
    "·": r"$\cdot$",
    "±": r"$\pm$",
    "…": r"\dots{}",
    "↓": r"$\downarrow$",
    "↑": r"$\uparrow$",
    "→": r"$\rightarrow$",
    TIED: r"$^\approx$",
    **{c: "\\" + c for c in "#$%&_{}"},
}


def latex(tables: list[Table], look: Look | None = None) -> str:
    """One ``table`` environment per table; needs the package booktabs."""
    look = look or Look()
    texts = [_one(table, look, f"-{i}" if look.label and i else "") for i, table in enumerate(tables)]
    return "% needs \\usepackage{booktabs}\n" + "\n".join(texts)


def escape(text: str) -> str:
    """Escape characters with a meaning in LaTeX; those beyond ASCII are left to ``inputenc``."""
    return "".join(_ESCAPES.get(letter, letter) for letter in text)


def _one(table: Table, look: Look, more: str) -> str:
    room = PAGE if look.wide else COLUMN
    environment = "table*" if look.wide else "table"
    names = _names(table, look)
    below, comments = _notes(table)
    beside = [line for name in (*names, *(escape(n) for n, _ in table.feet)) for line in wrapped(name, LABELS * room)]
    blocks = folded(table, room - widest([table.head, *beside]), _width, lambda column: _texts(table, column))
    return "\n".join(
        [
            rf"\begin{{{environment}}}[htbp]",
            r"\centering\footnotesize\setlength{\tabcolsep}{3pt}",
            rf"\caption{{{_caption(table)}}}",
            rf"\label{{{look.label + more if look.label else _label(table)}}}",
            "\n\n\\smallskip\n".join(_tabular(table, columns, names, room) for columns in blocks),
            *([r"\par\smallskip\parbox{\linewidth}{\raggedright\footnotesize " + below + "}"] if below else []),
            *(f"% {' '.join(escape(note).split())}" for note in comments),
            rf"\end{{{environment}}}",
            "",
        ]
    )


def _caption(table: Table) -> str:
    """The user's own, unchanged, with its commands; or the subject of the table."""
    if table.caption:
        return table.caption
    first, *others = table.title.split(" · ")
    words = ": ".join(filter(None, [first[:1].upper() + first[1:], ", ".join(others)]))
    return f"{escape(words.replace('_', ' '))}."


def _label(table: Table) -> str:
    return "tab:" + re.sub(r"[^a-z0-9]+", "-", table.title.lower()).strip("-")


def _notes(table: Table) -> tuple[str, list[str]]:
    """The notes below the table, in LaTeX, and those in comments, which the author can move into the text."""
    signs = standing_notes([table], r"Bold", r"Underlined")
    below = [note for note in (*table.notes, *signs) if note in signs or note.startswith(LEGENDS) or CUT in note]
    return " ".join(map(escape, below)), [note for note in table.notes if note not in below]


def _names(table: Table, look: Look) -> list[str]:
    """The names of the lines in LaTeX; of methods with their citations."""
    names = list(map(escape, table.methods))
    if look.cite and table.plugins:
        from .citing import cited

        names = [f"{name} {cited(plugin)}".rstrip() for name, plugin in zip(names, table.plugins, strict=True)]
    return names


def _tabular(table: Table, columns: Sequence[Column], names: Sequence[str], room: float) -> str:
    """A block of columns beside the names of the lines."""
    left = LABELS * room
    heads = [_heading(column) for column in columns]
    lines = [rf"\begin{{tabular}}{{@{{}}l{''.join(map(_alignment, columns))}@{{}}}}", r"\toprule"]
    lines += _lines([[escape(table.head)], *heads], bottom=True)
    lines.append(r"\midrule")
    for i, name in enumerate(names):
        lines += _lines([wrapped(name, left), *(_cell(column, i) for column in columns)])
    if table.feet:
        lines.append(r"\midrule")
    for name, cell in table.feet:
        lines += _lines([wrapped(escape(name), left), *(_score(cell(column)) for column in columns)])
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"])


def _lines(cells: Sequence[Sequence[str]], *, bottom: bool = False) -> list[str]:
    """Lines of a tabular for cells that may have several lines each; the last ones beside each other if ``bottom``."""
    if bottom:
        most = max(map(len, cells))
        cells = [[""] * (most - len(cell)) + list(cell) for cell in cells]
    return [" & ".join(line) + r" \\" for line in zip_longest(*cells, fillvalue="")]


def wrapped(text: str, room: float) -> list[str]:
    """A text in as many lines as it needs; a word that is wider than the room has a line of its own."""
    lines: list[str] = []
    for word in re.sub(r"(?<=,)(?=\w)", " ", text).split(" "):
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and width_of(longer) <= room:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines


def _alignment(column: Column) -> str:
    return "r" if isinstance(column, Metric) or column.right else "l"


def _heading(column: Column) -> list[str]:
    """The title in lines that are hardly wider than the cells below it."""
    if not isinstance(column, Metric):
        return column.title.split(" ")
    title = escape(column.title or in_words(column.name))
    arrow = ARROWS[column.better]
    unit = rf"($10^{{{column.exponent}}}$)" if column.exponent else ""
    below = widest(line for cell in column.cells for line in _score(cell))
    lines = wrapped(title, max(below, widest(title.split(" ")), NARROW))
    ends = [end for end in (arrow, unit) if end]
    for end in ends:
        if width_of(f"{lines[-1]} {end}") <= max(below, widest(lines), NARROW):
            lines[-1] = f"{lines[-1]} {end}"
        else:
            lines.append(end)
    return lines


def _cell(column: Column, i: int) -> list[str]:
    return _score(column.cells[i]) if isinstance(column, Metric) else [_dash(escape(column.texts[i]))]


def _score(cell: Cell) -> list[str]:
    """The mean, and the interval if it has a line of its own below."""
    text = _signed(escape(cell.text)) if cell.text != "-" else "--"
    mean, blank, rest = text.partition(" ")
    if text and cell.best:
        mean = rf"\textbf{{{mean}}}"
    elif text and cell.second:
        mean = rf"\underline{{{mean}}}"
    lines = [f"{mean}{escape(cell.signs)}{blank}{rest}"]
    return [*lines, rf"{{\scriptsize {_signed(cell.below)}}}"] if cell.below else lines


def _signed(text: str) -> str:
    """A minus before a number as such, and a dash between the ends of a rank; a hyphen within a name stays."""
    text = re.sub(r"(?<![\w)])-(?=[\d.])", "$-$", text)
    return re.sub(r"(?<=\()(\d+)-(\d+)(?=\))", r"\1--\2", text)


def _texts(table: Table, column: Column) -> list[str]:
    """All texts of a column."""
    cells = [line for i in range(len(table.methods)) for line in _cell(column, i)]
    return [*_heading(column), *cells, *(line for _, cell in table.feet for line in _score(cell(column)))]


def _width(texts: Sequence[str]) -> float:
    """Of a column, with the gap to the one before it."""
    return widest(texts) + GAP


def _dash(text: str) -> str:
    return text.replace("-", "--")
