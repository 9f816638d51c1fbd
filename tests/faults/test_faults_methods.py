"""Whatever a method does, its case gets a row that says so, and every other case and cell completes.

Two sweeps over all bad methods: one with a short limit of time, and one in which a slow or busy machine reaches the
limit of memory, too. The tests look at what they left. The processes of joblib and of the other launchers that are
installed here have the same engine in them as the basic launcher: each kind of fault once leaves the same rows, to the
bit.
"""

from __future__ import annotations

import importlib.util
import os
import re
from datetime import datetime
from itertools import pairwise
from pathlib import Path

import pandas as pd
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
    "writes_to_all_pipes": ("crashed", "a line that is not an event (b'hello')"),
    "forges_a_row": ("crashed", "an event 'row' that is not expected here"),
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
# Each kind of fault once, under the launchers whose engine is that of the basic one.
OF_EACH_KIND = (
    *("fine", "raises", "exits", "forges_a_row", "segfaults", "kills_its_group", "returns_nan", "undeclared_missing"),
    *("loops", "ignores_sigterm", "stops_its_server_and_sleeps", "leaves_a_child_and_loops"),
    *("leaves_a_daemon", "leaves_its_process_changed", "leaves_a_busy_thread", "lets_a_child_allocate"),
)
LIMITS = (f"limit.seconds={SECONDS}", f"limit.memory_gb={MEMORY_GB}", "cases=3", "limit.output_points=1000")
MORE_TIME = ("limit.seconds=60", *LIMITS[1:])
PLUGINS = (TOYS, MISBEHAVING)

# What Hydra calls the launchers, the packages that bring them, and their words; those of extras that are not installed
# are left to CI.
OTHERS = {
    "joblib": ("hydra_plugins.hydra_joblib_launcher", ("hydra.launcher.n_jobs=2",)),
    "submitit_local": ("hydra_plugins.hydra_submitit_launcher", ("hydra.launcher.timeout_min=5",)),
    "ray": ("hydra_plugins.hydra_ray_launcher", ("+hydra.launcher.ray.init.num_cpus=2",)),
}
# What a run measures, and when and in which process it did.
MEASURED = [
    *("seconds", "cpu_seconds", "reference_seconds", "exchange_seconds", "peak_rss_mb", "rss_before_mb"),
    *("started", "finished", "traceback", "host"),
]

launchers = pytest.mark.parametrize("launcher", ["basic", "joblib"])


def swept(launcher: str) -> list[str]:
    """The bad methods in the sweeps of a launcher."""
    return [name for name in BAD if launcher == "basic" or name in OF_EACH_KIND]


TIMEOUTS = [
    (launcher, name) for launcher in ("basic", "joblib") for name in swept(launcher) if BAD[name][0] == "timeout"
]


def _is_there(package: str) -> bool:
    try:
        return importlib.util.find_spec(package) is not None
    except ModuleNotFoundError:
        return False


INSTALLED = [name for name, (package, _) in OTHERS.items() if _is_there(package)]


@pytest.fixture(scope="module")
def sweeps(shells):
    """Makes, once per launcher, its sweeps over bad denoisers."""
    made = {}

    def sweep(launcher):
        if launcher not in made:
            shell = shells(f"denoise_{launcher}")
            how = () if launcher == "basic" else (f"hydra/launcher={launcher}", *OTHERS[launcher][1])
            options = {"plugins": PLUGINS, "timeout": 400}
            locks = shell.folder / "tmp"  # for the processors: what else is tested now holds others
            locks.mkdir()
            with pytest.MonkeyPatch.context() as patch:
                patch.setenv("TMPDIR", str(locks))
                names, greedy = (",".join(n for n in swept(launcher) if n in some) for some in (DENOISE, GREEDY))
                done = shell.run(f"method={names},declared_missing", *LIMITS, *how, board=True, **options)
                shell.run(f"method={greedy}", *MORE_TIME, *how, **options)
            left = shell.left_over()
            shell.kill_all()
            made[launcher] = shell, done, left, shell.rows()
        return made[launcher]

    return sweep


