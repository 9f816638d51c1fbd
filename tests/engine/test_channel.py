"""What may come through the pipe of a worker: events that fit its work, and nothing else."""

import json
import math
import os
import pathlib
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest

from bench.engine import watch
from bench.engine.channel import EVENTS, Channel, NoEvent, plain, read_event
from bench.engine.forkserver import FAILED, ServerDied
from bench.engine.runner import _Job
from bench.plan.limits import Limits
from bench.text import bounded, cut

ROW = {"case": "a", "case_index": 0, "status": "ok"}
GOOD = {
    "begin": {"stage": "case", "index": 0},
    "cases": {"ids": ["a", "b"]},
    "row": {"row": ROW | {"score.x": 1.5, "seconds": None}},
    "no_plan": {"row": {"status": "error", "message": "no file"}},
    "result": {"row": {"status": "refused", "message": ""}},
    "worst": {"index": 0, "row": {"worst.x": 2.0}},
    "progress": {"done": 1, "total": 2.5},
    "doing": {"what": "solving"},
}


def line(kind, **values):
    return json.dumps({"event": kind, **values}).encode()


@pytest.mark.parametrize("kind", EVENTS)
def test_an_event_is_read_as_it_was_sent(kind):
    values = GOOD.get(kind, {})
    assert read_event(line(kind, **values)) == {"event": kind, **values}
    for name in values:
        with pytest.raises(NoEvent, match=f"{kind}.*{name}"):
            read_event(line(kind, **{**values, name: [[None]]}))


@pytest.mark.parametrize(
    "text",
    [b"[1]", b'{"x": 1}', b"1", b"null", b'{"event": []}', b'{"event": "bow"}', b"\xff\xfe", b"hello", b"[" * 100_000]
    + [b'{"event": ' * 100_000, b"1" * 10_000, b'{"event": "done"} {}', b'"event"'],
)
def test_what_is_no_event_is_refused(text):
    with pytest.raises(NoEvent):
        read_event(text)


def test_an_index_is_a_whole_number_from_minus_one():
    for index in (-1, 0, 2**63 - 1):
        assert read_event(line("begin", stage="plan", index=index))["index"] == index
    for index in (-2, 2**63, 0.0, True, None, "0"):
        with pytest.raises(NoEvent, match="index"):
            read_event(line("begin", stage="plan", index=index))


def test_progress_is_in_finite_numbers_that_64_bits_hold():
    for done in (None, 0, 2.5, 2**63 - 1, 1 - 2**63):
        assert read_event(line("progress", done=done, total=done)) == {"event": "progress", "done": done, "total": done}
    for done in (2**63, -(2**63), math.inf, -math.inf, math.nan, "1"):
        with pytest.raises(NoEvent, match="done"):
            read_event(line("progress", done=done, total=1))


def test_a_channel_knows_the_stage_that_it_has_reported():
    reads, writes = os.pipe()
    channel = Channel(writes)
    assert channel.stage == "start"
    channel.enter("method", 3)
    assert channel.stage == "method"
    assert json.loads(os.read(reads, 1000)) == {"event": "begin", "index": 3, "stage": "method"}
    os.close(reads)


def test_a_fork_of_the_worker_that_reports_ends_instead():
    reads, writes = os.pipe()
    channel = Channel(writes)
    if not (child := os.fork()):
        channel.send("done")
        os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    channel.send("listed")
    assert json.loads(os.read(reads, 1000)) == {"event": "listed"}
    os.close(reads)


@pytest.mark.parametrize(
    "changed",
    [{"case_index": "0"}, {"case_index": 2**63}, {"case_index": None}, {"status": "fine"}, {"case": 1}]
    + [{"seconds": "1"}, {"message": 1}, {"score.x": "good"}, {"parameters": 0.5}, {"traceback": []}],
)
def test_a_row_that_cannot_be_stored_is_refused(changed):
    with pytest.raises(NoEvent):
        read_event(line("row", row=ROW | changed))


def test_the_worst_scores_are_numbers_and_their_directions_and_nothing_else_of_a_row():
    good = {"worst.x": 2.0, "worst.y": None, "directions": '{"x": "lower"}'}
    assert read_event(line("worst", index=0, row=good))["row"] == good
    for more in ({"score.x": 1.0}, {"status": "ok"}, {"worst.x": "large"}, {"directions": 1}):
        with pytest.raises(NoEvent, match="row"):
            read_event(line("worst", index=0, row=good | more))


