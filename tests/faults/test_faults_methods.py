"""Whatever a method does, its case gets a row that says so, and every other case and cell completes.

Two sweeps over all bad methods, and two more under joblib, whose processes have the same engine in them, over some of
each kind; the tests look at what they left.
"""

from __future__ import annotations

import re
from datetime import datetime
from pathlib import Path

import pytest

MISBEHAVING = Path(__file__).with_name("misbehaving.py")
TOYS = Path(__file__).with_name("toys.py")
SECONDS, MEMORY_GB = 2.0, 0.3
STOPPED = ("timeout", f"stopped after {SECONDS:g} s (limit.seconds={SECONDS:g})")

# method: status of the case of index 1, and what its message says
DENOISE = {
    "fine": ("ok", ""),
    "raises": ("error", "ArithmeticError: the matrix is singular"),
    "exits": ("error", "sys.exit(3)"),
    "interrupts": ("error", "KeyboardInterrupt"),
    "raises_what_cannot_be_shown": ("error", "Silent: its text cannot be shown (RuntimeError)"),
    "says_far_too_much": ("error", "... (49,990,057 more characters)"),
    "closes_what_it_finds": ("crashed", "Bad file descriptor"),
    "writes_to_all_pipes": ("crashed", "a line that is no event (b'hello')"),
    "forges_a_row": ("crashed", "an event 'row' where there can be none"),
    "says_it_is_done": ("crashed", "its worker ended before the case was done"),
    "floods_its_pipe": ("crashed", "more than 8 MB without the end of a line"),
    "stops_its_server": ("ok", ""),
    "os_exits": ("crashed", "exit status 9"),
    "segfaults": ("crashed", "SIGSEGV"),
    "aborts": ("crashed", "SIGABRT"),
    "killed": ("crashed", "SIGKILL"),
    "kills_its_group": ("crashed", "SIGKILL"),
    "loops": STOPPED,
    "ignores_sigterm": STOPPED,
    "stops_its_server_and_sleeps": STOPPED,
    "sleeps_in_c": STOPPED,
    "matches_for_ever": STOPPED,
    "leaves_a_child_and_loops": STOPPED,
    "leaves_a_daemon_and_loops": STOPPED,
    "leaves_a_child": ("ok", ""),
    "leaves_a_session": ("ok", ""),
    "leaves_a_daemon": ("ok", ""),
    "forks_and_returns_twice": ("ok", ""),
    "leaves_its_process_changed": ("ok", ""),
    "leaves_a_busy_thread": ("ok", ""),
    "returns_too_many_points": ("invalid", "returned 1,001 points, more than limit.output_points=1000"),
    "returns_nan": ("invalid", "all finite; 1 of 110 points are NaN"),
    "returns_no_points": ("invalid", "promised a PointCloud with at least one point"),
    "returns_an_array": ("invalid", "promised a PointCloud with at least one point, all finite; got numpy.ndarray"),
    "returns_nothing": ("invalid", "got NoneType"),
    "undeclared_missing": ("skipped", "pip install no_such_library_undeclared"),
}
# in a sweep with more time, in which a slow or busy machine reaches the memory limit, too
GREEDY = {
    "allocates_untouched": ("oom", "memory limit"),
    "allocates_with_numpy": ("oom", "memory limit"),
    "grows_a_list": ("oom", "memory"),
    "grows_shared_memory": ("oom", "limit.memory_gb=0.3"),
    "lets_a_child_allocate": ("oom", "limit.memory_gb=0.3"),
}
OTHER_TASKS = {
    "wrong_count": ("invalid", "exactly 4 x N points, all finite: 440 points; got 220"),
    "no_faces": ("invalid", "promised a trimesh.Trimesh with faces and finite vertices; got a mesh of 110 vertices"),
    "infinite_vertices": ("invalid", "1 of 42 vertices are NaN or infinite"),
}
BAD = DENOISE | GREEDY
SOME = """fine stops_its_server_and_sleeps forges_a_row raises interrupts segfaults kills_its_group ignores_sigterm
leaves_a_session returns_nan undeclared_missing lets_a_child_allocate"""
METHODS = {"basic": tuple(BAD), "joblib": tuple(SOME.split())}
EACH = [(launcher, method) for launcher, methods in METHODS.items() for method in methods]
TIMEOUTS = [name for name, (status, _) in DENOISE.items() if status == "timeout"]
LIMITS = (f"limit.seconds={SECONDS}", f"limit.memory_gb={MEMORY_GB}", "cases=3", "limit.output_points=1000")
MORE_TIME = ("limit.seconds=60", *LIMITS[1:])
PLUGINS = (TOYS, MISBEHAVING)

launchers = pytest.mark.parametrize("launcher", ["basic", "joblib"])


@pytest.fixture(scope="module")
def sweeps(shells):
    """Makes, once per launcher, the sweeps over the bad denoisers."""
    made = {}

    def sweep(launcher):
        if launcher not in made:
            shell = shells(f"denoise_{launcher}")
            words = ",".join([*(name for name in METHODS[launcher] if name in DENOISE), "declared_missing"])
            greedy = ",".join(name for name in METHODS[launcher] if name in GREEDY)
            done = shell.run(f"method={words}", *LIMITS, launcher=launcher, plugins=PLUGINS, timeout=400)
            shell.run(f"method={greedy}", *MORE_TIME, launcher=launcher, plugins=PLUGINS, timeout=400)
            left = shell.left_over()
            shell.kill_all()
            made[launcher] = shell, done, left, shell.rows()
        return made[launcher]

    return sweep


