"""The columns of a table of points: which are coordinates, normals, colours and scalars, by their names or values."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Sequence

import numpy as np

from ...notices import notice
from .colors import color_scale
from .raw import NO_FACES, RawGeometry

# What the three columns of a triple are called, in lower case and with "_" for all that is no letter or digit.
AXES = ("x", "y", "z")
POINTS = (
    "{a}",
    "p{a}",
    "pos_{a}",
    "position_{a}",
    "point_{a}",
    "coord_{a}",
    "{a}_coord",
    "{a}_coordinate",
    "points_{i}",
)
NORMALS = ("n{a}", "normal_{a}", "normal{a}", "normals_{a}", "n_{a}", "norm_{a}", "normals_{i}", "normal_{i}")
COLORS = (
    "{c}",
    "{w}",
    "color_{c}",
    "colour_{c}",
    "rgb_{c}",
    "diffuse_{w}",
    "color_{w}",
    "{w}_color",
    "rgb_{i}",
    "{c}f",
)
MAPS = (("easting", "northing", "height"), ("east", "north", "up"), ("e", "n", "h"))
HEIGHTS = ("z", "height", "elevation", "altitude", "alt", "h", "up")
UNITS = re.compile(r"[\[(].*?[\])]|_(?:m|mm|cm|km|ft|in|us_ft)$")
UNIT_LENGTH, MOST_OTHER = 0.05, 0.1  # of normals: tolerance, and the share of them that may have another length
TWIN = 0.2  # by how much the correlation of three columns must exceed that of others that may be colours as well


def plain_name(name: str) -> str:
    """A column's name in lower case, without units in brackets, with ``_`` for all that is no letter or digit."""
    name = UNITS.sub("", name.strip().strip("\"'").lower())
    return re.sub(r"\W+", "_", name).strip("_")


def geometry_of(table: np.ndarray, names: Sequence[str], name: str, *, lone: str = "") -> RawGeometry:
    """The points in a table, with their normals, colours and scalars.

    Parameters
    ----------
    table : (n, c) float64 array, c at least 3
    names : c names of columns, or none
        Without names the first three columns are coordinates. Of the others three in a row are normals if their lengths
        are 1 (or 0), colours if they are whole numbers from 0 to 255 or to 65,535, or any from 0 to 1; what is left
        are scalars. A notice reports the interpretation.
    name : of the file, for messages
    lone : the name of a single scalar if there are no names
    """
    groups = _by_name(names)
    if groups is None:
        if names:
            said = ", ".join(names)[:60]
            notice(
                f"{name}: the names of its columns ({said}) do not say which are x, y and z; the first three are used"
            )
        return _by_values(table, name, lone)
    rest = [k for k in range(table.shape[1]) if not any(k in group for group in groups.values())]
    normals = table[:, groups["normals"]] if "normals" in groups else None
    colors = None
    if "colors" in groups:
        triple = table[:, groups["colors"]]
        if scale := color_scale(triple, named=True):
            colors = triple / scale
        else:
            notice(f"{name}: its colours are not from 0 to 1, 255 or 65535; they are kept as scalars")
            rest = sorted([*rest, *groups["colors"]])
    scalars = {}
    for k in rest:
        if not plain_name(names[k]) and np.array_equal(table[:, k], np.arange(len(table))):
            continue  # the numbers of the rows, which pandas writes
        label = plain_name(names[k]).removeprefix("scalar_") or f"column_{k + 1}"
        label = label if label not in scalars else f"{label}_{k + 1}"
        if not np.isnan(table[:, k]).all():
            scalars[label] = table[:, k].copy()
    return RawGeometry(table[:, groups["points"]], NO_FACES, normals, colors, scalars)


def are_normals(triple: np.ndarray) -> bool:
    """Whether the vectors (n, 3) have unit length, within a few per cent; some may be zero or not finite."""
    lengths = np.linalg.norm(np.clip(triple[np.isfinite(triple).all(axis=1)], -9, 9), axis=1)  # no square is infinite
    lengths = lengths[lengths > 0]
    return bool(len(lengths) and (np.abs(lengths - 1) > UNIT_LENGTH).mean() <= MOST_OTHER)


