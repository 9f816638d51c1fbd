"""What a call leaves behind in its process is seen, whatever it is; what libraries do by the way is not."""

import os
import resource
import signal
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

from bench.engine import state as module
from bench.engine.state import changes, state


def lower_a_limit(which):
    resource.setrlimit(which, (4096, resource.getrlimit(which)[1]))


def close_a_descriptor():
    os.close(FILES[0])


def replace_a_descriptor():
    os.dup2(FILES[0], FILES[1])


def compute_for_ever():
    while True:
        sum(range(1000))


def delete_the_folder():
    os.mkdir("gone")
    os.chdir("gone")
    os.rmdir("../gone")


FILES = []
MASKS = "the mask of signals, umask or processors"
LEFT = {
    "a lowered limit of memory": (lambda: lower_a_limit(resource.RLIMIT_STACK), "limits"),
    "a lowered limit of files": (lambda: lower_a_limit(resource.RLIMIT_NOFILE), "limits"),
    "another folder": (lambda: os.chdir("/"), "the working folder"),
    "a folder that is gone": (delete_the_folder, "the working folder"),
    "a variable": (lambda: os.environ.update(LEFT="1"), "the environment"),
    "no variables": (os.environ.clear, "the environment"),
    "another umask": (lambda: os.umask(0o777), MASKS),
    "blocked signals": (
        lambda: signal.pthread_sigmask(signal.SIG_BLOCK, [2]),
        "the mask of signals, umask or processors",
    ),
    "a handler": (lambda: signal.signal(signal.SIGTERM, signal.SIG_IGN), "handlers of signals"),
    "patience": (lambda: os.nice(1), "the priority"),
    "strictness": (lambda: np.seterr(all="raise"), "floating-point errors"),
    "a depth": (lambda: sys.setrecursionlimit(5000), "the recursion limit"),
    "a closed descriptor": (close_a_descriptor, "descriptors"),
    "another file": (replace_a_descriptor, "descriptors"),
    "a busy thread": (lambda: threading.Thread(target=compute_for_ever, daemon=True).start(), "threads"),
    "a child": (lambda: FILES.append(subprocess.Popen(["sleep", "60"])), "processes"),
    "a child in C": (lambda: os.fork() or time.sleep(60), "processes"),
}
HARMLESS = {
    "nothing": lambda: None,
    "a thread that waits": lambda: threading.Thread(target=time.sleep, args=(60,), daemon=True).start(),
    "an open file": lambda: FILES.append(os.open(os.devnull, os.O_RDONLY)),
    "arithmetic": lambda: np.ones((300, 300)) @ np.ones((300, 300)),
    "a program": lambda: subprocess.run(["true"], check=True),
}


def left_by(action, folder):
    """What :func:`changes` says of an action in a child process."""
    reads, writes = os.pipe()
    child = os.fork()
    if not child:
        try:
            os.setsid()
            os.chdir(folder)
            FILES[:] = [os.open(os.devnull, os.O_RDONLY), os.open("/dev/zero", os.O_RDONLY)]
            before = state()
            action()
            os.write(writes, "; ".join(changes(before)).encode())
        finally:
            os.killpg(0, signal.SIGKILL)
    os.close(writes)
    with os.fdopen(reads) as pipe:
        said = pipe.read()
    os.waitpid(child, 0)
    return said


@pytest.mark.parametrize("what", LEFT)
def test_a_change_is_seen(what, tmp_path):
    action, said = LEFT[what]
    assert said in left_by(action, tmp_path)


@pytest.mark.parametrize("what", HARMLESS)
def test_what_hurts_no_other_call_is_no_change(what, tmp_path):
    assert left_by(HARMLESS[what], tmp_path) == ""


def test_a_thread_that_waits_for_a_processor_computes_too(tmp_path, monkeypatch):
    """On a busy machine it may wait for longer than it runs."""
    for thread, times in (("7", "5 70 1"), (str(os.getpid()), "1 1 1"), ("8", "ended")):
        (tmp_path / thread).mkdir()
        (tmp_path / thread / "schedstat").write_text(times)
    monkeypatch.setattr(module, "Path", lambda name: tmp_path)
    assert module._threads() == {"7": 75}


@pytest.mark.parametrize(
    ("share", "seconds", "waits", "computes"),
    [(0.6, 9.0, False, True), (0.4, 9.0, False, False), (0.0, 9.0, True, True), (1.0, 0.2, False, False)],
)
def test_a_new_thread_computes_that_has_a_processor_for_most_of_the_time(monkeypatch, share, seconds, waits, computes):
    """Or waits for one; one that ends soon, as those of libraries after their work, does not."""
    clock = [100.0]
    times = lambda: {"7": int(1e9 * share * min(clock[0], 100 + seconds))}  # noqa: E731
    sleep = lambda seconds: clock.append(clock.pop() + seconds)  # noqa: E731
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: clock[0], sleep=sleep))
    monkeypatch.setattr(module, "_threads", times)
    monkeypatch.setattr(module, "_is_runnable", lambda thread: waits)
    assert module._are_busy({}, times()) == computes


@pytest.mark.parametrize(("state", "runs"), [("R", True), ("S", False)])
def test_a_thread_with_any_name_is_asked_whether_it_runs(tmp_path, monkeypatch, state, runs):
    (tmp_path / "stat").write_text(f"7 (R) of (mine) {state} 1 7 7 0 R")
    monkeypatch.setattr(module, "Path", lambda name: tmp_path / name.rpartition("/")[2])
    assert module._is_runnable("7") == runs
    (tmp_path / "stat").unlink()
    assert not module._is_runnable("7")  # it has ended


@pytest.mark.parametrize("what", ["get_num_threads", "get_default_dtype", "is_grad_enabled"])
def test_a_change_of_torch_is_seen(monkeypatch, what):
    names = ("get_num_threads", "get_default_dtype", "is_grad_enabled")
    torch = SimpleNamespace(**dict.fromkeys(names, lambda: 1))
    monkeypatch.setitem(sys.modules, "torch", torch)
    before = state()
    setattr(torch, what, lambda: 2)
    assert "torch" in changes(before)
