"""The process that forks the workers: what it loads, what its workers are given, and how all of them end."""

import os
import select
import signal
import subprocess
import sys
import time

import psutil
import pytest
from conftest import wait_for

from bench.engine import forkserver
from bench.engine.watch import Worker
from bench.plan.limits import Limits


def is_gone(pid):
    try:
        return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


# -- a server that is started in advance -------------------------------------------------------------------------------


def test_a_prestarted_server_is_taken_once_and_only_for_its_number_of_threads(monkeypatch):
    monkeypatch.setattr(forkserver, "_prestarted", [])  # an earlier test may have left one for other threads
    monkeypatch.setattr(forkserver, "available", lambda: [0, 1])
    forkserver.prestart(2)
    (early,) = forkserver._prestarted
    forkserver.prestart(2)  # there is one already
    assert forkserver.take_prestarted(2) is early
    forkserver.prestart(2)
    (unused,) = forkserver._prestarted
    other = forkserver.take_prestarted(1)
    assert other.threads == 1
    assert unused._process.returncode is not None  # ended, for nobody will ask for it
    assert forkserver._prestarted == []
    other.load((), ())
    for server in (early, other):
        server.close()
        assert server._process.returncode is not None


def test_one_processor_imports_nothing_in_advance(monkeypatch):
    monkeypatch.setattr(forkserver, "_prestarted", [])  # an earlier test may have left one for other threads
    monkeypatch.setattr(forkserver, "available", lambda: [0])
    forkserver.prestart(1)
    assert forkserver._prestarted == []


def test_a_prestarted_server_that_nobody_takes_ends_with_the_process_that_started_it():
    lines = """
from bench.engine import forkserver
forkserver.available = lambda: [0, 1]
forkserver.prestart(1)
print(forkserver._prestarted[0]._process.pid)
"""
    done = subprocess.run([sys.executable, "-c", lines], stdout=subprocess.PIPE, check=True)
    assert not psutil.pid_exists(int(done.stdout))


def test_a_server_is_out_of_reach_of_the_keys_of_the_terminal_and_leaves_nothing_open():
    before = set(os.listdir("/proc/self/fd"))
    server = forkserver.ForkServer(1)
    assert os.getpgid(server._process.pid) != os.getpgrp()
    server.close()
    assert set(os.listdir("/proc/self/fd")) <= before


def test_threads_that_wait_sleep_unless_the_user_wants_them_to_spin(monkeypatch):
    monkeypatch.delenv("OMP_WAIT_POLICY", raising=False)
    made = forkserver.server_environment(3)
    assert made["OMP_WAIT_POLICY"] == "PASSIVE"
    assert {made[name] for name in forkserver.THREAD_VARIABLES} == {"3"}
    monkeypatch.setenv("OMP_WAIT_POLICY", "ACTIVE")
    assert forkserver.server_environment(1)["OMP_WAIT_POLICY"] == "ACTIVE"


# -- the handle on a server --------------------------------------------------------------------------------------------

ANSWER = "channel.recv(999); channel.send(b'{}')"


@pytest.fixture
def server_that(monkeypatch):
    """A fork server whose process runs other lines of Python, which have the ``channel`` to the runner."""

    def start(lines):
        code = f"import socket, sys, os, signal, time\nchannel = socket.socket(fileno=int(sys.argv[1]))\n{lines}"
        monkeypatch.setattr(
            forkserver,
            "start_process",
            lambda channel, threads, printed: subprocess.Popen(
                [sys.executable, "-S", "-c", code, str(channel)], pass_fds=[channel], stderr=printed
            ),
        )
        return forkserver.ForkServer(1)

    return start


def test_a_server_that_ends_is_reported_with_its_exit_status_and_its_last_words(server_that):
    end = "time.sleep(0.1); sys.exit('first line\\nlast line')"
    server = server_that(f"channel.recv(999); channel.close(); {end}")
    with pytest.raises(forkserver.CannotStart, match=r"ended unexpectedly \(exit status 1\): last line\. No result"):
        server.load(("a",), ("b",))
    server.close()
    server = server_that(f"{ANSWER}; channel.recv(999); channel.close(); {end}")
    with pytest.raises(forkserver.ServerDied, match=r"\(exit status 1\): last line; it was loading a, b$"):
        server.load(("a",), ("b",))
    server.close()


