"""One sweep: what the front door hands to Hydra, and what Hydra hands back, job by job.

Hydra enumerates and places the jobs; :func:`job` is what it calls, in this process or in those of a launcher. A job
never raises for what a method did: every outcome is a file in the sweep's session folder, which the front door reads
when Hydra is done.
"""

from __future__ import annotations

import contextlib
import functools
import os
import re
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..engine.forkserver import CannotStart
from ..errors import DetailbenchError, StoreError, Terminated, UsageError
from ..plan.cell import Cell, NotSolved, check_root, settings_of
from ..plan.keys import GROUPS
from ..plugins import config_files
from ..plugins.registry import load_plugins
from ..safe_path import isolate_imports, safe_children
from .session import Session

if TYPE_CHECKING:
    from omegaconf import DictConfig

    from .progress import Progress


PROGRESS: Progress | None = None  # set by the front door for jobs that run in its own process


def job(config: DictConfig) -> None:
    """What Hydra calls for every job."""
    from omegaconf import OmegaConf

    from .composition import register_resolvers

    register_resolvers()
    values = OmegaConf.to_container(config, resolve=True)
    session = Session(Path(os.path.expanduser(values["results"])).absolute(), values["session"])
    here = session.owner[0] == os.getpid()
    if not here:  # a launcher's process; Ctrl-C is the front door's business, and so is the end
        _ignore_interrupts()
        isolate_imports()
        config_files.use(list(config.config_dirs))
        load_plugins(list(config.plugins), warn=False)
    register_resolvers()  # they ask which plugins there are
    values = OmegaConf.to_container(config, resolve=True)

    def alive() -> None:
        if not here and not session.is_watched():
            from ..engine.runner import forget_servers

            forget_servers()
            os._exit(1)

    alive()
    if not here:
        _leave_with(session)
    number, title = _number(), _title(values)
    name = f"job-{number:06d}"
    if session.has(name):
        return  # the sweep was launched once more, after a process of the launcher was killed
    reporter = PROGRESS if here else None
    try:
        word = {"kind": "cell", **_run(values, reporter, alive)}
    except NotSolved as error:
        word = {"kind": "not_solved", "message": str(error)}
    except UsageError as error:
        word = {"kind": "usage", "message": str(error)}
    except CannotStart as error:  # every other job would meet the same; two processes may say so, one line is enough
        session.leave("stopped", kind="stopped", title=title, message=str(error))
        raise SystemExit(1) from error
    except StoreError as error:
        # There is no point in going on: every other job would meet the same disk.
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(1) from error
    session.leave(name, job=number, **{"title": title, **word})


def _run(values: Mapping[str, Any], reporter: Progress | None, alive: Callable[[], None]) -> dict[str, Any]:
    """Run the cell of a composed config; what its job leaves."""
    from ..engine.runner import run_cell
    from .progress import line_of

    begin = time.monotonic()
    check_root(values)
    settings = settings_of(values)
    cell = Cell.from_config(values)
    outcome = run_cell(cell, settings, reporter, alive)
    record = outcome.record
    return {
        "title": cell.title,
        "cell": record.cell,
        "fingerprint": record.fingerprint,
        "solved": record.solved,
        "planned": len(record.rows),
        "cached": outcome.cached,
        "for_outputs": outcome.for_outputs,
        "stale": outcome.stale,
        "notes": outcome.notes,
        "line": line_of(cell, outcome),
        "took": time.monotonic() - begin if outcome.cached < len(record.rows) else 0.0,
    }


def _number() -> int:
    """The place of this job in its sweep, from 0; 0 for the only one."""
    from hydra.core.hydra_config import HydraConfig
    from omegaconf import OmegaConf

    return OmegaConf.select(HydraConfig.get(), "job.num", default=None) or 0


@functools.cache
def _leave_with(session: Session) -> None:
    """End this process of a launcher when the front door is gone, also while it waits for the next job."""

    def look() -> None:
        while session.is_watched():
            time.sleep(0.5)
        os._exit(1)  # the fork servers see their socket close and end what is below them

    threading.Thread(target=look, daemon=True, name="front door").start()


def _title(values: Mapping[str, Any]) -> str:
    names = [(values.get(kind) or {}).get("_name_", "?") for kind in ("task", "dataset", "sensor", "method")]
    return " ".join([*names, f"seed={values.get('seed')}"])


