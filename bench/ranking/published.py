"""A paper's own numbers, shown beside ours in the tables of the experiment that reproduces its table.

They are in the experiment's file, under ``published``::

    published:
      source: "thesis, table 4.1: mean of 16 shapes"
      short: thesis                                     # the heading of the columns
      convention: idf                                   # whose columns and units
      by: sensor                                        # one table for each of: see `leaderboard --by`
      lines:
        - {method: siren, parameters: {omega: 60.0}, values: {"CD (1e-3)": 9.85}}

``values`` are keyed by the titles of the convention's columns. A line belongs to every method of ours whose parameters,
given or default, are those named. ``why`` explains a difference, for the page of `detailbench report`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from ..errors import UsageError, did_you_mean
from ..plugins.config_files import OURS, ConfigFile
from ..plugins.presets import content_of, files, names
from .naming import parts_of

GROUP = "experiment"


@dataclass(frozen=True)
class Line:
    """One line of a paper's table."""

    values: Mapping[str, float]  # by the title of the column
    method: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    sensor: str = ""  # only for this one; empty for any
    name: str = ""  # its name in the paper, if that differs
    why: str = ""  # the explanation of a difference between the paper's number and ours

    @property
    def title(self) -> str:
        """The paper's name, or ours with its parameters."""
        given = ",".join(f"{key}={_word(value)}" for key, value in self.parameters.items())
        return self.name or (f"{self.method}[{given}]" if given else self.method)

    def is_of(self, method: str, parameters: Mapping[str, str], sensor: str) -> bool:
        """Whether this line belongs to a method of ours, given all its parameters in words."""
        return (
            method == self.method
            and (not self.sensor or self.sensor == sensor)
            and all(parameters.get(key) == _word(value) for key, value in self.parameters.items())
        )


@dataclass(frozen=True)
class Published:
    """A paper's table."""

    source: str
    short: str
    convention: str
    lines: tuple[Line, ...]
    by: str | None = None

    def value(self, title: str, method: str, variant: str, sensor: str) -> float | None:
        """The paper's number in the column ``title`` for a method of ours."""
        line = self.line(title, method, variant, sensor)
        return None if line is None else float(line.values[title])

    def line(self, title: str, method: str, variant: str, sensor: str) -> Line | None:
        """The paper's line with a number in the column ``title`` for a method of ours."""
        parameters = all_parameters(method, variant)
        lines = (line for line in self.lines if title in line.values and line.is_of(method, parameters, sensor))
        return next(lines, None)

    def others(self, ours: Collection[tuple[str, str]], sensor: str) -> list[str]:
        """The lines, in words, that belong to none of ``ours``: methods and variants."""
        known = [(method, all_parameters(method, variant)) for method, variant in ours]
        left = [
            line
            for line in self.lines
            if line.sensor in ("", sensor) and not any(line.is_of(*one, sensor) for one in known)
        ]
        return [
            f"{line.title}: {', '.join(f'{title} {value}' for title, value in line.values.items())}" for line in left
        ]


def all_parameters(method: str, variant: str) -> dict[str, str]:
    """The parameters of a method in words: the defaults, overridden by the variant."""
    from ..plugins.registry import registry
    from ..plugins.schema import defaults

    known = registry().find("method", method) if method in registry().names("method") else None
    usual = {key: _word(value) for key, value in defaults(known).items()} if known else {}
    given = dict(part.split("=", 1) for part in parts_of(variant) if "=" in part)
    return usual | given


def _word(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def load_published(experiment: str) -> Published:
    """The published numbers in an experiment's file.

    Raises
    ------
    UsageError
        If there is no such experiment, or if it does not reproduce a paper's table.
    """
    if experiment not in names(GROUP):
        raise UsageError(f"no experiment is called {experiment!r}. {did_you_mean(experiment, names(GROUP))}")
    described = _described(experiment)
    if described is None:
        known = [name for name in names(GROUP) if has_published(name)]
        raise UsageError(f"experiment {experiment} repeats no paper's table; these do: {', '.join(known)}")
    try:
        lines = tuple(Line(**line) for line in described["lines"])
        return Published(described["source"], described["short"], described["convention"], lines, described.get("by"))
    except (KeyError, TypeError) as error:
        raise UsageError(
            f"{files(GROUP)[experiment].path}: published: expected source, short, convention, and lines such as "
            f"{{method: NAME, values: {{COLUMN: NUMBER}}}} ({error})"
        ) from error


def has_published(experiment: str) -> bool:
    """Whether an experiment's file has a paper's numbers."""
    return _described(experiment) is not None


def _described(experiment: str) -> dict[str, Any] | None:
    """The entry ``published`` of an experiment's file."""
    file = files(GROUP)[experiment]
    # A file of ours that does not mention it need not be parsed, which is slow.
    if file.folder.origin == OURS and "published" not in file.text():
        return None
    return _content(file).get("published")


def content_of_experiment(experiment: str) -> Mapping[str, Any]:
    """All that an experiment's file holds, which is read once."""
    return _content(files(GROUP)[experiment])


@cache
def _content(file: ConfigFile) -> dict[str, Any]:
    return content_of(file.path, file.text())