class Heard(_Job):
    """The cases of a cell, of which nothing is stored."""

    def __init__(self):
        self.ids, self.rows, self.scored, self.told = [], {}, set(), []
        self.reporter = type("", (), {"event": lambda _, event: self.told.append(event["event"])})()
        self.at, self.listed, self.replaced = (-1, 0), False, False
        self.cell = type("", (), {"cases": 100_000, "planned": 100_000})

    def keep(self, row):
        self.rows[row["case_index"]] = row


BEGINNING = [("begin", {"stage": "plan", "index": -1}), ("cases", {"ids": ["a", "b"]})]
FIRST = [("begin", {"stage": "case", "index": 0}), ("begin", {"stage": "method", "index": 0})]
ITS_ROW = [("row", {"row": ROW})]


def hear(events):
    job = Heard()
    for kind, values in events:
        job.hear(read_event(line(kind, **values)))
    return job


def test_a_worker_that_works_is_heard():
    worst = [("begin", {"stage": "worst", "index": 0}), ("worst", {"index": 0, "row": {"worst.x": 2.0}})]
    second = [("begin", {"stage": "case", "index": 1}), ("row", {"row": {**ROW, "case": "b", "case_index": 1}})]
    events = [*BEGINNING, *FIRST, ("progress", {"done": 1, "total": 2}), *ITS_ROW, *worst, *second]
    job = hear(events)
    assert list(job.rows) == [0, 1] and job.rows[0]["worst.x"] == 2.0 and not job.replaced
    assert job.scored == {0} and job.told == [kind for kind, _ in events]
    assert hear([*events, ("replace", {})]).replaced
    job = Heard()
    job.rows = dict.fromkeys(range(4), ROW)  # of a time when the dataset had four cases
    for kind, values in BEGINNING:
        job.hear({"event": kind, **values})
    assert list(job.rows) == [0, 1]


@pytest.mark.parametrize(
    "events",
    [
        [("row", {"row": ROW})],  # before there is a case
        [BEGINNING[1]],
        [BEGINNING[0], FIRST[0]],  # before it has said which there are
        [*BEGINNING, BEGINNING[1]],
        [*BEGINNING, *ITS_ROW],
        [*BEGINNING, *FIRST, ("row", {"row": {**ROW, "case_index": 1, "case": "b"}})],  # of another case
        [*BEGINNING, *FIRST, ("row", {"row": {**ROW, "case": "c"}})],
        [*BEGINNING, *FIRST, *ITS_ROW, *ITS_ROW],
        [*BEGINNING, *FIRST, FIRST[0]],  # the clock would begin again
        [*BEGINNING, *FIRST, FIRST[1]],
        [*BEGINNING, ("begin", {"stage": "case", "index": 2})],
        [*BEGINNING, ("begin", {"stage": "rest", "index": 0})],
        [*BEGINNING, *FIRST, ("cases", {"ids": []})],
        [*BEGINNING, *FIRST, ("no_plan", {"row": {"status": "error"}})],
        [*BEGINNING, *FIRST, ("worst", {"index": 1, "row": {"worst.x": 2.0}})],
    ],
)
def test_an_event_that_the_worker_cannot_have_sent_is_refused(events):
    hear(events[:-1])
    with pytest.raises(NoEvent):
        hear(events)


def test_a_listing_that_fails_has_one_row_or_one_for_each_listed_case():
    failed = ("no_plan", {"row": {"status": "error", "message": "no file", "stage": "plan"}})
    job = hear([BEGINNING[0], failed])
    assert list(job.rows) == [0] and job.rows[0]["case"] == "case-000"
    job = hear([*BEGINNING, *FIRST, *ITS_ROW])
    job.at, job.listed = (-1, 0), False  # another worker
    for kind, values in (BEGINNING[0], failed):
        job.hear({"event": kind, **values})
    assert [row["status"] for row in job.rows.values()] == ["ok", "error"] and job.rows[1]["case"] == "b"


class Server:
    """Forks workers that are a function, as a fork server would."""

    def __init__(self, function):
        self.function = function

    def fork(self, spec, messages, output):
        pid = os.fork()
        if not pid:
            os.setsid()
            os.dup2(output, 1)
            os.dup2(output, 2)
            os.close(output)
            try:
                self.function(Channel(messages))
            finally:
                os._exit(3)
        return pid

    def reap(self, pid):
        return os.waitpid(pid, 0)[1]


def watched(function, **limits):
    heard = []
    return watch.Worker(Server(function), {}, Limits(**limits), heard.append).watch(), heard


def test_a_worker_ends_when_it_is_done_and_is_killed_if_it_does_not(monkeypatch):
    monkeypatch.setattr(watch, "ENDS_WITHIN", 0.2)

    def lasting(channel):
        channel.enter("method", 0)
        channel.send("done")
        channel.send("progress", done=1, total=1)  # of a thread that was left
        while True:
            pass

    death, heard = watched(lasting)
    assert death is None
    assert [event["event"] for event in heard] == ["begin"]


