"""Every candidate on every scan and on its halves, in isolated workers."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from ..engine.isolate import Isolation
from ..plan.choice import Choice
from ..plan.limits import Limits
from .candidates import Candidate
from .scan import Scan

if TYPE_CHECKING:
    from trimesh import Trimesh


@dataclass(frozen=True, eq=False)
class Trial:
    """One candidate on one scan.

    Attributes
    ----------
    meshes : three Trimesh, or None where it failed
        Of the scan, of its first half and of its second.
    why : str
        Status and message where it failed, else empty.
    seconds, peak_mb : float
        Of the call on the scan.
    note : str
        What the method reported.
    """

    meshes: tuple[Trimesh, Trimesh, Trimesh] | None
    why: str = ""
    seconds: float = 0.0
    peak_mb: float = 0.0
    note: str = ""


@dataclass(frozen=True)
class Setup:
    """How trials are run."""

    task: str = "reconstruct"
    seed: int = 0
    limit: Limits = field(default_factory=Limits)
    jobs: int = 1  # workers side by side, one thread each
    plugins: tuple[str, ...] = ()


def trials(
    scans: Sequence[Scan],
    chosen: Sequence[Candidate],
    setup: Setup,
    on_done: Callable[[str], None] = lambda title: None,
) -> list[list[Trial]]:
    """Run all candidates on all scans: for each scan a list, in the order of the candidates.

    Parameters
    ----------
    scans, chosen, setup
    on_done : called with the title of each trial that has ended, from any thread
    """
    libraries = tuple(dict.fromkeys(name for c in chosen for part in c.choice.parts for name in part.requires))
    jobs = min(setup.jobs, len(scans) * len(chosen))
    with TemporaryDirectory(prefix="detailbench-recommend-") as name, contextlib.ExitStack() as servers:
        folder = Path(name)
        idle: SimpleQueue[Isolation] = SimpleQueue()
        for _ in range(jobs):
            idle.put(servers.enter_context(Isolation(libraries, setup.plugins, 1)))
        for number, scan in enumerate(scans):
            for part, cloud in enumerate((scan.cloud, scan.half(0), scan.half(1))):
                np.savez(_cloud(folder, number, part), **cloud.arrays())

        def one(number: int, index: int) -> Trial:
            isolation = idle.get()
            try:
                return _trial(isolation, folder, number, index, chosen[index], setup)
            finally:
                idle.put(isolation)
                on_done(chosen[index].label)

        with ThreadPoolExecutor(jobs) as pool:
            waiting = [[pool.submit(one, n, i) for i in range(len(chosen))] for n in range(len(scans))]
            try:
                return [[future.result() for future in row] for row in waiting]
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                servers.close()  # ends the workers, for which the pool would wait
                raise


def _trial(isolation: Isolation, folder: Path, number: int, index: int, candidate: Candidate, setup: Setup) -> Trial:
    output = folder / f"{number}-{index}.npz"
    arguments = {
        "task": asdict(Choice.of("task", {"_name_": setup.task})),
        "method": asdict(candidate.choice),
        "clouds": [str(_cloud(folder, number, part)) for part in range(3)],
        "output": str(output),
        "seed": setup.seed,
        "weights": candidate.weights,
    }
    row = isolation.call("bench.recommend.trial:call", arguments, limit=setup.limit)
    if row["status"] != "ok":
        return Trial(None, f"{row['status']}: {row['message']}")
    meshes = read_meshes(output)
    output.unlink()
    return Trial(meshes, "", row["seconds"], row["peak_rss_mb"], row["message"])


def _cloud(folder: Path, number: int, part: int) -> Path:
    return folder / f"scan{number}-{part}.npz"


def read_meshes(path: Path) -> tuple[Trimesh, Trimesh, Trimesh]:
    """The three meshes that a worker stored."""
    from trimesh import Trimesh

    with np.load(path) as arrays:
        whole, first, second = (Trimesh(arrays[f"vertices{i}"], arrays[f"faces{i}"], process=False) for i in range(3))
    return whole, first, second
