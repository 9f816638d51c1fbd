"""How long the rest takes: from finished cases, from what methods say, and from how the sweep has gone so far."""

import itertools
import time
from dataclasses import dataclass

import pytest
from conftest import TOYS, WORDS
from toy_cells import config, node

from bench import register
from bench.plan.cell import Cell
from bench.results.store import Results
from bench.sweep.forecast import Forecast, Pace, seconds_to_do, summary, workers_of
from bench.sweep.outlook import look_ahead
from bench.sweep.progress import Follow, Lines
from bench.sweep.request import Request
from bench.sweep.session import Session
from bench.text import duration


@register("method", name="forecast_method")
@dataclass(frozen=True)
class Method:
    """Is told how long to take."""

    seconds: float = 0.0
    depth: int = 1

    def denoise(self, cloud, run):
        return cloud


def cell(**values) -> Cell:
    return Cell.from_config(config(method=node("method", "forecast_method", **values)))


def key(kind: str, *names: str) -> tuple[str, ...]:
    return (*{"v": ("task", "method", "variant"), "m": ("task", "method")}[kind], "denoise", "forecast_method", *names)


def test_finished_cases_of_the_same_kind_come_first_and_then_what_the_method_says():
    timed = Pace({key("v", "depth=2"): 7.0, key("v", "seconds=30"): 33.0, key("m"): 5.0})
    assert timed.seconds(cell(depth=2)) == 7.0
    assert timed.seconds(cell(seconds=30.0)) == 33.0
    assert timed.seconds(cell(seconds=60.0)) == 60.0  # this one was never timed
    assert timed.seconds(cell(depth=3)) == 5.0
    assert Pace().seconds(cell(depth=3)) is None
    assert seconds_to_do(cell(seconds=60.0), 1, Pace()) == 3 * 60.0
    assert seconds_to_do(cell(), 4, Pace()) == 0.0  # nothing is left, whoever knows how long that takes


def test_the_time_of_a_case_is_that_from_its_beginning_to_its_end(shell):
    shell.run("method=fine", "method.take=0.3", sweep=False)
    rows = shell.rows()
    known = Pace.of(Results(shell.results)).known
    seconds = known["task", "method", "denoise", "fine"]
    assert rows["seconds"].median() <= seconds < rows["seconds"].median() + 5
    assert Pace.of(Results(shell.folder / "empty")).known == {}


def naive(expected, took, workers):
    """Seconds left by the definition: what is expected, times how much longer the others took than expected."""
    pairs = [(expected[i], t) for i, t in took.items() if t and expected[i]]
    factor = sum(t for _, t in pairs) / sum(e for e, _ in pairs) if pairs else 1
    rest = [e * factor for i, e in enumerate(expected) if i not in took]
    return max(sum(rest) / workers, max(rest, default=0))


@pytest.mark.parametrize("workers", [1, 2, 8])
def test_what_is_left_is_corrected_by_what_was_seen(workers):
    expected, took = [4.0, 2.0, 0.0, 8.0, 6.0], {}
    forecast = Forecast(expected, "abcde", workers)
    for job, seconds in [(1, 3.0), (2, 0.0), (0, 6.0), (4, 6.0), (3, 12.0)]:
        assert forecast.left() == pytest.approx(naive(expected, took, workers))
        took[job] = seconds
        forecast.ended(job, seconds)
    assert forecast.left() == 0


def test_jobs_without_a_time_take_what_their_kind_has_taken():
    forecast = Forecast([None] * 5, ["fast", "fast", "slow", "slow", "other"])
    assert forecast.left() is None
    forecast.ended(0, 1.0)
    assert forecast.left() == 4.0
    forecast.ended(2, 10.0)
    assert forecast.left() == 1.0 + 10.0 + (1.0 + 10.0) / 2
    forecast.ended(99, 1.0)  # of another sweep
    assert forecast.left() == 16.5


