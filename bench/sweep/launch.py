"""One sweep: the exchange between the front door and Hydra, job by job.

Hydra enumerates and places the jobs; it calls :func:`job` in this process or in those of a launcher. A job
never raises because of a method: every outcome is a file in the sweep's session folder, which the front door reads
when Hydra is done.
"""

from __future__ import annotations

import contextlib
import functools
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..engine.forkserver import CannotStart
from ..errors import DetailbenchError, StoreError, Terminated, UsageError
from ..plan.cell import Cell, NotSolved, check_root, sensor_of, settings_of
from ..plugins import config_files
from ..plugins.registry import load_plugins, registry
from ..safe_path import isolate_imports, safe_children
from .composition import CONFIG_NAME, hydra_message, hydra_ready, in_words
from .parts import representatives
from .request import Request, is_hydras, text_of
from .session import Session

if TYPE_CHECKING:
    from hydra.plugins.launcher import Launcher
    from omegaconf import DictConfig

    from .parts import Configs
    from .progress import Progress


PROGRESS: Progress | None = None  # set by the front door for jobs that run in its own process


def job(config: DictConfig) -> None:
    """The function that Hydra calls for every job."""
    from omegaconf import OmegaConf

    from .composition import register_resolvers

    register_resolvers()
    values: Any = OmegaConf.to_container(config, resolve=True)
    session = Session(Path(os.path.expanduser(values["results"])).absolute(), values["session"])
    here = session.owner[0] == os.getpid()
    if not here:  # a launcher's process; the front door handles Ctrl-C and the end
        _ignore_interrupts()
        isolate_imports()
        config_files.use(list(config.config_dirs))
        load_plugins(list(config.plugins), warn=False)
    register_resolvers()  # they query the plugins
    values = OmegaConf.to_container(config, resolve=True)

    def alive() -> None:
        if not here and not session.is_watched():
            from ..engine.runner import forget_servers

            forget_servers()
            os._exit(1)

    alive()
    if not here:
        _leave_with(session)
    number = _number()
    name = f"job-{number:06d}"
    if session.has(name):
        return  # the sweep was launched again after a process of the launcher was killed
    reporter = PROGRESS if here else None
    try:
        word = {"kind": "cell", **_run(values, reporter, alive)}
    except NotSolved as error:
        word = {"kind": "not_solved", "title": _title(values), "message": str(error)}
    except UsageError as error:
        word = {"kind": "usage", "title": _title(values), "message": str(error)}
    except CannotStart as error:  # every other job would fail alike; two processes may report it, one line is enough
        session.leave("stopped", kind="stopped", title=_title(values), message=str(error))
        raise SystemExit(1) from error
    except StoreError as error:
        # Going on is pointless: every other job would fail on the same disk.
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(1) from error
    session.leave(name, job=number, **word)


def _run(values: Mapping[str, Any], reporter: Progress | None, alive: Callable[[], None]) -> dict[str, Any]:
    """Run the cell of a composed config; the entry that its job leaves."""
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

    config: Any = HydraConfig.get()  # a node, although Hydra's types differ
    return OmegaConf.select(config, "job.num", default=None) or 0


@functools.cache
def _leave_with(session: Session) -> None:
    """End this process of a launcher when the front door has ended, also while it waits for the next job."""

    def look() -> None:
        while session.is_watched():
            time.sleep(0.5)
        os._exit(1)  # the fork servers see their socket close and end their descendants

    threading.Thread(target=look, daemon=True, name="front door").start()


def _title(values: Mapping[str, Any]) -> str:
    names = {kind: (values.get(kind) or {}).get("_name_", "?") for kind in ("task", "dataset", "sensor", "method")}
    with contextlib.suppress(UsageError):  # the message below the title reports it
        names["sensor"] = sensor_of(values.get("sensor"), registry().find("dataset", names["dataset"])).name
    return " ".join([*names.values(), f"seed={values.get('seed')}"])


def _ignore_interrupts() -> None:
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextlib.contextmanager
def _deaf_to_interrupts(request: Request) -> Iterator[None]:
    """Make submitit's processes on this machine leave Ctrl-C to the front door, whose end they notice.

    They are in its process group, and each would print a traceback of its own.
    """
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or request.launcher != "submitit_local":
        yield
        return
    try:
        from submitit.local import local
    except ImportError:  # Hydra reports that this launcher is not installed
        yield
        return
    start = local.start_controller

    def started(*arguments: Any, **options: Any) -> Any:
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # a process inherits ignored signals
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


# Overrides about Hydra on which no config of a job depends.
OF_THE_LAUNCH = ("hydra/launcher=", "hydra.launcher.", "hydra.mode=", "hydra.sweeper.")
# The exceptions of launchers for it: joblib (BrokenExecutor is Python's), submitit, ray.
WORKER_DIED = ("BrokenExecutor", "UncompletedJobError", "RayError")