def test_a_worker_that_is_done_has_time_to_end_by_itself():
    def ending(channel):
        channel.send("done")
        time.sleep(0.15)  # longer than between two looks
        os.write(1, b"goodbye")

    worker = watch.Worker(Server(ending), {}, Limits(), lambda event: None)
    assert worker.watch() is None and worker.printed == b"goodbye"


def test_a_worker_that_ends_before_the_first_case_says_so():
    death, _ = watched(lambda channel: os._exit(5))
    assert (death.status, death.message) == ("crashed", "ended with exit status 5")
    assert (death.stage, death.index) == ("start", -1) and 0 <= death.seconds < 30


def test_a_worker_that_closes_its_output_is_looked_at_no_more_often_and_leaves_no_descriptor():
    looks, before = [], os.listdir("/proc/self/fd")

    def closing(channel):
        os.close(1), os.close(2)
        time.sleep(0.2)

    watch.Worker(Server(closing), {}, Limits(), lambda event: None, lambda: looks.append(1)).watch()
    assert len(looks) < 100
    assert os.listdir("/proc/self/fd") == before


def test_nothing_that_changes_a_result_comes_after_the_end():
    def more(channel):
        channel.send("done")
        channel.send("result", row={"status": "ok"})

    death, _ = watched(more)
    assert death.status == "crashed" and "an event 'result' after 'done'" in death.message
    assert death.message.startswith("something other than the worker wrote to its event pipe: ")


def test_what_it_wrote_before_it_ended_counts_whenever_it_is_read():
    """It may write and end after a look at its messages, and before the look whether it has ended."""

    def death_of(*messages):
        begin, begun = os.pipe()

        def late(channel):
            os.read(begin, 1)
            for kind, values in messages:
                channel.send(kind, **values)
            os.write(1, b"goodbye")

        def alive():
            time.sleep(0.1)
            os.write(begun, b"x")
            os.waitid(os.P_PID, worker.pid, os.WEXITED | os.WNOWAIT)

        worker = watch.Worker(Server(late), {}, Limits(), lambda event: None, alive)
        death = worker.watch()
        os.close(begin), os.close(begun)
        assert death.status == "crashed" and death.printed == "goodbye"
        return death

    assert "an event 'result' after 'done'" in death_of(("done", {}), ("result", {"row": {"status": "ok"}})).message
    death = death_of(("begin", {"stage": "method", "index": 2}))
    assert (death.stage, death.index) == ("method", 2) and 0 <= death.seconds < 0.1  # since that stage began


@pytest.mark.parametrize(
    ("forged", "seconds", "status", "said"),
    [(True, 60, "crashed", "without a 'pause'"), (False, 0.05, "timeout", "stopped after 0.05 s (limit.seconds=0.05)")],
)
def test_no_message_counts_that_comes_after_a_limit_or_after_one_that_no_worker_sends(
    monkeypatch, forged, seconds, status, said
):
    """What it sends before it is killed, late on a busy machine, would be the result of a case, and end the next."""
    begin, begun = os.pipe()
    end, ended = os.pipe()
    kill = watch.Worker.kill

    def kill_late(worker):
        os.write(begun, b"x")
        os.read(end, 1)
        kill(worker)

    monkeypatch.setattr(watch.Worker, "kill", kill_late)

    def going_on(channel):
        channel.enter("method", 1)
        if forged:
            channel.send("resume")
        os.read(begin, 1)
        channel.enter("method", 2)
        os.write(1, b"goodbye")
        os.write(ended, b"x")
        time.sleep(60)

    death, heard = watched(going_on, seconds=seconds)
    for fd in (begin, begun, end, ended):
        os.close(fd)
    assert (death.status, death.index, death.printed) == (status, 1, "goodbye") and said in death.message
    assert [event["index"] for event in heard] == [1]


def test_a_clock_that_was_stopped_twice_stands_still_until_it_is_started_twice():
    def nested(channel):
        channel.enter("method", 0)
        for kind in ("pause", "pause", "resume"):
            channel.send(kind)
        __import__("time").sleep(0.5)
        channel.send("resume")
        channel.send("done")
        os._exit(0)

    assert watched(nested, seconds=0.2)[0] is None
    death, _ = watched(lambda channel: channel.send("resume"))
    assert "without a 'pause'" in death.message


