"""The clock and the memory of a method call, and what failures are called."""

import ctypes
import faulthandler
import math
import mmap
import os
import re
import resource
import signal
import subprocess
import sys
import time
import weakref

import numpy as np
import pytest

from bench.contract.run import Run
from bench.engine.channel import read_event
from bench.engine.meter import Meter, resident_mb
from bench.engine.worker import failure, plain, work
from bench.errors import BadInput, InvalidOutput, MissingLibrary
from bench.sweep.request import Request

MB = 2**20


def test_the_meter_sees_only_what_happens_inside():
    meter = Meter(4, "cpu")
    with meter:
        pass
    idle = meter.figures()
    block = np.ones(300 * MB // 8)  # outside
    del block
    with meter:
        block = np.ones(200 * MB // 8)
        begin = time.process_time()
        while time.process_time() - begin < 0.2:
            pass
        time.sleep(0.2)
    figures = meter.figures()
    del block
    assert 180 < figures["peak_rss_mb"] - figures["rss_before_mb"] < 280
    assert idle["peak_rss_mb"] - idle["rss_before_mb"] < 50
    assert 0.19 < figures["cpu_seconds"] < figures["seconds"]
    assert figures["seconds"] > 0.39
    assert math.isnan(figures["peak_device_mb"])


class Leftover:
    """What only the garbage collector frees."""

    def __init__(self):
        self.itself, self.block = self, np.ones(100 * MB // 8)


def test_nothing_of_an_earlier_call_is_measured_in_the_next():
    meter = Meter(4, "cpu")
    with meter:
        left = Leftover()
        time.sleep(0.2)
    left = weakref.ref(left)
    with meter:
        assert left() is None
    figures = meter.figures()
    assert figures["cpu_seconds"] <= figures["seconds"] + 0.01 < 0.15
    assert 0 <= figures["peak_rss_mb"] - figures["rss_before_mb"] < 50


def test_the_memory_of_a_process_that_the_method_started_counts():
    # In a fresh process, because the system keeps the largest of all that ever were.
    script = f"""
import subprocess, sys
from bench.engine.meter import Meter
meter = Meter(4, "cpu")
with meter:
    subprocess.run([sys.executable, "-c", "x = b'1' * {600 * MB}; sum(range(10**6))"], check=True)
print(meter.figures()["peak_rss_mb"])
with meter:
    pass
print(meter.figures()["peak_rss_mb"])
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    with_child, alone = map(float, done.stdout.split())
    assert 600 < with_child < 700
    assert alone < 200


def test_a_paused_clock_stands_still():
    meter = Meter(4, "cpu")
    with meter, meter.paused():
        block = np.ones(200 * MB // 8)
        time.sleep(0.3)
        del block
    assert meter.figures()["seconds"] < 0.2
    assert meter.figures()["peak_rss_mb"] - meter.figures()["rss_before_mb"] < 100


@pytest.mark.parametrize("what", ["bytearray(3 * 2**30)", "__import__('numpy').ones(3 * 2**27)"])
def test_an_allocation_past_the_limit_fails_at_once(what):
    script = f"""
import mmap
from bench.engine.meter import Meter
meter = Meter(1, "cpu")
try:
    with meter:
        x = {what}
except MemoryError:
    print("refused")
y = mmap.mmap(-1, 2 * 2**30, mmap.MAP_PRIVATE)  # untouched, it takes no time
print("allowed again")
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[:2] == ["refused", "allowed again"]


def test_a_call_may_allocate_its_limit_beyond_what_the_process_has():
    def take(mb):
        return mmap.mmap(-1, mb * MB, mmap.MAP_PRIVATE)  # untouched, it takes no time

    refused = pytest.raises(OSError, match="Cannot allocate memory")
    with take(1000), Meter(1, "cpu"), take(900), refused:
        take(200)


def test_a_system_that_does_not_tell_the_memory_of_now_tells_the_peak(monkeypatch):
    def absent(path):
        raise FileNotFoundError(path)

    told = resident_mb("VmRSS")
    monkeypatch.setattr("bench.engine.meter.open", absent, raising=False)
    assert told / 2 < resident_mb("VmRSS") < told * 50


def test_processor_seconds_count_children():
    meter = Meter(4, "cpu")
    with meter:
        subprocess.run([sys.executable, "-c", "sum(range(20_000_000))"], check=True)
    assert meter.figures()["cpu_seconds"] > 0.1


@pytest.mark.parametrize(
    ("error", "stage", "status", "words"),
    [
        (ValueError("boom"), "method", "error", "ValueError: boom"),
        (KeyboardInterrupt(), "method", "error", "KeyboardInterrupt"),
        (SystemExit(3), "method", "error", "called sys.exit(3)"),
        (MemoryError(), "method", "oom", "past the memory limit"),
        (RuntimeError("std::bad_alloc"), "method", "oom", "bad_alloc"),
        (RuntimeError("no pivot"), "method", "error", "RuntimeError: no pivot"),
        (ValueError("out of memory"), "method", "error", "ValueError: out of memory"),
        (InvalidOutput("promised x; got y"), "method", "invalid", "promised x; got y"),
        (MissingLibrary("CGAL", "pip install x"), "method", "skipped", "install it with: pip install x"),
        (ModuleNotFoundError("No module named 'foo'", name="foo.bar"), "method", "skipped", "pip install foo"),
        (ModuleNotFoundError("No module named 'foo'", name="foo"), "score", "error", "No module named 'foo'"),
        (ModuleNotFoundError("No module named 'bench.x'", name="bench.x"), "method", "error", "No module named"),
        (BadInput("a.ply: is empty"), "case", "error", "a.ply: is empty"),
    ],
)
def test_what_failures_are_called(error, stage, status, words):
    row = failure(error, stage)
    assert row["status"] == status
    assert words in row["message"]
    told = status in ("invalid", "skipped") or isinstance(error, BadInput)  # where the lines of code tell nothing more
    assert row["traceback"].startswith("" if told else type(error).__name__) and bool(row["traceback"]) != told


def test_plain_values_are_json():
    import json

    values = plain({"a": np.float64(1.5), "b": [np.int64(2), float("nan")], 3: (np.bool_(True),)})
    assert json.loads(json.dumps(values, allow_nan=False)) == {"a": 1.5, "b": [2, None], "3": [True]}


def test_runs_with_one_seed_draw_the_same():
    assert np.array_equal(Run(seed=5).rng.normal(size=9), Run(seed=5).rng.normal(size=9))
    assert not np.array_equal(Run(seed=5).rng.normal(size=9), Run(seed=6).rng.normal(size=9))


def test_tracing_costs_a_method_no_time():
    scored = []
    run = Run(seconds=10, on_trace=lambda output, seconds: (time.sleep(0.2), scored.append((output, seconds))))
    run.trace("first")
    run.trace("second")
    assert run.elapsed() < 0.1 and run.seconds_left() > 9.9
    assert [output for output, _ in scored] == ["first", "second"]
    assert 0 <= scored[0][1] <= scored[1][1] < 0.1


def test_the_clock_of_traces_never_goes_back(monkeypatch):
    """However long the process is held up between two looks at the clock."""
    told, now = [], iter([0, 1, 10, 11, 12, 12.1, 12.2, 12.3, 30, 30.1, 30.2, 30.3, 30.4, 30.5, 30.6, 30.7])
    monkeypatch.setattr(time, "perf_counter", lambda: next(now))
    run = Run(on_trace=lambda output, seconds: told.append(seconds))
    for _ in range(5):
        run.trace("output")
    assert told == sorted(told)


def test_a_torch_generator_follows_the_seed():
    import torch

    first, again, other = (torch.rand(4, generator=Run(seed=s).torch_generator()) for s in (1, 1, 2))
    assert torch.equal(first, again) and not torch.equal(first, other)


def crash(spec, channel):
    ctypes.string_at(0)


def test_a_worker_that_crashes_prints_where_it_was(tmp_path, monkeypatch, capfd):
    monkeypatch.setitem(sys.modules, "asked_to_crash", sys.modules[__name__])
    if not (child := os.fork()):
        try:
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            events = os.open(tmp_path / "events", os.O_WRONLY | os.O_CREAT)
            work({"function": "asked_to_crash:crash", "threads": 1}, events)
        finally:
            os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGSEGV
    assert re.search(r"Segmentation fault\n(.*\n)+.*test_worker.py.* in crash\n", capfd.readouterr().err)


def tell_threads(spec, channel):
    import torch

    said = f"{torch.get_num_threads()} threads on {sorted(os.sched_getaffinity(0))}"
    channel.send("result", row={"status": "ok", "message": said})


@pytest.fixture
def processors():
    """Those of this process, which a test may restrict."""
    before = os.sched_getaffinity(0)
    yield sorted(before)
    os.sched_setaffinity(0, before)


@pytest.mark.parametrize("threads", [3, 1])
def test_a_worker_is_pinned_and_torch_has_as_many_threads_as_the_job_asks_for(
    tmp_path, monkeypatch, processors, threads
):
    import torch  # noqa: F401

    monkeypatch.setattr(faulthandler, "enable", lambda: None)  # that of the tests stays
    monkeypatch.setitem(sys.modules, "asked_for_threads", sys.modules[__name__])
    events = tmp_path / "events"
    job = {"function": f"asked_for_threads:{tell_threads.__name__}", "threads": threads, "cpus": processors[-1:]}
    work(job, os.open(events, os.O_WRONLY | os.O_CREAT))
    result, done = map(read_event, events.read_bytes().splitlines())
    assert result["row"]["message"] == f"{threads} threads on {processors[-1:]}" and done["event"] == "done"


@pytest.mark.parametrize(
    ("words", "threads"),
    [((), 1), (("threads=3",), 3), (("threads=2,4", "seed=1"), 2), (("threads=1", "threads=2"), 2)]
    + [((f"threads={word}",), 1) for word in ("0", "-2", "many", "", "range(1,3)")],
)
def test_the_first_number_of_threads_in_the_overrides(words, threads):
    assert Request.of(words).threads == threads
