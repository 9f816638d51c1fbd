"""A table to print, in any format: lines of methods (or of cases), columns of scores and of costs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

# Behind a method: it was given the truth, it was trained beforehand, a search chose its parameters.
GIVEN, LEARNED, TUNED = "‡", "§", "¶"
TIED = "≈"  # behind a mean that is not significantly worse than the best
FLOOR = "floor / reference"
TITLES = {"rank": "rank", "front": "front", "solved": "solved", "seconds": "seconds", "peak_mb": "peak MB"}


@dataclass(frozen=True)
class Cell:
    """A mean with its interval, or the mark that there is none."""

    text: str
    best: bool = False  # the best mean of its column (or line)
    mark: str = ""  # what to read in the notes
    second: bool = False  # the second best mean
    tied: bool = False  # not significantly worse than the best
    below: str = ""  # the interval, if it has a line of its own below

    @property
    def signs(self) -> str:
        """The signs behind the text."""
        return (TIED if self.tied else "") + self.mark


@dataclass(frozen=True)
class Metric:
    """One column of scores."""

    name: str
    better: str  # lower, higher, reference (the score, to be near it) or difference (to the reference's own value)
    exponent: int  # the cells are multiplied by 10 to this power
    cells: tuple[Cell, ...]
    floor: str = ""  # the floor, or the reference's own value
    feet: tuple[Cell, ...] = ()  # of each last line of the table, see Table.foot; without it the floor
    title: str = ""  # its name, if set by the user or a table of methods

    @property
    def is_score(self) -> bool:
        """Whether the column is one of scores."""
        return True


@dataclass(frozen=True)
class Plain:
    """One column that is not of scores: a rank, a cost."""

    name: str
    title: str
    texts: tuple[str, ...]
    right: bool = True

    @property
    def is_score(self) -> bool:
        """Whether the column is one of scores."""
        return False


Column = Metric | Plain


@dataclass(frozen=True)
class Table:
    """One table; every tuple has one entry per method, best method first, or none if there is no such column."""

    task: str
    dataset: str
    sensor: str
    split: str
    methods: tuple[str, ...]
    metrics: tuple[Metric, ...]
    ranks: tuple[str, ...] = ()  # by the first metric; empty if the task has no single rank
    fronts: tuple[str, ...] = ()  # "1" on the Pareto front; empty if none was requested
    solved: tuple[str, ...] = ()
    seconds: tuple[str, ...] = ()
    memory: tuple[str, ...] = ()
    parameters: tuple[str, ...] = ()  # empty when no method has any
    notes: tuple[str, ...] = ()
    head: str = "method"  # above the names of the lines
    order: tuple[str, ...] = ()  # the names of the columns to print, in their order; empty for all
    foot: tuple[str, ...] = ()  # the names of the last lines; without it there is one, of the floors
    subject: str = ""  # the subject of the table, after its title: the metric of a table of cases
    plugins: tuple[str, ...] = ()  # the plugin of each line, where lines are methods
    caption: str = ""  # in place of the title

    @property
    def title(self) -> str:
        """``reconstruct · bumps · samples``; see :func:`title_of`."""
        return self.caption or title_of(self.task, self.dataset, self.sensor, self.split, self.subject)

    @property
    def places(self) -> list[Plain]:
        """The columns that rank the methods."""
        found = (("rank", self.ranks), ("front", self.fronts))
        return [Plain(name, name, cells, right=False) for name, cells in found if cells]

    @property
    def costs(self) -> list[Plain]:
        """The columns that are not scores."""
        found = [("solved", "solved", self.solved), ("seconds", "seconds", self.seconds)]
        found += [("peak_mb", "peak MB", self.memory), ("params", "params", self.parameters)]
        return [Plain(*one) for one in found if one[2]]

    @property
    def columns(self) -> list[Column]:
        """All columns to print, in their order."""
        every: list[Column] = [*self.places, *self.metrics, *self.costs]
        if not self.order:
            return every
        return [column for name in self.order for column in every if column.name == name]

    @property
    def feet(self) -> list[tuple[str, Callable[[Column], Cell]]]:
        """The last lines: the name of each, and its cell in a column."""
        if self.foot:
            return [(name, _foot(i)) for i, name in enumerate(self.foot)]
        shown = any(isinstance(column, Metric) and column.floor for column in self.columns)
        return [(FLOOR, lambda column: Cell(getattr(column, "floor", "")))] if shown else []

    @property
    def best_notes(self) -> tuple[bool, bool, bool]:
        """Whether any cell is marked as the best, as tied with it, as the second best."""
        cells = [c for column in self.columns if isinstance(column, Metric) for c in (*column.cells, *column.feet)]
        return any(c.best for c in cells), any(c.tied for c in cells), any(c.second for c in cells)


def _foot(i: int) -> Callable[[Column], Cell]:
    def cell(column: Column) -> Cell:
        feet = column.feet if isinstance(column, Metric) else ()
        return feet[i] if feet else Cell("")

    return cell


def title_of(task: str, dataset: str, sensor: str, split: str, subject: str = "") -> str:
    """``reconstruct · bumps · samples``; two parts without a sensor, one more for train shapes."""
    return " · ".join(filter(None, (task, dataset, sensor, "" if split == "test" else f"split {split}", subject)))


def folded(
    table: Table, room: float, width: Callable[[Sequence[str]], float], text: Callable[[Column], list[str]]
) -> list[list[Column]]:
    """The columns, as many to a block as fit beside the names of the lines; one that is too wide stands alone.

    Parameters
    ----------
    table : Table
    room : float
        Of a block beside the names of the lines, in the unit of ``width``.
    width : callable
        Of a column with these cells, with the gap to the next one.
    text : callable
        The cells of a column as they are printed, its heading first.
    """
    columns = table.columns
    if not table.order:  # ranks and costs stand beside the first metrics
        places, costs = table.places, table.costs
        beside = sum(width(text(column)) for column in (*places, *costs))
        metrics = [column for column in columns if column.is_score]
        if beside + sum(width(text(column)) for column in metrics[:1]) > room:
            return _filled(columns, room, room, width, text)
        blocks = _filled(metrics, room - beside, room, width, text)
        return [[*places, *blocks[0], *costs], *blocks[1:]]
    return _filled(columns, room, room, width, text)


def _filled(
    columns: Sequence[Column], first: float, others: float, width: Callable, text: Callable
) -> list[list[Column]]:
    blocks: list[list[Column]] = [[]]
    room = first
    for column in columns:
        wide = width(text(column))
        if wide > room and blocks[-1]:
            blocks.append([])
            room = others
        blocks[-1].append(column)
        room -= wide
    return blocks


def shared_notes(tables: Sequence[Table], *more: str) -> tuple[list[tuple[str, ...]], tuple[str, ...]]:
    """The notes of each table, and those common to all (with ``more``), which are printed only once."""
    first, *others = (table.notes for table in tables)
    shared = tuple(note for note in first if all(note in notes for notes in others))
    return [tuple(note for note in table.notes if note not in shared) for table in tables], (*shared, *more)


def standing_notes(tables: Sequence[Table], best: str, second: str = "") -> list[str]:
    """The meaning of the signs of the best means, in a format that shows these two in the given way.

    Parameters
    ----------
    tables : sequence of Table
    best, second : str
        How the best and the second best mean are shown, as ``Bold``; empty where it is not shown.
    """
    is_best, is_tied, is_second = (any(flags) for flags in zip(*(t.best_notes for t in tables), strict=True))
    if any(table.head.startswith("parameter") for table in tables):
        tied = [f"{TIED}: not significantly worse: the interval of its ratio holds 1."] if is_tied else []
        return [*([f"{best}: the best."] if is_best else []), *tied]
    of_line = any(table.head == "case" for table in tables)
    what = "the best of a line" if of_line else "the best mean"
    notes = [f"{best}: {what}; a method with failed cases is never the best."] if is_best else []
    if is_tied:
        notes.append(
            f"{TIED}: tied for first: by a paired test over the shapes not significantly worse than the best, however "
            "far the means are apart."
        )
    return [*notes, *([f"{second}: the second best mean."] if is_second and second else [])]
