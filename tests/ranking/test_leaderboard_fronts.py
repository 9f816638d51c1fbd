"""The column ``front``: who is on the Pareto front of two metrics, or of a metric and a cost."""

import numpy as np
import pandas as pd
import pytest
from boards import row, rows

from bench.cli import main
from bench.errors import UsageError
from bench.plugins.registry import registry
from bench.ranking.fronts import on_front
from bench.ranking.headline import primary_metrics
from bench.ranking.leaderboard import leaderboard
from bench.ranking.report import FORMATS, render

METHODS = {  # d (lower), f (higher), seconds, MB
    "accurate": (1.0, 0.9, 9.0, 300.0),
    "balanced": (2.0, 0.8, 3.0, 300.0),
    "beaten": (3.0, 0.7, 4.0, 200.0),
    "fast": (4.0, 0.95, 1.0, 100.0),
}


def frame_of(methods=METHODS, **changes):
    directions = '{"d": "lower", "f": "higher"}'
    return rows(
        *(
            row(m, c, 0, {"d": d, "f": f}, seconds=s, peak_rss_mb=mb, directions=directions, **changes)
            for m, (d, f, s, mb) in methods.items()
            for c in "wxyz"
        )
    )


def fronted(board):
    return set(board[board["front"] == 1]["method"])


@pytest.mark.parametrize("scale", [1.0, 1e-6])
def test_on_front_against_a_loop(scale):
    rng = np.random.default_rng(0)
    for n in (0, 1, 2, 30):
        points = rng.integers(0, 6, size=(n, 2)) * scale  # with ties
        naive = [not any((q < p).all() for q in points) for p in points]
        assert on_front(points).tolist() == naive


@pytest.mark.parametrize(
    ("pareto", "on"),
    [
        ("d,seconds", {"accurate", "balanced", "fast"}),
        ("seconds,d", {"accurate", "balanced", "fast"}),
        ("d,f", {"accurate", "fast"}),  # the greater f is the better one
        (["f", "peak_mb"], {"fast"}),
        ("seconds,peak_mb", {"fast"}),
    ],
)
def test_who_is_on_the_front(pareto, on):
    board = leaderboard(frame_of(), pareto=pareto)
    assert fronted(board) == on
    assert set(board["front"].dropna()) == {1}  # and empty for the others, in every line of a method
    assert (board.groupby("method")["front"].nunique(dropna=False) == 1).all()


def test_equal_in_one_criterion_is_not_better():
    board = leaderboard(
        frame_of({"a": (1.0, 1, 2.0, 1), "b": (1.0, 1, 5.0, 1), "c": (1.5, 1, 5.0, 1)}), pareto="d,seconds"
    )
    assert fronted(board) == {"a", "b"}


def test_rounding_excludes_no_method():
    board = leaderboard(frame_of({"a": (1.0, 1, 2.0, 1), "b": (1.0 + 1e-13, 1, 2.0 + 1e-13, 1)}), pareto="d,seconds")
    assert fronted(board) == {"a", "b"}


def test_who_solved_nothing_or_has_no_such_score_is_not_on_it():
    failed = rows(*(row("none", c) for c in "wxyz"))
    no_f = rows(*(row("no_f", c, 0, {"d": 0.1}, seconds=0.1) for c in "wxyz"))
    frame = pd.concat([frame_of(), failed, no_f])
    assert fronted(leaderboard(frame, pareto="d,f")) == {"accurate", "fast"}


def test_each_table_has_its_own_front():
    cad = {"beaten": (0.5, 0.5, 0.5, 1.0), "fast": (1.0, 0.5, 1.0, 1.0)}
    board = leaderboard(pd.concat([frame_of(), frame_of(cad, dataset="cad")]), pareto="d,seconds")
    assert fronted(board[board["dataset"] == "cad"]) == {"beaten"}
    assert fronted(board[board["dataset"] == "bumps"]) == {"accurate", "balanced", "fast"}


def test_variants_of_a_method_are_points_of_their_own():
    board = leaderboard(
        pd.concat([frame_of(), frame_of({"beaten": (0.5, 1, 2.0, 1.0)}, variant="k=3")]), pareto="d,seconds"
    )
    on = board[board["front"] == 1]
    assert set(on[on["method"] == "beaten"]["variant"]) == {"k=3"}


