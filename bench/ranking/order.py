"""The order of the metrics in a table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from .headline import primary_metrics


def metric_order(lines: Sequence[Mapping[str, Any]], wanted: Sequence[str] = ()) -> list[str]:
    """The metrics of a task's table: those wanted first, then measured distances (they have a floor), then counts.

    If none is wanted, the task's primary metrics come first. A metric that should be near the reference's own value
    describes a result rather than its quality, so these come last.
    """
    # The two parts of an F-score are shown to those who ask for them.
    hidden = ("\0",) if wanted else ("precision@", "recall@")
    wanted = list(wanted or (primary_metrics(lines[0]["task"]) if lines else ()))
    better = {line["metric"]: line["better"] for line in lines if line["metric"]}
    better = {m: b for m, b in better.items() if not m.startswith(hidden)}
    measured = {line["metric"] for line in lines if math.isfinite(line["floor"])}

    def key(name: str) -> tuple:
        place = wanted.index(name) if name in wanted else len(wanted)
        return place, ("lower", "higher", "reference").index(better[name]), name not in measured, name

    return sorted(better, key=key)
