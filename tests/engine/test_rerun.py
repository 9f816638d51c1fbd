"""Which stored rows are made anew: what a larger limit may change, what was not tried, and what is asked for."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

from bench.engine import runner
from bench.engine.runner import must_rerun
from bench.plan.cell import Settings
from bench.plan.limits import Limits

LIMITS = Limits(seconds=60, memory_gb=4, setup_seconds=600, output_points=1000)
BEFORE = {"setup_seconds": 600, "output_points": 1000}  # the limits that are no columns
SOLVED = {"status": "ok", "stage": "", "message": "", "limit_seconds": 60, "limit_memory_gb": 4}
NOTED = SOLVED | {"message": "half as many"}
FAILED = {
    status: SOLVED | {"status": status, "stage": stage}
    for status, stage in [
        ("error", "method"),
        ("crashed", "method"),
        ("invalid", "method"),
        ("timeout", "method"),
        ("oom", "method"),
    ]
}
LATE = FAILED["timeout"] | {"stage": "prepare"}
PAUSED = FAILED["timeout"] | {"message": "what stops the method's clock took longer than limit.setup_seconds=600"}
# What is raised, and the rows that are made anew then.
RAISED = {
    "seconds": {"noted": NOTED, "timeout": FAILED["timeout"], "late": LATE, "paused": PAUSED},
    "setup_seconds": {"late": LATE, "paused": PAUSED},
    "memory_gb": {"oom": FAILED["oom"]},
    "output_points": {"invalid": FAILED["invalid"]},
}
ROWS = {"solved": SOLVED, "noted": NOTED, "late": LATE, "paused": PAUSED, **FAILED}


def again(row, before=BEFORE, rerun="never", **limits):
    return must_rerun(row, Settings(limit=replace(LIMITS, **limits), rerun=rerun), before)


@pytest.mark.parametrize("name", ROWS)
def test_the_same_limits_make_nothing_anew(name):
    assert not again(ROWS[name])


@pytest.mark.parametrize("limit", RAISED)
@pytest.mark.parametrize("name", ROWS)
def test_a_raised_limit_makes_anew_what_it_stopped_and_a_lower_one_nothing(name, limit):
    own = getattr(LIMITS, limit)
    assert again(ROWS[name], **{limit: own + 1}) == (name in RAISED[limit])
    assert not again(ROWS[name], **{limit: own - 1})


@pytest.mark.parametrize("limit", ["setup_seconds", "output_points"])
def test_a_record_that_does_not_say_its_limits_is_not_made_anew_for_them(limit):
    for row in RAISED[limit].values():
        assert not again(row, before={}, **{limit: 10**9})


@pytest.mark.parametrize(("status", "limit"), [("timeout", "limit_seconds"), ("oom", "limit_memory_gb")])
def test_a_row_that_does_not_say_its_limit_is_made_anew(status, limit):
    assert again(FAILED[status] | {limit: None}, seconds=0.1, memory_gb=0.1)


@pytest.mark.parametrize("stage", ["start", "plan", "train", "prepare", "method"])
def test_everything_skipped_is_made_anew(stage):
    """The library may be there now, wherever it was missed."""
    assert again(SOLVED | {"status": "skipped", "stage": stage})


@pytest.mark.parametrize("stage", ["start", "plan", "train"])
def test_what_ended_before_any_case_is_made_anew(stage):
    for row in FAILED.values():
        assert again(row | {"stage": stage})
    for other in ("case", "prepare", "score", "worst"):
        assert not again(FAILED["error"] | {"stage": other})


@pytest.mark.parametrize("name", ROWS)
def test_failures_are_made_anew_where_that_is_asked_for(name):
    assert again(ROWS[name], rerun="failed") == (ROWS[name]["status"] != "ok")


def test_what_is_added_to_a_record_of_an_earlier_version_is_of_the_current_one(monkeypatch):
    """Its finished rows and those of the run that was interrupted; a record that is whole stays as it is."""
    stands = SimpleNamespace(record="earlier", mark="now")
    finished = {
        "earlier": ({0: {"fingerprint": "earlier"}, 1: {"fingerprint": "earlier"}}, SimpleNamespace(rows=[{}] * 3)),
        "now": ({1: {"fingerprint": "now", "new": True}}, None),
    }
    monkeypatch.setattr(runner, "finished_rows", lambda results, cell, mark, settings: finished[mark])
    rows, stored = runner.standing_rows(None, None, stands, Settings())
    assert rows == {0: {"fingerprint": "now"}, 1: {"fingerprint": "now", "new": True}}
    assert stored is finished["earlier"][1]
    stored.rows.pop()
    assert runner.standing_rows(None, None, stands, Settings()) == finished["earlier"]


def test_a_run_keeps_what_is_stored_and_not_to_be_made_anew(monkeypatch):
    monkeypatch.setattr(runner, "lacks", lambda meta: [])
    monkeypatch.setattr(runner, "of_the_cell", lambda cell: {"seed": 3, "split": "test"})
    cell = SimpleNamespace(id="cell", split="test", to_json=dict)
    good = [SOLVED | {"case_index": index} for index in range(4)]
    record = SimpleNamespace(meta={"settings": {"limit": BEFORE}}, rows=[good[0], LATE | {"case_index": 1}])
    of_another = good[3] | {"seed": 4}
    partial = [good[2] | {"seed": 3}, of_another]
    results = SimpleNamespace(read=lambda cell, mark: record, partial_rows=lambda cell, mark: partial)
    more = Settings(limit=replace(LIMITS, setup_seconds=700), outputs="none")
    assert runner.finished_rows(results, cell, "mark", more) == ({0: good[0], 2: partial[0]}, record)
    assert runner.finished_rows(results, cell, "mark", replace(more, rerun="always")) == ({}, record)
