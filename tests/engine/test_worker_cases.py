"""What a worker reports of the cases of a cell, one event after the other."""

import json
import os
import re
from pathlib import Path

import pytest
from conftest import TOYS

from bench.engine import worker
from bench.engine.channel import Channel, read_event
from bench.geometry.io.files import load_cloud, load_mesh
from bench.plan.cell import Cell
from bench.plan.choice import Choice

TOLD = Path(__file__).with_name("toy_cases.py")


@pytest.fixture(autouse=True, scope="module")
def toys(plugin_file):
    plugin_file(TOYS)
    plugin_file(TOLD)


@pytest.fixture
def events(tmp_path, monkeypatch):
    """What a worker reports of a cell of toys, whose cases run in this process.

    Other tests change this process, too: each call has changed what ``changed`` says.
    """

    def run(dataset="ball", method="told", sensor="dots", metric="size", changed=(), **spec):
        monkeypatch.setattr(worker, "state", dict)
        monkeypatch.setattr(worker, "changes", lambda before: list(changed))
        named = {"task": "denoise", "dataset": dataset, "sensor": sensor, "method": method}
        choices = {kind: Choice.of(kind, node(value)) for kind, value in named.items()}
        metrics = (Choice.of("metric", node(metric)),)
        cell = Cell(**choices, metrics=metrics, seed=0, split="test", cases=2, threads=1, device="cpu")
        job = {
            "cell": cell.to_json(),
            "keys": dict.fromkeys((*named, *(f"metric {choice.name}" for choice in metrics)), "key"),
            "done": [],
            "owed": [],
            "threads": 1,
            "seconds": 60.0,
            "memory_gb": 8.0,
            "cache_gb": 0,
            "outputs": "none",
            "fingerprint": "mark",
            "cache": str(tmp_path),
            "results": str(tmp_path),
        }
        return reported(tmp_path, {**job, **spec})

    return run


def node(value):
    return value if isinstance(value, dict) else {"_name_": value}


def reported(folder, spec):
    """The events of a job."""
    file = folder / "events"
    channel = Channel(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC))
    worker.Session(json.loads(json.dumps(spec)), channel).run()
    return [read_event(line) for line in file.read_bytes().splitlines()]


def told(events):
    """The kinds of the events, and of each beginning the stage."""
    return [event.get("stage", event["event"]) for event in events]


CASE = ["case", "prepare", "method", "score", "row", "worst", "worst"]


# -- cases -------------------------------------------------------------------------------------------------------------


def test_cases_are_listed_and_then_run_one_after_the_other(events):
    heard = events()
    assert told(heard) == ["plan", "cases", *CASE, *CASE]
    assert heard[1]["ids"] == ["ball-test-000", "ball-test-001"]
    assert [event["row"]["case"] for event in heard if event["event"] == "row"] == heard[1]["ids"]
    assert told(events(done=[0])) == ["plan", "cases", *CASE]
    assert told(events(done=[0, 1], owed=[1])) == ["plan", "cases", "worst", "worst"]


def test_after_a_call_that_changed_its_process_the_next_case_is_left_to_a_new_one(events, capsys):
    assert told(events(changed=["limits", "threads"])) == ["plan", "cases", *CASE, "replace"]
    assert capsys.readouterr().out == (
        "ball-test-001: runs in a new process, because the call before it changed limits, threads\n"
    )


@pytest.mark.parametrize(
    ("ids", "message"),
    [
        (["b", "b"], r"named\[.*\]: two cases have one id: 'b'"),
        (["a", "x" * 201], r"named\[.*\]: an id of 201 letters; expected 200 at most"),
    ],
)
def test_names_of_cases_that_no_folder_of_outputs_can_hold_are_refused_before_any_is_made(events, ids, message):
    heard = events({"_name_": "named", "ids": ids})
    assert told(heard) == ["plan", "no_plan"]
    assert heard[-1]["row"]["status"] == "error" and heard[-1]["row"]["stage"] == "plan"
    assert re.search(message, heard[-1]["row"]["message"])


