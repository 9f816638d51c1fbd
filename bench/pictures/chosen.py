"""Which results a figure shows: the cases in its rows, and the methods in its columns."""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ..errors import UsageError, did_you_mean
from ..ranking.selection import Names, matching, select
from .labels import labels
from .shapes import PLACE

if TYPE_CHECKING:
    import pandas as pd

    from ..results.store import Results

ORDERED = ("dataset", "sensor")  # options whose order is that of the rows


def chosen(
    rows: pd.DataFrame,
    folders: Sequence[Results],
    *,
    task: Names = None,
    dataset: Names = None,
    sensor: Names = None,
    split: Names = None,
    method: Names = None,
    case: str | None = None,
    seed: int | None = None,
) -> pd.DataFrame:
    """The rows to show, with a column ``label``: cases in the order to show them, methods in that of their columns.

    Parameters
    ----------
    rows : DataFrame
    folders : sequence of Results
        Their origin.
    task, dataset, sensor, split : str or list of str
        As for :func:`bench.ranking.selection.select`; the order of datasets and sensors is kept.
    method : str or list of str
        Methods, presets, or labels as shown.
    case : str
        Numbers, or parts of ids, with commas; by default the first case of each dataset.
    seed : int
        The smallest by default.

    Raises
    ------
    UsageError
        For a name that no row has, and for results of several tasks.
    """
    filters = {"task": task, "dataset": dataset, "sensor": sensor, "split": split}
    rows = select(rows, **filters)
    kinds = sorted(set(rows["task"].str.partition("[")[0]))
    if len(kinds) > 1:
        raise UsageError(f"these are results of {', '.join(kinds)}: choose one with --task")
    rows = _of_seed(rows, seed)
    rows = rows.assign(label=labels(rows))
    order = ordered_labels(rows, method)
    rows = rows[rows["label"].isin(order)]
    rows = _of_cases(rows, case)
    ranks = {name: {value: i for i, value in enumerate(_order(name, filters[name], rows))} for name in ORDERED}
    ranks["label"] = {value: i for i, value in enumerate(order)}
    keys = rows.assign(**{name: rows[name].map(rank) for name, rank in ranks.items()})
    keys = keys.sort_values(["dataset", "sensor", "__case", "case_index", "label"], kind="stable")
    return rows.loc[keys.index].drop(columns="__case")


def split_names(text: str | None) -> list[str]:
    """``"a,b[c=1,d=2]"`` -> ``["a", "b[c=1,d=2]"]``."""
    return [name.strip() for name in re.split(r",(?![^\[(]*[\])])", text or "") if name.strip()]


def renamed(text: str | None, names: Sequence[str]) -> dict[str, str]:
    """The titles of columns: from ``poisson=Poisson,mine=Ours``, all others unchanged.

    Raises
    ------
    UsageError
        For an entry without an equals sign, or a name that is not shown.
    """
    found = {name: name for name in names}
    for word in split_names(text):
        name, equals, title = word.partition("=") if word not in found else (word, "", "")
        hits = [known for known in names if word.startswith(f"{known}=")]  # labels may have an equals sign themselves
        if hits:
            name = max(hits, key=len)
            equals, title = "=", word[len(name) + 1 :]
        if not equals:
            raise UsageError(f"--names {word}: expected NAME=TITLE, like poisson=Poisson")
        if name not in found:
            raise UsageError(f"--names {word}: {name!r} is not shown. {did_you_mean(name, names)}")
        found[name] = title
    return found


def _of_seed(rows: pd.DataFrame, seed: int | None) -> pd.DataFrame:
    seeds = sorted(rows["seed"].unique())
    wanted = seeds[0] if seed is None else seed
    if wanted not in seeds:
        raise UsageError(f"--seed {seed}: no result has this seed; the seeds are {', '.join(map(str, seeds))}")
    return rows[rows["seed"] == wanted]


def ordered_labels(rows: pd.DataFrame, method: Names) -> list[str]:
    """The labels to show, in the requested order, or by name.

    Raises
    ------
    UsageError
        For a name that is neither a method, nor a preset, nor a label of the rows.
    """
    known = dict(zip(rows["label"], rows["method"], strict=True))
    if method is None:
        return sorted(known)
    found: list[str] = []
    for name in split_names(method) if isinstance(method, str) else method:
        pattern = name.replace("[", "[[]")
        hits = sorted(k for k, m in known.items() if name in (k, m) or fnmatch.fnmatchcase(k, pattern))
        if not hits:
            raise UsageError(f"no result has method {name!r}. {did_you_mean(name, {*known, *known.values()})}")
        found.extend(hits)
    return list(dict.fromkeys(found))


def _of_cases(rows: pd.DataFrame, case: str | None) -> pd.DataFrame:
    """The rows of some cases, with the place of each in the requested order in ``__case``."""
    wanted = split_names(case) if case else ["0"]
    place: dict[Any, int] = {}
    for number, word in enumerate(wanted):
        hits = rows["case_index"] == int(word) if word.isdecimal() else rows["case"].str.contains(word, regex=False)
        if not hits.any():
            count = int(rows["case_index"].max()) + 1
            raise UsageError(
                f"--case {word}: no such case; expected a number below {count}, or a part of a case's name, like "
                f"{rows['case'].iloc[0]}"
            )
        for index in rows.index[hits]:
            place.setdefault(index, number)
    return rows.loc[list(place)].assign(__case=list(place.values()))


def _order(name: str, names: Names, rows: pd.DataFrame) -> list[str]:
    known = sorted(rows[name].unique())
    if names is None:
        return known
    asked = matching(name, names, [*known, *(_all(names) or ())])
    return [value for value in asked if value in known]


def _all(names: Names) -> list[str]:
    return split_names(names) if isinstance(names, str) else list(names or ())


def case_names(rows: pd.DataFrame) -> dict[tuple, str]:
    """The names of the rows of a figure by the place of their case: the case, and other differences between them."""
    places = rows[PLACE].drop_duplicates()
    shown = [name for name in ("task", "sensor", "split") if places[name].nunique() > 1]
    return {
        tuple(place): "\n".join([str(place[-1]), *(str(place[PLACE.index(name)]) for name in shown)])
        for place in places.itertuples(index=False)
    }