def launch(request: Request, jobs: Sequence[Sequence[str]], configs: Configs | None = None) -> int:
    """Let a launcher of Hydra run jobs; 0, or the exit code that a job ended them with.

    Parameters
    ----------
    request : with the launcher and its parameters
    jobs : the overrides of each job
    configs : the configs of the jobs, if they are known

    Raises
    ------
    UsageError
        With Hydra's message, if it cannot compose a config or find a launcher.
    StoreError
        If the launcher's own files cannot be written.
    WorkerDied
        If a process of the launcher was killed.
    """
    try:
        with safe_children(), _deaf_to_interrupts(request), _launcher(request, jobs, configs) as (launcher, batches):
            first = 0
            for batch in batches:
                for ended in launcher.launch(batch, initial_job_idx=first):
                    _ = ended.return_value  # raises what the job raised
                first += len(batch)
    except SystemExit as error:
        if error.code == signal.SIGTERM:  # a launcher (ray) that handles SIGTERM itself
            raise Terminated(signal.SIGTERM) from error
        return error.code if isinstance(error.code, int) else 1
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
    return 0


@contextlib.contextmanager
def _launcher(
    request: Request, jobs: Sequence[Sequence[str]], configs: Configs | None
) -> Iterator[tuple[Launcher, list[list[list[str]]]]]:
    """Hydra's launcher, and the batches of jobs for it.

    Hydra's own sweeper would compose every job once before the first starts, which takes minutes for thousands; here
    representatives are composed, unless their parts have been. A single job reports its own errors.
    """
    from hydra._internal.callbacks import Callbacks
    from hydra.core.plugins import Plugins
    from hydra.errors import HydraException
    from hydra.types import HydraContext, RunMode
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    from .known import KnownConfigs

    own = [text_of(override) for override in request.overrides if is_hydras(override)]
    if not all(word.startswith(OF_THE_LAUNCH) for word in own):
        configs = None
    with hydra_ready() as loader:
        with in_words([*own, *jobs[0]]):
            config = loader.load_configuration(CONFIG_NAME, [*own, *jobs[0]], run_mode=RunMode.MULTIRUN)
            for words in representatives(jobs)[1:] if configs is None else ():  # the first is the one above
                loader.load_sweep_config(config, list(words))
            callbacks = Callbacks(config)
            known: Any = KnownConfigs(loader, jobs, configs)
            launcher = Plugins.instance().instantiate_launcher(
                hydra_context=HydraContext(config_loader=known, callbacks=callbacks), task_function=job, config=config
            )
        callbacks.on_multirun_start(config=config, config_name=CONFIG_NAME)
        most = OmegaConf.select(config, "hydra.sweeper.max_batch_size")
        size = most if most and most > 0 else len(jobs)
        try:
            yield launcher, [[list(words) for words in jobs[at : at + size]] for at in range(0, len(jobs), size)]
        except (HydraException, OmegaConfBaseException) as error:
            raise UsageError(hydra_message(error)) from error
        callbacks.on_multirun_end(config=config, config_name=CONFIG_NAME)


def launch_all(
    session: Session, request: Request, jobs: Sequence[Sequence[str]], configs: Configs | None = None
) -> int:
    """:func:`launch`, and once more for jobs left undone by a killed process of a launcher: finished jobs end at once.

    Returns
    -------
    int
        As :func:`launch`; 3 if a process was killed again, and some jobs are still undone.
    """
    for again in (False, True):
        try:
            code, what = launch(request, jobs, configs), "the launcher ended early"
        except WorkerDied as error:
            code, what = 0, str(error)
        undone = len(jobs) - sum("job" in entry for _, entry in session.entries())
        if code or undone <= 0:
            return code
        rest = f"{what}: {undone} of {len(jobs)} cells are not finished"
        if again:
            print(f"error: {rest}; run the same command again to continue", file=sys.stderr)
        else:
            print(f"warning: {rest}; they are launched once more", file=sys.stderr)
    return 3


def show(flags: Mapping[str, str], request: Request) -> int:
    """Let Hydra print what its flags ask for about the one config of the request; the exit code."""
    from argparse import Namespace

    from hydra._internal.utils import get_args_parser
    from hydra.core.global_hydra import GlobalHydra

    words = request.words
    with hydra_ready(), in_words(words):
        hydra = GlobalHydra.instance().hydra
        assert hydra is not None
        try:
            if "--cfg" in flags:
                hydra.show_cfg(CONFIG_NAME, words, flags["--cfg"], flags.get("--package"), "--resolve" in flags)
            elif "--info" in flags:
                hydra.show_info(flags["--info"], CONFIG_NAME, words)
            else:
                hydra.hydra_help(None, get_args_parser(), Namespace(overrides=words))
        except SystemExit as error:  # a package that the config lacks
            return error.code if isinstance(error.code, int) else 1
    return 0
