"""Performance profiles: the share of cases on which a method is within a factor of the best one.

E. D. Dolan and J. J. Moré, "Benchmarking optimization software with performance profiles", *Math. Program.* 91, 2002.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from ...errors import UsageError
from ...ranking.selection import UNIT
from .style import chart, looks, name_width, names_at_ends, plain_log

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .kinds import Options
    from .scores import Scores

FARTHEST = 30.0  # the largest factor that is drawn


def ratios(values: np.ndarray, direction: str) -> np.ndarray:
    """How many times worse than the best each method is on each unit.

    Parameters
    ----------
    values : (units, k) array
        Scores of 0 or more; NaN where a method failed.
    direction : str
        ``lower`` or ``higher``.

    Returns
    -------
    (units, k) array
        1 for the best; infinite for a failure, and if imperfect where another is perfect. A unit on which all failed
        is infinite for all.
    """
    is_lower = direction == "lower"
    known = np.isfinite(values)
    filled = np.where(known, values, np.inf if is_lower else 0.0)
    best = (filled.min(axis=1) if is_lower else filled.max(axis=1))[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        found = filled / best if is_lower else best / filled
    return np.where(known, np.where(filled == best, 1.0, np.where(np.isnan(found), np.inf, found)), np.inf)


def table(scores: Scores, options: Options) -> pd.DataFrame:
    """The steps of each method's curve: from a factor on, the share of units that are within it."""
    if scores.direction not in ("lower", "higher"):
        raise UsageError(f"--metric {scores.metric}: has no direction (lower or higher), so no method is the best")
    rows = scores.pooled()
    value = pd.to_numeric(rows[f"score.{scores.metric}"]).where(rows["status"] == "ok")
    keys = [rows[name] for name in UNIT]
    values = value.groupby([*keys, rows["label"]], dropna=False).mean().unstack("label").reindex(columns=scores.order)
    if (values < 0).to_numpy().any():
        raise UsageError(f"--metric {scores.metric}: has scores below 0, which have no ratios")
    run = rows.groupby([*keys, "label"], dropna=False).size().unstack("label").reindex(columns=scores.order)
    whole = run.notna().all(axis=1)  # compared on the units planned for all methods
    if not whole.any():
        raise UsageError("no case was run with all of these methods; choose fewer with --method")
    found = ratios(values[whole].to_numpy(dtype=float), scores.direction)
    finite = found[np.isfinite(found)]
    end = float(min(FARTHEST, max(1.5, finite.max() * 1.02))) if len(finite) else 1.5
    parts = [_steps(name, found[:, i], end, scores) for i, name in enumerate(scores.order)]
    table = pd.concat(parts, ignore_index=True)
    left = int((~whole).sum())
    table.attrs["notes"] = [f"{int(whole.sum())} cases, seeds and sensors"] + (
        [f"{left} left out, on which not all of these methods were run"] if left else []
    )
    return table


def _steps(name: str, ratio: np.ndarray, end: float, scores: Scores) -> pd.DataFrame:
    factors = np.unique(np.r_[1.0, ratio[ratio <= end], end])
    shares = [(ratio <= factor * (1 + 1e-12)).mean() for factor in factors]
    return pd.DataFrame(
        {
            "method": name,
            "title": scores.titles[name],
            "metric": scores.metric,
            "factor": factors,
            "share": shares,
        }
    )


def draw(table: pd.DataFrame, scores: Scores, options: Options) -> Figure:
    """A step curve for each method, with its name at its end."""
    width = options.size[0]
    figure, axes = chart(width, options.size[1] or 0.72 * width, right=name_width(scores.titles) + 0.22)
    look, ends = looks(scores.order), {}
    for name in scores.order:
        line = table[table["method"] == name]
        x, y = line["factor"].to_numpy(), 100 * line["share"].to_numpy()
        axes.step(x, y, where="post", color=look[name].color, linestyle=look[name].line)
        ends[name] = (x[-1], y[-1])
    axes.set_xscale("log")
    axes.set_xlim(1, table["factor"].max())
    axes.set_ylim(0, 102)
    plain_log(axes.xaxis)
    axes.set_xlabel(f"factor of the best {scores.metric}")
    axes.set_ylabel("% of cases within the factor")
    names_at_ends(axes, ends, scores.titles, look, table.groupby("method")["share"].mean().to_dict())
    return figure