def test_a_run_that_is_stopped_leaves_no_worker():
    class Interrupted(Exception):
        pass

    def alive():
        raise Interrupted

    ends = []
    server = Server(lambda channel: time.sleep(10))
    server.reap = lambda pid: ends.append(os.waitpid(pid, 0)[1])
    with pytest.raises(Interrupted):
        watch.Worker(server, {}, Limits(), lambda event: None, alive).watch()
    assert list(map(os.WTERMSIG, ends)) == [signal.SIGKILL]


def test_a_worker_that_died_with_its_server_is_followed_no_further():
    """Its process is nobody's child any more, and gone."""

    class Killed(Server):
        def fork(self, spec, messages, output):
            pid = super().fork(spec, messages, output)
            os.waitpid(pid, 0)
            return pid

        def reap(self, pid):
            raise ServerDied("killed")

    limits = Limits(seconds=2, setup_seconds=2)
    death = watch.Worker(Killed(lambda channel: None), {}, limits, lambda event: None).watch()
    assert death.with_server and (death.status, death.message) == ("crashed", "the fork server was killed")


@pytest.mark.parametrize(
    ("status", "printed", "how", "said"),
    [
        (None, "", "crashed", "the fork server was killed"),
        (9, "a\nb", "crashed", "killed by SIGKILL (signal 9)"),
        (
            6,
            "a\nMemoryError: no\nb",
            "oom",
            "killed by SIGABRT (signal 6) after it could not allocate (limit.memory_gb=2)",
        ),
        (50, "", "crashed", "killed by signal 50"),  # of no name
        (3 << 8, "a\nb", "crashed", "ended with exit status 3"),
        (FAILED << 8, "Traceback:\nKeyError: 3\n", "crashed", f"ended with exit status {FAILED}: KeyError: 3"),
        (FAILED << 8, "", "crashed", f"ended with exit status {FAILED}"),
    ],
)
def test_the_cause_of_a_death(status, printed, how, said):
    worker = SimpleNamespace(printed=printed.encode(), limits=Limits(memory_gb=2))
    assert watch.Worker._cause(worker, status) == (how, said)


def test_a_pipe_that_is_never_empty_is_read_to_its_end(monkeypatch):
    """With looks at the limits in between: so many reads, and on."""
    monkeypatch.setattr(watch, "READS", 1)

    def busy(channel):
        channel.enter("method", 0)
        for done in range(5000):  # more than a pipe holds
            channel.send("progress", done=done, total=5000)
        channel.send("done")
        os._exit(0)

    death, heard = watched(busy, seconds=5)
    assert death is None and [event["done"] for event in heard[1:]] == list(range(5000))


def test_the_memory_of_what_a_program_of_the_method_has_started_counts(monkeypatch):
    monkeypatch.setattr(watch, "LOOK_BELOW", 0.0)
    program = "import time; block = b'1' * (250 << 20); time.sleep(60)"

    def starting(channel):
        channel.enter("method", 0)
        subprocess.run(["sh", "-c", f'{sys.executable} -c "{program}"; true'])

    death, _ = watched(starting, seconds=20, memory_gb=0.2)
    assert death.status == "oom" and death.message.endswith(" GB (limit.memory_gb=0.2)")


def reached(stage, then, **limits):
    """The death of a worker that comes to a stage, and goes on when the runner knows that."""
    begin, begun = os.pipe()
    there, came = os.pipe()

    def staged(channel):
        channel.enter(stage, 0)
        os.write(came, b"x")
        os.read(begin, 1)
        then(channel)

    class Waiting(Server):
        def fork(self, *given):
            pid = super().fork(*given)
            os.read(there, 1)  # so that a busy machine does not make its start last longer than a limit
            return pid

    worker = watch.Worker(Waiting(staged), {}, Limits(**limits), lambda event: None, lambda: os.write(begun, b"x"))
    death = worker.watch()
    for fd in (begin, begun, there, came):
        os.close(fd)
    return death


@pytest.mark.parametrize(
    ("stage", "seconds", "setup_seconds", "said"),
    [
        ("method", 0.1, 60, "stopped after 0.1 s (limit.seconds=0.1)"),
        ("case", 0.01, 0.1, "making the case took longer than limit.setup_seconds=0.1"),
        ("prepare", 0.1, 0.01, "preparing the method took longer than limit.seconds=0.1"),
        ("rest", 0.1, 0.1, "the stage 'rest' took longer than limit.setup_seconds=0.1"),
    ],
)
def test_a_stage_has_its_time_and_the_limit_that_it_passed_is_named(stage, seconds, setup_seconds, said):
    death = reached(stage, lambda channel: time.sleep(60), seconds=seconds, setup_seconds=setup_seconds)
    assert (death.status, death.stage, death.message) == ("timeout", stage, said)
    assert 0.1 <= death.seconds < 30


