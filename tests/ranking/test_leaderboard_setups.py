"""Device, threads and host: never averaged, and part of a line's name where they differ in its table."""

import numpy as np
import pandas as pd
import pytest
from boards import row, rows
from records import record

from bench.commands.leaderboard import read_rows
from bench.ranking.leaderboard import failures, leaderboard, notes
from bench.ranking.overview import overview
from bench.ranking.report import FORMATS, render
from bench.ranking.report.tables import tables
from bench.ranking.report.terminal import remarks
from bench.ranking.selection import pool
from bench.results.store import Results


def run(method="sap", cases="abcd", value=1.0, **changes):
    return [row(method, case, 0, {"d": value * (1 + 0.1 * i)}, **changes) for i, case in enumerate(cases)]


def both(**changes):
    """One method on a CPU and on a GPU, whose scores differ by 100 and whose times by 10, and another one."""
    return rows(
        *run(value=1.0, seconds=10.0, **changes),
        *run(value=0.01, seconds=1.0, device="cuda", **changes),
        *run("poisson", value=0.5, seconds=0.1, variant="depth=9", **changes),
    )


def test_a_device_is_a_line_of_its_own():
    board = leaderboard(both()).set_index(["method", "device"])
    assert board["mean"].to_dict() == pytest.approx(
        {("sap", "cuda"): 0.0115, ("poisson", "cpu"): 0.575, ("sap", "cpu"): 1.15}
    )
    assert board["seconds_median"].to_dict() == {("sap", "cuda"): 1.0, ("poisson", "cpu"): 0.1, ("sap", "cpu"): 10.0}
    assert set(board["solved"]) == set(board["planned"]) == {4}
    assert board["rank_low"].tolist() == board["rank_high"].tolist() == [1, 2, 3]


def test_one_case_on_two_devices_is_not_two_cases():
    board = leaderboard(rows(*run(cases="a", value=1.0), *run(cases="a", value=0.01, device="cuda")))
    assert board["mean"].tolist() == [0.01, 1.0] and board["solved"].tolist() == [1, 1]


def test_the_device_is_named_where_there_are_several():
    (table,) = tables(leaderboard(both()), both())
    assert table.methods == ("sap · cuda", "poisson_9 · cpu", "sap · cpu")
    frame = both()
    (table,) = tables(leaderboard(frame, method="poisson"), frame)
    assert table.methods == ("poisson_9",)


def test_threads_are_named_where_there_are_several():
    frame = rows(*run(), *run(threads=8, device="cuda", seconds=0.5))
    (table,) = tables(leaderboard(frame), frame)
    assert table.methods == ("sap · cpu, 1 thread", "sap · cuda, 8 threads")
    assert table.seconds == ("1.00", "0.50")


def test_two_machines_that_ran_the_same_cases_have_a_line_each():
    frame = rows(*run(host="left"), *run(host="right", value=2.0), *run("poisson", host="left", value=9.0))
    (table,) = tables(leaderboard(frame), frame)
    assert table.methods == ("sap · host left", "sap · host right", "poisson · host left")
    assert leaderboard(frame)["mean"].tolist() == pytest.approx([1.15, 2.3, 10.35])


def test_a_sweep_spread_over_machines_stays_one_line_and_reports_it():
    """As a cluster does it: each cell wherever there is room."""
    frame = rows(*run(cases="ab", host="left"), *run(cases="cd", host="right"), *run("poisson", host="left", value=9.0))
    board = leaderboard(frame)
    assert board["host"].tolist() == ["left, right", "left"] and board["planned"].tolist() == [4, 4]
    (table,) = tables(board, frame)
    assert table.methods == ("sap", "poisson")
    assert any("run on 2 machines (left, right)" in note for note in table.notes)
    (table,) = tables(leaderboard(frame, method="poisson"), frame)
    assert not any("machines" in note for note in table.notes)


def test_results_of_an_unknown_machine_have_their_costs_and_are_told_apart():
    """As those of another tool."""
    frame = rows(*run(cases="ab", host=None, seconds=2.0), *run(cases="cd", host="left", seconds=2.0))
    for made in (frame, frame.drop(columns="host"), frame.assign(host=None)):
        (table,) = tables(leaderboard(made), made)
        assert (table.methods, table.seconds, table.memory) == (("sap",), ("2",), ("100",))
        assert any("(left, unknown)" in note for note in table.notes) == (made is frame)


