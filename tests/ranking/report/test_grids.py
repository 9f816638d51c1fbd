"""Plain tables: what stands where, in each format."""

from bench.ranking.report.grids import Grid, rendered

GRID = Grid("title", ("name", "x", "y"), (("a", "-1.5", "2"), ("b_c", "3", "4")), ("a note",))


def test_the_terminal_has_columns_over_a_rule_as_wide_as_they_are():
    assert (
        rendered([GRID], "terminal")
        == """title
name  x     y
─────────────
a     -1.5  2
b_c   3     4

a note
"""
    )


def test_markdown_has_a_section():
    assert (
        rendered([GRID], "markdown")
        == """### title

| name | x | y |
| --- | --- | --- |
| a | -1.5 | 2 |
| b_c | 3 | 4 |

- a note
"""
    )


def test_latex_has_a_line_for_each():
    lines = [line for line in rendered([GRID], "latex").splitlines() if line.endswith(r"\\")]
    assert lines == [r"name & x & y \\", r"a & $-$1.5 & 2 \\", r"b\_c & 3 & 4 \\"]
