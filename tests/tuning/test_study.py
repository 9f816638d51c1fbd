"""A search finds what is best on train shapes, says what it is worth, and does nothing twice."""

from __future__ import annotations

import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from bench import cli
from bench.errors import UsageError
from bench.plugins import presets
from bench.tuning.scores import Scores, metric_of, ratio, surely_worse
from bench.tuning.space import Axis
from bench.tuning.study import Bench, Search

MOVER = str(Path(__file__).with_name("mover.py"))


def rows(values, status="ok", better="lower", **more):
    return [
        {"task": "t", "dataset": "d", "sensor": "s", "case": f"c{i}", "seed": 0, "case_index": i, "status": status,
         "directions": f'{{"m": "{better}"}}', "score.m": value, **more}
        for i, value in enumerate(values)
    ]  # fmt: skip


def scores(values, **more):
    found = Scores()
    found.add(rows(values, **more), "m")
    return found


def test_the_mean_is_geometric_and_failures_count_as_the_worst_output():
    assert scores([0.1, 0.4]).mean() == pytest.approx(0.2)
    assert scores([0.5, 0.8], better="higher").mean() == pytest.approx(math.sqrt(0.4))
    both = scores([0.1])
    both.add([{**row, "case": "other", "worst.m": 0.9} for row in rows([None], status="timeout")], "m")
    assert both.mean() == pytest.approx(math.sqrt(0.1 * 0.9))
    # Without a worst score of its own, that of another setting on the same case; without any, worse than any answer.
    failed, known = scores([None], status="oom"), scores([None], status="error", **{"worst.m": 2.0})
    assert failed.losses([known]) == {("t", "d", "s", "c0", 0): pytest.approx(math.log(2))}
    assert next(iter(failed.losses().values())) > math.log(1e5)
    near = scores([5.0, 3.0], better="reference", **{"floor.m": 4.0})
    assert near.mean() == pytest.approx(1.0)


def test_the_ratio_and_its_interval_by_hand():
    rng = np.random.default_rng(0)
    first, second = rng.lognormal(-1, 0.3, 12), rng.lognormal(-1, 0.3, 12)
    found = ratio(scores(first), scores(second), scores(first).index)
    logs = np.log(first) - np.log(second)
    half = 2.200985 * logs.std(ddof=1) / math.sqrt(12)  # Student's t with 11 degrees of freedom
    expected = (logs.mean(), logs.mean() - half, logs.mean() + half)
    assert np.allclose(np.log([found.mean, found.low, found.high]), expected, atol=1e-5)
    assert math.isnan(ratio(scores(first[:3]), scores(second[:3]), scores(first).index).low)
    assert surely_worse(scores(first * 2), scores(first * rng.lognormal(0, 0.01, 12)))
    assert not surely_worse(scores(first), scores(second)) and not surely_worse(scores([2, 2, 2]), scores([1, 1, 1]))


def test_the_score_that_decides():
    made = rows([1.0]) + [{**rows([2.0])[0], "score.n": 1.0}]
    assert metric_of(made, "no task", None) == "m" and metric_of(made, "no task", "n") == "n"
    with pytest.raises(UsageError, match="no case has this score"):
        metric_of(made, "no task", "q")
    with pytest.raises(UsageError, match="nothing to compare"):
        metric_of([], "no task", None)


def a_search(monkeypatch, loss, axes, **more):
    """A search over a function of the parameters, on two cells of five cases each."""
    calls = []
    monkeypatch.setattr("bench.tuning.study.Cell.from_config", lambda values: values)
    configs = [{"method": {"x": 5.0}, "cases": 5, "task": {"_name_": "none"}, "place": i} for i in range(2)]

    def run(values, settings):
        calls.append(dict(values["method"]))
        noise = np.random.default_rng(values["place"]).lognormal(0, 0.1, values["cases"])
        return [{**row, "dataset": f"d{values['place']}"} for row in rows(loss(values["method"]) * noise)]

    return Search(Bench(configs, None, run), axes, **more), calls


def test_a_search_finds_the_least_is_the_same_each_time_and_stops_what_is_surely_worse(monkeypatch):
    def loss(method):
        return 0.1 + (method["x"] - 1.0) ** 2

    axes = [Axis("x", 5.0, 0.0, 10.0)]
    search, calls = a_search(monkeypatch, loss, axes, seed=3, trials=25)
    search.run()
    assert len(search.done) == 25 and search.default.changed == {} and search.metric == "m"
    assert abs(search.best.changed["x"] - 1.0) < 0.5 and search.best.loss <= search.default.loss
    stopped = [t for t in search.done if t.stopped]
    assert stopped and all(loss({"x": t.changed["x"]}) > 0.1 for t in stopped)
    assert len(calls) == 2 * 25 - len(stopped)
    again, _ = a_search(monkeypatch, loss, axes, seed=3, trials=25)
    again.run()
    assert [t.changed for t in again.done] == [t.changed for t in search.done]
    fewer, _ = a_search(monkeypatch, loss, axes, seed=3, trials=12)
    fewer.run()
    assert [t.changed for t in fewer.done] == [t.changed for t in search.done[:12]]
    held = search.judged(held_out=4)
    assert {case[1:4:2] for case in held[0].solved} == {(f"d{p}", f"c{i}") for p in range(2) for i in range(5, 9)}
    assert ratio(held[1], held[0], held[0].index).high < 1


