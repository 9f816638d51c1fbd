"""A recommendation as text for the terminal."""

from __future__ import annotations

import io
from collections.abc import Iterable
from textwrap import wrap

from ..text import duration, one_line, shortened
from .priors import nearest
from .recommendation import Recommendation
from .scan import Scan

WIDTH = 100  # of notes
MOST_MESSAGE = 200  # characters of a failure's message
LEGEND = (
    "A rank of 1-3: no method is significantly better than this one, and all but two others are significantly worse. "
    "Lower is better throughout; distances are in thousandths of the radius. score: three quarters of to mesh, a "
    "quarter of to points, others, and gaps by the share of the surface in holes; relative to the best. to mesh, to "
    "points: from the points of one half of the scan to the mesh of the other, and back. others: to the meshes of "
    "other methods. halves: between the meshes of the two halves. gaps: between the points of holes that were cut "
    "into the scan and the mesh of the rest. x noise: median distance of held-out points divided by the "
    "distance that noise alone causes. halves, x noise and the columns to their right do not count; pieces, "
    "open edges, seconds and memory are of the tried points."
)


def table(found: Recommendation) -> str:
    """The scans, the methods with their ranks and why, and the command that applies the first."""
    states = (_state(scan, of.hidden) for scan, of in zip(found.scans, found.evidence, strict=True))
    lines = [line for state in states for line in _wrapped(state)]
    lines += ["", *_methods(found), ""]
    for text in _notes(found):
        lines += _wrapped(text)
    lines += ["", *(f"  {one_line(found.command(candidate))}" for candidate in found.tied[:1])]
    return "\n".join(lines)


def _prior(scan: Scan) -> str:
    known = nearest(scan.state)
    errors = ", ".join(f"{name} {error:g}" for name, error in known.errors.items())
    return (
        f"{scan.name} is most like the clouds of the benchmark's sensor {known.sensor}, where the mean distance "
        f"to the truth was, with the usual parameters ({known.metric}, {known.shapes} shapes): {errors}."
    )


def _wrapped(text: str) -> list[str]:
    return wrap(one_line(text), WIDTH, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)


def _state(scan: Scan, hidden: float) -> str:
    state, unit = scan.state, scan.spacing * scan.frame.radius
    tried = "" if len(scan.cloud) == scan.total else f", of which {len(scan.cloud):,} are tried"
    normals = "no normals"
    if state.normals:
        normals = "normals"
        if state.contradicting > 0.05:
            normals += f", of which {state.contradicting:.0%} point opposite to their neighbours"
    return (
        f"{scan.name}: {scan.total:,} points{tried}, {unit:.3g} apart; noise about {state.noise * unit:.2g} "
        f"({state.noise:.2f} spacings, rough detail included); {state.outliers:.1%} outliers; density varies by "
        f"{state.density_variation:.0%}; {normals}; "
        + (f"about {hidden:.0%} of the surface lies in holes" if hidden else "no holes")
    )


def _methods(found: Recommendation) -> list[str]:
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    shown = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 2, 0, 0), header_style="")
    shown.add_column("method")
    titles = (
        "rank",
        "score",
        "to mesh",
        "to points",
        "others",
        "halves",
        "gaps",
        "x noise",
        "pieces",
        "open edges",
        "seconds",
        "peak MB",
    )
    for title in titles:
        shown.add_column(title, justify="right")
    verdict = found.verdict
    for place, candidate in found.ranked:
        low, high = verdict.low[place], verdict.high[place]
        seconds, peak = found.costs(place)
        above = found.above_noise(place)
        cells = [
            f"{low}-{high}" if low < high else f"{low}",
            f"{verdict.score[place]:.2f}",
            *(f"{1e3 * value:.3g}" if value else "" for value in verdict.criteria[place]),
            f"{above:.2f}" if above < 100 else "",
            _most(e.pieces[place] for e in found.evidence),
            _most(e.open_edges[place] for e in found.evidence),
            f"{seconds:.2g}",
            f"{peak:.0f}",
        ]
        shown.add_row(Text(one_line(candidate.label)), *cells)
    text = io.StringIO()
    Console(file=text, width=160, highlight=False).print(shown)
    return [line.rstrip() for line in text.getvalue().splitlines()]


def _most(values: Iterable[int]) -> str:
    return f"{max(values):,}"


def _notes(found: Recommendation) -> list[str]:
    tied = found.tied
    rest = (
        f", tied with {', '.join(c.label for c in tied[1:])}"
        if len(tied) > 1
        else ", significantly better than the others"
    )
    tried = max(len(scan.cloud) for scan in found.scans)
    largest = max(scan.total for scan in found.scans)
    seconds = found.costs(found.ranked[0][0])[0] * largest / tried
    texts = [
        f"First: {tied[0].label}{rest}. On all {largest:,} points it takes about {duration(seconds)} if time grows "
        "with their number.",
        LEGEND,
    ]
    texts += [_prior(scan) for scan in found.scans]
    for label, why in found.failed.items():
        texts.append(f"no rank: {label}: {shortened(one_line(why), MOST_MESSAGE)}")
    for index in found.solved:
        notes = {row[index].note for row in found.trials} - {""}
        texts += [f"{found.candidates[index].label}: {shortened(note, MOST_MESSAGE)}" for note in sorted(notes)]
    return texts
