"""What the tests of the command line share: the installed command, run like a user would, and nothing left behind."""

from __future__ import annotations

import functools
import json
import os
import signal
import subprocess
import sys
import time
import uuid
from pathlib import Path

import psutil
import pytest

# Fixtures of the tests of pages. A conftest.py of their own would be what the others find as `conftest`.
from browsing import browser, small, small_data, small_page, visit, window, windows  # noqa: F401

from bench.datasets.real import Real
from bench.errors import MissingData
from bench.plugins.registry import KINDS, load_plugins, plugin_module_name, registry

COMMAND = [str(Path(sys.prefix) / "bin" / "detailbench")]
MARK = "DETAILBENCH_TEST_MARK"  # in the environment of a command: all that descends from it carries it
TOYS = Path(__file__).parent / "faults" / "toys.py"
FORKS = Path(__file__).with_name("forks.py")
AT_START = dict(os.environ)  # before a test changes it
WORDS = ("task=denoise", "dataset=ball", "sensor=dots", "metric=[spread]", "cases=2")
# Where the suite is started in the background of a script, Ctrl-C is ignored by it and by all that it starts.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # ignored under nohup
LAUNCHERS = {"basic": (), "joblib": ("hydra/launcher=joblib", "hydra.launcher.n_jobs=2")}


OF_REAL_FILES = "datasets/test_datasets_real_files.py"


def _why_no_real_files() -> str:
    try:
        Real().check()
    except MissingData as error:
        return str(error)
    return ""


# The tests of fetched data are collected where they were fetched (`make real`); no other test needs them.
collect_ignore = [OF_REAL_FILES] if _why_no_real_files() else []


def pytest_collection_finish() -> None:
    """All test modules are imported now, and so is what compiles, where any of them needs it."""
    if "numba" in sys.modules:
        from compiling import compile_each_function_once

        compile_each_function_once()
    set_one_thread_of_torch()


def pytest_report_header() -> str | None:
    """Say why they do not run."""
    return f"{OF_REAL_FILES} is left out: {why}" if (why := _why_no_real_files()) else None


def wait_for(condition, seconds: float = 60.0, more=lambda: "") -> None:
    """Wait until ``condition()`` holds; the message of one that does not ends with ``more()``."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"{condition} did not come true{more()}"
        time.sleep(0.02)


class Shell:
    """A folder in which commands are run, and all the processes that they start.

    The folder holds ``work`` (the current directory of the commands), ``results`` and ``calls.log``, in which the toy
    methods write a line per call.
    """

    def __init__(self, folder: Path):
        self.folder = folder
        self.mark = uuid.uuid4().hex[:15]  # so many letters does Linux keep of a process's name
        self.work, self.results, self.log = folder / "work", folder / "results", folder / "calls.log"
        self.work.mkdir()

    def environment(self) -> dict[str, str]:
        return {**os.environ, MARK: self.mark, "TOY_LOG": str(self.log), "COLUMNS": "200"}

    def start(self, *words: str, command: list[str] | None = None, **options) -> subprocess.Popen[str]:
        """Start ``detailbench WORDS`` in a session of its own, as a terminal would."""
        return subprocess.Popen(
            [*(command or COMMAND), *map(str, words)],
            cwd=self.work,
            env=self.environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            **options,
        )

    def call(self, *words: str, timeout: float = 120, **options) -> subprocess.CompletedProcess[str]:
        """Run ``detailbench WORDS`` to its end.

        In a fork of a process that has the imports; with an option of :meth:`start`, from nothing.
        """
        if not options:
            return in_a_fork(list(map(str, words)), self.work, self.environment(), timeout)
        process = self.start(*words, **options)
        try:
            out, err = process.communicate(timeout=timeout)
        except BaseException:
            self.kill_all()
            raise
        return subprocess.CompletedProcess(process.args, process.returncode, out, err)

    def run(self, *words: str, launcher: str = "basic", sweep: bool = True, plugins=(TOYS,), board=False, **options):
        """``detailbench run`` with the toy plugins, into this shell's results; with its leaderboard only if asked for.

        Of a small run that takes as long as all the rest.
        """
        flags = [part for plugin in plugins for part in ("--plugin", plugin)]
        results = () if any(w.startswith("results=") for w in words) else (f"results={self.results}",)
        given = {w.partition("=")[0].lstrip("~+") for w in words}
        usual = [w for w in WORDS if w.partition("=")[0] not in given]
        how = ("-m", *LAUNCHERS[launcher]) if sweep else ()
        act = options.pop("act", self.call)
        if act in (self.call, self.start) and not board:
            flags.append("--no-leaderboard")
        return act("run", *how, *flags, *usual, *words, *results, **options)

    def apply(self, *words: str, **options) -> subprocess.CompletedProcess[str]:
        """``detailbench apply`` on one processor: for that forks have the libraries already, for all of them none."""
        return self.call("apply", "threads=1", *words, **options)

    def processes(self) -> list[psutil.Process]:
        """All processes that descend from this shell's commands."""
        found = []
        for process in psutil.process_iter():
            try:
                marks = process.environ().get(MARK), process.name()  # see forks.py
                if self.mark in marks and process.status() != psutil.STATUS_ZOMBIE:
                    found.append(process)
            except (psutil.Error, OSError):
                continue
        return found

    def left_over(self, seconds: float = 5.0) -> list[str]:
        """The processes that are still there after a grace of some seconds, in words."""
        end = time.monotonic() + seconds
        while (left := self.processes()) and time.monotonic() < end:
            time.sleep(0.1)
        return [repr(process) for process in left]

    def kill_all(self) -> None:
        """Clean up after a test, whatever it did."""
        for process in self.processes():
            try:
                process.kill()
            except psutil.Error:
                continue

    def wait_for(self, condition, seconds: float = 60.0) -> None:
        """Wait until ``condition()`` holds."""
        wait_for(condition, seconds, lambda: f"; calls so far:\n{self.calls()}")

    def calls(self) -> list[str]:
        """What the toy methods logged, one ``method seed case`` per call."""
        return [" ".join(line.split()[:3]) for line in self._logged()]

    def call_times(self) -> dict[str, float]:
        """When each call began, in seconds since the epoch."""
        return {" ".join(line.split()[:3]): float(line.split()[3]) for line in self._logged()}

    def call_processes(self) -> dict[str, int]:
        """In which process each call was."""
        return {" ".join(line.split()[:3]): int(line.split()[4]) for line in self._logged()}

    def call_processors(self) -> dict[str, set[int]]:
        """On which processors each call might run."""
        return {" ".join(line.split()[:3]): set(map(int, line.split()[5].split(","))) for line in self._logged()}

    def _logged(self) -> list[str]:
        return [line for line in self.log.read_text().splitlines() if line.strip()] if self.log.exists() else []

    def rows(self, **wanted):
        """The stored rows as a table, without the help of the index."""
        from bench.results.store import Results

        frame = Results(self.results).rows(use_index=False)
        for key, value in wanted.items():
            frame = frame[frame[key] == value]
        return frame.sort_values(["method", "seed", "case_index"]).reset_index(drop=True)

    def files(self) -> list[Path]:
        """The files of finished cells."""
        return sorted(self.results.glob("cells/*/*.parquet"))


