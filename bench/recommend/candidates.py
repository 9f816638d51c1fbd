"""The methods, with their settings, that a recommendation chooses from."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import UsageError
from ..plan.choice import Choice

DEFAULT = (
    "poisson[depth=6],poisson,poisson_9,apss,rimls,ball_pivoting,alpha_shape,alpha_wrap,advancing_front,wnnc,"
    "chain[steps=[statistical_outlier,jet,poisson]]"
)
"""Classical methods that take seconds, of every kind: smooth, interpolating, closed, for points without normals."""


@dataclass(frozen=True)
class Candidate:
    """One method with all its parameters.

    Attributes
    ----------
    label : str
        As the user wrote it.
    overrides : tuple of str
        The arguments of ``detailbench apply``: ``method=poisson``, ``method.depth=6``.
    choice : Choice
    weights : str
        The file of weights of a learned method; empty for others.
    """

    label: str
    overrides: tuple[str, ...]
    choice: Choice
    weights: str = ""

    def command(self, task: str, scan: str, output: str) -> str:
        """The line that applies it to a scan."""
        words = ["detailbench", "apply", *self.overrides, f"task={task}", scan, output]
        return " ".join(word if word == output else shlex.quote(word) for word in words)


def candidates(text: str, task: str) -> list[Candidate]:
    """The candidates of a list: ``poisson,poisson[depth=6],chain[steps=[jet,poisson]]``.

    Parameters
    ----------
    text : str
        Names of methods or presets with commas between them, each with parameters in brackets if they are not the
        usual ones.
    task : str
        The task that all of them must solve.

    Raises
    ------
    UsageError
        For a name or parameter that does not exist, a method that does not solve the task, a duplicate,
        a learned one without weights, and fewer than two of them.
    """
    words = list(parts(text))
    found = [_candidate(word, task) for word in words]
    known: dict[Any, str] = {}
    for candidate in found:
        key = (candidate.choice.name, repr(candidate.choice.parameters))
        if key in known:
            raise UsageError(f"--methods: {known[key]} and {candidate.label} are the same; name each once")
        known[key] = candidate.label
    if len(found) < 2:
        raise UsageError(f"--methods {text!r}: expected at least two methods with commas between them")
    return found


def parts(text: str) -> Iterator[str]:
    """The parts of a list between commas that no brackets enclose, without blanks around them.

    Raises
    ------
    UsageError
        If a bracket has no partner.
    """
    depth, part = 0, ""
    for letter in text:
        depth += (letter in "[{") - (letter in "]}")
        if depth < 0:
            break
        if letter == "," and not depth:
            if part.strip():
                yield part.strip()
            part = ""
        else:
            part += letter
    if depth:
        raise UsageError(f"{text}: unbalanced brackets; expected NAME or NAME[key=value,...], with commas between")
    if part.strip():
        yield part.strip()


def _candidate(word: str, task: str) -> Candidate:
    from ..plugins.presets import resolve
    from ..plugins.registry import registry
    from ..sweep.overrides import checked

    name, _, rest = word.partition("[")
    given = list(parts(rest[:-1])) if rest else []
    if rest and (not rest.endswith("]") or not all("=" in value for value in given)):
        raise UsageError(f"{word}: expected NAME or NAME[key=value,...], as in poisson[depth=6]")
    registry().find("method", resolve("method", name))  # or an error that names it
    overrides = (f"method={name}", *(f"method.{value}" for value in given))
    values = checked([*overrides, f"task={task}"], "recommend").values
    choice = Choice.of("method", values["method"])
    if not choice.solves(task):
        raise UsageError(f"method {choice.label} does not solve {task}")
    return Candidate(word, overrides, choice, _weights(values, choice))


def _weights(values: dict[str, Any], method: Choice) -> str:
    """The file of a learned method's weights, shipped with it or trained here; empty for other methods."""
    from ..engine.training import known_weights
    from ..plan.training import Training
    from ..results.store import Results

    chosen = {kind: Choice.of(kind, values[kind]) for kind in ("task", "dataset", "sensor")}
    training = Training.of(values["training"], chosen | {"method": method})
    if training is None:
        return ""
    known = known_weights(Results(values["results"]), training)
    if known is None:
        raise UsageError(
            f"method {method.label} is learned, and has no weights here. Train it (detailbench train "
            f"method={method.name} dataset=NAME), or leave it out"
        )
    return str(Path(known.path))
