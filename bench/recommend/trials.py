"""Every candidate on every cloud of every scan, in isolated workers."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from ..engine.isolate import Isolation
from ..plan.choice import Choice
from ..plan.limits import Limits
from .candidates import Candidate

if TYPE_CHECKING:
    from trimesh import Trimesh

    from ..geometry.cloud import PointCloud


@dataclass(frozen=True, eq=False)
class Trial:
    """One candidate on one scan.

    Attributes
    ----------
    meshes : a Trimesh for each cloud, or None where one of them failed
    why : str
        Status and message where it failed, else empty.
    seconds, peak_mb : float
        Of the call on the first cloud.
    note : str
        What the method reported.
    """

    meshes: tuple[Trimesh, ...] | None
    why: str = ""
    seconds: float = 0.0
    peak_mb: float = 0.0
    note: str = ""

    def then(self, other: Trial) -> Trial:
        """This trial with the meshes of a later one; failed if that one failed."""
        meshes = (*self.meshes, *other.meshes) if self.meshes and other.meshes else None
        return replace(self, meshes=meshes, why=self.why or other.why)


@dataclass(frozen=True)
class Setup:
    """How trials are run."""

    task: str = "reconstruct"
    seed: int = 0
    limit: Limits = field(default_factory=Limits)
    jobs: int = 1  # workers side by side, one thread each
    plugins: tuple[str, ...] = ()


def trials(
    clouds: Sequence[Sequence[PointCloud]],
    chosen: Sequence[Candidate],
    setup: Setup,
    on_done: Callable[[], None] = lambda: None,
) -> list[list[Trial]]:
    """Run all candidates on several clouds of each scan: for each scan a list, in the order of the candidates.

    Parameters
    ----------
    clouds : for each scan as many as are reconstructed one after the other in one trial
    chosen, setup
    on_done : called when a trial has ended, from any thread
    """
    libraries = tuple(dict.fromkeys(name for c in chosen for part in c.choice.parts for name in part.requires))
    jobs = min(setup.jobs, len(clouds) * len(chosen))
    with TemporaryDirectory(prefix="detailbench-recommend-") as name, contextlib.ExitStack() as servers:
        folder = Path(name)
        idle: SimpleQueue[Isolation] = SimpleQueue()
        for _ in range(jobs):
            idle.put(servers.enter_context(Isolation(libraries, setup.plugins, 1)))
        files = [
            [_stored(folder / f"scan{number}-{part}.npz", cloud) for part, cloud in enumerate(of_scan)]
            for number, of_scan in enumerate(clouds)
        ]

        def one(number: int, index: int) -> Trial:
            isolation = idle.get()
            try:
                return _trial(isolation, files[number], folder / f"{number}-{index}.npz", chosen[index], setup)
            finally:
                idle.put(isolation)
                on_done()

        with ThreadPoolExecutor(jobs) as pool:
            waiting = [[pool.submit(one, n, i) for i in range(len(chosen))] for n in range(len(clouds))]
            try:
                return [[future.result() for future in row] for row in waiting]
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                servers.close()  # ends the workers, for which the pool would wait
                raise


def _trial(isolation: Isolation, clouds: list[str], output: Path, candidate: Candidate, setup: Setup) -> Trial:
    arguments = {
        "task": asdict(Choice.of("task", {"_name_": setup.task})),
        "method": asdict(candidate.choice),
        "clouds": clouds,
        "output": str(output),
        "seed": setup.seed,
        "weights": candidate.weights,
    }
    row = isolation.call("bench.recommend.trial:call", arguments, limit=setup.limit)
    if row["status"] != "ok":
        return Trial(None, f"{row['status']}: {row['message']}")
    meshes = read_meshes(output, len(clouds))
    output.unlink()
    return Trial(meshes, "", row["seconds"], row["peak_rss_mb"], row["message"])


def _stored(file: Path, cloud: PointCloud) -> str:
    named: dict[str, Any] = dict(cloud.arrays())
    np.savez(file, **named)
    return str(file)


def read_meshes(path: Path, count: int) -> tuple[Trimesh, ...]:
    """The meshes that a worker stored, one for each cloud."""
    from trimesh import Trimesh

    with np.load(path) as arrays:
        return tuple(Trimesh(arrays[f"vertices{i}"], arrays[f"faces{i}"], process=False) for i in range(count))
