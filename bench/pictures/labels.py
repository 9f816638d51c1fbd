"""The names of methods in pictures: as short as possible while distinct."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..ranking.naming import naming
from ..ranking.report.labels import setup, shown_setup, with_setup

if TYPE_CHECKING:
    import pandas as pd

    from ..results.store import Results

WHO = ["method", "variant", "threads", "device", "host"]


def labels(rows: pd.DataFrame) -> list[str]:
    """For each row the label of its method, as in tables.

    Device, threads and host follow if only these distinguish two rows.

    Parameters
    ----------
    rows : DataFrame
        With ``method``, ``variant``, ``threads``, ``device`` and ``host``.
    """
    lines = rows[WHO].fillna({"variant": "", "host": ""}).assign(metric="").to_dict("records")
    called = naming((line["method"], line["variant"]) for line in lines).labels
    distinct = {tuple(line.values()): line for line in lines}
    shown = shown_setup(distinct.values())
    return [with_setup(called[line["method"], line["variant"]], setup(line, shown)) for line in lines]


def folder_of(folders: Sequence[Results], row: Mapping[str, Any]) -> Results | None:
    """The folder that has the record of a row, preferably with its output."""
    having = [results for results in folders if results.path(row["cell"], row["fingerprint"]).is_file()]
    return next((results for results in having if results.output_of(row)), having[0] if having else None)
