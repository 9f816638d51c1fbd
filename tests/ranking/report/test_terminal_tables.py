"""Tables and remarks of the terminal: every cell below its heading, within the width, and each message there."""

import re

import pytest
from boards import row, rows

from bench.ranking.report.table import FLOOR, Cell, Metric, Plain, Table
from bench.ranking.report.terminal import MOST_MESSAGE, MOST_REMARKS, NOTES, heading, remarks, terminal, wrapped
from bench.ranking.selection import CONTENDER, GROUP

FIRST = (Cell("1.0 [0.9, 1.1]", best=True), Cell("20.0", mark="†", tied=True, below="[19.0, 21.0]"), Cell("9.0"))
SECOND = (Cell("0.5", second=True), Cell(""), Cell("0.25"))
MARKUP = "[b]x[/b] :smile:"  # of rich


@pytest.fixture
def table():
    metrics = (Metric("one", "lower", -3, FIRST, floor="0.1"), Metric("two", "higher", 0, SECOND, title=MARKUP))
    names = ("a", "long one §", "b")
    changes = {"ranks": ("1", "2-3", "2-3"), "solved": ("8/8", "17/18", MARKUP), "notes": ("Mine.",)}
    return Table("t", "d", "", "test", names, metrics, **changes)


def cut(line, starts):
    """The parts of a line that begin at these columns."""
    return [line[a:b].rstrip() for a, b in zip(starts, [*starts[1:], None], strict=True)]


def test_each_cell_stands_below_its_heading(table):
    title, head, rule, *lines = terminal([table]).splitlines()
    assert title == "t · d" and set(rule) == {"─"} and len(rule) == len(head)
    starts = [head.index(name) for name in ("method", "rank", "one ↓ (1e-3)", f"{MARKUP} ↑")]
    assert starts[0] == 0
    end = head.index("solved") + len("solved")
    for line, solved in zip((lines[0], lines[1], lines[3]), ("8/8", "17/18", MARKUP), strict=True):
        assert line.endswith(f"  {solved}") and len(line) == end  # numbers end where their heading ends
    found = [cut(line[: end - len(MARKUP)], starts) for line in lines[:5]]
    assert found == [
        ["a", "1", "1.0 [0.9, 1.1]*", "0.5"],
        ["long one §", "2-3", "20.0≈†", ""],
        ["", "", "[19.0, 21.0]", ""],
        ["b", "2-3", "9.0", "0.25"],
        [FLOOR, "", "0.1", ""],
    ]
    assert lines[5:7] == ["", "Mine."] and lines[7].startswith("*: the best mean")


def test_the_best_is_bold_and_the_second_underlined_but_no_blanks(table):
    text = terminal([table], color=True)
    pieces = re.findall(r"\x1b\[(\d+)m(.*?)\x1b\[0m", text)
    assert ("1", "1.0 [0.9, 1.1]*") in pieces and ("4", "0.5") in pieces and ("2", "[19.0, 21.0]") in pieces
    assert ("1", "t · d") in pieces and ("2", FLOOR) in pieces and ("2", "Mine.") in pieces
    assert {style for style, _ in pieces} == {"1", "2", "4"}  # numbers and names have no colours of their own
    assert all(inside.strip() for _, inside in pieces)
    plain = re.sub(r"\x1b\[\d+m", "", text).splitlines()
    wanted = terminal([table]).splitlines()
    assert plain[:9] == wanted[:9]
    assert "Underlined: the second best mean." in plain and "Underlined: the second best mean." not in wanted


@pytest.mark.parametrize("columns", [1, 2, 3, 6, 10])
def test_a_block_is_as_wide_as_the_terminal_and_no_wider(columns):
    metrics = tuple(Metric(f"m{i:02}", "lower", 0, (Cell("1.0000"),)) for i in range(20))
    made = Table("t", "d", "", "test", ("m" * 9,), metrics)
    width = 9 + columns * (3 + 6)  # the name, and behind a gap each column

    def heads(width):
        text = terminal([made], width)
        assert max(map(len, text.splitlines())) <= width
        return [re.findall(r"m\d\d", line) for line in text.splitlines() if "↓" in line]

    names = [metric.name for metric in metrics]
    assert heads(width) == [names[i : i + columns] for i in range(0, 20, columns)]
    if columns > 1:
        assert len(heads(width - 1)[0]) == columns - 1


@pytest.mark.parametrize(
    ("column", "text"),
    [
        (Metric("d", "lower", 0, ()), "d ↓"),
        (Metric("d", "higher", -6, ()), "d ↑ (1e-6)"),
        (Metric("d", "reference", 3, (), title="count"), "count →ref (1e3)"),
        (Metric("d", "difference", 0, ()), "d |diff| ↓"),
        (Metric("d", "", 0, ()), "d"),
        (Plain("peak_mb", "peak MB", ()), "peak MB"),
    ],
)
def test_a_heading_has_the_direction_and_the_unit(column, text):
    assert heading(column) == text


def test_notes_are_as_wide_as_the_terminal_and_names_of_files_stay_whole():
    path = "p" * 200
    short, long, file = wrapped(["word " * 10, "word " * 60, f"{'word ' * 10}{path}"], 10)
    assert short == ("word " * 10).strip() and file.splitlines()[1] == f"  {path}"
    assert [len(line) <= NOTES for line in long.splitlines()] == [True] * 4
    assert all(line.startswith("  word") for line in long.splitlines()[1:])
    assert len(wrapped(["word " * 60], 150)[0].splitlines()) == 3


# -- what failed -------------------------------------------------------------------------------------------------------


def told(*messages):
    """What is said of cases that failed with these messages, which are of different kinds."""
    made = rows(*(row("a", f"case-{i}", 0, message=message) for i, message in enumerate(messages)))
    board = made[[*GROUP, *CONTENDER]].drop_duplicates().assign(metric="d")
    return remarks(board, made).splitlines()


@pytest.mark.parametrize(("n", "more"), [(MOST_REMARKS, 0), (MOST_REMARKS + 1, 1), (MOST_REMARKS + 9, 9)])
def test_more_messages_than_anybody_reads_are_counted(n, more):
    lines = told(*(f"message {'x' * (i + 1)}" for i in range(n)))
    assert lines[:2] == ["", "Not solved"]
    start = "  a: 1 error (reconstruct · bumps · samples): "
    assert [line.startswith(start) for line in lines[2 : 2 + MOST_REMARKS]] == [True] * MOST_REMARKS
    others = f"{more} other message{'s' * (more > 1)}"
    rest = [f"  and {others}; the rows of the results have them all"] if more else []
    assert lines[2 + MOST_REMARKS :] == rest


def test_a_long_message_is_cut_with_a_sign():
    whole, over = "x" * MOST_MESSAGE, "y" * (MOST_MESSAGE + 1)
    lines = told(whole, over)
    assert lines[2].endswith(f": {whole}") and lines[3].endswith(f": {over[2:]}…")
    assert told("one\n  two\tthree")[2] == "  a: 1 error (reconstruct · bumps · samples): one two three"


def test_only_methods_of_the_table_are_remarked_on():
    made = rows(row("a", "x", 0), row("b", "x", 0))
    board = made[made["method"] == "a"][[*GROUP, *CONTENDER]].assign(metric="d")
    assert remarks(board, made).splitlines()[2:] == ["  a: 1 error (reconstruct · bumps · samples): boom"]
    assert remarks(board, made[made["method"] == "b"]) == ""
