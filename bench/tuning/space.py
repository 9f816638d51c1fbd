"""The space of a search: the parameters of a method, and the values that each may take.

A parameter is searched over the values that the user names, in Hydra's syntax and one addition::

    method.depth=range(5,9)           5, 6, 7, 8
    method.weight=interval(0.1,10)    any number between, a whole one for such a parameter
    method.weight=log(0.1,10)         the same, with factors instead of differences
    method.k=8,16,24                  one of these

If none is named, over the declared values: ``field(metadata={"range": (5, 12)})`` of the plugin's dataclass, with
``"log": True`` if wanted, the choices of a parameter that is a bool or a Literal, and the grid of the experiment
``tune_METHOD`` for the others.
"""

from __future__ import annotations

import math
import re
import typing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..errors import UsageError, did_you_mean
from ..plugins import presets
from ..plugins.registry import Plugin, registry
from ..plugins.schema import check_value, defaults, field_types

if TYPE_CHECKING:
    import optuna

LOG = re.compile(r"log\(\s*([^,()]+)\s*,\s*([^,()]+)\s*\)")
DIGITS = 3  # of a number between two others, for readable presets
FACTOR = 8.0  # between the ends of a grid, from which on it counts as logarithmic
EDGE = 0.05  # of an interval's length: if the best is nearer to an end, the optimum may lie outside


@dataclass(frozen=True)
class Axis:
    """One parameter, and the values that it may take.

    Attributes
    ----------
    name : str
    default : Any
        Of the plugin, or fixed by an override.
    low, high : float or int, optional
        The ends of an interval, both included; None where there are ``choices``.
    whole, log : bool
        Whether values are whole numbers; whether they are searched by factors.
    choices : tuple
        All values, numbers in order.
    """

    name: str
    default: Any
    low: float | None = None
    high: float | None = None
    whole: bool = False
    log: bool = False
    choices: tuple[Any, ...] = ()

    @property
    def count(self) -> float:
        """How many values there are; infinite for an interval of real numbers."""
        if self.choices:
            return len(self.choices)
        return self.high - self.low + 1 if self.whole else math.inf  # type: ignore[operator]

    @property
    def holds_default(self) -> bool:
        """Whether the default is one of the values."""
        if self.choices:
            return self.default in self.choices
        is_number = isinstance(self.default, (int, float)) and not isinstance(self.default, bool)
        return is_number and self.low <= self.default <= self.high

    @property
    def text(self) -> str:
        """The values in words."""
        if self.choices:
            return ", ".join(f"{c:g}" if isinstance(c, float) else str(c) for c in self.choices)
        return f"{self.low:g} to {self.high:g}" + (" by factors" if self.log else "")

    def suggested(self, trial: optuna.Trial) -> Any:
        """The value that a trial tries; the default itself if it is tried without being a value of the axis."""
        if not self.holds_default and trial.suggest_categorical(f"{self.name} at its default", [True, False]):
            return self.default
        if self.choices:
            last = len(self.choices) - 1
            if all(_is_number(c) for c in self.choices):
                return self.choices[trial.suggest_int(self.name, 0, last)]
            return self.choices[trial.suggest_categorical(self.name, list(range(last + 1)))]
        if self.whole:
            return trial.suggest_int(self.name, int(self.low), int(self.high), log=self.log)  # type: ignore[arg-type]
        value = trial.suggest_float(self.name, self.low, self.high, log=self.log)  # type: ignore[arg-type]
        return min(max(float(f"{value:.{DIGITS}g}"), self.low), self.high)  # type: ignore[type-var]

    def of_default(self) -> dict[str, Any]:
        """Optuna's parameters for the default."""
        if not self.holds_default:
            return {f"{self.name} at its default": True}
        return {self.name: self.choices.index(self.default) if self.choices else self.default}

    def edge(self, value: Any) -> str:
        """``low`` or ``high`` if a value is at an end of the searched range, or next to it; empty elsewhere."""
        if not _is_number(value) or (self.choices and not all(map(_is_number, self.choices))):
            return ""
        low: Any
        high: Any
        low, high = (self.choices[0], self.choices[-1]) if self.choices else (self.low, self.high)
        if value == self.default and not self.holds_default:
            return ""
        margin = 0.0
        if not self.choices and not self.whole:
            scale: Callable[[Any], float] = math.log if self.log else float
            low, high, value = scale(low), scale(high), scale(value)
            margin = EDGE * (high - low)
        return "low" if value <= low + margin else "high" if value >= high - margin else ""


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


# -- the values that overrides name ------------------------------------------------------------------------------------


