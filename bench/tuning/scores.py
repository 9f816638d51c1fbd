"""The scores of a setting: one number per case, and the geometric mean over them."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..errors import UsageError, did_you_mean
from ..ranking.headline import primary_metrics

LEAST = 1e-9  # lower scores count as this
FAR = 1e6  # times the largest score of a case: a failure without a known score
CASE = ("task", "dataset", "sensor", "case", "seed")
FEW = 4  # shapes, from which on there is an interval

Case = tuple[Any, ...]


@dataclass
class Scores:
    """The scores of one setting on cases.

    Attributes
    ----------
    better : str
        Whether a ``lower`` or a ``higher`` score is better, or one near the ``reference``'s own.
    solved : dict
        By case, the score; of a reference metric, how far it is from the reference's own.
    failed : dict
        By failed case, the score of the worst output that takes no method; NaN if it is not known.
    index : dict
        By case, its place in its dataset.
    """

    better: str = "lower"
    solved: dict[Case, float] = field(default_factory=dict)
    failed: dict[Case, float] = field(default_factory=dict)
    index: dict[Case, int] = field(default_factory=dict)

    def add(self, rows: Iterable[Mapping[str, Any]], metric: str) -> None:
        """Add the rows of a cell."""
        for row in rows:
            case = tuple(row[name] for name in CASE)
            self.better = _direction(row, metric) or self.better
            score = _shown(row, f"score.{metric}", metric, self.better)
            self.index[case] = row["case_index"]
            if row["status"] == "ok" and math.isfinite(score):
                self.solved[case] = score
            else:
                self.failed[case] = _shown(row, f"worst.{metric}", metric, self.better)

    def losses(self, others: Iterable[Scores] = ()) -> dict[Case, float]:
        """By case, the logarithm of the score such that lower is better, failures included.

        The cost of a failure is known from any setting scored on the same case.
        """
        sign = -1.0 if self.better == "higher" else 1.0
        logs = {case: sign * math.log(max(score, LEAST)) for case, score in self.solved.items()}
        for case, worst in self.failed.items():
            known = [w for s in others for c, w in s.failed.items() if c == case and math.isfinite(w)]
            worst = worst if math.isfinite(worst) else known[0] if known else math.nan
            if math.isfinite(worst):
                logs[case] = sign * math.log(max(worst, LEAST))
            else:
                largest = max((abs(s) for s in self.solved.values()), default=1.0)
                logs[case] = math.log(FAR * max(largest, 1.0))
        return logs

    def mean(self, cases: Iterable[Case] | None = None) -> float:
        """The geometric mean of the scores, failures included; over all cases or some."""
        logs = self.losses()
        chosen = [logs[case] for case in (logs if cases is None else cases) if case in logs]
        if not chosen:
            return math.nan
        return math.exp((-1 if self.better == "higher" else 1) * float(np.mean(chosen)))


def _direction(row: Mapping[str, Any], metric: str) -> str:
    return json.loads(row.get("directions") or "{}").get(metric, "")


def _shown(row: Mapping[str, Any], key: str, metric: str, better: str) -> float:
    value = row.get(key)
    if value is None:
        return math.nan
    floor = row.get(f"floor.{metric}")
    return abs(value - (math.nan if floor is None else floor)) if better == "reference" else float(value)


def metric_of(rows: Iterable[Mapping[str, Any]], task: str, asked: str | None) -> str:
    """The score that decides: the requested one, or the first of those that the task is ranked by.

    Raises
    ------
    UsageError
        If no row has it.
    """
    known = sorted({key.removeprefix("score.") for row in rows for key, v in row.items() if key.startswith("score.")
                    and v is not None})  # fmt: skip
    if asked:
        if known and asked not in known:
            raise UsageError(f"--score {asked}: no case has this score. {did_you_mean(asked, known)}")
        return asked
    primary = [name for name in primary_metrics(task) if name in known]
    if not known:
        raise UsageError("no case was solved with the default parameters: there is nothing to compare with")
    return (primary or known)[0]


@dataclass(frozen=True)
class Ratio:
    """One setting's score over another's, below 1 where the first is better: the geometric mean over cases.

    ``low`` and ``high`` are the ends of its 95 % interval over shapes; NaN with fewer than :data:`FEW` shapes.
    """

    mean: float
    low: float
    high: float
    shapes: int

    @property
    def text(self) -> str:
        """``0.86 [0.80, 0.92]``."""
        inside = (
            f" [{self.low:.3g}, {self.high:.3g}]" if math.isfinite(self.low) else " (too few shapes for an interval)"
        )
        return f"{self.mean:.3g}" + inside


def ratio(one: Scores, other: Scores, cases: Iterable[Case], level: float = 0.95) -> Ratio:
    """The ratio of two settings on the cases that both were run on.

    Each shape counts once, whatever its sensors and seeds: the interval is Student's, of the means of the
    shapes' logarithms.
    """
    from scipy.stats import t

    first, second = one.losses([other]), other.losses([one])
    by_shape: dict[Case, list[float]] = {}
    for case in cases:
        if case in first and case in second:
            by_shape.setdefault((case[1], case[3]), []).append(first[case] - second[case])
    means = np.array([np.mean(values) for values in by_shape.values()])
    if not len(means):
        return Ratio(math.nan, math.nan, math.nan, 0)
    centre, half = float(means.mean()), math.nan
    if len(means) >= FEW:
        half = float(t.ppf((1 + level) / 2, len(means) - 1) * means.std(ddof=1) / math.sqrt(len(means)))
    return Ratio(math.exp(centre), math.exp(centre - half), math.exp(centre + half), len(means))


def surely_worse(one: Scores, best: Scores, error: float = 0.005) -> bool:
    """Whether one setting is significantly worse than another on its own cases, by Student's test over shapes."""
    shared = ratio(one, best, one.losses(), level=1 - 2 * error)
    return shared.shapes >= FEW and shared.low > 1
