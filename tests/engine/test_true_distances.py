"""True distances of the reference for methods that are trained on them: what they get, what it costs, how it shows."""

import csv
import io
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from boards import line, row, rows
from records import record

from bench import Run, UsageError
from bench.ranking.leaderboard import leaderboard
from bench.ranking.overview import overview
from bench.ranking.report import FORMATS, render
from bench.ranking.report.table import GIVEN
from bench.ranking.report.tables import tables
from bench.results.store import Results

TOYS = Path(__file__).parents[1] / "faults" / "toys.py"
SLOW = 1.5  # seconds that the distances are made to take
PLUGIN = f'''
"""A method that is told the truth, and an engine whose distances take their time."""

import time
from dataclasses import dataclass

import numpy as np

import bench.geometry.signed_distance as engine
from bench import PointCloud, register

exact = engine.signed_distances


def slow(mesh, points):
    if len(mesh.faces) == 320:  # the ball of the tests, not the kit's toy
        time.sleep({SLOW})
    return exact(mesh, points)


engine.signed_distances = slow


@register("method")
@dataclass(frozen=True)
class Told:
    """Moves every point onto the surface, by the distance and its derivatives."""

    asks: bool = True  # for true distances

    def denoise(self, cloud, run):
        if not self.asks:
            return cloud
        begin = time.perf_counter()
        steps = np.vstack([np.zeros(3), 1e-5 * np.eye(3)])
        around = run.true_distances((cloud.points[:, None] + steps).reshape(-1, 3)).reshape(-1, 4)
        run.parameters = int(1000 * (time.perf_counter() - begin))
        gradient = (around[:, 1:] - around[:, :1]) / 1e-5
        return PointCloud(cloud.points - around[:, :1] * gradient)
'''


# -- the function ------------------------------------------------------------------------------------------------------


def test_the_clock_stands_still():
    def slowly(points):
        time.sleep(0.3)
        return np.linalg.norm(points, axis=1) - 1

    run = Run(seconds=10, on_distances=slowly)
    assert run.has_truth
    assert np.allclose(run.true_distances([[0, 0, 0], [0, 3, 0]]), [-1, 2])
    assert run.elapsed() < 0.15 and run.seconds_left() > 9.85
    assert run.distances_given == 2
    run.true_distances(np.zeros((5, 3), dtype=np.float32))
    assert run.distances_given == 7


def test_without_a_reference_it_is_said_what_to_do():
    assert not Run().has_truth
    with pytest.raises(UsageError, match="no reference to measure.*choose a supervision"):
        Run().true_distances(np.zeros((1, 3)))


@pytest.mark.parametrize(("points", "words"), [(np.zeros(3), r"\(n, 3\), got \(3,\)"), ([[0, np.nan, 0]], "NaN")])
def test_points_that_make_no_sense_are_refused(points, words):
    run = Run(on_distances=len)
    with pytest.raises(ValueError, match=words):
        run.true_distances(points)
    assert run.distances_given == 0


# -- a run -------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def ran(shells):
    """A sweep of the method with and without true distances, and one that knows nothing of them."""
    shell = shells("told")
    plugin = shell.folder / "told.py"
    plugin.write_text(PLUGIN)
    words = ("limit.seconds=1", "metric=[spread,p2f_mean]", "cases=2")
    done = shell.run("method=told", "method.asks=true,false", *words, plugins=(TOYS, plugin), board=True)
    assert done.returncode == 0, done.stderr
    return shell, plugin, done.stdout


def test_a_method_gets_distances_to_the_reference_in_the_frame(ran):
    shell, _, _ = ran
    found = shell.rows()
    assert list(found["status"]) == ["ok"] * 4, list(found["message"])
    told, untold = (found[found["variant"] == variant] for variant in ("", "asks=False"))
    assert len(told) == len(untold) == 2
    assert (told["score.p2f_mean"] < 1e-6).all() and (untold["score.p2f_mean"] > 1e-3).all()
    assert list(told["true_distances"]) == [4 * 100, 4 * 110]  # four at each of the points
    assert untold["true_distances"].isna().all()


def test_neither_the_clock_nor_the_limit_runs_meanwhile(ran):
    shell, _, _ = ran
    told = shell.rows(variant="")
    assert (told["parameters"] >= 1000 * SLOW).all(), "the distances took no time: the test shows nothing"
    assert (told["seconds"] < 1).all() and (told["cpu_seconds"] < 1).all()


