"""One method applied to files: what its row says of sizes, colours and stages, and what a dead server costs."""

import sys
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from bench import PointCloud
from bench.engine import application, isolate
from bench.engine.application import Application, Applier, _StageClock
from bench.engine.applied import fingerprint
from bench.engine.forkserver import CannotStart, ServerDied
from bench.engine.watch import Death
from bench.errors import UsageError
from bench.geometry.io.files import load_cloud
from bench.notices import collected
from bench.plan.choice import Choice

BOX = trimesh.creation.box()
JOB = Application(Choice("task", "denoise"), Choice("method", "identity"), ("a.ply",), "b.ply")
RESULT = {"event": "result", "row": {"status": "ok"}}
DEAF = SimpleNamespace(send=lambda *_, **__: None, enter=lambda *_: None)


def noticed(function, *values):
    """What a function returns, and its notices."""
    with collected() as notes:
        return function(*values), list(notes)


def test_a_mesh_of_few_faces_is_not_simplified_and_that_is_said(monkeypatch):
    monkeypatch.setattr("bench.geometry.simplify.simplify", lambda mesh, faces: mesh)  # does not wait for Open3D
    asked = {"simplify": 12, "seed": 0}
    assert noticed(application._simplified, BOX, asked) == (BOX, ["not simplified: it has 12 faces"])


def test_colours_are_those_of_the_first_input_that_has_any():
    plain = PointCloud(np.eye(3))
    red = PointCloud(np.eye(3), colors=np.tile([1.0, 0, 0], (3, 1)))
    assert [application._has_colors(value) for value in (plain, red, 3, BOX)] == [False, True, False, False]
    assert noticed(application._colored, plain, []) == (plain, ["no colours: the input has none"])
    assert np.allclose(application._colored(plain, [red]).colors, red.colors, atol=0.01)


def test_inputs_and_outputs_are_told_in_words_and_numbers():
    cloud = PointCloud(np.eye(3), normals=np.eye(3), colors=np.zeros((3, 3)))
    found = application._sizes({"cloud": cloud, "ratio": 4}, BOX + BOX.copy().apply_translation([3, 0, 0]))
    assert (found["input"], found["input_points"]) == ("3 points with normals, colours", 3)
    assert (found["output"], found["pieces"]) == ("16 vertices, 24 faces, 2 pieces", 2)
    assert (found["output_points"], found["output_faces"]) == (16, 24)
    found = application._sizes({"mesh": BOX}, BOX)
    assert (found["output"], found["pieces"]) == ("8 vertices, 12 faces", 1)
    found = application._sizes({}, PointCloud(np.eye(3)))
    assert found["output"] == "3 points" and "pieces" not in found


def test_the_seconds_of_a_stage_that_comes_again_add_up(monkeypatch):
    now = iter([0.0, 1.0, 3.0, 7.0, 15.0])
    monkeypatch.setattr(application.time, "monotonic", lambda: next(now))
    told = []
    clock = _StageClock(SimpleNamespace(send=lambda event, what: told.append(what)))
    for name in ("reading", "solving", "reading", ""):
        clock(name)
    assert clock.seconds == {"reading": 2.0 + 8.0, "solving": 4.0} and told == ["reading", "solving", "reading", ""]


def test_reading_and_writing_are_off_the_method_s_clock_and_keep_all_attributes(tmp_path):
    """The runner holds each stage to its own limit."""
    (tmp_path / "a.csv").write_text("x,y,z,intensity\n0,0,0,7\n1,0,0,8\n0,1,0,9\n")
    task = Choice.of("task", {"_name_": "upsample", "ratio": 2})
    job = replace(JOB, task=task, inputs=(str(tmp_path / "a.csv"),), output=str(tmp_path / "b.ply"))
    events = []
    channel = SimpleNamespace(
        send=lambda event, **values: events.append(values.get("what", event)),
        enter=lambda stage, index: events.append(stage),
    )
    spec = {"arguments": application._arguments(job), "threads": 1, "seconds": 100.0, "memory_gb": 8.0}
    row = application._applied(spec, channel, [])
    assert (row["output"], row["input_points"]) == ("6 points with intensity", 3)
    assert load_cloud(tmp_path / "b.ply").scalars["intensity"].tolist() == [7, 7, 8, 8, 9, 9]
    assert events == ["prepare", "case", "prepare", "method", "write"]