def names_for(scalars: Iterable[str], taken: Iterable[str]) -> list[str]:
    """Names of scalars as a file can have them: letters, digits and ``_``, none twice, none that is ``taken``."""
    used, names = set(taken) | {"x", "y", "z"}, []
    for scalar in scalars:
        plain = re.sub(r"\W+", "_", scalar, flags=re.ASCII).strip("_") or "scalar"
        plain = f"scalar_{plain}" if plain in used or plain[0].isdigit() else plain
        name = next(n for k in itertools.count(1) if (n := plain if k == 1 else f"{plain}_{k}") not in used)
        used.add(name)
        names.append(name)
    return names


def smallest_float(values: np.ndarray) -> str:
    """``f4`` if that keeps all values, otherwise ``f8``."""
    with np.errstate(over="ignore"):
        return "f4" if np.array_equal(values, values.astype(np.float32), equal_nan=True) else "f8"


def _by_name(names: Sequence[str]) -> dict[str, list[int]] | None:
    """The columns of points, normals and colours; None where no three names are those of coordinates."""
    plain = [plain_name(name) for name in names]
    points = _triple(plain, POINTS)
    for group in MAPS:
        points = points or _found(plain, group)
    if points is None and {"x", "y"} <= set(plain):
        points = next((found for z in HEIGHTS if (found := _found(plain, ("x", "y", z)))), None)
    if points is None:
        return None
    groups = {"points": points}
    for kind, forms in (("normals", NORMALS), ("colors", COLORS)):
        left = [word if k not in points else "" for k, word in enumerate(plain)]
        if found := _triple(left, forms):
            groups[kind] = found
    return groups


def _triple(plain: list[str], forms: Sequence[str]) -> list[int] | None:
    for form in forms:
        words = [form.format(a=a, i=i, c="rgb"[i], w=("red", "green", "blue")[i]) for i, a in enumerate(AXES)]
        if found := _found(plain, words):
            return found
    return None


def _found(plain: list[str], words: Sequence[str]) -> list[int] | None:
    return [plain.index(word) for word in words] if all(word in plain for word in words) else None


def _by_values(table: np.ndarray, name: str, lone: str) -> RawGeometry:
    """The groups of a table whose columns have no names."""
    count = table.shape[1]
    left = set(range(3, count))
    if count == 3:
        return RawGeometry(table, NO_FACES)
    said = []
    normals = colors = None
    starts = [k for k in range(3, count - 2) if are_normals(table[:, k : k + 3])]
    if starts:
        normals = table[:, starts[0] : starts[0] + 3]
        left -= set(range(starts[0], starts[0] + 3))
        said.append(f"columns {starts[0] + 1}-{starts[0] + 3} for normals (of length 1)")
    starts = [k for k in range(3, count - 2) if {k, k + 1, k + 2} <= left and color_scale(table[:, k : k + 3])]
    if starts:
        first = _likeliest(table, starts)
        triple = table[:, first : first + 3]
        scale = color_scale(triple)
        colors = triple / scale
        left -= set(range(first, first + 3))
        said.append(f"columns {first + 1}-{first + 3} for colours (0 to {scale:g})")
    labels = {k: lone if lone and len(left) == 1 else f"column_{k + 1}" for k in sorted(left)}
    if labels:
        listed = ", ".join(str(k + 1) for k in labels)
        called = lone if list(labels.values()) == [lone] else "scalars"
        said.append(f"column{'s' * (len(labels) > 1)} {listed} for {called}")
    if normals is None or len(said) > 1:  # x y z nx ny nz is what such files are by custom
        notice(f"{name}: its columns have no names; uses {'; '.join(said)}")
    return RawGeometry(table[:, :3], NO_FACES, normals, colors, {label: table[:, k] for k, label in labels.items()})


def _likeliest(table: np.ndarray, starts: list[int]) -> int:
    """Of triples that may be colours the one whose columns go together, else the last: intensity comes first."""
    if len(starts) == 1:
        return starts[0]
    sample = table[:: max(1, len(table) // 10_000)]

    def together(start: int) -> float:
        values = sample[:, start : start + 3]
        values = values[np.isfinite(values).all(axis=1)]
        if len(values) < 3 or not np.ptp(values, axis=0).all():
            return 0.0
        return float(np.corrcoef(values.T)[np.triu_indices(3, 1)].min())

    best = max(starts, key=together)
    return best if together(best) > together(starts[-1]) + TWIN else starts[-1]
