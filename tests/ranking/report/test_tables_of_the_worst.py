"""The tables of the worst cases, from cases that are written down."""

import math

import pandas as pd
import pytest

from bench.ranking.report.terminal import heading
from bench.ranking.report.worst_tables import worst_tables
from bench.ranking.worst import COLUMNS, Tag, Worst

CASE = {
    "task": "t", "dataset": "bumps", "sensor": "noisy", "split": "test", "case": "a", "seed": 0, "tags": "thin,smooth",
    "metric": "d", "value": 3.25, "best_method": "other", "best_value": 1.25, "ratio": 2.6,
    "status": "ok", "message": "",
}  # fmt: skip


def found(*changes, better="lower", order="ratio", tags=()):
    cases = pd.DataFrame([CASE | change for change in changes], columns=COLUMNS)
    return Worst("t", "test", "mine", "d", better, order, cases, tags)


def table(*changes, count=10, **options):
    return worst_tables(found(*changes, **options), count)[0]


def columns(*changes, **options):
    return {heading(m): [cell.text for cell in m.cells] for m in table(*changes, **options).metrics}


def test_the_columns_of_a_case():
    assert columns({}, {"case": "b", "value": 12.5, "ratio": math.inf, "best_value": 0.25}) == {
        "dataset": ["bumps", "bumps"],
        "sensor": ["noisy", "noisy"],
        "mine": ["3.25", "12.50"],
        "best other": ["1.25", "0.25"],
        "which": ["other", "other"],
        "ratio": ["2.60", "-"],
        "tags": ["thin, smooth", "thin, smooth"],
        "status": ["ok", "ok"],
    }


def test_what_a_case_lacks_is_empty():
    """A failure of unknown worth, and a case that no other method was run on."""
    lines = ({"value": math.nan, "ratio": math.nan, "tags": None}, {"best_value": math.nan, "best_method": math.nan})
    shown = columns(*lines)
    assert (shown["mine"], shown["best other"], shown["which"]) == (["-", "3.25"], ["1.25", "-"], ["other", ""])
    assert (shown["tags"], shown["ratio"]) == (["", "thin, smooth"], ["-", "2.60"])
    assert "sensor" not in columns({"sensor": ""})


def test_seeds_are_shown_where_there_are_several_even_if_not_among_the_first():
    assert "seed" not in columns({}, {"case": "b"})
    assert columns({"seed": 3}, {"seed": 4})["seed"] == ["3", "4"]
    assert columns({"seed": 3}, {"seed": 4}, count=1)["seed"] == ["3"]


@pytest.mark.parametrize(
    ("better", "value", "subject"),
    [
        ("lower", 3.25, "mine by d ↓"),
        ("higher", 3.25, "mine by d ↑"),
        ("reference", 3.25, "mine by d |diff| ↓"),
        ("lower", 0.00325, "mine by d ↓ (1e-3)"),
    ],
)
def test_the_title_has_the_direction_and_the_unit(better, value, subject):
    made = table({"value": value, "best_value": value}, better=better)
    assert made.title == f"t · {subject}" and made.metrics[2].cells[0].text == "3.25"


def test_notes_say_what_is_first_what_is_left_out_and_why_there_are_no_tags():
    lines = [{"case": name} for name in "abcdefgh"]
    first, more, tags = table(*lines, count=2).notes
    assert "ratio to the best other method" in first and more == "6 more cases: --count 8 shows all."
    assert tags == "No tag is among the worst shapes, or all shapes have the same."
    first, few = table(*lines[:7], order="score").notes
    assert "by the score;" in first and few == "Only 7 shapes: a test of tags takes 8."
    two_seeds = table(*lines[:7], *(line | {"seed": 1} for line in lines[:7]), count=14)
    assert two_seeds.notes[1] == few  # shapes count, not cases


def test_tags_with_their_shares_and_chances():
    tags = (Tag("thin", 3, 3, 3, 12, 0.0004, 0.0008), Tag("odd", 2, 3, 6, 12, 0.5, 0.5))
    first, second = worst_tables(found({}, tags=tags), 10)
    assert len(first.notes) == 2  # and why there are no tags is left to a table without
    cells = {m.name: [cell.text for cell in m.cells] for m in second.metrics}
    assert second.methods == ("thin", "odd") and cells == {
        "among the worst": ["3/3", "2/3"],
        "among all": ["3/12", "6/12"],
        "p": ["0.0004", "0.500"],
        "p, corrected": ["0.0008", "0.500"],
    }
    assert second.notes[0] == "Over-represented among the worst shapes: thin."
    _, other = worst_tables(found({}, tags=tags[1:]), 10)
    assert other.notes[0].startswith("No tag is significantly over-represented")
