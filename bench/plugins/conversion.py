"""From JSON values to the types of an annotation, and back; a value that does not fit is refused at any depth.

The types that a parameter may have: ``int``, ``float``, ``str``, ``bool``, ``Path``, enums, ``Literal``, ``Any``, and
``list[T]``, ``tuple[T, ...]``, ``tuple[A, B]``, ``dict[str, T]`` and ``A | B | None`` of these, nested at will.

The only silent conversion is ``int`` where a ``float`` is expected: ``true`` is not 1, and ``"3"`` is not 3.
"""

from __future__ import annotations

import enum
import math
import types
import typing
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Literal, Union

from ..errors import PluginError, UsageError, did_you_mean

ALLOWED = "int, float, str, bool, Path, Literal, an enum, list, tuple, dict[str, ...], or a union of these and None"
SCALARS = {bool: "true or false", int: "a whole number", float: "a number", str: "a text", Path: "a path"}


def check_type(annotation: Any, where: str) -> None:
    """Raise :class:`PluginError`, which begins with ``where``, for a type that configs and records cannot hold."""
    origin, args = _split(annotation)
    if origin in (None, Any, Literal) or origin in SCALARS or _is_enum(origin):
        return
    if origin not in (Union, list, tuple, dict):
        raise PluginError(f"{where}: a config cannot hold the type {annotation!r}; use {ALLOWED}")
    if origin is dict and args:
        key = args[0]
        texts = _split(key)[0] is Literal and all(isinstance(a, str) for a in _split(key)[1])
        if not (key is str or texts or _is_enum(key)):
            raise PluginError(f"{where}: the keys of {annotation!r} are not strings; use dict[str, ...]")
    for arg in args:
        if arg is not Ellipsis:
            check_type(arg, where)


def convert(value: Any, annotation: Any, where: str) -> Any:
    """``value``, made of JSON values, converted to ``annotation``.

    Parameters
    ----------
    value : None, bool, int, float, str, or a list or mapping of these; values that are converted already pass too
    annotation : a type that :func:`check_type` accepts
    where : str
        The parameter, for messages: ``method.depth``; indices and keys are appended.

    Raises
    ------
    UsageError
        Naming the place, what was expected and, where there is a choice, the nearest right value.
    """
    origin, args = _split(annotation)
    if origin is Any:
        return value
    if origin in _CONTAINERS:
        return _CONTAINERS[origin](value, args, annotation, where)
    found = _scalar(value, origin, args)
    if found is _REFUSED:
        raise _refusal(value, annotation, where)
    return found


def is_text(annotation: Any) -> bool:
    """Whether every value of a type except null is written as text: ``str``, paths, enums, choices of texts."""
    origin, args = _split(annotation)
    if origin is Union:
        return all(is_text(a) for a in args if _split(a)[0] is not None)
    if origin is Literal:
        return all(isinstance(a, str) for a in args)
    return origin in (str, Path) or _is_enum(origin)


def plain(value: Any) -> Any:
    """The value as JSON, the inverse of :func:`convert`: paths and enums as text, tuples as lists."""
    if isinstance(value, enum.Enum):
        return value.name
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, Mapping):
        return {str(plain(k)): plain(v) for k, v in value.items()}
    return value


def describe(annotation: Any) -> str:
    """The name of a type's values in messages: ``a list of whole numbers`` is ``a list (each a whole number)``."""
    origin, args = _split(annotation)
    if origin is Any:
        return "any value"
    if origin is None:
        return "null"
    if origin is Literal or _is_enum(origin):
        names = [str(plain(a)) for a in _choices(origin, args)]
        return names[0] if len(names) == 1 else f"one of {', '.join(names)}"
    if origin is Union:
        return " or ".join(dict.fromkeys(describe(a) for a in args))
    if origin is dict:
        return f"a mapping {{key: value}}{_each('each value ', args[1:])}"
    if origin is tuple and args and args[-1] is not Ellipsis:
        return f"a list of {len(args)} ({', '.join(describe(a) for a in args)})"
    if origin in (list, tuple):
        return f"a list [...]{_each('each ', args[:1])}"
    return f"{SCALARS[origin]} ({origin.__name__})"


def _each(word: str, args: tuple[Any, ...]) -> str:
    return f" ({word}{describe(args[0])})" if args and args[0] is not Any else ""


# -- one type each -----------------------------------------------------------------------------------------------------

_REFUSED = object()


def _split(annotation: Any) -> tuple[Any, tuple[Any, ...]]:
    """The type itself (a scalar, ``None``, ``Literal``, ``Union``, ``list``, ...), and its arguments."""
    if annotation is None or annotation is type(None):
        return None, ()
    origin, args = typing.get_origin(annotation), typing.get_args(annotation)
    return Union if origin is types.UnionType else origin or annotation, args


