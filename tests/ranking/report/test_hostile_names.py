"""Names and messages of somebody else's results are text in every printed form."""

from __future__ import annotations

import csv
import functools
import io
import re
from html.parser import HTMLParser
from types import SimpleNamespace

import pandas as pd
import pytest
from boards import row, rows

from bench.ranking.agreement import agreement
from bench.ranking.best import best
from bench.ranking.by_case import by_case
from bench.ranking.leaderboard import leaderboard
from bench.ranking.report import FORMATS, in_format, render
from bench.ranking.report.agreement import render_agreement
from bench.ranking.report.best_tables import best_tables
from bench.ranking.report.case_tables import case_tables
from bench.ranking.report.cells import csv as as_csv
from bench.ranking.report.cells import plain_texts
from bench.ranking.report.grids import Grid, rendered
from bench.ranking.report.look import Look
from bench.ranking.report.markdown import escape
from bench.ranking.report.score_table import Score, score_table
from bench.ranking.report.worst_tables import worst_tables
from bench.ranking.worst import worst
from bench.text import OBEYED

ESCAPES = "\x1b[31m\x1b]0;t\x07\x9b5m\r\x7f\u202e\u2028"
VISIBLE = r"\x1b[31m\x1b]0;t\x07\x9b5m\r\x7f\u202e\u2028"
NAMES = {
    "escapes": f"a\nb\r\nc\t{ESCAPES}b",
    "markup": "[bold]a[/]|b:smile: `c` ~d~ *e* ![x](http://e) [y](http://e) <img src=x onerror=y> <script>z</script>",
    "formula": r'=HYPERLINK("http://e") & \input{x} $y$ % # _ ^ ~ {',
}


def frame_of(name: str) -> pd.DataFrame:
    texts = dict.fromkeys(("dataset", "sensor", "host", "variant", "weights", "train_data", "train_device"), name)
    texts |= {"weights_from": "trained", "train_seconds": 60.0}
    records = [row(f"{name}{k}", case, 0, {name: 0.1 * (k + 1)}, **texts) for k in range(2) for case in "abcd"]
    failed = row(f"{name}2", "a", 0, **texts | {"message": f"{name}\n{name}"})
    noted = {"message": name, f"input.{name}": 1.0}
    return rows(records[0] | noted, *records[1:], failed)


@pytest.fixture(scope="module", params=NAMES.values(), ids=NAMES.keys())
def frame(request):
    made = frame_of(request.param)
    return request.param, made, leaderboard(made)


@pytest.mark.parametrize("format", [*FORMATS, "color"])
def test_no_control_character_is_printed(frame, format):
    name, made, board = frame
    text = render(board, format.replace("color", "terminal"), rows=made, color=format == "color")
    if format == "color":
        assert "\x1b[1m" in text
        text = re.sub(r"\x1b\[[012]?m", "", text)  # of the table itself
    assert not re.search(rf"(?!\n)[{OBEYED}]", text)
    if format in ("terminal", "color"):
        assert "[bold]" not in name or "[bold]a[/]|b:smile: `c`" in text
    if ESCAPES in name:
        assert VISIBLE in text.replace(r"\textbackslash{}", "\\").replace(r"\\", "\\")


def test_a_method_is_one_line(frame):
    _, made, board = frame
    texts = [render(b, "terminal", rows=r, width=100_000) for r, b in ((made, board), plain())]
    assert len(texts[0].splitlines()) == len(texts[1].splitlines())


@functools.cache
def plain():
    made = frame_of("plain")
    return made, leaderboard(made)


def test_markdown_has_as_many_cells_and_no_tags(frame):
    _, made, board = frame
    text = render(board, "markdown", rows=made)
    lines = [line for line in text.splitlines() if line.startswith("|")]
    assert len({len(re.findall(r"(?<!\\)\|", line)) for line in lines}) == 1
    assert len(lines) == len(
        [li for li in render(plain()[1], "markdown", rows=plain()[0]).splitlines() if li[:1] == "|"]
    )
    assert not re.search(r"(?<!\\)(<|`)", text) and not re.search(r"(?<!\\)\[[^\]]*\]\(", text)
    found = []
    parser = HTMLParser()
    parser.handle_starttag = lambda tag, attrs: found.append(tag)
    parser.feed(re.sub(r"\\.", "", text))
    assert not found


def test_latex_has_no_command_of_a_name(frame):
    _, made, board = frame
    text = render(board, "latex", rows=made)
    body = "\n".join(line for line in text.splitlines() if not line.startswith("% "))  # comments are whole lines
    assert r"\input" not in text and not re.search(r"(?<!\\)%", body)
    cells = [line for line in text.splitlines() if line.endswith(r"\\")]
    assert len({len(re.findall(r"(?<!\\)&", line)) for line in cells}) <= 2  # of one tabular each


