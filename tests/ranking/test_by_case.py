"""Cases in lines and methods in columns: values, means and wins against pandas by hand, in every format."""

import io

import numpy as np
import pandas as pd
import pytest
from boards import row, rows, table

from bench.commands.leaderboard import Output, show_by_case
from bench.errors import UsageError
from bench.ranking.by_case import COLUMNS, by_case, without_case
from bench.ranking.report import FORMATS, in_format
from bench.ranking.report.case_tables import case_tables
from bench.ranking.report.look import Look
from bench.ranking.report.tables import FAILED_NOTE, LEFT_OUT_NOTE

CASES = ["plate", "bracket", "knot", "chain", "bowl"]


@pytest.fixture(scope="module")
def frame():
    rng = np.random.default_rng(3)
    return rows(
        *(
            row(method, case, seed, {"d": rng.lognormal(0, 0.5), "f": rng.random()}, sensor=sensor, case_index=i)
            for method in ("b_method", "a_method", "c_method")
            for i, case in enumerate(CASES)
            for seed in (0, 1)
            for sensor in ("noisy", "scanned")
        )
    )


def pivot(frame, metric="score.d"):
    return frame.pivot_table(index="case", columns="method", values=metric, aggfunc="mean").loc[CASES]


def test_without_a_metric_it_is_the_first_of_the_board(frame):
    scores, board = by_case(frame, by="case,task")
    assert set(board["metric"]) == {"d", "f"}
    assert scores["metric"].unique().tolist() == board["metric"].unique().tolist()[:1]


def test_values_means_and_wins(frame):
    scores, board = by_case(frame, by="case,task", metric="d")
    wanted = pivot(frame)
    assert set(scores["case"]) == {f"bumps/{case}" for case in CASES}
    scores = scores.assign(case=scores["case"].str.removeprefix("bumps/"))
    found = scores.pivot(index="case", columns="method", values="value").loc[CASES]
    pd.testing.assert_frame_equal(found, wanted, check_names=False)
    (table,) = case_tables(scores, board)
    assert table.methods == tuple(CASES)
    for column in table.metrics:
        mean, wins = (cell.text for cell in column.feet)
        assert float(mean) == pytest.approx(wanted[column.name].mean(), abs=0.006)
        assert int(wins) == (wanted.idxmin(axis=1) == column.name).sum()
    assert [c.best for column in table.metrics for c in column.cells].count(True) == len(CASES)


def test_cases_keep_their_order_and_sensors_their_tables(frame):
    scores, board = by_case(frame, by="case", metric="d")
    first, second = case_tables(scores, board)
    assert first.methods == second.methods == tuple(CASES) and {first.sensor, second.sensor} == {"noisy", "scanned"}
    assert first.subject == "d ↓" and first.head == "case"
    assert scores.index.is_unique  # one frame of both tables


def test_cases_of_several_datasets_are_in_the_order_of_each():
    """By the dataset first, then as it numbers its cases: ids are in no order, and two datasets number alike."""
    made = rows(
        *(
            row(m, case, 0, {"d": 1.0}, dataset=dataset, case_index=i)
            for dataset, cases in (("cad", ("nut", "gear")), ("bumps", ("z", "y", "x")))
            for i, case in enumerate(cases)
            for m in "ab"
        )
    )
    scores, board = by_case(made, by="case,task", metric="d")
    cases = ["bumps/z", "bumps/y", "bumps/x", "cad/nut", "cad/gear"]
    assert scores["case"].tolist() == [case for case in cases for _ in "ab"]
    assert [table.methods for table in case_tables(scores, board)] == [tuple(cases)]