@functools.cache
def _forks() -> subprocess.Popen[str]:
    """The process that answers commands in forks; it ends with this one, whose end of the pipe it reads."""
    environment = {**AT_START, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}  # a fork leaves threads behind
    return subprocess.Popen(
        [sys.executable, str(FORKS)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment, text=True
    )


def in_a_fork(
    words: list[str], folder: Path, environment: dict[str, str], timeout: float
) -> subprocess.CompletedProcess[str]:
    """Run ``detailbench WORDS`` to its end, like :func:`subprocess.run`."""
    forks = _forks()
    request = {"words": words, "folder": str(folder), "environment": environment, "timeout": timeout}
    request["mark"] = environment.get(MARK, "")
    print(json.dumps(request), file=forks.stdin, flush=True)
    code, out, err = json.loads(forks.stdout.readline())
    if code is None:
        raise subprocess.TimeoutExpired(words, timeout, out, err)
    return subprocess.CompletedProcess(words, code, out, err)


def set_one_thread_of_torch() -> None:
    """Four processes with two threads each, that spin while they wait, are thirty times as slow as with one each."""
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)


@pytest.fixture(autouse=True)
def one_thread_of_torch():
    """A test that sets another number leaves it to itself."""
    set_one_thread_of_torch()


@pytest.fixture
def shell(tmp_path):
    made = Shell(tmp_path)
    yield made
    made.kill_all()


@pytest.fixture(scope="module")
def shells(tmp_path_factory):
    """Makes shells that live as long as the module's tests."""
    made = []

    def make(name: str) -> Shell:
        made.append(Shell(tmp_path_factory.mktemp(name)))
        return made[-1]

    yield make
    for shell in made:
        shell.kill_all()


@pytest.fixture(scope="module")
def plugin_file():
    """Loads a plugin's file into this process, until the module's tests have ended.

    Other tests of the process look at all plugins there are, and at what stored results of a toy's name are made with.
    """
    paths = []

    def load(path: Path) -> Path:
        load_plugins([str(path)])
        paths.append(Path(path).resolve())
        return path

    yield load
    for kind in KINDS:
        plugins = registry()._plugins[kind]
        for name in [name for name, plugin in plugins.items() if plugin.file in paths]:
            del plugins[name]
    registry()._loaded.difference_update(plugin_module_name(path) for path in paths)