def test_metrics_of_the_front_are_shown_even_if_others_are_chosen():
    board = leaderboard(frame_of(), metric="f", pareto="d,seconds")
    assert set(board["metric"]) == {"d", "f"}
    assert fronted(board) == {"accurate", "balanced", "fast"}


@pytest.mark.parametrize("format", FORMATS)
def test_every_format_has_the_column(format):
    frame = frame_of()
    text = render(leaderboard(frame, pareto="d,seconds"), format, rows=frame)
    lines = {m: next(x for x in text.splitlines() if m in x and "Compared" not in x) for m in METHODS}
    if format == "csv":
        place = text.splitlines()[0].split(",").index("front")
        assert {m: x.split(",")[place] for m, x in lines.items()} == {
            "accurate": "1",
            "balanced": "1",
            "beaten": "",
            "fast": "1",
        }
        return
    assert "front" in text.replace("\n", " ").partition("beaten")[0]
    assert "no other method is better in both d and seconds" in " ".join(text.split())
    cells = {m: [c.strip() for c in x.strip("| ").replace("&", "|").split("|")] for m, x in lines.items()}
    if format != "terminal":
        assert {m: c[2] for m, c in cells.items()} == {"accurate": "1", "balanced": "1", "beaten": "", "fast": "1"}
    plain = render(leaderboard(frame), format, rows=frame)
    assert "front" not in plain


@pytest.mark.parametrize("wrong", ["d", "d,f,seconds", "d,d", "*"])
def test_it_takes_two(wrong):
    with pytest.raises(UsageError, match="pareto .*expected two of the metrics and seconds, peak_mb"):
        leaderboard(frame_of(), pareto=wrong)


def test_a_wrong_name_gets_the_nearest():
    with pytest.raises(UsageError, match="--pareto second.*Did you mean 'seconds'"):
        leaderboard(frame_of(), pareto="d,second")


def test_across_shows_one_metric_and_no_front(capsys):
    assert main(["leaderboard", "--across", "tag", "--pareto", "d,seconds"]) == 1
    assert "does not go with --pareto d,seconds" in capsys.readouterr().err


# -- a task with two primary metrics -----------------------------------------------------------------------------------


@pytest.fixture
def two(monkeypatch):
    monkeypatch.setattr(registry().find("task", "reconstruct").cls, "primary", ("f", "d"))


@pytest.mark.parametrize("format", ["terminal", "markdown", "latex"])
def test_a_task_with_two_primary_metrics_has_no_rank_but_a_front(two, format):
    frame = frame_of()
    board = leaderboard(frame)
    assert fronted(board) == {"accurate", "fast"}
    text = " ".join(render(board, format, rows=frame).split())
    assert "no single rank: it is judged by f and d" in text
    head = text[: text.index("accurate")]
    assert " front " in head and " rank " not in head and "Resolution" not in text
    assert text.index("f ↑" if format != "latex" else r"f $\uparrow$") < text.index(
        "d ↓" if format != "latex" else r"d $\downarrow$"
    )


def test_a_task_with_one_primary_metric_does_not_end_the_fronts_of_others(two):
    assert len(primary_metrics("denoise")) == 1
    board = leaderboard(pd.concat([frame_of(task="denoise"), frame_of()]))
    assert fronted(board[board["task"] == "reconstruct"]) == {"accurate", "fast"}
    assert not fronted(board[board["task"] == "denoise"])


def test_the_user_who_names_a_metric_gets_ranks_by_it(two):
    frame = frame_of()
    text = render(leaderboard(frame, metric="d"), "markdown", rows=frame, metrics=["d"])
    assert "| method | rank | d ↓" in text and "front" not in text


def test_one_primary_metric_ranks(monkeypatch):
    monkeypatch.setattr(registry().find("task", "reconstruct").cls, "primary", ("f",))
    text = render(leaderboard(frame_of()), "markdown")
    assert "| method | rank | f ↑" in text and "front" not in text
