"""The parts of a table to print: its columns, their blocks, its last lines, and the meaning of its signs."""

import pytest

from bench.ranking.report.table import FLOOR, Cell, Metric, Table, folded, standing_notes


def table(*cells, metrics=("aa", "bb", "cc"), **changes):
    """A table of one method, with these cells in each metric."""
    shown = cells or (Cell("1"),)
    columns = tuple(Metric(name, "lower", 0, shown) for name in metrics)
    return Table("task", "data", "", "test", ("one",), columns, **({"ranks": ("1",), "solved": ("4/4",)} | changes))


def blocks(made, room):
    """The names of the columns in each block, where a column is as wide as its name."""
    found = folded(made, room, lambda cells: len(cells[0]), lambda column: [column.name])
    return [[column.name for column in block] for block in found]


@pytest.mark.parametrize(
    ("room", "wanted"),
    [
        (16, [["rank", "aa", "bb", "cc", "solved"]]),
        (15, [["rank", "aa", "bb", "solved"], ["cc"]]),
        (14, [["rank", "aa", "bb", "solved"], ["cc"]]),
        (12, [["rank", "aa", "solved"], ["bb", "cc"]]),  # exactly as wide as there is room
        (11, [["rank", "aa", "bb", "cc"], ["solved"]]),  # no metric fits beside ranks and costs
        (6, [["rank", "aa"], ["bb", "cc"], ["solved"]]),
        (1, [["rank"], ["aa"], ["bb"], ["cc"], ["solved"]]),
    ],
)
def test_a_block_holds_what_fits_and_every_column_is_in_one(room, wanted):
    assert blocks(table(), room) == wanted


def test_a_new_block_has_all_the_room_again():
    made = table(metrics=("aa", "bbbbbbbbb", "ccc"), solved=())
    assert blocks(made, 12) == [["rank", "aa"], ["bbbbbbbbb", "ccc"]]
    assert blocks(made, 11) == [["rank", "aa"], ["bbbbbbbbb"], ["ccc"]]
    assert blocks(table(metrics=("a" * 20, "bb")), 15) == [["rank"], ["a" * 20], ["bb", "solved"]]


def test_columns_in_an_order_of_the_users_are_folded_in_it():
    made = table(order=("cc", "solved", "aa", "rank"))
    assert blocks(made, 14) == [["cc", "solved", "aa", "rank"]]
    assert blocks(made, 10) == [["cc", "solved", "aa"], ["rank"]] and blocks(made, 9) == [
        ["cc", "solved"],
        ["aa", "rank"],
    ]


def test_without_a_score_ranks_and_costs_are_folded_too():
    """Where every method failed there is no metric."""
    made = table(metrics=(), seconds=("-",))
    assert blocks(made, 17) == [["rank", "solved", "seconds"]]
    assert blocks(made, 16) == [["rank", "solved"], ["seconds"]]


def test_every_cost_is_a_column():
    made = table(metrics=(), fronts=("1",), seconds=("0.1",), memory=("90",), parameters=("1.3M",))
    cells = {column.name: (column.title, *column.texts) for column in made.columns}
    assert cells == {
        "rank": ("rank", "1"),
        "front": ("front", "1"),
        "solved": ("solved", "4/4"),
        "seconds": ("seconds", "0.1"),
        "peak_mb": ("peak MB", "90"),
        "params": ("params", "1.3M"),
    }


def test_last_lines_have_a_cell_for_each_column():
    first = Metric("a", "lower", 0, (Cell("1"),), feet=(Cell("2", best=True), Cell("3")))
    last = Metric("b", "lower", 0, (Cell("4"),), floor="9")
    made = Table("task", "data", "", "test", ("one",), (first, last), ranks=("1",), foot=("mean", "wins"))
    texts = {name: [cell(column).text for column in made.columns] for name, cell in made.feet}
    assert texts == {"mean": ["", "2", ""], "wins": ["", "3", ""]}
    assert made.best_notes == (True, False, False)


def test_without_last_lines_of_its_own_a_table_has_the_floors_of_what_it_shows():
    metrics = (Metric("a", "lower", 0, (Cell("1"),), floor="9"), Metric("b", "lower", 0, (Cell("2"),)))
    made = Table("task", "data", "", "test", ("one",), metrics, ranks=("1",))
    ((name, cell),) = made.feet
    assert (name, [cell(column).text for column in made.columns]) == (FLOOR, ["", "9", ""])
    hidden = Table("task", "data", "", "test", ("one",), metrics, ranks=("1",), order=("rank", "b"))
    assert hidden.feet == []


BEST, TIED, SECOND = Cell("1", best=True), Cell("1", tied=True), Cell("1", second=True)


@pytest.mark.parametrize(
    ("head", "second", "cells", "starts"),
    [
        (
            "method",
            "Italic",
            [BEST, TIED, SECOND],
            ["Bold: the best mean;", "≈: tied for first:", "Italic: the second"],
        ),
        ("method", "", [BEST, SECOND], ["Bold: the best mean;"]),
        ("method", "Italic", [BEST], ["Bold: the best mean;"]),
        ("method", "Italic", [TIED], ["≈: tied for first:"]),
        ("method", "Italic", [Cell("1")], []),
        ("case", "Italic", [BEST], ["Bold: the best of a line;"]),
        ("parameters", "Italic", [BEST, TIED, SECOND], ["Bold: the best.", "≈: not significantly worse: the interval"]),
        ("parameter", "", [BEST], ["Bold: the best."]),
        ("parameter", "", [TIED], ["≈: not significantly worse: the interval"]),
        ("parameter", "Italic", [Cell("1")], []),
    ],
)
def test_the_signs_that_a_table_has_are_explained(head, second, cells, starts):
    notes = standing_notes([table(), table(*cells, head=head)], "Bold", second)
    assert len(notes) == len(starts) and all(map(str.startswith, notes, starts))