@pytest.mark.parametrize("method", BAD)
def test_a_bad_case_gets_its_status_and_affects_no_other(sweeps, method):
    _, _, _, rows = sweeps("basic")
    status, message = BAD[method]
    found = rows[rows["method"] == method]
    assert list(found["status"]) == ["ok", status, "ok"], list(found["message"])
    assert message in found["message"].iloc[1]
    assert list(found["case"]) == ["ball-test-000", "ball-test-001", "ball-test-002"]


def test_one_launcher_at_least_is_installed():
    assert "joblib" in INSTALLED


@pytest.mark.parametrize("launcher", INSTALLED)
def test_the_rows_are_those_of_the_basic_launcher(sweeps, launcher):
    shell, done, _, rows = sweeps(launcher)
    assert "Traceback" not in done.stderr, done.stderr
    assert done.returncode == sweeps("basic")[1].returncode
    expected = comparable(sweeps("basic")[3])
    assert set(expected["method"]) == {*BAD, "declared_missing"}
    expected = expected[expected["method"].isin([*OF_EACH_KIND, "declared_missing"])].reset_index(drop=True)
    assert set(expected["status"]) == {"ok", "error", "crashed", "timeout", "oom", "invalid", "skipped"}
    pd.testing.assert_frame_equal(comparable(rows), expected, check_exact=True)
    assert shell.left_over() == []


def comparable(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows without what was measured; the message of an `oom` says how much was taken."""
    greedy = rows["status"] == "oom"
    return rows.drop(columns=MEASURED, errors="ignore").assign(message=rows["message"].mask(greedy))


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
    assert set(calls) == {f"{method} 0 {case}" for method in swept(launcher) for case in range(3)}


@pytest.mark.parametrize(("launcher", "method"), TIMEOUTS)
def test_a_timeout_is_over_two_seconds_after_the_limit(sweeps, launcher, method):
    shell, _, _, rows = sweeps(launcher)
    row = rows[(rows["method"] == method) & (rows["case_index"] == 1)].iloc[0]
    began = shell.call_times()[f"{method} 0 1"]  # written by the method itself, as its first act
    took = datetime.fromisoformat(row["finished"]).timestamp() - began
    assert SECONDS - 0.1 < took < SECONDS + 2.0


def test_two_cells_at_once_get_different_processors(sweeps):
    """Those of joblib's two processes; each that runs into its limit takes long enough to meet another."""
    shell, _, _, rows = sweeps("joblib")
    begins, processors = shell.call_times(), shell.call_processors()
    finished = rows[rows["case_index"] == 1].set_index("method")["finished"].map(datetime.fromisoformat)
    spans = sorted(
        (begins[f"{name} 0 1"], finished[name].timestamp(), f"{name} 0 1")
        for launcher, name in TIMEOUTS
        if launcher == "joblib"
    )
    assert all(len(found) == 1 for found in processors.values())
    met = [(one, other) for (_, end, one), (begin, _, other) in pairwise(spans) if begin < end]
    assert met
    if len(os.sched_getaffinity(0)) > 1:
        assert [pair for pair in met if processors[pair[0]] & processors[pair[1]]] == []


@launchers
def test_a_process_that_a_method_has_changed_runs_no_other_case(sweeps, launcher):
    """And one that it has left as it was runs all of them."""
    processes = sweeps(launcher)[0].call_processes()
    for method in ("fine", "leaves_its_process_changed", "leaves_a_busy_thread"):
        first, second, third = (processes[f"{method} 0 {case}"] for case in range(3))
        assert first == second and (second == third) == (method == "fine")


@launchers
def test_the_exit_code_tells_and_nothing_else_goes_wrong(sweeps, launcher):
    shell, done, _, rows = sweeps(launcher)
    assert done.returncode == 3, done.stderr
    assert "Traceback" not in done.stderr + done.stdout
    names = swept(launcher)
    cells = sum(name in DENOISE for name in names) + 1  # and declared_missing
    planned = 3 * cells
    assert len(rows) == 3 * (len(names) + 1)
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