def test_tables_without_a_metric_do_not_hide_the_others():
    """Another task has no chamfer distance, and on the hardest dataset nothing was solved."""
    made = rows(
        *(row(m, c, 0, {"d": 1.0, "f": 2.0}, dataset="cad") for m in "ab" for c in "wxyz"),
        *(row(m, c, 0, {"e": 1.0}, task="denoise") for m in "ab" for c in "wxyz"),
        *(row(m, c, 0, None, dataset="fbm") for m in "ab" for c in "wxyz"),
    )
    for metric, wanted in {
        None: [("denoise", "bumps", "e"), ("reconstruct", "cad", "d")],
        "d": [("reconstruct", "cad", "d")],
        "f,e,d": [("denoise", "bumps", "e"), ("reconstruct", "cad", "f"), ("reconstruct", "cad", "d")],
    }.items():
        scores, board = by_case(made, by="case", metric=metric)
        found = scores[["task", "dataset", "metric"]].drop_duplicates()
        assert list(found.itertuples(index=False, name=None)) == wanted
        assert len(scores) == 8 * len(wanted)
        titles = [(one.task, one.dataset, one.subject.removesuffix(" ↓")) for one in case_tables(scores, board)]
        assert titles == wanted
    with pytest.raises(UsageError, match="chamfer"):
        by_case(made, by="case", metric="chamfer")


def test_results_of_unknown_machines_have_lines_too():
    made = rows(*(row(m, c, 0, {"d": 1.0}, host=None) for m in "ab" for c in "wxyz"))
    scores, board = by_case(made, by="case", metric="d")
    assert len(scores) == 8
    (table,) = case_tables(scores, board)
    assert [(column.feet[1].text, column.feet[1].best) for column in table.metrics] == [("4", True)] * 2


def test_higher_is_better_where_the_metric_declares_it(frame):
    up = frame.assign(directions='{"d": "lower", "f": "higher"}')
    scores, _ = by_case(up, by="case,task", metric="f")
    best = scores[scores["best"] == 1].set_index("case")["method"]
    assert best.loc[[f"bumps/{case}" for case in CASES]].tolist() == pivot(up, "score.f").idxmax(axis=1).tolist()


def test_ties_count_for_each_and_failures_for_nobody():
    made = rows(
        *(row(m, c, 0, {"d": 1.0}, worst={"d": 5.0}) for m in "ab" for c in "wxyz"),
        row("c", "w", 0, None, worst={"d": 5.0}),
        *(row("c", c, 0, {"d": 0.5}, worst={"d": 5.0}) for c in "xyz"),
    )
    scores, board = by_case(made, by="case", metric="d")
    wins = scores.groupby("method")["best"].sum()
    assert wins.to_dict() == {"a": 1, "b": 1, "c": 3}
    (table,) = case_tables(scores, board)
    failed = next(c for c in table.metrics if c.name == "c").cells[0]
    assert (failed.text, failed.mark, failed.best) == ("5.00", "†", False)
    assert FAILED_NOTE in table.notes and LEFT_OUT_NOTE not in table.notes


@pytest.mark.parametrize(
    ("values", "wins"),
    [
        ((1e-6, 1.1e-6), (1, 0)),  # small is not equal
        ((1e6 * (1 + 1e-12), 1e6), (1, 1)),  # but rounding decides nothing
        ((0.1 + 0.2, 0.3), (1, 1)),
        ((0.0, 0.0), (1, 1)),
        ((0.0, 1e-12), (1, 0)),
        ((-2.0, -2.0 - 1e-12), (1, 1)),
    ],
)
def test_a_tie_is_one_up_to_rounding(values, wins):
    made = rows(*(row(m, "w", 0, {"d": value}) for m, value in zip("ab", values, strict=True)))
    scores, board = by_case(made, by="case", metric="d")
    assert tuple(scores["best"]) == wins
    (found,) = case_tables(scores, board)
    assert {column.name: column.feet[1].best for column in found.metrics} == dict(zip("ab", wins, strict=True))