@pytest.fixture(scope="module", params=["cases", "worst", "best"])
def other_tables(frame, request):
    name, made, _ = frame
    if request.param == "cases":
        return case_tables(*map(plain_texts, by_case(made, by="case")))
    if request.param == "worst":
        (found,) = worst(made, f"{name}2".replace("*", "?"))
        return worst_tables(found, 4)
    variants = [made.assign(variant=f"{name}={v}", split="train", method=f"{name}m", worst=0.0) for v in "xy"]
    return best_tables(best(plain_texts(pd.concat(variants, ignore_index=True))))


@pytest.mark.parametrize("format", ["terminal", "markdown", "latex"])
def test_the_other_tables_show_names_as_text(other_tables, format):
    text = in_format(other_tables, format, Look())
    assert not re.search(rf"(?!\n)[{OBEYED}]", text)
    if format == "latex":
        assert r"\input" not in text and not re.search(r"(?<!\\)%", re.sub("^% .*", "", text, flags=re.MULTILINE))
    if format == "markdown":
        lines = [line for line in text.splitlines() if line.startswith("|")]
        assert lines and not any(re.search(r"(?<!\\)(<(?!br>)|`)", line) for line in lines)


# -- CSV ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("first", ["=", "+", "-", "@", "\t=", "\r=", "\n=", "＝"])
def test_a_text_is_no_formula(first):
    text = f"{first}cmd|' /C calc'!A0"
    (cell,) = csv.DictReader(io.StringIO(as_csv(pd.DataFrame({"name": [text]}))))
    assert cell["name"][0] in "'\\" and cell["name"].endswith(text.strip()[1:])


@pytest.mark.parametrize("value", [-0.5, "-0.5", "+1e5", "-inf", "a=b", "", "depth=9,trim=0.1", "-"])
def test_numbers_and_other_texts_stay(value):
    text = as_csv(pd.DataFrame({"x": [value], "y": [-1.5]}))
    back = next(csv.DictReader(io.StringIO(text)))
    assert back == {"x": "'-" if value == "-" else str(value), "y": "-1.5"}


def test_the_csv_of_a_board_with_a_formula():
    made = frame_of(NAMES["formula"])
    back = list(csv.DictReader(io.StringIO(render(leaderboard(made), "csv"))))
    for name in ("method", "dataset", "variant", "host", "metric"):
        assert {line[name][:2] for line in back} == {"'="}, name


# -- other tables ------------------------------------------------------------------------------------------------------


def test_two_orders_side_by_side():
    name = f"={ESCAPES}|<b>"
    records = [
        row(f"{name}{k}", case, 0, {name: 0.1 * (k + 1)}, dataset=dataset, tags=name)
        for dataset in (f"{name}1", "other") for k in range(3) for case in "abcd"
    ]  # fmt: skip
    found = agreement(rows(*records), "other")
    texts = {format: render_agreement(found, format) for format in FORMATS}
    for text in texts.values():
        assert "x1b[31m" in text and not re.search(rf"(?!\n)[{OBEYED}]", text)
    assert r"'=\x1b" in texts["csv"] and not re.search(r"(^|,)=", texts["csv"], re.MULTILINE)


@pytest.mark.parametrize("format", ["terminal", "markdown", "latex"])
def test_a_grid(format):
    found = [rendered([Grid(n, (n, n), ((n, n),), (n,))], format) for n in (f"a\nb{ESCAPES}", "plain")]
    assert not re.search(rf"(?!\n)[{OBEYED}]", found[0])
    assert len(found[0].splitlines()) == len(found[1].splitlines())


def test_a_message_keeps_its_lines_for_its_printer():
    found = plain_texts(pd.DataFrame({"message": ["a\nb"], "name": ["a\nb"], "size": [1]}))
    assert found.to_dict("records") == [{"message": "a\nb", "name": r"a\nb", "size": 1}]


@pytest.mark.parametrize("name", ["[/]", "[bold]x", "[link=y]z[/link]", ":smile:", ESCAPES])
def test_the_table_of_scores(name):
    case = SimpleNamespace(frame=SimpleNamespace(radius=1.0), seed=0)
    text = score_table({name: Score(0.5, None, "lower")}, case, 10, {name: "does not apply"})
    assert (VISIBLE if name == ESCAPES else name) in text.splitlines()[2]


def test_brackets_of_intervals_are_no_links():
    assert escape("0.1 [0.05, 0.2]") == "0.1 [0.05, 0.2]"
    assert escape("[a](b)") == r"\[a](b)" and escape("![a][b]") == r"!\[a][b]"