def test_a_name_of_200_letters_is_fine(events):
    assert told(events({"_name_": "named", "ids": ["x" * 197 + "000"]})) == ["plan", "cases", *CASE]


def test_a_process_that_a_method_forked_ends_like_a_script_where_it_fails(events):
    heard = events(method={"_name_": "told", "do": "fork"}, done=[1])
    assert told(heard) == ["plan", "cases", *CASE]
    assert heard[6]["row"]["message"] == "ended with 1"


def test_cases_without_weights_tell_what_became_of_the_training(events):
    failed = {"status": "timeout", "stage": "train", "message": "took too long", "traceback": "", "case": "no column"}
    heard = events(weights={"failed": failed})
    assert told(heard) == ["plan", "cases", *["case", "row"] * 2]
    row = heard[3]["row"]
    assert row["case"] == "ball-test-000" and row["input.points"] == 100
    assert {key: row[key] for key in failed} == failed | {"case": "ball-test-000"}


def row_of(events, number=0):
    """The row of a case."""
    return [event["row"] for event in events if event["event"] == "row"][number]


def test_intermediate_results_are_scored_alone_and_the_output_beside_a_perfect_one(events):
    row = row_of(events(method={"_name_": "told", "do": "trace"}, done=[1]))
    (entry,) = json.loads(row["trace"])
    assert entry.pop("seconds") >= 0 and entry == {"score.size": 7}
    assert (row["score.size"], row["floor.size"], row["directions"]) == (100, 100, '{"size": "higher"}')


@pytest.mark.parametrize(("outputs", "kept"), [("none", 0), ("first", 1), ("all", 2)])
def test_outputs_are_kept_beside_their_references_where_that_is_asked_for(events, tmp_path, outputs, kept):
    heard = events(outputs=outputs)
    for number in range(2):
        row = row_of(heard, number)
        assert bool(row["output"]) == (number < kept) == ("reference" in row)
        if number < kept:
            assert f"-mark/ball-test-00{number}.ply" in row["output"]
            assert (len(load_cloud(tmp_path / row["output"]).points), row["output_points"]) == (100 + 10 * number,) * 2
            assert len(load_mesh(tmp_path / row["reference"]).faces) == 320


def test_metrics_without_a_score_say_why_after_what_the_method_has_noted(events):
    told = {"_name_": "told", "do": "trace"}
    row = row_of(events(method=told, metric={"_name_": "size", "least": 105}, done=[1]))
    assert (row["status"], row["message"]) == ("ok", "traced; no size: only 100 points")
    row = row_of(events(method=told, metric={"_name_": "size", "refuse": 100}, done=[1]))
    assert (row["status"], row["stage"], row["traceback"]) == ("error", "method", "")
    assert row["message"].startswith("an output of 7 points (while scoring size)")


# -- the worst scores --------------------------------------------------------------------------------------------------


def worst_of(events):
    (row,) = (event["row"] for event in events if event["event"] == "worst")
    return row


def test_the_worst_score_is_that_of_the_worst_output_that_is_not_refused(events):
    assert worst_of(events(done=[1])) == {"worst.size": 0, "directions": '{"size": "higher"}'}
    assert worst_of(events(done=[0, 1], owed=[0])) == worst_of(events(done=[1]))
    for metric in ({"refuse": 1000}, {"refuse": 1}, {"surface": True}):  # all of them, or all that are worse
        assert worst_of(events(metric={"_name_": "size", **metric}, done=[0, 1], owed=[0])) == {}


def test_a_task_whose_hopeless_outputs_cannot_be_made_keeps_its_result(events, monkeypatch, capsys):
    def fails(task, case):
        raise ArithmeticError("hopeless indeed")

    monkeypatch.setattr("bench.contract.task.Task.hopeless", fails)
    assert told(events(done=[1])) == ["plan", "cases", *CASE[:-1]]
    assert capsys.readouterr().err == (
        "ball-test-000: cannot score the outputs of hopeless(): ArithmeticError('hopeless indeed')\n"
    )