def test_a_table_by_hand():
    """One method failed at unknown cost; two are about as good, and the others surely worse."""
    scores = {
        "good": (1.0, 2.0, 3.0, 4.0, 5.0),
        "near": (1.1, 1.9, 3.1, 4.2, 4.9),
        "bad": (3.0, 6.0, 9.0, 12.0, 15.0),
        "worse": (3.2, 6.0, 9.2, 13.0, 16.0),
        "fails": (None, 2.0, 3.0, 4.0, 5.5),
    }
    made = table({method: {(c, 0): v for c, v in zip("abcde", line, strict=True)} for method, line in scores.items()})
    tables = case_tables(*by_case(made, by="case"))
    lines = [line for line in in_format(tables, "markdown", Look()).splitlines() if line.startswith("|")]
    assert [[cell.strip() for cell in line.strip("|").split("|")] for line in lines] == [
        ["case", "good", "near", "fails", "bad", "worse"],
        ["---"] * 6,
        ["a", "**1.0**", "1.1", "-††", "3.0", "3.2"],
        ["b", "2.0", "**1.9**", "2.0", "6.0", "6.0"],
        ["c", "**3.0**", "3.1", "**3.0**", "9.0", "9.2"],
        ["d", "**4.0**", "4.2", "**4.0**", "12.0", "13.0"],
        ["e", "5.0", "**4.9**", "5.5", "15.0", "16.0"],
        ["*mean*", "**3.0**", "*3.0* ≈", "3.6 ≈", "9.0", "9.5"],
        ["*wins*", "**3**", "2", "2", "0", "0"],
    ]
    assert len(tables[0].notes) == 2 and tables[0].notes[1] == LEFT_OUT_NOTE


def test_where_nobody_is_the_best_no_number_of_wins_is():
    made = table({m: {(c, s): [1.0, None][s] for c in "wxyz" for s in (0, 1)} for m in "ab"}, worst={"d": 5.0})
    (found,) = case_tables(*by_case(made, by="case"))
    assert [(column.feet[1].text, column.feet[1].best) for column in found.metrics] == [("0", False)] * 2
    assert {(cell.text, cell.mark, cell.best) for column in found.metrics for cell in column.cells} == {
        ("3", "†", False)
    }
    assert found.notes[0].startswith("mean of a case over its seeds") and FAILED_NOTE in found.notes


@pytest.mark.parametrize(
    ("better", "scale", "subject"),
    [("lower", 1e-3, "CD ↓ (1e-3)"), ("higher", 1.0, "CD ↑"), ("reference", 1.0, "CD |diff| ↓")],
)
def test_the_subject_has_the_direction_and_the_unit(better, scale, subject):
    made = table({"only": {(c, 0): 2 * scale for c in "wxyz"}}, better=better, floors={"d": scale})
    assert [one.subject for one in case_tables(*by_case(made, by="case"), Look(names={"d": "CD"}))] == [subject]


@pytest.mark.parametrize("format", FORMATS)
def test_every_format_has_every_case_and_method(frame, format, capsys):
    show_by_case(frame, "case,task", Output(format, Look(digits=2)), metric="d")
    text = capsys.readouterr().out
    plain = text.replace("\\", "")
    assert all(name in plain for name in [*CASES, "a_method", "b_method", "c_method"])
    if format == "csv":
        back = pd.read_csv(io.StringIO(text))
        assert tuple(back.columns) == COLUMNS and len(back) == 15
    else:
        assert "wins" in text and "mean" in text and f"{pivot(frame).iloc[0, 0]:.2f}" in text


def test_the_order_of_the_columns_is_the_users(frame):
    look = Look(order="given", methods=("c_method", "a_method"), names={"a_method": "Ours"})
    (table,) = case_tables(*by_case(frame, by="case,task", metric="d"), look)
    assert [column.title for column in table.metrics] == ["c_method", "Ours", "b_method"]


def test_the_keys_besides_case():
    assert without_case("case") is None and without_case("case,sensor") == ["sensor"]
    with pytest.raises(UsageError, match="sensr"):
        by_case(rows(row(scores={"d": 1.0})), by="case,sensr")
