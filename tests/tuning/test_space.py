"""What a search may set: as the words name it, and as plugins declare it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import optuna
import pytest

from bench.errors import UsageError
from bench.plugins.registry import Plugin, registry
from bench.tuning.space import Axis, declared_axes, grid_of, named_axes, split_words


@dataclass(frozen=True)
class Toy:
    steps: int = field(default=4, metadata={"range": (1, 64), "log": True})
    weight: float = field(default=1.0, metadata={"range": (0.5, 2.0)})
    kind: Literal["a", "b", "c"] = "b"
    closed: bool = False
    radius: float | None = None
    title: str = "x"


@pytest.fixture
def toy():
    usual = registry().find("method", "identity")
    return Plugin(**{**{f: getattr(usual, f) for f in usual.__dataclass_fields__}, "name": "toy", "cls": Toy})


def axis(toy, word, **fixed):
    others, named = split_words([word])
    assert others == []
    return named_axes(toy, named, fixed)[0]


def test_overrides_are_split_into_those_that_fix_and_those_that_name_values():
    words = ["method=apss", "method.steps=4", "method.reach=interval(0,3)", "method.k=log(1,9)", "seed=0,1"]
    others, named = split_words(words)
    assert others == ["method=apss", "method.steps=4", "seed=0,1"]
    assert named == {"reach": "method.reach=interval(0,3)", "k": "method.k=log(1,9)"}


@pytest.mark.parametrize(
    ("word", "low", "high", "whole", "log", "choices"),
    [
        ("method.steps=range(5,9)", None, None, False, False, (5, 6, 7, 8)),
        ("method.steps=interval(1.2,7)", 2, 7, True, False, ()),
        ("method.weight=interval(0.1,10)", 0.1, 10, False, False, ()),
        ("method.weight=log(0.1,10)", 0.1, 10, False, True, ()),
        ("method.weight=tag(log,interval(0.1,10))", 0.1, 10, False, True, ()),
        ("method.weight=3,1,2", None, None, False, False, (1.0, 2.0, 3.0)),
        ("method.kind=c,a", None, None, False, False, ("c", "a")),
        ("method.radius=log(1,4)", 1, 4, False, True, ()),
    ],
)
def test_values_that_overrides_name(toy, word, low, high, whole, log, choices):
    found = axis(toy, word)
    assert (found.low, found.high, found.whole, found.log, found.choices) == (low, high, whole, log, choices)


@pytest.mark.parametrize(
    ("word", "reason"),
    [
        ("method.stepz=1,2", "no parameter 'stepz'. Did you mean 'steps'"),
        ("method.kind=a,d", "expected"),
        ("method.title=log(1,2)", "is not a number"),
        ("method.weight=log(0,2)", "above 0"),
        ("method.weight=log(x,2)", "expected two numbers"),
        ("method.weight=interval(3,2)", "lower end first"),
        ("method.weight=choice(3)", "two values or more"),
    ],
)
def test_what_is_wrong_with_arguments_is_reported(toy, word, reason):
    with pytest.raises(UsageError, match="method"):
        axis(toy, word)
    with pytest.raises(UsageError) as error:
        axis(toy, word)
    assert reason in str(error.value)


def test_declared_ranges_and_choices(toy):
    found = {a.name: a for a in declared_axes(toy, {})}
    assert set(found) == {"steps", "weight", "kind", "closed"}
    assert (found["steps"].low, found["steps"].high, found["steps"].whole, found["steps"].log) == (1, 64, True, True)
    assert found["kind"].choices == ("a", "b", "c") and found["closed"].choices == (False, True)
    assert [a.name for a in declared_axes(toy, {"weight": 2.0, "kind": "a"})] == ["steps", "closed"]
    assert "default" not in registry().find("method", "identity").options  # the toy is no plugin of anybody


def test_the_grid_of_an_experiment_is_a_range():
    assert grid_of("poisson")["point_weight"] == [0.5, 1.0, 2.0, 4.0, 10.0]
    found = {a.name: a for a in declared_axes(registry().find("method", "poisson"), {})}
    assert (found["point_weight"].low, found["point_weight"].high, found["point_weight"].log) == (0.5, 10.0, True)
    assert found["depth"].count == 2 and found["depth"].default == 8
    with pytest.raises(UsageError, match="name them"):
        declared_axes(registry().find("method", "identity"), {})


def test_suggestions_are_values_and_the_default_is_one_of_them(toy):
    axes = [*declared_axes(toy, {}), axis(toy, "method.radius=log(1,4)"), axis(toy, "method.weight=3,5")]
    study = optuna.create_study(sampler=optuna.samplers.RandomSampler(seed=0))
    study.enqueue_trial({k: v for a in axes for k, v in a.of_default().items()})
    first = study.ask()
    assert all(a.suggested(first) == a.default for a in axes if a.name != "weight")
    seen = {a.text: set() for a in axes}
    for _ in range(60):
        trial = study.ask()
        for a in axes[:4] + axes[4:5]:
            value = a.suggested(trial)
            seen[a.text].add(value)
            assert value == a.default or value in a.choices or a.low <= value <= a.high
            assert type(value) is not float or value == a.default or value == float(f"{value:.3g}")
    assert seen["a, b, c"] == {"a", "b", "c"} and seen["False, True"] == {False, True}
    assert None in seen["1 to 4 by factors"] and len(seen["1 to 4 by factors"]) > 5


@pytest.mark.parametrize(
    ("given", "value", "edge"),
    [
        (Axis("x", 1.0, 0.0, 100.0), 4.9, "low"),
        (Axis("x", 1.0, 0.0, 100.0), 5.1, ""),
        (Axis("x", 1.0, 0.0, 100.0), 96.0, "high"),
        (Axis("x", 1.0, 0.01, 100.0, log=True), 0.1, ""),
        (Axis("x", 1.0, 0.01, 100.0, log=True), 0.015, "low"),
        (Axis("x", 8, 5, 9, whole=True), 9, "high"),
        (Axis("x", 8, 5, 9, whole=True), 8, ""),
        (Axis("x", 8, choices=(8, 16, 24)), 8, "low"),
        (Axis("x", "a", choices=("a", "b")), "a", ""),
        (Axis("x", None, 1.0, 4.0), None, ""),
    ],
)
def test_the_edge_of_what_was_searched(given, value, edge):
    assert given.edge(value) == edge


def test_how_many_values_there_are():
    assert Axis("x", 8, 5, 9, whole=True).count == 5
    assert Axis("x", 8, choices=(1, 2)).count == 2
    assert Axis("x", 8, 5, 9).count == math.inf
