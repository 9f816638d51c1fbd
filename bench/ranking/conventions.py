"""Conventions: the table format of a paper, as a preset over metrics whose names are formulas.

A convention is a YAML file in the config group ``convention``: it selects the metrics that it needs and assigns
scores, times a factor, to columns. It changes what is computed and what is printed, never what a score
means, so it is not part of a cell's identity; its metrics are.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Any

from ..errors import UsageError, did_you_mean
from ..plugins.config_files import ConfigFile
from ..plugins.presets import content_of, files, names

if TYPE_CHECKING:
    import pandas as pd

METRIC = "override /metric"  # the entry of the defaults list that selects the metrics


@dataclass(frozen=True)
class Column:
    """One column of a paper's table."""

    title: str  # as in the paper, with its unit
    score: str  # the key of the score
    factor: float = 1.0  # the printed number is the score times this, above 0
    digits: int = 2  # after the point


@dataclass(frozen=True)
class Convention:
    """A paper's table: which scores, in which units."""

    name: str
    prints: str  # the columns, in one sentence
    paper: str  # whom to cite
    code: str  # the file that computes the numbers
    differs: str  # where ours differs from it, in words
    metrics: tuple[str, ...]  # the plugins that compute the scores
    columns: tuple[Column, ...]

    @property
    def digits(self) -> dict[str, int]:
        """Digits after the point by title."""
        return {column.title: column.digits for column in self.columns}

    def notes(self, shown: Collection[str]) -> tuple[str, ...]:
        """The notes below a table with these titles: columns, formulas, source, missing parts."""
        formulas = [f"{c.title} = {c.factor:g} x {c.score}" for c in self.columns if c.title in shown]
        missing = [f"{c.title} ({c.score})" for c in self.columns if c.title not in shown]
        if not formulas:  # nothing was solved
            return ()
        notes = [
            f"convention {self.name}: {self.prints}",
            f"{'; '.join(formulas)}.",
            f"After {self.paper}; {self.code}.",
        ]
        if self.differs:
            notes.append(f"What differs: {self.differs}")
        if missing:
            notes.append(f"These results have no {' and no '.join(missing)}.")
        return tuple(notes)

    def of(self, known: Collection[str]) -> Convention:
        """The same with the scores in results: with N samples, ``score@N`` is used if they have no ``score``.

        Of several N the largest is used.
        """
        columns = []
        for column in self.columns:
            sampled = [name for name in known if name.rpartition("@")[0] == column.score]
            most = max(sampled, key=lambda name: float(name.rpartition("@")[2]), default=column.score)
            columns.append(column if column.score in known else replace(column, score=most))
        return replace(self, columns=tuple(columns))

    def scores(self, known: Mapping[str, Any] | list[str]) -> list[str]:
        """The scores of the columns that ``known`` has.

        Raises
        ------
        UsageError
            If it has none of them.
        """
        found = [column.score for column in self.columns if column.score in known]
        if not found:
            wanted = ", ".join(column.score for column in self.columns)
            raise UsageError(
                f"convention {self.name} prints {wanted}; these results have none of them. Run them with "
                f"convention={self.name}, or metric=[{','.join(self.metrics)}]"
            )
        return list(dict.fromkeys(found))

    def view(self, board: pd.DataFrame) -> pd.DataFrame:
        """A leaderboard in this convention: the columns' scores in its units, under its titles, in its order.

        The lines of a table in which nothing was solved have no score and are unchanged.
        """
        import pandas as pd

        parts: list[pd.DataFrame] = []
        group = [name for name in ("task", "dataset", "sensor", "split") if name in board]
        for _, lines in board.groupby(group, sort=False, dropna=False):
            shown = [self._column(lines, column) for column in self.columns]
            shown.append(lines[lines["metric"] == ""])
            parts.extend(part for part in shown if len(part))
        made = pd.concat(parts, ignore_index=True) if parts else board.iloc[:0].copy()
        made.attrs.update(board.attrs)
        return made

    def _column(self, lines: pd.DataFrame, column: Column) -> pd.DataFrame:
        part = lines[lines["metric"] == column.score].copy()
        part["metric"] = column.title
        # A paper prints the score itself, our tables the difference to the reference's own value.
        if "score_mean" in part:  # boards of earlier versions have no other mean
            own = part["better"] == "reference"
            part.loc[own, "mean"] = part.loc[own, "score_mean"]
            part.loc[own, ["ci_low", "ci_high"]] = float("nan")
        for name in ("mean", "ci_low", "ci_high", "floor"):
            part[name] *= column.factor
        return part


def convention_names() -> list[str]:
    """The names of all conventions."""
    return names("convention")


def load_convention(name: str) -> Convention:
    """The convention of a name.

    Raises
    ------
    UsageError
        For an unknown name, with the nearest right one, and for a file that is not a convention.
    """
    if name not in convention_names():
        raise UsageError(f"no convention is called {name!r}. {did_you_mean(name, convention_names())}")
    return _read(files("convention")[name])


@cache
def _read(file: ConfigFile) -> Convention:
    content = content_of(file.path, file.text())
    try:
        (selected,) = (entry[METRIC] for entry in content["defaults"] if METRIC in entry)
        described = content["convention"]
        return Convention(
            name=described["name"],
            prints=described["prints"],
            paper=described["paper"],
            code=described["code"],
            differs=described.get("differs", ""),
            metrics=tuple(selected),
            columns=tuple(Column(**column) for column in described["columns"]),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise UsageError(
            f"{file.path}: expected defaults with '{METRIC}: [NAMES]', and a convention with name, prints, paper, "
            f"code and columns such as {{title: TEXT, score: NAME, factor: NUMBER, digits: NUMBER}} ({error})"
        ) from error