def test_a_small_space_ends_and_defaults_that_are_best_stay(monkeypatch):
    search, _ = a_search(
        monkeypatch, lambda m: 1 + abs(m["x"] - 5), [Axis("x", 5.0, choices=(4.0, 5.0, 6.0))], trials=50
    )
    search.run()
    assert len(search.done) == 3 and search.exhausted and search.best is search.default


def test_a_budget_ends_the_search(monkeypatch):
    search, _ = a_search(monkeypatch, lambda m: 1.0 + m["x"], [Axis("x", 5.0, 0.0, 10.0)], seconds=0.0)
    search.run()
    assert len(search.done) == 2  # the default and one more, however little time there is


USUAL = ("--plugin", MOVER, "task=denoise", "method=mover", "metric=p2f_mean", "results=r")
USUAL += ("dataset=globes", "sensor.count=300", "cases=2")


def test_the_command_writes_a_preset_that_is_used_and_marked(shell):
    words = ("tune", *USUAL, "--trials", "6", "--held-out", "1")
    done = shell.call(*words)
    assert done.returncode == 0, done.stderr
    assert "searched: shift in 0 to 2; default 1.0" in done.stderr
    assert len(re.findall(r"^\[\d\]", done.stderr, re.MULTILINE)) == 6
    assert re.search(r"^6 trials, by p2f_mean \(lower is better\)$", done.stdout, re.MULTILINE)
    assert re.search(r"^2 trial cases .*\n1 held-out cases ", done.stdout, re.MULTILINE)
    path = shell.work / "conf/method/mover_tuned.yaml"
    text = path.read_text()
    content = yaml.safe_load(text)
    assert content["defaults"] == ["mover"] and content["_tier_"] == "tuned"
    assert "--trials 6" in text and "optuna" in text and abs(content["shift"] - 0.3) < 0.7

    # The same command computes nothing again, and finds the same.
    cells = {f: f.stat().st_mtime_ns for f in shell.work.glob("r/cells/*/*.parquet")}
    assert cells and shell.call(*words).stdout == done.stdout
    assert {f: f.stat().st_mtime_ns for f in shell.work.glob("r/cells/*/*.parquet")} == cells
    assert yaml.safe_load(path.read_text()) == content

    # It is a preset as any other, and tables mark it.
    elsewhere = shell.work / "elsewhere"
    shutil.copytree(shell.work / "conf", elsewhere / "conf")
    shell.work = elsewhere
    words = ("--plugin", MOVER, "task=denoise", "metric=p2f_mean", "results=t", "cases=1", "sensor.count=300")
    shown = shell.call("run", "-m", *words, "method=mover,mover_tuned", "dataset=globes")
    assert shown.returncode == 0, shown.stderr
    assert len(re.findall(r"^mover_tuned ¶", shown.stdout, re.MULTILINE)) == 1
    assert "¶ tuned: a search on train shapes" in shown.stdout
    listed = shell.call("leaderboard", "t", "--plugin", MOVER, "--format", "csv")
    assert listed.returncode == 0, listed.stderr
    lines = listed.stdout.splitlines()
    assert lines[0].endswith(",tier") and sorted(line.endswith(",tuned") for line in lines[1:]) == [False, True]


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("split=test",), "uses train shapes only"),
        (("--budget", "soon"), "expected a time"),
        (("--trials", "0"), "expected 1 or more"),
        (("--preset", "poisson"), "a method has this name"),
        (("--preset", "a b"), "expected letters"),
        (("--preset", "mine"), "no search wrote it"),
        (("method.titel=a,b", "method.shift=1"), "no parameter"),
        (("method=[mover,jet]",), "method"),
    ],
)
def test_what_cannot_be_searched_is_reported_before_anything_runs(tmp_path, monkeypatch, capsys, words, reason):
    monkeypatch.chdir(tmp_path)
    mine = tmp_path / "conf" / "method" / "mine.yaml"
    mine.parent.mkdir(parents=True)
    mine.write_text("defaults: [mover]\nshift: 0.5\n")
    assert cli.main(["tune", *USUAL, *words]) == 1
    out, err = capsys.readouterr()
    assert reason in err, err
    assert out == "" and not list(tmp_path.glob("r/cells/*"))


def test_a_tier_is_no_parameter_and_others_are_refused(tmp_path, monkeypatch):
    folder = tmp_path / "conf" / "method"
    folder.mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    (folder / "fine.yaml").write_text("defaults: [jet]\n_tier_: tuned\nk: 24\n")
    (folder / "finer.yaml").write_text("defaults: [fine]\niterations: 2\n")
    (folder / "odd.yaml").write_text("defaults: [jet]\n_tier_: best\n")
    found = presets.presets("method", "jet")
    assert found["fine"].values == {"k": 24} and {found["fine"].tier, found["finer"].tier} == {"tuned"}
    assert presets.tuned_variants("method", "jet") == {"k=24", "k=24,iterations=2"}
    assert presets.tuned_variants("method", "poisson") == frozenset()
    assert [("_tier_" in why) for file, why in presets.broken(own=True)] == [True]
