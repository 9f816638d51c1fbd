"""What methods are called in pictures: as short as it can be while different methods have different names."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..errors import DetailbenchError
from ..ranking.report.labels import label, setup, shown_setup

if TYPE_CHECKING:
    import pandas as pd

    from ..results.store import Results

WHO = ["method", "variant", "threads", "device", "host"]


def labels(rows: pd.DataFrame, folders: Sequence[Results] = ()) -> list[str]:
    """For each row the label of its method.

    The name of its preset where its parameters are those of one; otherwise the method, with the parameters that differ
    between rows of this method. Device, threads and host follow where only these tell two rows apart.

    Parameters
    ----------
    rows : DataFrame
        With ``method``, ``variant``, ``threads``, ``device`` and ``host``.
    folders : sequence of Results
        Where the rows are from: presets are told by the parameters in the records. Without them no preset is named.
    """
    lines = rows[WHO].fillna({"variant": "", "host": ""}).to_dict("records")
    presets = preset_names(rows, folders) if folders else {}
    parts: dict[str, list[set[str]]] = {}
    for line in lines:
        parts.setdefault(line["method"], []).append(set(split_variant(line["variant"])))
    common = {method: set.intersection(*sets) for method, sets in parts.items()}
    for line in lines:
        own = [part for part in split_variant(line["variant"]) if part not in common[line["method"]]]
        preset = presets.get((line["method"], line["variant"]))
        line["metric"], line["variant"] = "", "" if preset else ",".join(own)
        line["method"] = preset or line["method"]
    distinct = list({tuple(line.values()): line for line in lines}.values())
    shown = shown_setup(distinct)
    return [label(line["method"], line["variant"], setup(line, shown)) for line in lines]


def split_variant(text: str) -> list[str]:
    """``"depth=9,steps=[a,b]"`` -> ``["depth=9", "steps=[a,b]"]``."""
    return [part for part in re.split(r",(?![^\[]*\])(?![^(]*\))", text or "") if part]


def preset_names(rows: pd.DataFrame, folders: Sequence[Results]) -> dict[tuple[str, str], str]:
    """The names of presets by method and variant, for parameters that are those of a preset which is installed here."""
    from ..plan.cell import Choice

    found = {}
    with_parameters = rows[rows["variant"].fillna("") != ""].drop_duplicates(["method", "variant"])
    for row in with_parameters.to_dict("records"):
        results = folder_of(folders, row)
        node = (results.meta(row["cell"], row["fingerprint"]).get("cell") or {}).get("method") if results else None
        if not isinstance(node, Mapping):
            continue
        try:
            choice = Choice("method", node["name"], node["parameters"])
            name = choice.label
        except (DetailbenchError, KeyError, TypeError, ValueError, AttributeError):
            continue
        if "[" not in name and name != choice.name:
            found[row["method"], row["variant"]] = name
    return found


def folder_of(folders: Sequence[Results], row: Mapping[str, Any]) -> Results | None:
    """The folder that has the record of a row, preferably with its output."""
    having = [results for results in folders if results.path(row["cell"], row["fingerprint"]).is_file()]
    return next((results for results in having if results.output_of(row)), having[0] if having else None)
