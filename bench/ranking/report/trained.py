"""The notes of a table on learned methods: the duration, the device and the data of each training."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ...text import duration
from ..leaderboard import costs

if TYPE_CHECKING:
    import pandas as pd

GROUP_AND_CONTENDER = ("task", "dataset", "sensor", "split", "method", "variant", "threads", "device", "host")
FROM = {"shipped": "with weights that come with it, ", "trained": "", "file": "with weights of a file, "}


def trained(rows: pd.DataFrame | None) -> dict[tuple, str]:
    """A sentence for each learned method of each table, by table and contender."""
    if rows is None or "weights" not in rows or not rows["weights"].fillna("").any():
        return {}
    from ..selection import prepared

    learned = prepared(rows)  # all of them: the host of a line names the machines of its failures, too
    learned = learned[learned["weights"].fillna("") != ""]
    known = costs(rows)
    return {
        key: sentence(part.to_dict("records"))
        for key, part in learned.groupby(list(GROUP_AND_CONTENDER), sort=True)
        if key in known.index
    }


def sentence(rows: list[Mapping[str, Any]]) -> str:
    """``mpu: trained for 21 min on cuda on 40 train shapes of fbm, weights 3f2ab1``; of several trainings the range."""
    first = rows[0]
    trainings = {row["weights"]: row for row in rows}
    seconds = [s for row in trainings.values() if (s := _number(row.get("train_seconds"))) is not None]
    if not seconds:
        return f"{first['method']}: {FROM.get(first['weights_from'], '')}its training is not known."
    time = duration(min(seconds))
    time += f" to {duration(max(seconds))}" if duration(max(seconds)) != time else ""
    which = ", ".join(sorted(weights[:6] for weights in trainings))
    count = f"{len(trainings)} trainings, each " if len(trainings) > 1 else "trained "
    data = f" of {first['train_data']}" if first.get("train_data") else ""
    cases = _number(first.get("train_cases"))
    shapes = f" on {cases:,.0f} train shapes{data}" if cases else data
    steps = _number(first.get("train_steps"))
    return (
        f"{first['method']}: {FROM.get(first['weights_from'], '')}{count}for {time}"
        f"{f' ({steps:,.0f} steps)' if steps else ''} on {first['train_device'] or 'an unknown device'}{shapes}; "
        f"weights {which}."
    )


def _number(value: Any) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)