@pytest.mark.parametrize(
    ("words", "threads", "processors", "workers"),
    [
        ("method=jet", 1, 8, 1),
        ("hydra/launcher=joblib hydra.launcher.n_jobs=3", 1, 8, 3),
        ("hydra/launcher=joblib", 1, 8, 8),
        ("hydra/launcher=joblib hydra.launcher.n_jobs=-2", 1, 8, 7),
        ("hydra/launcher=joblib hydra.launcher.n_jobs=8", 4, 8, 2),
        ("hydra/launcher=joblib hydra.launcher.n_jobs=8", 16, 8, 1),
        ("hydra/launcher=ray", 1, 8, 1),
    ],
)
def test_how_many_cells_are_run_at_a_time(monkeypatch, words, threads, processors, workers):
    monkeypatch.setattr("bench.sweep.forecast.available", lambda: list(range(processors)))
    assert workers_of(Request.of(words.split()), threads) == workers


def test_times_and_summaries_in_words():
    words = [duration(s) for s in (0.24, 7.4, 44, 130, 3600, 7300, 4 * 86400)]
    assert words == ["0.2 s", "7 s", "44 s", "2 min", "60 min", "2 h", "4 days"]
    assert summary(8, 8, [0.0, 0.0], 0, 2) == "8 cases, 8 finished, 0 to do"
    assert summary(8, 2, [30.0, 30.0], 0, 2) == "8 cases, 2 finished, 6 to do, about 30 s, 2 cells at a time"
    rest = summary(8, 2, [90.0, None], 4, 1)
    assert rest == "8 cases, 2 finished, 6 to do, about 90 s and 4 cases never timed"


# -- before the start -------------------------------------------------------------------------------------------------


def test_a_sweep_with_a_wrong_job_is_not_looked_up(tmp_path):
    assert look_ahead([["method=nobody"]], Request(()), Results(tmp_path)) is None
    assert look_ahead([["method=jet"], ["method=nobody"]], Request(()), Results(tmp_path)) is None


def test_every_job_of_a_large_sweep_is_looked_up(tmp_path):
    jobs = [["task=denoise", "method=identity", f"seed={seed}", "cases=2"] for seed in range(350)]
    ahead = look_ahead(jobs, Request(()), Results(tmp_path))
    assert ahead is not None and ahead.text == ""  # nothing was timed
    assert [values["seed"] for values in ahead.configs] == [*range(350)]
    ahead.forecast.ended(0, 2.0)
    assert ahead.forecast.left() == 349 * 2.0


def test_some_jobs_stand_for_all_where_each_is_composed_by_itself(tmp_path, monkeypatch):
    monkeypatch.setenv("CASES", "2")
    jobs = [["task=denoise", "method=identity", f"seed={seed}", "cases=${oc.env:CASES}"] for seed in range(30)]
    ahead = look_ahead(jobs, Request(()), Results(tmp_path))
    assert ahead is not None and ahead.configs is None and ahead.ended == {}
    ahead.forecast.ended(0, 2.0)
    assert ahead.forecast.left() == 29 * 2.0


# -- progress ---------------------------------------------------------------------------------------------------------


def test_progress_follows_what_jobs_leave_whoever_leaves_it(tmp_path, capsys):
    session = Session.new(tmp_path)
    with session.open(), Follow(session, Lines(3, Forecast([None] * 3, "aab"))):
        for job, line in itertools.islice(enumerate(("first", "second")), 2):
            session.leave(f"job-{job:06d}", kind="cell", job=job, line=line, took=40.0, notes=["odd"] if job else [])
            time.sleep(0.3)
        session.leave("job-000002", kind="not_solved", job=2, message="does not fit")
    assert capsys.readouterr().err.splitlines() == [
        "[1/3] first; about 80 s left",
        "warning: odd",
        "[2/3] second; about 80 s left",  # it is looked up once a second at most
    ]


def test_lines_count_and_say_what_is_left_under_joblib(shell):
    words = ("method=fine", "method.take=0.1", "method.salt=1,2,3")
    done = shell.run(*words, launcher="joblib")
    assert [line[:6] for line in done.stderr.splitlines() if line.startswith("[")] == ["[1/3] ", "[2/3] ", "[3/3] "]
    again = shell.run(*words, "seed=0,1")
    assert "12 cases, 6 finished, 6 to do, about" in again.stderr, again.stderr
    words = ("--plugin", TOYS, *words, *WORDS, "seed=2", f"results={shell.results}")
    plan = shell.call("plan", "-m", *words)
    assert "3 cells, 6 cases, 0 finished, 6 to do, about" in plan.stdout, plan.stdout + plan.stderr