def split_words(overrides: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """The overrides that fix a value, and by parameter those that name values of the method to search."""
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import OverrideParseException

    others, named = [], {}
    for word in overrides:
        key, _, value = word.partition("=")
        if key.startswith("method."):
            if LOG.fullmatch(value):
                named[key.removeprefix("method.")] = word
                continue
            try:
                (override,) = OverridesParser.create().parse_overrides([word])
            except OverrideParseException:
                others.append(word)  # refused where all overrides are
                continue
            if override.is_sweep_override():
                named[key.removeprefix("method.")] = word
                continue
        others.append(word)
    return others, named


def named_axes(plugin: Plugin, named: Mapping[str, str], fixed: Mapping[str, Any]) -> list[Axis]:
    """The axes that overrides name.

    Parameters
    ----------
    plugin : the method
    named : overrides by parameter, as returned by :func:`split_words`
    fixed : values of the method's parameters that replace the plugin's own

    Raises
    ------
    UsageError
        For a parameter that the method lacks, and for values that it cannot have.
    """
    usual = {**defaults(plugin), **fixed}
    return [_axis(plugin, name, word, usual) for name, word in named.items()]


def _axis(plugin: Plugin, name: str, word: str, usual: Mapping[str, Any]) -> Axis:
    if name not in usual:
        raise UsageError(f"{word}: method {plugin.name} has no parameter {name!r}. {did_you_mean(name, usual)}")
    found = LOG.fullmatch(word.partition("=")[2])
    if found:
        try:
            low, high = (float(part) for part in found.groups())
        except ValueError as error:
            raise UsageError(f"{word}: expected two numbers, for instance log(0.1,10)") from error
        return _interval(plugin, name, usual, low, high, log=True, word=word)
    from hydra.core.override_parser.overrides_parser import OverridesParser

    (override,) = OverridesParser.create().parse_overrides([word])
    value: Any = override.value()
    if override.is_interval_sweep():
        log = "log" in value.tags
        return _interval(plugin, name, usual, float(value.start), float(value.end), log=log, word=word)
    values = list(dict.fromkeys(override.sweep_iterator()))
    plain = [_value(plugin, name, text) for text in values]
    if len(plain) < 2:
        raise UsageError(f"{word}: expected two values or more; one value is fixed as {word.partition('=')[0]}=VALUE")
    return Axis(name, usual[name], choices=_ordered(plain))


def _value(plugin: Plugin, name: str, text: Any) -> Any:
    """A value in the type of the parameter."""
    from hydra.core.override_parser.overrides_parser import OverridesParser

    (override,) = OverridesParser.create().parse_overrides([f"x={text}"])
    value = override.value()
    check_value(plugin, name, value)
    return float(value) if _takes(plugin, name, float) and isinstance(value, int) else value


def _takes(plugin: Plugin, name: str, kind: type) -> bool:
    annotation = field_types(plugin)[name]
    kinds = typing.get_args(annotation) or (annotation,)
    return kind in kinds and (kind is not int or float not in kinds)


def _interval(
    plugin: Plugin, name: str, usual: Mapping[str, Any], low: float, high: float, *, log: bool, word: str
) -> Axis:
    whole = _takes(plugin, name, int)
    if not whole and not _takes(plugin, name, float):
        raise UsageError(f"{word}: {name} is not a number; list its values: method.{name}=a,b")
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise UsageError(f"{word}: expected the lower end first, and finite numbers")
    if log and low <= 0:
        raise UsageError(f"{word}: expected ends above 0, for values that are searched on a log scale")
    if whole:
        low, high = math.ceil(low), math.floor(high)
    for end in (low, high):
        check_value(plugin, name, end)
    return Axis(name, usual[name], low, high, whole, log)


def _ordered(values: Sequence[Any]) -> tuple[Any, ...]:
    return tuple(sorted(values)) if all(map(_is_number, values)) else tuple(values)


# -- what is declared --------------------------------------------------------------------------------------------------


def declared_axes(plugin: Plugin, fixed: Mapping[str, Any]) -> list[Axis]:
    """The axes of a method's own parameters, without those that are fixed, in the order of the parameters.

    Raises
    ------
    UsageError
        If nothing is declared: overrides must then name the values to search.
    """
    usual, grid = defaults(plugin), grid_of(plugin.name)
    axes = []
    for f in plugin.fields:
        if f.name in fixed:
            continue
        choices = _choices(field_types(plugin)[f.name])
        if "range" in f.metadata:
            low, high = f.metadata["range"]
            log = bool(f.metadata.get("log"))
            axes.append(_interval(plugin, f.name, usual, low, high, log=log, word=f"range of {f.name}"))
        elif choices:
            axes.append(Axis(f.name, usual[f.name], choices=choices))
        elif f.name in grid:
            axes.append(_of_grid(plugin, f.name, usual, grid[f.name]))
    if not axes:
        names = ", ".join(f.name for f in plugin.fields) or "none"
        raise UsageError(
            f"method {plugin.name} declares no ranges of its parameters ({names}): name them, for instance "
            f"'method.{plugin.fields[0].name if plugin.fields else 'NAME'}=interval(1,10)'"
        )
    return axes


def _choices(annotation: Any) -> tuple[Any, ...]:
    if annotation is bool:
        return (False, True)
    return _ordered(typing.get_args(annotation)) if typing.get_origin(annotation) is typing.Literal else ()


def grid_of(method: str) -> dict[str, list[Any]]:
    """The values over which the experiment ``tune_METHOD`` sweeps, by parameter; empty without one."""
    file = presets.files("experiment").get(f"tune_{method}")
    if file is None:
        return {}
    content = presets.content_of(file.path, file.text())
    swept = ((content.get("hydra") or {}).get("sweeper") or {}).get("params") or {}
    plugin = registry().find("method", method)
    found = {}
    for key, text in swept.items():
        name = str(key).removeprefix("method.")
        if name != key and name in defaults(plugin):
            found[name] = [_value(plugin, name, one) for one in _values(str(text))]
    return {name: values for name, values in found.items() if len(values) > 1}


def _values(text: str) -> list[Any]:
    from hydra.core.override_parser.overrides_parser import OverridesParser

    (override,) = OverridesParser.create().parse_overrides([f"x={text}"])
    return list(override.sweep_iterator()) if override.is_sweep_override() else [text]


def _of_grid(plugin: Plugin, name: str, usual: Mapping[str, Any], values: Sequence[Any]) -> Axis:
    """From the least to the greatest value of a grid of numbers; other grids are choices."""
    if len(values) < 2 or not all(map(_is_number, values)):
        return Axis(name, usual[name], choices=tuple(values))
    low, high = min(values), max(values)
    log = low > 0 and high / low >= FACTOR
    return _interval(plugin, name, usual, low, high, log=log, word=f"grid of {name}")