@pytest.mark.parametrize("across", ["dataset", "sensor", "tag"])
def test_lines_across_groups_have_one_name(across):
    frame = rows(
        *run(host="left", tags="thin"), *run(host="right", dataset="cad", sensor="noisy", tags="sharp", cases="efgh")
    )
    frame["parameters"] = 1_000_000
    board = overview(frame, across)
    assert set(board["host"]) == {"left, right"}
    (table,) = tables(board, pool(frame, "task"))
    assert table.methods == ("sap",) and table.parameters == ("1M",)
    twice = pd.concat([frame, frame.assign(host="third")], ignore_index=True)
    (table,) = tables(overview(twice, across), pool(twice, "task"))
    assert set(table.methods) == {"sap · host left", "sap · host right", "sap · host third"}


@pytest.mark.parametrize("format", FORMATS)
def test_every_format_tells_devices_apart(format):
    text = render(leaderboard(both()), format, rows=both())
    if format == "csv":
        frame = pd.read_csv(pd.io.common.StringIO(text))
        assert set(zip(frame["method"], frame["device"], frame["threads"], frame["host"], strict=True)) == {
            ("sap", "cuda", 1, "h"),
            ("sap", "cpu", 1, "h"),
            ("poisson", "cpu", 1, "h"),
        }
    else:
        dot = r"$\cdot$" if format == "latex" else "·"
        assert all(f"{name} {dot} {device}" in text for name, device in (("sap", "cuda"), ("sap", "cpu")))


def test_failures_name_the_device_as_the_table_does():
    frame = both()
    frame.loc[4, "status"] = "timeout"
    frame.loc[4, "message"] = "stopped"
    assert failures(frame)[["method", "device", "count"]].to_numpy().tolist() == [["sap", "cuda", 1]]
    assert "sap · cuda: 1 timeout (reconstruct · bumps · samples): stopped" in remarks(leaderboard(frame), frame)


def test_failures_and_notes_of_one_of_two_machines_are_listed_under_the_line_of_both():
    frame = rows(
        row("sap", "a", 0, {"d": 1.0}, host="left"),
        row("sap", "b", 0, {"d": 1.0}, host="right", message="half of it"),
        row("sap", "c", 0, host="right", message="stopped"),
        row("other", "a", 0, {"d": 1.0}, host="left"),
    )
    assert failures(frame)["host"].tolist() == notes(frame)["host"].tolist() == ["left, right"]
    text = remarks(leaderboard(frame), frame)
    assert "sap: 1 error (reconstruct · bumps · samples): stopped" in text
    assert "sap: 1 (reconstruct · bumps · samples): half of it" in text


def test_the_order_of_rows_does_not_matter():
    frame = pd.concat([both(), both().assign(host="other")], ignore_index=True)
    board = leaderboard(frame)
    again = leaderboard(frame.sample(frac=1, random_state=np.random.RandomState(0)))
    pd.testing.assert_frame_equal(board, again, check_exact=True)


# -- which rows of several folders count -------------------------------------------------------------------------------


def test_the_same_cell_of_two_machines_counts_twice_and_a_later_version_replaces_all(tmp_path):
    for folder, values in {
        "left": {"host": "left", "finished": "2026-01-01T00:00:00"},
        "right": {"host": "right", "finished": "2026-01-02T00:00:00"},
    }.items():
        Results(tmp_path / folder).write(record("ab0000000001", **values))
    folders = [str(tmp_path / name) for name in ("left", "right")]
    assert read_rows(folders)["host"].value_counts().to_dict() == {"left": 3, "right": 3}
    later = record("ab0000000001", mark="e" * 16, host="right", finished="2026-01-03T00:00:00")
    Results(tmp_path / "right").write(later)
    found = read_rows(folders)
    assert found["host"].tolist() == ["right"] * 3 and set(found["fingerprint"]) == {"e" * 16}
