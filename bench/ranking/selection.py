"""Choosing rows of results by name: the filters of the leaderboard."""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Iterable, Sequence

import numpy as np
import pandas as pd

from ..errors import UsageError, did_you_mean
from ..geometry.traits import TAGS
from .naming import is_called, preset_of

Names = str | Iterable[str] | None


GROUP = ["task", "dataset", "sensor", "split"]  # one table each
UNIT = ["case", "seed", "condition"]  # the first one is the cluster: a shape; the others are its conditions
CONTENDER = ["method", "variant", "threads", "device", "host"]  # one line each

# Key columns of tables that rows of results may lack, and their defaults. ``condition`` is how the
# units of one case differ if sensors are pooled; rows read by other tools may have no ``split`` or no ``host``.
LATER = {"split": "test", "condition": "", "host": "unknown"}


def completed(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows with all key columns of tables."""
    missing = {name: value for name, value in LATER.items() if name not in rows}
    empty = {name: rows[name].fillna(LATER[name]) for name in LATER if name in rows and rows[name].hasnans}
    return rows.assign(**missing, **empty) if missing or empty else rows


def prepared(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows with all key columns of tables, and the host of each line in ``host``.

    A sweep over several machines may run some cases of a method here and some there: these stay one line, whose
    ``host`` names all machines. If two machines ran the *same* cases, their results are not averaged: each machine
    has a line of its own.
    """
    rows = completed(rows)
    if rows["host"].nunique() < 2:
        return rows
    who = CONTENDER[:-1]
    twice = rows.groupby([*GROUP, *UNIT, *who], dropna=False)["host"].transform("nunique") > 1
    apart = twice.groupby([rows[name] for name in who], dropna=False).transform("any")
    together = rows.groupby([*GROUP, *who], dropna=False)["host"].transform(_joined)
    return rows.assign(host=rows["host"].where(apart, together))


def _joined(hosts: pd.Series) -> str:
    return ", ".join(sorted({name for host in hosts for name in host.split(", ")}))


def select(
    rows: pd.DataFrame,
    *,
    task: Names = None,
    dataset: Names = None,
    sensor: Names = None,
    method: Names = None,
    tag: Names = None,
    split: Names = None,
) -> pd.DataFrame:
    """The rows that pass the filters.

    Parameters
    ----------
    rows : DataFrame
        One row per planned case, as returned by :meth:`bench.results.store.Results.rows`.
    task, dataset, sensor, method, tag, split : str or list of str
        Names, a list of them or one string with commas. A method is named by its plugin, its preset or
        ``plugin[variant]``. ``bumps`` stands for every ``bumps[...]`` too, and ``*``
        and ``?`` stand for anything.

    Raises
    ------
    UsageError
        For a name that no row has, with the nearest one; and if no row passes all filters.
    """
    rows = completed(rows)
    chosen = np.ones(len(rows), dtype=bool)
    wanted = {"task": task, "dataset": dataset, "sensor": sensor, "method": method, "split": split}
    for option, names in wanted.items():
        if names is not None:
            chosen &= (
                _called(rows, names)
                if option == "method"
                else rows[option].isin(matching(option, names, rows[option].unique())).to_numpy()
            )
    if tag is not None:
        tags = rows["tags"].map(_tags)
        known = sorted(set().union(*tags))
        tagged = set(matching("tag", tag, known))
        chosen &= np.fromiter((not tagged.isdisjoint(t) for t in tags), dtype=bool, count=len(rows))
    if not chosen.any() and len(rows):
        given = [f"{option}={names}" for option, names in {**wanted, "tag": tag}.items() if names is not None]
        raise UsageError(f"no result has {' and '.join(given)} together")
    return rows if chosen.all() else rows[chosen]


def _called(rows: pd.DataFrame, names: Names) -> np.ndarray:
    """(rows,) bool array: whose method has one of the names, by its plugin or, as in tables, by its preset."""
    pairs = rows[["method", "variant"]].drop_duplicates()
    variants: list[tuple[str, str]] = list(pairs.itertuples(index=False, name=None))
    heads = [preset_of(*pair)[0] for pair in variants]
    wanted = set()
    for name in split_names(names) or [""]:
        found = {pair for pair in variants if is_called(*pair, name)}
        if not found:
            matching("method", [name], {*rows["method"], *heads})  # refused, with the nearest one
        wanted |= found
    keys = rows["method"] + "\0" + rows["variant"]
    return keys.isin({f"{method}\0{variant}" for method, variant in wanted}).to_numpy()


SHAPES = 4  # fewer of one kind are not informative, and a chair, a gear and a tree would have a column each
GROUPINGS = ("task", "dataset", "sensor", "tag")


def pool(rows: pd.DataFrame, by: Names = None) -> pd.DataFrame:
    """The rows with all cases of other datasets and sensors put into one table, or into one for each challenge tag.

    A shape remains one case, whatever its number of sensors: they go into the column ``condition``, which makes
    each a unit of its own within the case. Shapes of different datasets are different cases, also if one dataset
    was run with several parameters: its label distinguishes them.

    Parameters
    ----------
    rows : DataFrame
    by : str or list of str
        The keys of tables besides the task: some of ``dataset``, ``sensor`` and ``tag``, or just ``task``; by
        dataset and sensor without it. A case with several tags counts under each; one with none is ``untagged``. A
        kind of thing (a tag that a dataset declares) makes a table where :data:`SHAPES` shapes or more are of it.

    Raises
    ------
    UsageError
        For another key.
    """
    if by is None:
        return prepared(rows)
    chosen = set(matching("by", by, GROUPINGS))
    rows = rows.copy()
    if "sensor" not in chosen:
        rows["condition"] = rows["sensor"]
        rows["sensor"] = "all sensors"
    group = [[name] for name in rows["dataset"]]
    if "dataset" not in chosen:
        rows["case"] = rows["dataset"] + "/" + rows["case"]  # two datasets may use one id
        group = [["all datasets"]] * len(rows)
    if "tag" in chosen:
        known = _groups(rows)
        tags = [sorted(_tags(value) & known) or ["untagged"] for value in rows["tags"]]
        shown = "{tag}" if "dataset" not in chosen else "{name} {tag}"
        group = [[shown.format(name=n[0], tag=t) for t in ts] for n, ts in zip(group, tags, strict=True)]
    rows["dataset"] = group
    return prepared(rows.explode("dataset", ignore_index=True))


def _groups(rows: pd.DataFrame) -> set[str]:
    """The tags that make a group: those that are measured, and declared ones that enough shapes have."""
    shapes: dict[str, set[tuple[str, str]]] = {}
    for dataset, case, value in zip(rows["dataset"], rows["case"], rows["tags"], strict=True):
        for tag in _tags(value):
            shapes.setdefault(tag, set()).add((dataset, case))
    return {tag for tag, of in shapes.items() if tag in TAGS or len(of) >= SHAPES}


def metrics_of(rows: pd.DataFrame, metric: Names = None) -> list[str]:
    """The metric keys that the rows have, those that ``metric`` names if given, in alphabetical order."""
    known = sorted(column.removeprefix("score.") for column in rows.columns if column.startswith("score."))
    return known if metric is None else sorted(matching("metric", metric, known))


def split_names(names: Names) -> list[str]:
    """``"cad,bumps[a=1,b=2]"`` -> ``["cad", "bumps[a=1,b=2]"]``."""
    parts = [names] if isinstance(names, str) else list(names or ())
    return [name.strip() for part in parts for name in re.split(r",(?![^\[]*\])", part) if name.strip()]


VIEWS = ("by", "across", "pareto", "columns")  # options for the display of results; the others select results


def matching(option: str, names: Names, known: Iterable[str]) -> list[str]:
    """Those of ``known`` that ``names`` mean, in the order of ``names``.

    Raises
    ------
    UsageError
        For a name that matches none.
    """
    known = sorted(known)
    found: list[str] = []
    wanted = split_names(names)
    if not wanted:
        raise UsageError(f"{option}: expected a name. {did_you_mean('', known)}")
    for name in wanted:
        pattern = name.replace("[", "[[]")
        hits = [k for k in known if name in (k, re.split(r"[\[@]", k)[0]) or fnmatch.fnmatchcase(k, pattern)]
        if not hits:
            what = f"--{option} {name}: no such name" if option in VIEWS else f"no result has {option} {name!r}"
            raise UsageError(f"{what}. {did_you_mean(name, known)}")
        found.extend(hits)
    return list(dict.fromkeys(found))


def _tags(value: object) -> frozenset[str]:
    parts = value.split(",") if isinstance(value, str) else value if isinstance(value, Sequence | np.ndarray) else ()
    return frozenset(str(part).strip() for part in parts if str(part).strip())
