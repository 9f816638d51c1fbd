"""The search: settings that optuna suggests, each run as ordinary cells on train shapes."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from ..errors import UsageError
from ..installing import line_of_extra
from ..plan.cell import Cell, NotSolved, Settings
from .scores import Scores, metric_of, surely_worse
from .space import Axis

if TYPE_CHECKING:
    import optuna

STARTS = 8  # random settings before the search learns from results
REPEATS = 25  # settings in a row that were tried before: the search space is exhausted


@dataclass
class Trial:
    """One setting and its result.

    Attributes
    ----------
    number : int
        0 is the default.
    changed : dict
        The parameters that are not at their defaults.
    stopped : bool
        Whether it was stopped after some cells, significantly worse than the best.
    seconds : float
        Wall-clock seconds of its cells; near 0 where they were finished before.
    """

    number: int
    changed: Mapping[str, Any]
    scores: Scores = field(default_factory=Scores)
    stopped: bool = False
    seconds: float = 0.0

    @property
    def text(self) -> str:
        """``depth=9 trim=0.1``."""
        shown = (f"{k}={v:g}" if isinstance(v, float) else f"{k}={v}" for k, v in self.changed.items())
        return " ".join(shown) or "the defaults"

    @property
    def loss(self) -> float:
        """The mean of the logarithms: lower is better."""
        losses = self.scores.losses()
        return sum(losses.values()) / len(losses) if losses else math.inf


@dataclass(frozen=True)
class Bench:
    """The setup for trials: the cells of the method with its defaults, and the function that runs one.

    Attributes
    ----------
    configs : the composed values of each cell
    settings : how cells are run
    run : called with a cell and the settings; the rows of its record
    """

    configs: Sequence[Mapping[str, Any]]
    settings: Settings
    run: Callable[[Cell, Settings], list[dict[str, Any]]]

    def rows(self, changed: Mapping[str, Any], cases: int | None = None) -> Iterator[list[dict[str, Any]]]:
        """The rows of a setting, cell by cell; with ``cases``, of that many shapes of each dataset."""
        for values in self.configs:
            method = {**values["method"], **changed}
            own = {"method": method, "cases": values["cases"] if cases is None else cases}
            try:
                cell = Cell.from_config({**values, **own})
            except NotSolved as error:
                raise UsageError(str(error)) from error
            yield self.run(cell, self.settings)

    @property
    def task(self) -> str:
        """The name of the task."""
        return self.configs[0]["task"]["_name_"]


@dataclass
class Search:
    """A search over some axes.

    Parameters
    ----------
    bench : the setup for trials
    axes : the axes to search
    seed : of the suggestions; with it and a number of trials, the same trials come each time
    trials : the maximum number, including the default; None: until the time is up
    seconds : of wall clock at most; None: no limit
    score : the score that decides; None: the task's own
    tell : called with each trial that ended, the best, and the seconds that are left (None: not known)
    """

    bench: Bench
    axes: Sequence[Axis]
    seed: int = 0
    trials: int | None = None
    seconds: float | None = None
    score: str | None = None
    tell: Callable[[Trial, Trial, float | None], None] = lambda *_: None
    done: list[Trial] = field(default_factory=list)
    metric: str = ""
    exhausted: bool = False

    @property
    def best(self) -> Trial:
        """The best of the trials that were run on all cases; of equal ones the first."""
        return min((t for t in self.done if not t.stopped), key=lambda t: t.loss)

    @property
    def default(self) -> Trial:
        """The trial of the defaults."""
        return self.done[0]

    def run(self, held_out: int = 0) -> None:
        """Try settings until the trials, the time or the space is exhausted.

        Parameters
        ----------
        held_out : shapes of each dataset that are run at the end, for which time is reserved
        """
        self._started = time.monotonic()
        study = self._study()
        self._first()
        repeats = 0
        known = {_key({}): self.default}
        while not self._is_over(len(known), repeats, held_out):
            asked = study.ask()
            changed = self._suggested(asked)
            repeats = repeats + 1 if _key(changed) in known else 0
            trial = known.get(_key(changed)) or self._try(len(self.done), changed, asked)
            if _key(changed) not in known:
                known[_key(changed)] = trial
                self.done.append(trial)
                self.tell(trial, self.best, self._left(held_out))
            _report(study, asked, trial)
        self.exhausted = repeats >= REPEATS or len(known) >= self._size

    def _study(self) -> optuna.Study:
        optuna = imported()
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        # With more trials the first ones are the same, so that a search can be continued.
        sampler = optuna.samplers.TPESampler(seed=self.seed, n_startup_trials=STARTS)
        study = optuna.create_study(sampler=sampler, direction="minimize")
        study.enqueue_trial({key: value for axis in self.axes for key, value in axis.of_default().items()})
        return study

    def _first(self) -> None:
        """The default, which is run in full: it determines the score that decides."""
        trial, begin = Trial(0, {}), time.monotonic()
        rows = [row for cell in self.bench.rows({}) for row in cell]
        self.metric = metric_of(rows, self.bench.task, self.score)
        trial.scores.add(rows, self.metric)
        trial.seconds = time.monotonic() - begin
        self.done = [trial]
        self.tell(trial, trial, self._left(0))

    def _suggested(self, asked: optuna.Trial) -> dict[str, Any]:
        values = {axis.name: (axis.suggested(asked), axis.default) for axis in self.axes}
        return {name: value for name, (value, default) in values.items() if value != default}

    def _try(self, number: int, changed: Mapping[str, Any], asked: optuna.Trial) -> Trial:
        trial, begin = Trial(number, changed), time.monotonic()
        last = len(self.bench.configs) - 1
        for place, rows in enumerate(self.bench.rows(changed)):
            trial.scores.add(rows, self.metric)
            asked.report(trial.loss, step=place)
            if place < last and surely_worse(trial.scores, self.best.scores):
                trial.stopped = True
                break
        trial.seconds = time.monotonic() - begin
        return trial

    @property
    def _size(self) -> float:
        return math.prod(axis.count + (not axis.holds_default) for axis in self.axes)

    def _is_over(self, tried: int, repeats: int, held_out: int) -> bool:
        if repeats >= REPEATS or tried >= self._size:
            return True
        if self.trials is not None and len(self.done) >= self.trials:
            return True
        left = self._time_left(held_out)
        return left is not None and len(self.done) > 1 and left < self._usual()

    def _usual(self) -> float:
        """Seconds of a trial that is run in full: the mean."""
        whole = [t.seconds for t in self.done if not t.stopped]
        return sum(whole) / len(whole)

    def _time_left(self, held_out: int) -> float | None:
        """Seconds for further trials: the final run, on shapes that the search did not see, takes its share."""
        if self.seconds is None:
            return None
        cases = self.bench.configs[0]["cases"]
        end = 2 * self.default.seconds * (cases + held_out) / max(cases, 1) if held_out else 0.0
        return self.seconds - (time.monotonic() - self._started) - end

    def _left(self, held_out: int) -> float | None:
        ends = [self._time_left(held_out)]
        if self.trials is not None:
            ends.append((self.trials - len(self.done)) * self._usual())
        known = [max(end, 0.0) for end in ends if end is not None]
        return min(known) if known else None

    def judged(self, held_out: int) -> tuple[Scores, Scores]:
        """The scores of the default and of the best setting on shapes that the search did not see."""
        found = []
        for trial in (self.default, self.best):
            scores = Scores()
            for values in self.bench.configs:
                cases = values["cases"]
                one = replace(self.bench, configs=[values])
                for rows in one.rows(trial.changed, cases + held_out):
                    scores.add([row for row in rows if row["case_index"] >= cases], self.metric)
            found.append(scores)
        return found[0], found[1]


def _report(study: optuna.Study, asked: optuna.Trial, trial: Trial) -> None:
    optuna = imported()
    if trial.stopped:
        study.tell(asked, state=optuna.trial.TrialState.PRUNED)
    else:
        study.tell(asked, trial.loss)


def _key(changed: Mapping[str, Any]) -> str:
    return json.dumps(changed, sort_keys=True)


def imported() -> Any:
    """The library of the search.

    Raises
    ------
    UsageError
        With the line that installs it.
    """
    try:
        import optuna
    except ImportError as error:
        raise UsageError(f"this command needs optuna: {line_of_extra('tune')}") from error
    return optuna