def _ignore_interrupts() -> None:
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def representatives(batch: Sequence[Sequence[str]]) -> list[Sequence[str]]:
    """So many of a sweep's jobs that each combination of overrides of one group is in at least one of them.

    Whether ``method=jet method.k=24`` can be composed does not depend on the dataset, and ``seed=7`` is composed like
    ``seed=8``, so of thousands of jobs a few tell whether all can.
    """
    seen: set[tuple[str, ...]] = set()
    chosen = []
    for job in batch:
        groups: dict[str, list[str]] = {}
        for override in job:
            groups.setdefault(_head(override), []).append(_kind_of_number(override))
        fresh = {tuple(group) for group in groups.values()} - seen
        if fresh:
            chosen.append(job)
            seen |= fresh
    return chosen


def _kind_of_number(override: str) -> str:
    """``seed=<int>`` for ``seed=7``: of a key of the run, one number is composed like another of its type."""
    key, _, value = override.partition("=")
    if is_hydras(key) or _head(key) in GROUPS:
        return override
    kind = next((kind for kind, form in NUMBERS.items() if form.fullmatch(value)), None)
    return f"{key}=<{kind}>" if kind else override


def _head(override: str) -> str:
    """The group, or the key of the run, that an override is about."""
    return re.split(r"[./=@]", override.lstrip("+~"), maxsplit=1)[0]


# As Hydra's grammar has them; what is not surely a number there is composed as it stands.
NUMBERS = {
    "int": re.compile(r"[+-]?(0|[1-9](_?[0-9])*)"),
    "float": re.compile(r"[+-]?([0-9]+\.[0-9]*|[0-9]*\.[0-9]+|[0-9]+(?=[eE]))([eE][+-]?[0-9]+)?"),
}


def is_hydras(override: str) -> bool:
    """Whether an override is about Hydra itself: its launcher, say."""
    return override.lstrip("+~").startswith("hydra")


@contextlib.contextmanager
def _few_compositions(mode_is_known: bool, jobs: Sequence[Sequence[str]] | None) -> Iterator[None]:
    """Let Hydra compose less often, and launch these jobs alone where they are given.

    It composes every job of a sweep once before the first starts, which takes minutes for thousands, and all but the
    swept words only to see whether ``hydra.mode`` says that this is a sweep, which the front door has found out. A job
    that is the only one says itself what is wrong with it.
    """
    from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
    from hydra._internal.hydra import Hydra
    from hydra.plugins.sweeper import Sweeper

    validate, get_mode, split = Sweeper.validate_batch_is_legal, Hydra.get_mode, BasicSweeper.split_arguments
    Sweeper.validate_batch_is_legal = lambda self, batch: validate(
        self, representatives(batch) if len(batch) > 1 else ()
    )
    if mode_is_known:
        Hydra.get_mode = lambda self, config_name, overrides: None
    if jobs is not None:
        BasicSweeper.split_arguments = staticmethod(lambda overrides, most=None: _batches(jobs, most))
    try:
        yield
    finally:
        Sweeper.validate_batch_is_legal, Hydra.get_mode = validate, get_mode
        BasicSweeper.split_arguments = staticmethod(split)


def _batches(jobs: Sequence[Sequence[str]], most: int | None) -> list[list[list[str]]]:
    """The jobs as Hydra's sweeper hands them to a launcher: at most ``most`` at a time, all without it."""
    size = len(jobs) if most is None or most == -1 else most
    return [[list(job) for job in jobs[begin : begin + size]] for begin in range(0, len(jobs), max(size, 1))]


@contextlib.contextmanager
def _deaf_to_interrupts(overrides: Sequence[str]) -> Iterator[None]:
    """Let the processes that submitit starts on this machine leave Ctrl-C to the front door, whose end they see.

    They are in its process group, and each would print a traceback of its own.
    """
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or not any("launcher=submitit_local" in word for word in overrides):
        yield
        return
    try:
        from submitit.local import local
    except ImportError:  # Hydra says that this launcher is not installed
        yield
        return
    start = local.start_controller

    def started(*arguments: Any, **options: Any) -> Any:
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # a process inherits what is ignored
        try:
            return start(*arguments, **options)
        finally:
            signal.signal(signal.SIGINT, before)

    local.start_controller = started
    try:
        yield
    finally:
        local.start_controller = start


