"""The name of a method with its parameters in tables: its preset, and the differences from that.

Rows hold the plugin and the parameters that are not default, ``idf`` and ``omega=30,resolution=192``. A table shows
``idf_30 (resolution=192)``: the preset is one whose parameters are all present, and of several the one with the
most. So old results have these names too, and a preset that changes later does not name results that it no longer fits.
"""

from __future__ import annotations

import fnmatch
import functools
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from ..errors import UsageError, did_you_mean
from ..plugins.presets import variants

LONGEST = 60  # characters of a label; parameters that do not fit go into a note

Method = tuple[str, str]  # plugin and variant, as in rows


@dataclass(frozen=True)
class Naming:
    """The labels of the methods of one table, and the notes about them."""

    labels: Mapping[Method, str]
    notes: tuple[str, ...] = ()


def naming(methods: Iterable[Method], names: Mapping[str, str] | None = None) -> Naming:
    """Labels that are different for different methods.

    Parameters
    ----------
    methods : iterable of (plugin, variant)
        Those of one table. A parameter with the same value in all of them is left out, and noted.
    names : mapping, optional
        Other names for them: by label, preset, plugin, or ``plugin[variant]``.
    """
    known = list(dict.fromkeys(methods))
    found = {method: preset_of(*method) for method in known}
    found = {m: (m[0], parts_of(m[1])) if _is_swept(m, found) else one for m, one in found.items()}
    twice = Counter(found.values())
    found = {m: (m[0], parts_of(m[1])) if twice[one] > 1 else one for m, one in found.items()}
    rests = [set(rest) for _, rest in found.values()]
    shared = set.intersection(*rests) if len(rests) > 1 else set()
    plain = {m: label(head, [part for part in rest if part not in shared]) for m, (head, rest) in found.items()}
    heads, plugins = Counter(head for head, _ in found.values()), Counter(method for method, _ in found)
    new = {m: _renamed(m, head, plain[m], names or {}, heads, plugins) for m, (head, _) in found.items()}
    labels = {m: text if (other := new[m]) is None else other for m, text in plain.items()}
    often = Counter(labels.values())
    labels = {m: plain[m] if often[text] > 1 else text for m, text in labels.items()}  # names are unique
    notes = []
    if shared:
        first = next(iter(found.values()))[1]
        notes.append(f"All methods: {', '.join(part for part in first if part in shared)}.")
    short = {method: _shortened(text) for method, text in labels.items()}
    often = Counter(short.values())
    for method, text in short.items():
        if often[text] == 1 and text != labels[method]:
            notes.append(f"{text}: {labels[method]}.")
            labels[method] = text
    return Naming(labels, tuple(notes))


def label(head: str, parts: Iterable[str]) -> str:
    """``poisson (depth=9, trim=0.1)``."""
    inside = ", ".join(parts)
    return f"{head} ({inside})" if inside else head


def parts_of(variant: str) -> tuple[str, ...]:
    """The parameters of a variant, one each: ``"radii=[1, 2],depth=9"`` -> ``("radii=[1, 2]", "depth=9")``."""
    found: list[str] = []
    depth = 0
    for piece in variant.split(","):
        if found and (depth > 0 or "=" not in piece):  # a comma within a value
            found[-1] += f",{piece}"
        elif piece:
            found.append(piece.strip())
        depth += sum(map(piece.count, "[(")) - sum(map(piece.count, "])"))
    return tuple(found)


def preset_of(method: str, variant: str) -> tuple[str, tuple[str, ...]]:
    """The preset that matches a method with its parameters, and its further parameters.

    The plugin itself with all its parameters if none matches.
    """
    parts = parts_of(variant)
    fitting = [(own, name) for name, own in _presets(method) if own <= set(parts)] if parts else []
    if not fitting:
        return method, parts
    own, name = min(fitting, key=lambda one: (-len(one[0]), one[1]))
    return name, tuple(part for part in parts if part not in own)


def is_called(method: str, variant: str, name: str) -> bool:
    """Whether ``name`` means this method: its plugin, its preset, ``plugin[variant]``; ``*`` stands for anything.

    So do its labels, of its preset and, as in the table of a sweep, of its plugin with all parameters.
    """
    head, rest = preset_of(method, variant)
    whole = f"{method}[{variant}]" if variant else method
    pattern = name.replace("[", "[[]")
    labels = {label(head, rest), label(method, parts_of(variant))}
    return any(fnmatch.fnmatchcase(one, pattern) for one in {method, head, whole, *labels})


def check_names(names: Mapping[str, str], tables: Iterable[Iterable[Method]], others: Iterable[str]) -> None:
    """Refuse a new name for something that no table has: neither a method, as :func:`naming` knows it, nor a column.

    Raises
    ------
    UsageError
        With the nearest existing name.
    """
    shown, columns = [list(methods) for methods in tables], set(others)
    for old in names:
        renamed = (text for methods in shown for text in naming(methods, {old: "\0"}).labels.values())
        if old not in columns and not any(text.startswith("\0") for text in renamed):
            known = {name for methods in shown for m in methods for name in (m[0], preset_of(*m)[0])} | columns
            raise UsageError(f"--names {old}={names[old]}: no table has {old!r}. {did_you_mean(old, sorted(known))}")


def _is_swept(method: Method, found: Mapping[Method, tuple[str, tuple[str, ...]]]) -> bool:
    """Whether the preset is one value of a sweep: others of its plugin have other values, and no names."""
    plugin, variant = method
    head, rest = found[method]
    named = {_key(part) for part in parts_of(variant) if part not in rest} if head != plugin else set()
    others = [parts for (other, _), (name, parts) in found.items() if other == plugin and name == plugin]
    return any(named.intersection(map(_key, parts)) for parts in others)


def _key(part: str) -> str:
    return part.partition("=")[0]


def _renamed(
    method: Method, head: str, plain: str, names: Mapping[str, str], heads: Counter[str], plugins: Counter[str]
) -> str | None:
    """The label that the user wants; None if the user names nothing for this method.

    A new name of a plugin or a preset applies to all of its variants: several in a table keep their parameters.
    """
    whole = f"{method[0]}[{method[1]}]" if method[1] else method[0]
    for key in (plain, label(method[0], parts_of(method[1])), whole):
        if key in names:
            return names[key]
    if head in names:
        return names[head] + (plain.removeprefix(head) if heads[head] > 1 else "")
    if method[0] in names:
        return names[method[0]] + (label("", parts_of(method[1])) if plugins[method[0]] > 1 else "")
    return None


def _shortened(text: str) -> str:
    """A long label with the first parameters, as many as fit."""
    if len(text) <= LONGEST or " (" not in text:
        return text
    head, _, inside = text.partition(" (")
    kept: list[str] = []
    for part in parts_of(inside.removesuffix(")").replace(", ", ",")):
        if len(label(head, [*kept, part, "…"])) > LONGEST:
            break
        kept.append(part)
    return label(head, [*kept, "…"])


@functools.cache
def _parts(variant: str) -> frozenset[str]:
    return frozenset(parts_of(variant))


def _presets(method: str) -> list[tuple[str, frozenset[str]]]:
    return [(name, _parts(changed)) for name, changed in variants("method", method).items()]