def test_a_server_that_does_not_answer_is_ended_with_all_that_it_started(server_that, monkeypatch):
    monkeypatch.setattr(forkserver, "LOAD_SECONDS", 0.1)
    monkeypatch.setattr(forkserver, "LOOK", 0.05)
    server = server_that("os.fork() or os.fork(); os.write(2, b'%d ' % os.getpid()); time.sleep(60)")
    wait_for(lambda: len(server._said().split()) == 3)
    started = [int(pid) for pid in server._said().split()]
    with pytest.raises(forkserver.CannotStart, match="exit status -9"):
        server.load((), ())
    server.close()
    wait_for(lambda: all(map(is_gone, started)))


def test_a_server_that_was_stopped_goes_on(server_that, monkeypatch):
    """A method that it has forked can stop it."""
    monkeypatch.setattr(forkserver, "LOOK", 0.05)
    stop = "os.kill(os.getpid(), signal.SIGSTOP)"
    server = server_that(f"{stop}; {ANSWER}; {ANSWER}; {stop}; channel.recv(999)")
    server.load((), ())
    wait_for(lambda: psutil.Process(server._process.pid).status() == psutil.STATUS_STOPPED)
    server.close()
    assert server._process.returncode == 0


def test_a_server_that_is_still_loading_is_not_waited_for(server_that):
    server = server_that("channel.recv(999); time.sleep(60)")
    begin = time.monotonic()
    server.close()
    assert time.monotonic() - begin < 3 and server._process.returncode == -signal.SIGKILL


@pytest.mark.parametrize("said", ["a warning", ""])
def test_what_a_server_prints_while_it_loads_is_shown_once(server_that, capsys, said):
    server = server_that(
        f"{ANSWER}; print(end={said!r}, file=sys.stderr, flush=True); {ANSWER}; channel.recv(999); os._exit(3)"
    )
    server.load((), ())
    assert capsys.readouterr().err == (said and f"{said}\n")
    with pytest.raises(forkserver.ServerDied, match=r"\(exit status 3\)$"):
        server.reap(1)
    server.close()
    with pytest.raises(forkserver.ServerDied, match=r"\(exit status 3\)$"):
        server.reap(1)


def test_a_server_that_cannot_fork_says_why(server_that):
    server = server_that("channel.recv(999); sys.exit('BlockingIOError: no more processes')")
    with pytest.raises(forkserver.ServerDied, match=r"\(exit status 1\): BlockingIOError: no more processes$"):
        server.fork({}, 1, 2)
    server.close()


# -- servers and their workers -----------------------------------------------------------------------------------------


@pytest.fixture
def server(monkeypatch, tmp_path):
    """A fork server that loads nothing by itself, and whose workers run the ``lines`` of their specification."""
    code = f"""
import os, signal, stat, sys, time, types
from bench.engine import forkserver
worker = types.ModuleType("bench.engine.worker")
worker.work = lambda spec, messages: exec(spec["lines"], {{**globals(), "messages": messages}})
sys.modules[worker.__name__] = worker
sys.path.insert(0, {str(tmp_path)!r})
forkserver.ALWAYS = ()
forkserver.serve()
"""
    monkeypatch.setattr(forkserver, "_START", code)
    monkeypatch.delenv("PYTHONUNBUFFERED", raising=False)
    server = forkserver.ForkServer(1)
    yield server
    server.close()


def end_of(server, lines):
    """How a worker ends that runs these lines and does not say that it is done."""
    death = Worker(server, {"lines": lines}, Limits(), lambda event: None).watch()
    assert death is not None and not death.with_server
    return death.message, death.printed


