"""What a worker reports of the cases of a cell, one event after the other."""

import json
import os
import re
from datetime import UTC, datetime
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

    def run(dataset="ball", method="told", sensor="dots", metric="size", task="denoise", changed=(), **spec):
        monkeypatch.setattr(worker, "state", dict)
        monkeypatch.setattr(worker, "changes", lambda before: list(changed))
        named = {"task": task, "dataset": dataset, "sensor": sensor, "method": method}
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
    begin = datetime.now(UTC).isoformat(timespec="milliseconds")
    heard = events()
    assert told(heard) == ["plan", "cases", *CASE, *CASE]
    end = datetime.now(UTC).isoformat(timespec="milliseconds")
    assert heard[1]["ids"] == ["ball-test-000", "ball-test-001"]
    assert [event["row"]["case"] for event in heard if event["event"] == "row"] == heard[1]["ids"]
    row = row_of(heard)
    assert begin <= row["started"] <= row["finished"] <= end and row["reference_seconds"] > 0
    assert (row["tags"], row["output_points"]) == ("smooth", 100)
    assert told(events(done=[0])) == ["plan", "cases", *CASE]
    assert told(events(done=[0, 1], owed=[1])) == ["plan", "cases", "worst", "worst"]


def test_of_a_cloud_as_the_reference_the_tags_are_those_of_the_dataset(events):
    heard = events({"_name_": "named", "ids": ["a000"], "clouds": True})
    row = row_of(heard)
    assert (row["status"], row["tags"], row["score.size"], "floor.size" in row) == ("ok", "round", 0, False)
    assert worst_of(heard)["worst.size"] == -100


def test_the_size_of_a_mesh_is_told_in_vertices_and_faces(events):
    row = row_of(events(task="reconstruct", done=[1]))
    assert (row["status"], row["output_points"], row["output_faces"]) == ("ok", 42, 80)


def test_what_one_cell_has_made_and_measured_the_next_one_does_not_make_again(events, monkeypatch):
    def fails(*arguments):
        raise ArithmeticError("once is enough")

    first = row_of(events(cache_gb=1, done=[1]))
    monkeypatch.setattr(Choice.of("sensor", node("dots")).plugin.cls, "sense", fails)
    monkeypatch.setattr(worker, "measure_traits", fails)
    monkeypatch.setattr("bench.geometry.conditions.describe_cloud", fails)
    again = row_of(events(cache_gb=1, done=[1]))
    kept = [key for key in first if key.startswith(("score.", "floor.", "input.")) or key in ("status", "tags")]
    assert len(kept) > 5 and {key: again[key] for key in kept} == {key: first[key] for key in kept}
    assert row_of(events(cache_gb=0, done=[1]))["status"] == "error"


@pytest.mark.parametrize(
    ("job", "status", "message"),
    [
        ({"metric": "lacking"}, "skipped", "no_such_library_of_a_metric is not installed; install it with"),
        ({"device": "abacus"}, "error", "device.*abacus"),
    ],
)
def test_what_is_missing_for_all_cases_is_said_before_any_is_made(events, job, status, message):
    heard = events(**job)
    assert told(heard) == ["plan", "no_plan"] and heard[-1]["row"]["status"] == status
    assert re.search(message, heard[-1]["row"]["message"])


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
    assert entry.pop("seconds") >= 0 and entry == {"score.size": -93}
    assert (row["score.size"], row["floor.size"], row["directions"]) == (0, 0, '{"size": "higher"}')


@pytest.mark.parametrize(("outputs", "kept"), [("none", 0), ("first", 1), ("all", 2)])
def test_outputs_are_kept_beside_their_references_where_that_is_asked_for(events, tmp_path, outputs, kept):
    heard = events(method={"_name_": "told", "do": "keep"}, outputs=outputs)
    for number in range(2):
        row = row_of(heard, number)
        assert bool(row["output"]) == (number < kept) == ("reference" in row) == ("artefacts" in row)
        if number < kept:
            assert f"-mark/ball-test-00{number}.ply" in row["output"]
            assert (len(load_cloud(tmp_path / row["output"]).points), row["output_points"]) == (100 + 10 * number,) * 2
            assert len(load_mesh(tmp_path / row["reference"]).faces) == 320


def test_metrics_without_a_score_say_why_after_what_the_method_has_noted(events):
    told = {"_name_": "told", "do": "trace"}
    row = row_of(events(method=told, metric={"_name_": "size", "least": 105}, done=[1]))
    assert (row["status"], row["message"]) == ("ok", "traced; it is small; no size: only 100 points")
    row = row_of(events(metric={"_name_": "size", "least": 105}, done=[1]))
    assert (row["status"], row["message"]) == ("ok", "it is small; no size: only 100 points")
    row = row_of(events(method=told, metric={"_name_": "size", "refuse": 100}, done=[1]))
    assert (row["status"], row["stage"], row["traceback"]) == ("error", "method", "")
    assert row["message"].startswith("an output of 7 points (while scoring size)")


# -- the worst scores --------------------------------------------------------------------------------------------------


def worst_of(events):
    (row,) = (event["row"] for event in events if event["event"] == "worst")
    return row


def test_the_worst_score_is_that_of_the_worst_output_that_is_not_refused(events):
    assert worst_of(events(done=[1])) == {"worst.size": -100, "directions": '{"size": "higher"}'}
    assert worst_of(events(done=[0, 1], owed=[0])) == worst_of(events(done=[1]))
    for metric in ({"refuse": 1000}, {"refuse": 1}, {"surface": True}):  # all of them, or all that are worse
        assert worst_of(events(metric={"_name_": "size", **metric}, done=[0, 1], owed=[0])) == {}


def test_the_worst_score_of_a_case_is_not_that_of_the_case_before_it_which_failed(events):
    failed = {"status": "error", "stage": "train", "message": "it failed"}
    assert worst_of(events(weights={"failed": failed}, done=[1], owed=[1]))["worst.size"] == -110


def test_a_task_whose_hopeless_outputs_cannot_be_made_keeps_its_result(events, monkeypatch, capsys):
    def fails(task, case):
        raise ArithmeticError("hopeless indeed")

    monkeypatch.setattr("bench.contract.task.Task.hopeless", fails)
    assert told(events(done=[1])) == ["plan", "cases", *CASE[:-1]]
    assert capsys.readouterr().err == (
        "ball-test-000: cannot score the outputs of hopeless(): ArithmeticError('hopeless indeed')\n"
    )
