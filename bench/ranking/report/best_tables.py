"""The tables of the best parameters: the variants of a method, and the effect of each parameter."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

from ...text import counted
from ..best import Best, Effect, Variant
from ..naming import parts_of
from ..resolution import FEWEST
from .look import Look
from .numbers import column_digits, plain, unit_exponent, with_interval
from .table import Cell, Metric, Table

if TYPE_CHECKING:
    import pandas as pd

MOST = 30  # lines of a table of variants
DEFAULTS = "(the defaults)"


def best_tables(found: Iterable[Best], look: Look | None = None) -> list[Table]:
    """Two tables for each method: its variants, and the effects of its parameters."""
    look = look or Look()
    return [table for one in found for table in (_variants(one, look), _effects(one, look)) if table.methods]


def frame_of(found: Iterable[Best]) -> pd.DataFrame:
    """All variants in full precision, for CSV."""
    import pandas as pd

    columns = ("task", "dataset", "sensor", "split", "method", "variant", "metric", "better", "geometric_mean")
    columns += ("ratio", "ratio_low", "ratio_high", "solved", "planned", "seconds_median", "shapes")
    lines = [
        (*b.group, b.method, v.variant, b.metric, b.better, v.mean, v.ratio, v.low, v.high, v.solved, v.planned)
        + (v.seconds, b.shapes)
        for b in found
        for v in b.variants
    ]
    return pd.DataFrame(lines, columns=list(columns))


def _variants(one: Best, look: Look) -> Table:
    shown = one.variants[:MOST]
    ratios = [_ratio(v, i == 0) for i, v in enumerate(shown)]
    what = f"geometric mean over all cases, {counted(one.shapes, 'shape')}; a failed case has the worst pseudo-method's"
    notes = [
        f"{what} score.",
        *_tie_note(one),
        *([f"Fewer than {FEWEST} shapes: no interval of a ratio ({one.shapes})."] if one.shapes < FEWEST else []),
        *one.edges,
        *([f"The CSV has {counted(len(one.variants) - MOST, 'more variant')}."] if len(one.variants) > MOST else []),
        *one.notes,
        *_split_note(one),
    ]
    return Table(
        *one.group,
        methods=tuple(", ".join(parts_of(v.variant)) or DEFAULTS for v in shown),
        metrics=(_means(one, shown, look), Metric("ratio", "", 0, tuple(ratios), title="ratio")),
        solved=tuple(f"{v.solved}/{v.planned}" for v in shown),
        seconds=tuple(plain(v.seconds) for v in shown),
        notes=tuple(notes),
        head="parameters",
        subject=one.method,
        caption=look.caption,
    )


def _effects(one: Best, look: Look) -> Table:
    ratios = (Cell(plain(e.ratio, digits=3), best=e.ratio == 1) for e in one.effects)
    counts = (Cell(str(e.variants)) for e in one.effects)
    return Table(
        *one.group,
        methods=tuple(f"{e.parameter}={e.value}" for e in one.effects),
        metrics=(
            _means(one, one.effects, look),
            Metric("ratio", "", 0, tuple(ratios), title="ratio"),
            Metric("variants", "", 0, tuple(counts), title="variants"),
        ),
        notes=(
            "one parameter at a time: the geometric mean over all variants with that value, of those settings of the "
            "others that were run with all values; ratio: to its best value.",
        ),
        head="parameter",
        subject=f"{one.method}: effects",
    )


def _means(one: Best, shown: Iterable[Variant | Effect], look: Look) -> Metric:
    values = [line.mean for line in shown]
    exponent = unit_exponent(values)
    digits = look.digits
    if digits is None:  # a digit more than a table of means has: variants of one method are close to each other
        digits = min(4, 1 + column_digits(((value, math.nan, math.nan) for value in values), exponent))
    cells = (Cell(plain(value, exponent, digits)) for value in values)
    return Metric(one.metric, one.better, exponent, tuple(cells), title=look.names.get(one.metric, ""))


def _ratio(variant: Variant, first: bool) -> Cell:
    if not math.isfinite(variant.ratio):
        return Cell("-")
    if first:
        return Cell("1", best=True)
    return Cell(with_interval(variant.ratio, variant.low, variant.high, digits=3), tied=variant.is_tied)


def _tie_note(one: Best) -> list[str]:
    first, *others = one.variants
    if math.isnan(first.low):
        return []
    tied = sum(variant.is_tied for variant in others)
    return [f"ratio: to the best, with its {one.level:.0%} interval over shapes; it holds 1 for {tied} of the others."]


def _split_note(one: Best) -> list[str]:
    if one.group[3] == "train":
        return []
    return ["Chosen on test shapes: on these the winner looks better than it is. Tune on split=train, judge on test."]