class WorkerDied(DetailbenchError):
    """A process of the launcher was killed, by a system short of memory for instance, and the sweep ended early."""


# How launchers call it: joblib (BrokenExecutor is Python's), submitit, ray.
WORKER_DIED = ("BrokenExecutor", "UncompletedJobError", "RayError")


def launch(overrides: list[str], multirun: bool, jobs: Sequence[Sequence[str]] | None = None) -> int:
    """Let Hydra run the jobs; 0, or the exit code that a job ended the sweep with.

    Parameters
    ----------
    overrides : of the command
    multirun : whether it is a sweep
    jobs : of a sweep, the overrides of the jobs that are launched; all without it

    Raises
    ------
    UsageError
        With what Hydra said, when it cannot compose a config or find a launcher.
    StoreError
        When Hydra's own file cannot be written.
    WorkerDied
        When a process of the launcher was killed.
    """
    import hydra
    from hydra.errors import HydraException
    from omegaconf.errors import OmegaConfBaseException

    from .composition import CONFIG_MODULE, CONFIG_NAME, VERSION_BASE, hydra_message, register_base

    register_base()
    argv, full = sys.argv, os.environ.get("HYDRA_FULL_ERROR")
    sys.argv = ["detailbench", *(["--multirun"] if multirun else []), *overrides]
    os.environ["HYDRA_FULL_ERROR"] = "1"  # otherwise Hydra prints a traceback of its own and ends the process
    try:
        with (
            safe_children(),
            _deaf_to_interrupts(overrides),
            _few_compositions(not any(is_hydras(word) for word in overrides), jobs),
        ):
            hydra.main(config_path=f"pkg://{CONFIG_MODULE}", config_name=CONFIG_NAME, version_base=VERSION_BASE)(job)()
    except SystemExit as error:
        if error.code == signal.SIGTERM:  # a launcher (ray) that makes SIGTERM its own
            raise Terminated(signal.SIGTERM) from error
        return error.code if isinstance(error.code, int) else 1
    except (HydraException, OmegaConfBaseException) as error:
        raise UsageError(hydra_message(error)) from error
    except OSError as error:
        if error.filename is None:  # no file: semaphores, processes, descriptors
            raise UsageError(
                f"the launcher cannot start its processes: {error.strerror or error}. It needs shared memory that can "
                "be written (/dev/shm) and processes; make room for them, or leave out hydra/launcher"
            ) from error
        raise StoreError(
            f"cannot write {error.filename}: {error.strerror or error}. Earlier results "
            "are intact; free some space or choose another folder with results=DIR, then run the same command again"
        ) from error
    except Exception as error:
        if not {cls.__name__ for cls in type(error).__mro__}.intersection(WORKER_DIED):
            raise
        if ray := sys.modules.get("ray"):
            ray.shutdown()  # a cluster that has lost its raylet starts nothing more; the next launch starts another
        raise WorkerDied(f"a process of the launcher was killed ({type(error).__name__})") from error
    finally:
        sys.argv = argv
        os.environ.pop("HYDRA_FULL_ERROR") if full is None else os.environ.update(HYDRA_FULL_ERROR=full)
    return 0


def launch_all(
    session: Session,
    overrides: list[str],
    total: int,
    multirun: bool,
    jobs: Sequence[Sequence[str]] | None = None,
) -> int:
    """:func:`launch`, and once more for what a killed process of a launcher left undone: finished jobs end at once.

    Returns
    -------
    int
        As :func:`launch`; 3 where a process was killed again, and some jobs are still undone.
    """
    counts = not any(word.lstrip("+").startswith("hydra/sweeper") for word in overrides)  # as many jobs as were planned
    for again in (False, True):
        try:
            code, what = launch(overrides, multirun, jobs), "the launcher ended early"
        except WorkerDied as error:
            code, what = 0, str(error)
        undone = total - sum("job" in entry for _, entry in session.entries())
        if code or not counts or undone <= 0:
            return code
        rest = f"{what}: {undone} of {total} cells are not finished"
        if again:
            print(f"error: {rest}; the same command goes on from there", file=sys.stderr)
        else:
            print(f"warning: {rest}, and are launched once more", file=sys.stderr)
    return 3