@pytest.mark.parametrize(("launcher", "method"), EACH)
def test_a_bad_case_gets_its_status_and_spoils_no_other(sweeps, launcher, method):
    _, _, _, rows = sweeps(launcher)
    status, message = BAD[method]
    found = rows[rows["method"] == method]
    assert list(found["status"]) == ["ok", status, "ok"], list(found["message"])
    assert message in found["message"].iloc[1]
    assert list(found["case"]) == ["ball-test-000", "ball-test-001", "ball-test-002"]


@launchers
def test_a_missing_declared_library_skips_every_case_with_the_install_line(sweeps, launcher):
    _, _, _, rows = sweeps(launcher)
    found = rows[rows["method"] == "declared_missing"]
    assert list(found["status"]) == ["skipped"] * 3
    assert all("pip install no_such_library_declared" in message for message in found["message"])


@launchers
def test_errors_keep_their_traceback_and_the_stage(sweeps, launcher):
    _, _, _, rows = sweeps(launcher)
    row = rows[(rows["method"] == "raises") & (rows["case_index"] == 1)].iloc[0]
    assert row["stage"] == "method"
    assert "misbehaving.py" in _traceback(sweeps(launcher)[0], row["cell"])


def _traceback(shell, cell):
    from bench.results.store import Results

    (record,) = Results(shell.results).records(cell)
    return record.rows[1]["traceback"]


@launchers
def test_every_good_case_is_called_once(sweeps, launcher):
    shell, _, _, _ = sweeps(launcher)
    calls = shell.calls()
    assert sorted(set(calls)) == sorted(calls)
    assert set(calls) == {f"{method} 0 {case}" for method in METHODS[launcher] for case in range(3)}


@pytest.mark.parametrize(("launcher", "method"), [pair for pair in EACH if pair[1] in TIMEOUTS])
def test_a_timeout_is_over_two_seconds_after_the_limit(sweeps, launcher, method):
    shell, _, _, rows = sweeps(launcher)
    row = rows[(rows["method"] == method) & (rows["case_index"] == 1)].iloc[0]
    began = shell.call_times()[f"{method} 0 1"]  # written by the method itself, as its first act
    took = datetime.fromisoformat(row["finished"]).timestamp() - began
    assert SECONDS - 0.1 < took < SECONDS + 2.0


@launchers
def test_a_process_that_a_method_has_changed_runs_no_other_case(sweeps, launcher):
    """And one that it has left as it was runs all of them."""
    processes = sweeps(launcher)[0].call_processes()
    for method in set(METHODS[launcher]) & {"fine", "leaves_its_process_changed", "leaves_a_busy_thread"}:
        first, second, third = (processes[f"{method} 0 {case}"] for case in range(3))
        assert first == second and (second == third) == (method == "fine")


@launchers
def test_the_exit_code_tells_and_nothing_else_goes_wrong(sweeps, launcher):
    shell, done, _, rows = sweeps(launcher)
    assert done.returncode == 3, done.stderr
    assert "Traceback" not in done.stderr + done.stdout
    cells = sum(method in DENOISE for method in METHODS[launcher]) + 1  # and declared_missing
    planned = 3 * cells
    assert len(rows) == 3 * (len(METHODS[launcher]) + 1)
    solved = int((rows[~rows["method"].isin(GREEDY)]["status"] == "ok").sum())
    assert f"{cells} cells, {solved}/{planned} cases solved, {planned} run, 0 cached" in done.stderr
    assert "fine" in done.stdout  # the leaderboard


@launchers
def test_no_process_of_the_sweep_is_left(sweeps, launcher):
    _, _, left, _ = sweeps(launcher)
    assert not left


@launchers
def test_nothing_is_littered(sweeps, launcher):
    shell, *_ = sweeps(launcher)
    assert list(shell.work.iterdir()) == []
    assert not list(shell.results.glob(".sweeps/*"))
    assert not list(shell.results.glob(".partial/*"))
    assert not list(shell.results.rglob("*.tmp"))
    assert not {p.name for p in shell.results.rglob("*")} & {"outputs", "multirun", ".hydra"}


def test_broken_promises_of_other_tasks_and_pairs_that_do_not_fit(shell):
    words = ",".join([*OTHER_TASKS, "identity"])
    done = shell.run("task=upsample,reconstruct", f"method={words}", *LIMITS, plugins=PLUGINS)
    assert done.returncode == 3
    rows = shell.rows()
    assert len(rows) == 3 * 5, done.stderr  # identity solves both tasks, each bad method one
    assert (rows[rows["method"] == "identity"]["status"] == "ok").all()
    for method, (status, message) in OTHER_TASKS.items():
        found = rows[rows["method"] == method]
        assert list(found["status"]) == ["ok", status, "ok"], list(found["message"])
        assert message in found["message"].iloc[1]
    assert re.search(r"not planned: .*reconstruct by wrong_count.*: these methods do not solve it", done.stderr)
    assert "Traceback" not in done.stderr
    assert not shell.left_over()