@pytest.mark.parametrize(
    ("stage", "setup_gb", "passed"), [("method", 4, True), ("case", 0.08, True), ("case", 4, False)]
)
def test_making_a_case_may_take_more_memory_than_the_method(monkeypatch, stage, setup_gb, passed):
    monkeypatch.setattr(watch, "SETUP_MEMORY_GB", setup_gb)
    inherited = b"1" * (100 << 20)  # what the worker has before a stage does not count

    def taking(channel):
        block = b"1" * (100 << 20)
        time.sleep(60 if passed else 0.15)  # longer than between two looks
        channel.send("done")
        del block

    death = reached(stage, taking, seconds=20, memory_gb=0.08)
    end = ("oom", "took 0.1 GB (limit.memory_gb=0.08)")
    assert (death and (death.status, death.message)) == (end if passed else None)
    assert len(inherited) == 100 << 20


def test_a_clock_that_is_stopped_for_too_long_is_no_fault_of_the_method():
    def paused(channel):
        channel.send("pause")
        time.sleep(60)

    death = reached("method", paused, seconds=0.05, setup_seconds=0.1)
    assert (death.status, death.stage) == ("timeout", "method") and 0.15 <= death.seconds < 30
    assert death.message == "what stops the method's clock took longer than limit.setup_seconds=0.1"

    def resumed(channel):
        channel.send("pause")
        channel.send("resume")
        time.sleep(60)

    death = reached("method", resumed, seconds=0.1, setup_seconds=60)
    assert death.status == "timeout" and 0.1 <= death.seconds < 30


def test_what_a_worker_prints_is_shown_at_once_to_a_user_who_wants_to_see_it(monkeypatch, tmp_path):
    path = tmp_path / "shown.txt"
    with path.open("w") as file:
        monkeypatch.setattr(sys, "stderr", file)
        for wanted in ({}, {"verbose": True}):
            server = Server(lambda channel: os.write(1, b"hello"))
            watch.Worker(server, {}, Limits(), lambda event: None, **wanted).watch()
            assert path.read_text() == ("hello" if wanted else "")


def test_an_event_may_be_longer_than_a_pipe_holds_but_not_without_end(monkeypatch):
    monkeypatch.setattr(watch, "LONGEST", 1 << 20)

    def long(channel):
        channel.send("doing", what="x" * 500_000)
        channel._file.write(b"\n")  # an empty line is nothing
        while True:
            channel._file.write(b"x" * (1 << 16))

    death, heard = watched(long)
    assert [len(event["what"]) for event in heard] == [500_000]
    assert death.status == "crashed" and death.message.endswith(": more than 1 MB without the end of a line")


def test_memory_is_measured_alike_where_there_is_no_proc(monkeypatch):
    here = watch._resident_mb(os.getpid())
    monkeypatch.setattr(watch, "Path", lambda name: pathlib.Path("/nowhere"))
    monkeypatch.setattr(sys, "platform", "darwin")
    assert watch._resident_mb(os.getpid()) == pytest.approx(here, rel=0.1)


def test_a_server_that_cannot_fork_costs_no_descriptor():
    class Gone:
        def fork(self, spec, messages, output):
            raise ServerDied("gone")

    before = os.listdir("/proc/self/fd")
    with pytest.raises(ServerDied):
        watch.Worker(Gone(), {}, Limits(), lambda event: None)
    assert os.listdir("/proc/self/fd") == before


def test_a_text_without_end_gets_one():
    assert cut("x" * 100, 100) == "x" * 100
    long = cut("x" * 1000, 100)
    assert long == "x" * 60 + "... (940 more characters)" and cut(long, 100) == long


def test_json_is_left_out_where_it_cannot_be_cut():
    row = bounded({"message": "m" * 10**6, "trace": "[" * 10**7, "directions": "{}", "seconds": 1.0})
    assert row["trace"] == "" and row["directions"] == "{}" and row["seconds"] == 1.0
    assert "trace: left out, 10,000,000 characters" in row["message"]
    assert len(row["message"]) < 10_100
    assert bounded(row)["message"].startswith("mmm")


def test_values_are_told_as_json_can_hold_them():
    values = {1: np.float32(0.5), "n": (np.int64(3), True, "text", None), "bad": [float("nan"), float("inf"), 2.5]}
    assert plain(values) == {"1": 0.5, "n": [3, True, "text", None], "bad": [None, float("inf"), 2.5]}
    assert type(plain(np.float64(1.5))) is float and type(plain(np.int32(1))) is int