@pytest.mark.parametrize(
    ("lines", "message", "printed"),
    [
        ("os.kill(os.getpid(), signal.SIGINT)", "killed by SIGINT (signal 2)", ""),
        ("os.kill(os.getpid(), signal.SIGTERM)", "killed by SIGTERM (signal 15)", ""),
        ("os.killpg(0, signal.SIGKILL)", "killed by SIGKILL (signal 9)", ""),
        ("os.write(1, b'out '); os.write(2, b'err '); os._exit(9)", "ended with exit status 9", "out err"),
        ("print('out'); sys.exit(0)", "ended with exit status 70: SystemExit: 0", "SystemExit: 0"),
        ("print('out')", "ended with exit status 0", "out"),
        ("sys.stdout = None", "ended with exit status 0", ""),
        ("sys.stdout = None; raise KeyError(1)", "ended with exit status 70: KeyError: 1", "KeyError: 1"),
    ],
)
def test_the_end_of_a_worker_is_told_and_its_server_forks_the_next(server, lines, message, printed):
    for _ in range(2):
        told, said = end_of(server, lines)
        assert (told, said[-len(printed) :]) == (message, printed)


def test_a_worker_has_open_only_what_it_writes_to(server):
    lines = """
for number in range(3, 64):
    try:
        print(number == messages, stat.filemode(os.fstat(number).st_mode)[0])
    except OSError:
        pass
"""
    assert end_of(server, lines)[1] == "True p"


def test_a_server_keeps_nothing_of_its_workers_open(server):
    def count():
        return len(os.listdir(f"/proc/{server._process.pid}/fd"))

    end_of(server, "")
    before = count()
    end_of(server, "")
    assert count() == before


def test_what_a_worker_leaves_behind_ends_with_it(server):
    """In a session of its own, and with its parent gone, it is still below the server."""
    _, pid = end_of(server, "if child := os.fork(): print(child)\nelse: os.setsid(); time.sleep(60)")
    assert not psutil.pid_exists(int(pid))


def test_a_library_is_imported_once_for_all_workers_and_one_that_is_missing_is_left_to_them(server, tmp_path, capsys):
    (tmp_path / "heavy.py").write_text("print('imported')")
    server.load(("no_such_library", "heavy"), ())
    assert capsys.readouterr().err == "imported\n"
    assert end_of(server, "import heavy; print('used')")[1] == "used"


def test_a_library_that_cannot_be_loaded_is_named_with_the_reason(server, tmp_path):
    """Some raise OSError where a file of the system is missing."""
    (tmp_path / "heavy.py").write_text("raise OSError('libGL.so.1: cannot open shared object file')")
    with pytest.raises(forkserver.ServerDied, match=r"OSError: libGL.so.1: cannot open.*; it was loading heavy$"):
        server.load(("heavy",), ())


@pytest.mark.parametrize(
    ("number", "status", "lines"),
    [(signal.SIGTERM, 1, "if not os.fork(): os.setsid()\n"), (signal.SIGKILL, -9, "")],
)
def test_a_worker_ends_with_its_server_and_so_does_what_it_started_unless_the_server_is_killed(
    server, number, status, lines
):
    reads, writes = os.pipe()
    server.fork({"lines": f"{lines}os.write(2, b'.'); time.sleep(60)"}, writes, writes)
    os.close(writes)
    there = b""
    while len(there) < 1 + bool(lines):
        there += os.read(reads, 9)
    server._process.send_signal(number)
    assert select.select([reads], [], [], 5)[0] and os.read(reads, 9) == b""  # nobody is left to write to it
    os.close(reads)
    with pytest.raises(forkserver.ServerDied, match=rf"\(exit status {status}\)$"):
        server.reap(1)


@pytest.fixture
def ended_children_ignored():
    """What a process inherits from one that ignores how its children end."""
    before = signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    yield
    signal.signal(signal.SIGCHLD, before)


def test_the_end_of_a_worker_is_told_although_who_started_all_ignores_such_ends(ended_children_ignored, server):
    assert end_of(server, "os._exit(9)")[0] == "ended with exit status 9"
    failing = "import subprocess; print(subprocess.run([sys.executable, '-S', '-c', 'raise SystemExit(3)']).returncode)"
    assert end_of(server, failing)[1] == "3"
    server._process.kill()
    wait_for(lambda: not psutil.pid_exists(server._process.pid))
    server.close()
