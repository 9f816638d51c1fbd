"""The options of `detailbench leaderboard`: files, columns, names, and what does not go together."""

import io
import os
from dataclasses import replace

import pandas as pd
import pytest
from records import cell_of, record

from bench import cli
from bench.commands.leaderboard_options import names_of
from bench.errors import UsageError
from bench.plan.cell import Choice
from bench.results.store import Results


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two methods on five shapes, by two metrics."""
    results = Results(tmp_path_factory.mktemp("results"))
    for method, score in (("jet", 0.1), ("identity", 0.4)):
        cell = replace(cell_of(), method=Choice("method", method, {}))
        directions = '{"p2f_mean": "lower", "fscore@0.01": "higher"}'
        scores = {"score.p2f_mean": score, "score.fscore@0.01": 1 - score, "directions": directions}
        one = record(cell.id, method=method, cases=5, **scores)
        one.meta["cell"] = cell.to_json()
        results.write(one)
    return str(results.folder)


@pytest.fixture
def board(folder, capsys):
    def run(*words):
        code = cli.main(["leaderboard", folder, *words])
        return code, *capsys.readouterr()

    return run


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--digits", "-1"), "--digits -1: expected a whole number"),
        (("--order", "given"), "name the methods in their order with --method"),
        (("--names", "jet"), "expected OLD=NEW"),
        (("--names", "jett=Jet"), "Did you mean 'jet'"),
        (("--columns", "p2f_maen"), "Did you mean 'p2f_mean'"),
        (("--by", "case", "--columns", "p2f_mean"), "does not go with --columns"),
        (("--by", "case", "--pareto", "p2f_mean,seconds"), "does not go with --pareto"),
        (("--best", "--across", "sensor"), "does not go with --across"),
        (("--preset", "x"), "writes the winner of --best; add --best"),
        (("--best",), "split=train"),
        (("--no-intervals", "--intervals", "below"), "does not go with"),
        (("-o", "nowhere/board.tex"), "there is no folder nowhere"),
        (("-o", "."), "is a folder"),
        (("--by", "cases"), "Did you mean 'case'"),
    ],
)
def test_what_makes_no_sense_is_refused_with_what_to_do(board, words, message):
    code, out, err = board(*words)
    assert code == 1 and out == "" and message in err and "Traceback" not in err


@pytest.mark.parametrize("format", ["terminal", "markdown", "latex", "csv"])
def test_a_file_holds_what_would_be_printed(board, tmp_path, format):
    target = tmp_path / "board"
    code, printed, _ = board("--format", format)
    assert code == 0 and printed
    code, out, err = board("--format", format, "-o", str(target))
    assert (code, out) == (0, "") and f"written to {target}" in err
    assert target.read_text(encoding="utf-8") == printed and os.listdir(tmp_path) == ["board"]


def test_columns_names_and_digits(board):
    words = ("--columns", "fscore,rank,p2f_mean", "--names", "jet=Ours,p2f_mean=P2F", "--digits", "1", "--no-intervals")
    code, out, _ = board(*words, "--format", "markdown")
    lines = [line.strip("| ").split(" | ") for line in out.splitlines() if line.startswith("|")]
    assert code == 0 and lines[0] == ["method", "fscore@0.01 ↑", "rank", "P2F ↓"]
    assert lines[2] == ["Ours", "**0.9**", "1", "**0.1**"] and lines[3] == ["identity", "0.6", "2", "0.4"]


def test_columns_of_the_csv_are_all_and_its_metrics_those_asked_for(board):
    _, out, _ = board("--columns", "p2f_mean,seconds", "--format", "csv")
    back = pd.read_csv(io.StringIO(out))
    assert set(back["metric"]) == {"p2f_mean"} and back["place"].fillna("").tolist() == ["best", ""]


def test_methods_in_the_order_given(board):
    words = ("--columns", "p2f_mean", "--format", "csv")
    _, by_rank, _ = board("--method", "identity,jet", "--format", "markdown", *words[:2])
    _, given, _ = board("--method", "identity,jet", "--order", "given", "--format", "markdown", *words[:2])
    assert by_rank.index("| jet") < by_rank.index("| identity") and given.index("| identity") < given.index("| jet")


def test_the_help_lists_what_tables_are_made_by_and_has_examples(capsys):
    text = " ".join(cli.parser_for("leaderboard").format_help().split())
    assert "dataset, sensor, tag, or just task" in text and "case: one line a case" in text
    for command, least in (("leaderboard", 4), ("worst", 4)):
        assert cli.parser_for(command).format_help().count(f"  detailbench {command}") >= least


def test_new_names_may_be_of_variants():
    assert names_of("idf[omega=30,a=1]=Ours,jet=Jet (CGAL)") == {"idf[omega=30,a=1]": "Ours", "jet": "Jet (CGAL)"}
    with pytest.raises(UsageError, match="--names =x"):
        names_of("=x")