def test_a_device_that_is_not_there_is_told_before_a_file_is_read(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    arguments = application._arguments(replace(JOB, inputs=("no such file.ply",), device="cuda"))
    with pytest.raises(UsageError, match="device=cuda: .*install it with"):
        application._applied({"arguments": arguments}, DEAF, [])


def test_an_output_that_cannot_be_written_is_told_before_a_file_is_read(tmp_path):
    (tmp_path / "b.ply").mkdir()
    arguments = application._arguments(replace(JOB, inputs=("no such file.ply",), output=str(tmp_path / "b.ply")))
    with pytest.raises(UsageError, match="is a folder; expected the name of a file"):
        application._applied({"arguments": arguments}, DEAF, [])


def test_an_output_is_made_again_where_a_file_of_its_folder_is_another(tmp_path):
    job = replace(JOB, inputs=(str(tmp_path),))
    (tmp_path / "below").mkdir()
    first, second = tmp_path / "1.png", tmp_path / "below" / "2.png"
    first.write_text("one"), second.write_text("two")
    before = fingerprint(job)
    assert fingerprint(job) == before
    second.write_text("too")
    assert fingerprint(job) != before
    second.write_text("two")
    assert fingerprint(job) == before
    second.rename(tmp_path / "2.png")
    assert fingerprint(job) != before


# -- servers -----------------------------------------------------------------------------------------------------------


@pytest.fixture
def servers(monkeypatch):
    """All that an Applier started; each answers with the next of ``answers``."""
    made = []

    class Calls:
        answers = []

        def __init__(self, *_):
            self.closed = 0
            made.append(self)

        def call(self, *_, **__):
            answer = Calls.answers.pop(0)
            if isinstance(answer, Exception):
                raise answer
            return answer

        def close(self):
            self.closed += 1

    monkeypatch.setattr(application, "Isolation", Calls)
    made_by = SimpleNamespace(made=made, answers=Calls.answers)
    return made_by


def test_a_server_that_died_of_one_file_is_replaced_for_the_next(servers):
    servers.answers += [{"status": "ok"}, ServerDied("killed"), {"status": "ok", "seconds": 2}, ServerDied("killed")]
    with Applier(JOB) as apply:
        assert apply(JOB) == {"status": "ok"}
        assert apply(JOB) == {"status": "ok", "seconds": 2}
        assert [server.closed for server in servers.made] == [1, 0]
        servers.answers += [CannotStart("no memory")]
        with pytest.raises(CannotStart):
            apply(JOB)
    assert [server.closed for server in servers.made] == [1, 1, 1]
    with Applier(JOB):
        pass  # no file: no server
    assert len(servers.made) == 3
    servers.answers += [CannotStart("no memory"), {"status": "ok"}]
    with Applier(JOB) as apply, pytest.raises(CannotStart):
        apply(JOB)  # another server would not start either
    assert len(servers.made) == 4


@pytest.fixture
def calls(monkeypatch):
    """What is done for single calls: the specs of workers, which send ``events`` and end as ``deaths`` says."""
    made = SimpleNamespace(specs=[], events=[RESULT], deaths=[], closed=0)

    class Ended:
        def __init__(self, server, spec, limit, hear, verbose):
            made.specs.append(spec)
            for event in made.events:
                hear(event)

        def watch(self):
            return made.deaths.pop(0) if made.deaths else None

    def close():
        made.closed += 1

    monkeypatch.setattr(isolate, "Worker", Ended)
    monkeypatch.setattr(isolate, "claim_device", lambda device: nullcontext("cuda:1" if device == "cuda" else device))
    server = SimpleNamespace(load=lambda *_: None, close=close)
    monkeypatch.setattr(isolate, "take_prestarted", lambda threads: server)
    return made


@pytest.mark.parametrize(
    ("arguments", "given"), [({"device": "cuda"}, {"device": "cuda:1"}), ({"seed": 3}, {"seed": 3})]
)
def test_a_call_is_told_the_device_that_was_claimed_for_it(calls, arguments, given):
    with isolate.Isolation() as isolation:
        assert isolation.call("module:name", arguments) == {"status": "ok"}
    assert calls.specs[0]["arguments"] == given


def test_a_call_gives_its_result_or_how_its_worker_ended(calls):
    begin, heard = {"event": "begin", "stage": "method"}, []
    death = Death("oom", "too much", 0, "case", 1.0, "", True)
    with isolate.Isolation() as isolation:
        for calls.events, calls.deaths, status, message in (
            ([begin, RESULT], [], "ok", None),
            ([begin, RESULT], [death], "oom", "too much"),
            ([begin], [death], "oom", "too much"),
            ([begin], [], "crashed", "its worker ended before it was done"),
        ):
            heard.clear()
            row = isolation.call("module:name", {}, on_event=heard.append)
            assert (row["status"], row.get("message")) == (status, message) and heard == calls.events
        assert not calls.closed
    assert calls.closed
