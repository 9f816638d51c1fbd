"""Every case that could be made has the scores of hopeless outputs in its row, however the method failed on it."""

from pathlib import Path

import numpy as np
import pytest

from bench.ranking.leaderboard import leaderboard
from bench.results.store import Results

MISBEHAVING = Path(__file__).with_name("misbehaving.py")
STATUS = {
    "fine": "ok",
    "raises": "error",
    "segfaults": "crashed",
    "loops": "timeout",
    "returns_nan": "invalid",
    "undeclared_missing": "skipped",
}
WORST = ("worst.p2f_mean", "worst.normal_angle_deg")


@pytest.fixture(scope="module")
def swept(shells):
    shell = shells("worst")
    methods = f"method={','.join(STATUS)},noise"
    metrics = "metric=[p2f_mean,normal_angle_deg,spacing_variation]"
    shell.run(methods, metrics, "limit.seconds=1", plugins=(Path(__file__).with_name("toys.py"), MISBEHAVING))
    return shell


def test_whatever_became_of_the_method(swept):
    rows = swept.rows()
    failed = rows[rows["case_index"] == 1].set_index("method")["status"].to_dict()
    assert failed == STATUS | {"noise": "ok"}
    for name in WORST:
        assert rows.groupby("case")[name].nunique().tolist() == [1, 1]
        assert rows[name].notna().all()
    # An even ball of points is better spread than a perfect sample, so it says nothing of what failing costs.
    assert "worst.spacing_variation" not in rows
    assert not rows["directions"].isin(["", None]).any()


def test_it_is_what_the_pseudo_methods_score(swept):
    rows = swept.rows(method="noise")
    assert rows["worst.p2f_mean"].to_numpy() == pytest.approx(rows["score.p2f_mean"].to_numpy(), rel=0.2)
    assert (rows["worst.normal_angle_deg"] == 90).all()  # of no output at all


def test_a_failure_stands_behind_every_answer_in_the_leaderboard(swept):
    board = leaderboard(swept.rows(), metric="p2f_mean")
    means = board.set_index("method")["mean"]
    assert (means[list(STATUS)[1:]] > 2 * means["fine"]).all()
    assert board.set_index("method")["imputed"].to_dict() == {
        m: int(m not in ("fine", "noise")) for m in [*STATUS, "noise"]
    }
    again = leaderboard(swept.rows(), metric="p2f_mean", method="raises,loops")
    assert np.array_equal(again["mean"], means[again["method"]])


def test_a_cell_that_goes_on_asks_for_what_its_finished_rows_lack(shell):
    words = ("method=fine", "method.take=1.5", "method.at=2", "cases=3", "metric=[p2f_mean]")
    process = shell.run(*words, act=shell.start, sweep=False)
    shell.wait_for(lambda: len(shell.calls()) == 3)
    process.kill()
    process.wait()
    shell.kill_all()
    (partial,) = (shell.results / ".partial").glob("*.jsonl")
    assert partial.read_text().count('"case_index"') == 2 and "worst." not in partial.read_text()
    done = shell.run(*words, sweep=False)
    assert done.returncode == 0, done.stderr
    assert len(shell.calls()) == 4  # the two finished cases were not run again
    assert Results(shell.results).rows()["worst.p2f_mean"].notna().all()
