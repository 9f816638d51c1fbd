"""The sweep itself is hurt: killed, interrupted, doubled. Nothing finished is lost or run twice; no orphan goes on."""

from __future__ import annotations

import json
import os
import re
import signal
from collections import Counter

import pytest

SALTS, CASES = 3, 3
SWEEP = ("method=fine", "method.salt=1,2,3", "method.take=0.4", f"cases={CASES}")
ALL = {f"fine {salt} {case}" for salt in range(1, SALTS + 1) for case in range(CASES)}


def finished(shell) -> set[str]:
    """The calls whose results are on the disk: in files of finished cells, and of those that were cut off."""
    from bench.results.store import Results

    rows = []
    for path in shell.files():
        cell, _, mark = path.stem.partition("-")
        rows += Results(shell.results).read(cell, mark).rows
    for path in shell.results.glob(".partial/*.jsonl"):
        rows += [json.loads(line) for line in path.read_text().splitlines() if line.strip()]
    return {f"fine {_salt(row['variant'])} {row['case_index']}" for row in rows if row["status"] == "ok"}


def _salt(variant: str) -> str:
    return dict(part.split("=") for part in variant.split(","))["salt"]


def assert_goes_on(shell, launcher: str, kept: set[str]) -> None:
    """The same command completes the rest, without doing again what was finished."""
    before = Counter(shell.calls())
    done = shell.run(*SWEEP, launcher=launcher)
    assert done.returncode == 0, done.stderr
    assert f"{len(ALL)}/{len(ALL)} cases solved, {len(ALL - kept)} run, {len(kept)} cached" in done.stderr
    after = Counter(shell.calls())
    assert set(after) == ALL
    assert all(after[call] == before[call] == 1 for call in kept)
    assert all(after[call] <= 2 for call in ALL - kept)  # one that was cut off begins once more
    rows = shell.rows()
    assert len(rows) == len(ALL)
    assert (rows["status"] == "ok").all()
    assert not shell.left_over()
    assert not list(shell.results.glob(".sweeps/*"))
    assert not list(shell.results.glob(".partial/*"))


@pytest.mark.parametrize(("launcher", "calls"), [("basic", 5), ("joblib", 8)])
def test_front_door_killed_in_mid_sweep(shell, launcher, calls):
    """Of joblib's two processes, one waits for work by then: the other has the last of three cells."""
    process = shell.run(*SWEEP, launcher=launcher, act=shell.start)
    shell.wait_for(lambda: len(shell.calls()) >= calls)
    process.kill()  # that process alone: nobody is told
    process.wait(timeout=20)
    assert not shell.left_over(seconds=8), "orphans go on"
    process.communicate()
    kept = finished(shell)
    assert 2 <= len(kept) < len(ALL)
    assert_goes_on(shell, "basic", kept)


@pytest.mark.parametrize(
    ("to", "launcher", "number", "code"),
    [
        ("group", "basic", signal.SIGINT, 130),
        ("group", "joblib", signal.SIGINT, 130),
        ("process", "joblib", signal.SIGTERM, 143),
        ("process", "basic", signal.SIGHUP, 129),
    ],
)
def test_an_interrupted_sweep_says_what_is_stored(shell, launcher, to, number, code):
    process = shell.run(*SWEEP, launcher=launcher, board=True, act=shell.start)
    shell.wait_for(lambda: len(shell.calls()) >= 6)
    if to == "group":  # what a terminal does
        os.killpg(process.pid, number)
    else:
        process.send_signal(number)
    out, err = process.communicate(timeout=30)
    assert process.returncode == code, err
    assert "Traceback" not in out + err, err
    said = [line for line in err.splitlines() if not line.startswith(("[", "denoise ball"))]
    assert len(said) == 1, err
    assert said[0].startswith("interrupted:")
    # The table of what is finished says that it is not all.
    assert (
        re.search(rf"^[1-{SALTS - 1}] of {SALTS} planned cells are in this table; ", out, re.MULTILINE)
        or "[1/" not in err
    )
    assert not shell.left_over()
    assert not list(shell.results.glob(".sweeps/*"))
    kept = finished(shell)
    assert 2 <= len(kept) < len(ALL)
    if number == signal.SIGTERM:  # as after it was killed, where what is left is the least that can be left
        assert_goes_on(shell, launcher, kept)


def test_two_sweeps_at_once_into_one_folder(shell):
    processes = [shell.run(*SWEEP, launcher=launcher, act=shell.start) for launcher in ("basic", "joblib")]
    ends = [process.communicate(timeout=120) for process in processes]
    for process, (_, err) in zip(processes, ends, strict=True):
        assert process.returncode == 0, err
        assert f"{len(ALL)}/{len(ALL)} cases solved" in err
        assert "Traceback" not in err
        assert "damaged" not in err
    assert Counter(shell.calls()) == Counter(ALL)  # each case once, whoever got it
    assert len(shell.files()) == SALTS
    assert (shell.rows()["status"] == "ok").all()
    assert not shell.left_over()


def test_a_killed_fork_server_costs_nothing(shell):
    """A system short of memory may choose any process to kill; the case has another try."""
    process = shell.run("method=fine", "method.take=0.5", "method.salt=1,2", "cases=3", act=shell.start)
    shell.wait_for(lambda: len(shell.calls()) >= 2)
    servers = [p for p in shell.processes() if "bench.engine.forkserver" in " ".join(p.cmdline())]
    parents = {p.pid for p in servers if p.ppid() == process.pid}
    assert len(parents) == 1
    os.kill(parents.pop(), signal.SIGKILL)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    assert list(shell.rows()["status"]) == ["ok"] * 6
    assert len(shell.calls()) == 7  # the one that was cut off
    assert not shell.left_over()


def test_what_a_killed_process_of_a_launcher_left_undone_is_launched_once_more(shell):
    """A system short of memory kills a process of joblib, which then gives up the whole sweep."""
    process = shell.run(*SWEEP, launcher="joblib", act=shell.start)
    shell.wait_for(lambda: len(shell.calls()) >= 6)
    kept = finished(shell)
    launched = [p for p in shell.processes() if "popen_loky" in " ".join(p.cmdline()) and p.ppid() == process.pid]
    os.kill(launched[0].pid, signal.SIGKILL)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    assert "Traceback" not in err
    said = [line for line in err.splitlines() if line.startswith("warning:")]
    assert len(said) == 1 and "was killed" in said[0] and "launched once more" in said[0], err
    assert f"[{SALTS}/{SALTS}] " in err  # progress counts on
    calls = Counter(shell.calls())
    assert set(calls) == ALL
    assert all(calls[call] == 1 for call in kept)
    assert sum(calls.values()) <= len(ALL) + 2  # the two that were cut off
    assert len(shell.rows()) == len(ALL) and (shell.rows()["status"] == "ok").all()
    assert not shell.left_over()
    assert not list(shell.results.glob(".partial/*"))