def _is_enum(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, enum.Enum)


def _choices(origin: Any, args: tuple[Any, ...]) -> tuple[Any, ...]:
    return args if origin is Literal else tuple(origin)


def _scalar(value: Any, origin: Any, args: tuple[Any, ...]) -> Any:
    """The converted value, or :data:`_REFUSED`."""
    if origin is None:
        return None if value is None else _REFUSED
    if origin is Literal:  # 1 == True == 1.0: the type matters too
        return next((a for a in args if type(a) is type(value) and a == value), _REFUSED)
    if _is_enum(origin):
        if isinstance(value, origin):
            return value
        return origin.__members__.get(value, _REFUSED) if isinstance(value, str) else _REFUSED
    if origin is float:
        fits = type(value) in (int, float) and not math.isnan(value)
        return float(value) if fits else _REFUSED
    if origin is Path:
        return Path(value) if isinstance(value, (str, Path)) else _REFUSED
    return value if type(value) is origin else _REFUSED


def _sequence(value: Any, args: tuple[Any, ...], annotation: Any, where: str, make: Callable[[Iterable], Any]) -> Any:
    if not isinstance(value, (list, tuple)):
        raise _refusal(value, annotation, where)
    if not args:
        return make(value)
    fixed = make is tuple and args[-1] is not Ellipsis
    if fixed and len(value) != len(args):
        raise UsageError(f"{where}={_shown(value)}: expected {describe(annotation)}, got {len(value)} of them")
    each = args if fixed else (args[0],) * len(value)
    return make(convert(v, a, f"{where}[{i}]") for i, (v, a) in enumerate(zip(value, each, strict=True)))


def _mapping(value: Any, args: tuple[Any, ...], annotation: Any, where: str) -> dict[Any, Any]:
    if not isinstance(value, Mapping):
        raise _refusal(value, annotation, where)
    if not args:
        return dict(value)
    return {convert(k, args[0], f"{where}, key"): convert(v, args[1], f"{where}.{plain(k)}") for k, v in value.items()}


def _union(value: Any, args: tuple[Any, ...], annotation: Any, where: str) -> Any:
    """The first member that accepts the value, preferably without conversion: 3 stays 3 in ``float | int``."""
    members = sorted(args, key=lambda a: _split(a)[0] is not type(value))
    errors = {}
    for member in members:
        try:
            return convert(value, member, where)
        except UsageError as error:
            errors[member] = error
    alike = [m for m in members if isinstance(value, _HELD_BY.get(_split(m)[0], ()))]
    others = [m for m in members if _split(m)[0] is not None]
    if len(alike) == 1 or len(others) == 1:  # the intended member is clear: report the error within it
        raise errors[(alike if len(alike) == 1 else others)[0]]
    raise _refusal(value, annotation, where)


_CONTAINERS: dict[Any, Callable[..., Any]] = {
    list: partial(_sequence, make=list),
    tuple: partial(_sequence, make=tuple),
    dict: _mapping,
    Union: _union,
}
_HELD_BY = {list: (list, tuple), tuple: (list, tuple), dict: (Mapping,)}


def _refusal(value: Any, annotation: Any, where: str) -> UsageError:
    """The expected value, and for a text the nearest valid choice."""
    origin, args = _split(annotation)
    names = []
    for member in args if origin is Union else (annotation,):
        kind, parts = _split(member)
        names += [str(plain(a)) for a in _choices(kind, parts)] if kind is Literal or _is_enum(kind) else []
    near = did_you_mean(value, names) if names and isinstance(value, str) else ""
    got = f". {near}" if near.startswith("Did you mean") else "" if near else f", got {_kind(value)}"
    return UsageError(f"{where}={_shown(value)}: expected {describe(annotation)}{got}")


def _kind(value: Any) -> str:
    """The type of a value, in the words of :func:`describe`."""
    if isinstance(value, str):
        return f"the text {_shown(value)!r}"
    if value is None:
        return "null"
    if isinstance(value, float) and math.isnan(value):
        return "not a number (nan)"
    if isinstance(value, (list, tuple)):
        return "a list"
    if isinstance(value, Mapping):
        return "a mapping"
    return f"{SCALARS[type(value)]} ({type(value).__name__})" if type(value) in SCALARS else type(value).__name__


def _shown(value: Any) -> str:
    """A value as one would type it, shortened if it is long."""
    text = "null" if value is None else str(value).lower() if isinstance(value, bool) else str(plain(value))
    return text if len(text) <= 60 else f"{text[:57]}..."