def test_every_format_reports_it(ran):
    shell, _, printed = ran
    assert f"told {GIVEN}" in printed and "trained on true distances of the reference" in printed
    markdown = shell.call("leaderboard", shell.results, "--format", "markdown").stdout
    assert f"| told {GIVEN} |" in markdown and "| told (asks=False) |" in markdown
    text = shell.call("leaderboard", shell.results, "--format", "csv").stdout
    assert {(line["variant"], line["true_distances"]) for line in lines_of(text)} == {("", "440"), ("asks=False", "0")}


def lines_of(text):
    """The lines of a CSV, by the names of the columns."""
    return list(csv.DictReader(io.StringIO(text)))


def test_a_file_of_one_s_own_has_no_truth(ran):
    from trimesh.creation import icosphere

    shell, plugin, _ = ran
    icosphere(subdivisions=2).export(shell.work / "ball.ply")
    words = ("apply", "threads=1", "--plugin", plugin, "method=told", "ball.ply", "out.ply")
    refused = shell.call(*words)
    assert refused.returncode != 0 and "Traceback" not in refused.stdout
    assert "told: true distances: there is no reference to measure them to" in refused.stderr
    assert not (shell.work / "out.ply").exists()
    done = shell.call(*words, "method.asks=false")
    assert done.returncode == 0, done.stderr


def test_the_conformance_kit_gives_the_toy_s_distances(ran):
    shell, plugin, _ = ran
    check = shell.call("check", plugin)
    assert check.returncode == 0, check.stdout
    assert "FAIL" not in check.stdout and "denoise: toy case" in check.stdout


# -- leaderboards ------------------------------------------------------------------------------------------------------


@pytest.fixture
def frame():
    return rows(
        *(row("told", case, 0, {"d": 1.0}, true_distances=given) for case, given in (("a", 500), ("b", 700))),
        *(row("seeing", case, 0, {"d": 2.0}, true_distances=None) for case in "ab"),
        *(row("told", case, 0, {"d": 1.0}, true_distances=None, dataset="other") for case in "ab"),
    )


def test_the_board_has_the_largest_number_of_each(frame):
    board = leaderboard(frame, dataset="bumps")
    assert line(board, "told")["true_distances"] == 700
    assert line(board, "seeing")["true_distances"] == 0
    assert set(leaderboard(frame, dataset="other")["true_distances"]) == {0}


def test_a_method_given_true_distances_is_marked_only_where_it_used_them(frame):
    other, told = sorted(tables(leaderboard(frame), frame), key=lambda table: table.dataset == "bumps")
    assert told.methods == (f"told {GIVEN}", "seeing") and other.methods == ("told",)
    assert sum(GIVEN in note for note in told.notes) == 1
    assert not any(GIVEN in note for note in other.notes)


@pytest.mark.parametrize("format", FORMATS)
def test_the_mark_is_in_every_format(format, frame):
    text = render(leaderboard(frame, dataset="bumps"), format, rows=frame)
    if format == "csv":
        assert [line["true_distances"] for line in lines_of(text)] == ["700", "0"]
    else:
        mark = r"$^\ddagger$" if format == "latex" else GIVEN
        assert f"told {mark}" in text and f"{mark} trained on true distances of the reference" in " ".join(text.split())
        assert f"seeing {mark}" not in text


def test_the_overview_is_marked_too(frame):
    (table,) = tables(overview(frame[frame["dataset"] == "bumps"], "sensor"))
    assert table.methods == (f"told {GIVEN}", "seeing")


def test_a_method_is_not_marked_if_all_its_cases_with_true_distances_failed():
    frame = rows(row("told", "a", 0, None, true_distances=9), row("seeing", "a", 0, {"d": 1.0}, true_distances=None))
    assert set(leaderboard(frame)["true_distances"]) == {0}


# -- results of the version before -------------------------------------------------------------------------------------


def test_results_without_the_column_are_read_and_ranked_beside_those_with_it(tmp_path):
    results = Results(tmp_path / "results")
    old, new = record("ab0000000001", method="old"), record("ab0000000002", method="new", true_distances=12)
    for made in (old, new):
        made.rows = [entry | {"directions": '{"p2f_mean": "lower"}'} for entry in made.rows]
        results.write(made)
    path = results.path(old.cell, old.fingerprint)
    table = pq.read_table(path)
    pq.write_table(table.drop_columns(["true_distances"]), path)

    assert len(results.read(old.cell, old.fingerprint).rows) == 3
    for _ in range(2):  # without the index, then with it
        board = leaderboard(results.rows())
        assert dict(zip(board["method"], board["true_distances"], strict=True)) == {"old": 0, "new": 12}
    results.path(new.cell, new.fingerprint).unlink()
    assert set(leaderboard(results.rows())["true_distances"]) == {0}
    assert results.damaged == []
