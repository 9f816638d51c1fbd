"""A program, in its own environment or container, as a method."""

from __future__ import annotations

import contextlib
import fcntl
import os
import shlex
import shutil
import signal
import string
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Literal

import numpy as np

from bench import BadInput, PointCloud, Run, register

from .exchange import OnlyAs, read_output

if TYPE_CHECKING:
    from trimesh import Trimesh

PLACES = ("input", "output", "seed", "threads", "folder", "seconds", "ratio", "points")
PREFIX = "detailbench-external-"  # of the folders in which files are exchanged
LOCK = ".lock"
MARK = "DETAILBENCH_EXTERNAL"  # the environment variable that identifies a program and all processes that it starts
TAIL = 16384  # last bytes of a program's standard error that are stored; the last lines of these are shown
LINES = 5
LOOK = 0.02  # seconds between looks at the memory of a program
PATIENCE = 1.0  # seconds to wait for the end of the standard error: another process may hold it open
VERSION_SECONDS = 30
# The phrases of libraries for this; the engine recognises them too, and records the row as out of memory.
OUT_OF_MEMORY = ("bad_alloc", "out of memory", "cannot allocate memory", "memoryerror", "not enough memory")


@register("method", requires=("psutil",))
@dataclass(frozen=True)
class External:
    """Any program as a method: the input is written to a file, the program is run, its output is read.

    The command is split as by a shell, but run without one, and these placeholders in braces are replaced:
    ``{input}`` and ``{output}`` (files), ``{seed}``, ``{threads}``, ``{seconds}`` (the limit), ``{folder}`` (a folder
    for files of its own, removed afterwards), ``{points}`` (of the input) and ``{ratio}`` (of ``upsample``). A literal
    brace is written twice.

    Limits are those of all methods: when the time is over, the program and all processes that it started are killed,
    and its memory counts. The time for writing and reading files is not part of the method's time; it is in the column
    ``exchange_seconds``. A result depends on the program's file, on each file that the command names (a script), and on
    the output of ``version_command``: if one of them changes, the cells are run again.
    """

    called = "name"
    runs = ("command", "version_command")  # parameters that a record from elsewhere must not start

    name: str = ""  # in tables, instead of all other parameters: one name for each setting
    command: str = "cp {input} {output}"  # the program and its arguments
    task: Literal["denoise", "upsample", "reconstruct"] = "denoise"  # the task that it solves
    input_format: Literal["ply", "xyz", "off", "obj", "pcd", "csv"] = "ply"  # of {input}
    output_format: Literal["ply", "xyz", "off", "obj", "stl", "pcd", "csv"] = "ply"  # of {output}
    normals: bool = True  # whether the normals of the input, if it has any, are written
    frame: Literal["file", "unit"] = "file"  # of the output: that of {input}; or its box centred, at radius 1
    env: dict[str, str] = field(default_factory=dict)  # environment variables, in addition to the inherited ones
    cwd: str = ""  # the folder in which it is run; empty: the one in which detailbench was started
    version_command: str = ""  # prints the version, for example of a container image

    def __post_init__(self) -> None:
        words = _split(self.command, "command")
        if not words:
            raise ValueError("command: expected a program and its arguments: my_binary {input} {output}")
        for word in words:
            _check_places(word)
        for place in ("input", "output"):
            if not any(f"{{{place}}}" in word for word in words):
                raise ValueError(f"command: expected {{{place}}} in it, for instance: my_binary {{input}} {{output}}")
        if self.cwd and not self._folder.is_dir():
            raise ValueError(f"cwd: {self.cwd}: no such folder")
        self._find(words[0], "command")
        if self.version_command:
            self._find((_split(self.version_command, "version_command") or [""])[0], "version_command")

    # -- the interface to the engine -------------------------------------------------------------------------------

    def expect(self, task: str) -> None:
        """Raise :class:`AttributeError` for another task than the program's."""
        if task != self.task:
            raise AttributeError(f"external: its program solves {self.task} (method.task), not {task}")

    def reads(self) -> Iterator[Path]:
        """The program, and the files that the command names: scripts, weights."""
        words = _split(self.command, "command")
        yield Path(self._find(words[0], "command"))
        for word in words[1:]:
            if (path := self._folder / os.path.expanduser(word)).is_file() and "{" not in word:
                yield path

    def version(self) -> str:
        """The output of ``version_command``."""
        if not self.version_command:
            return ""
        words = _split(self.version_command, "version_command")
        words[0] = self._find(words[0], "version_command")
        return _printed(tuple(words), str(self._folder), tuple(sorted(self.env.items())))

    # -- the tasks -------------------------------------------------------------------------------------------------

    @OnlyAs
    def denoise(self, cloud: PointCloud, run: Run) -> PointCloud:
        """The points that the program writes."""
        return self._solve(cloud, run, {})

    @OnlyAs
    def upsample(self, cloud: PointCloud, ratio: int, run: Run) -> PointCloud:
        """The points that the program writes."""
        return self._solve(cloud, run, {"ratio": ratio})

    @OnlyAs
    def reconstruct(self, cloud: PointCloud, run: Run) -> Trimesh:
        """The mesh that the program writes."""
        return self._solve(cloud, run, {})

    # -- the program -----------------------------------------------------------------------------------------------

    @cached_property
    def _folder(self) -> Path:
        return Path(os.path.expanduser(self.cwd) or ".").absolute()

    def _find(self, program: str, parameter: str) -> str:
        """The path of a program.

        Raises
        ------
        ValueError
            If it does not exist, or is not executable.
        """
        path = {**os.environ, **self.env}.get("PATH")
        name = os.path.expanduser(program)
        found = shutil.which(str(self._folder / name) if os.sep in name else name, path=path)
        if found is None:
            where = f"in {self._folder}" if os.sep in name else f"on the PATH ({path})"
            raise ValueError(
                f"{parameter}: there is no program {program!r} {where}. Install it, correct its name, or make the file "
                f"executable (chmod +x)"
            )
        return found

    def _solve(self, cloud: PointCloud, run: Run, values: Mapping[str, Any]) -> Any:
        with _exchange_folder() as folder:
            source, target = folder / f"input.{self.input_format}", folder / f"output.{self.output_format}"
            with run.exchange():
                _write(cloud if self.normals else replace(cloud, normals=None), source)
            places = {"input": source, "output": target, "folder": folder, "seed": run.seed, "threads": run.threads}
            places |= {"seconds": f"{run.seconds:g}", "points": len(cloud), "ratio": 1, **values}
            words = [word.format_map(places) for word in _split(self.command, "command")]
            words[0] = self._find(words[0], "command")
            try:
                self._call(words, run, folder.name)
            finally:
                with run.exchange():
                    _kill(_marked(folder.name))
            with run.exchange():
                moved = self._in_own_frame(cloud) if self.frame == "unit" else None
                output = read_output(target, self.task, moved or cloud, f"{target.name} of {Path(words[0]).name}")
                return self._moved_back(output, cloud) if moved else output

    def _call(self, words: list[str], run: Run, mark: str) -> None:
        """Run the program to its end, with ``mark`` in its environment.

        Raises
        ------
        BadInput
            If it does not end with exit code 0; the message holds the last lines of its standard error.
        MemoryError
            If these lines report a lack of memory.
        """
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), str(run.threads))
        process = subprocess.Popen(
            words,
            cwd=self._folder,
            env={**os.environ, **threads, **self.env, MARK: mark},
            stdin=subprocess.DEVNULL,
            stdout=sys.__stderr__.fileno() if sys.__stderr__ else None,
            stderr=subprocess.PIPE,
        )
        assert process.stderr is not None  # it is a pipe
        tail = _Tail(process.stderr)
        peak = 0.0
        while (code := process.poll()) is None:
            peak = max(peak, sum(map(_peak_mb, _tree(process.pid))))
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(LOOK)
        run.peak_mb = peak or None
        if code:
            said = tail.text()
            name = Path(words[0]).name
            what = f"was killed by {_signal(-code)}" if code < 0 else f"ended with exit code {code}"
            text = f"{name} {what}: {said}" if said else f"{name} {what}, and wrote nothing to its standard error"
            if any(word in said.lower() for word in OUT_OF_MEMORY):
                raise MemoryError(text)
            raise BadInput(text)

    @staticmethod
    def _in_own_frame(cloud: PointCloud) -> PointCloud:
        """The input in the frame of a program that centres its box and scales it to radius 1."""
        center, radius = _frame(cloud.points)
        return PointCloud((cloud.points - center) / radius)

    @staticmethod
    def _moved_back(output: Any, cloud: PointCloud) -> Any:
        """An output in the frame ``unit``, transformed to the coordinates of the input."""
        center, radius = _frame(cloud.points)
        if isinstance(output, PointCloud):
            return replace(output, points=output.points * radius + center)
        output.vertices = np.asarray(output.vertices) * radius + center
        return output


# -- the command line --------------------------------------------------------------------------------------------------


def _split(text: str, parameter: str) -> list[str]:
    try:
        return shlex.split(text)
    except ValueError as error:
        raise ValueError(f"{parameter}: {error}: {text}") from error


def _check_places(word: str) -> None:
    try:
        names = [name for _, name, _, _ in string.Formatter().parse(word) if name is not None]
    except ValueError as error:
        raise ValueError(f"command: {word}: {error}; a brace itself is written twice") from error
    for name in names:
        if name not in PLACES:
            raise ValueError(f"command: {{{name}}} is not known; expected one of {', '.join(PLACES)}")


def _signal(number: int) -> str:
    try:
        return f"{signal.Signals(number).name} (signal {number})"
    except ValueError:
        return f"signal {number}"


@lru_cache(maxsize=64)  # called for every cell of a sweep
def _printed(words: tuple[str, ...], folder: str, env: tuple[tuple[str, str], ...]) -> str:
    try:
        done = subprocess.run(
            words,
            cwd=folder,
            env={**os.environ, **dict(env)},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=VERSION_SECONDS,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise BadInput(f"method.version_command: {shlex.join(words)}: {error}") from error
    if done.returncode:
        raise BadInput(f"method.version_command: {shlex.join(words)} ended with exit code {done.returncode}")
    return (done.stdout + done.stderr).strip()[:400]


# -- processes ---------------------------------------------------------------------------------------------------------


class _Tail:
    """Reads the standard error of a program, passes it on, and stores its end."""

    def __init__(self, stream: IO[bytes]):
        self._stream, self._kept = stream, b""
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        while chunk := os.read(self._stream.fileno(), 65536):
            self._kept = (self._kept + chunk)[-TAIL:]
            with contextlib.suppress(OSError):
                os.write(2, chunk)

    def text(self) -> str:
        """The last lines."""
        self._thread.join(PATIENCE)
        lines = self._kept.decode(errors="replace").strip().splitlines()
        return "\n".join(lines[-LINES:])


def _marked(mark: str) -> list[int]:
    """The processes whose environment contains ``mark``.

    Neither the process group nor the parent identifies the processes that a program left: other programs may be started
    in the same group meanwhile, and a process whose parent has ended gets another parent.
    """
    import psutil

    found = []
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error, OSError):
            if process.environ().get(MARK) == mark:
                found.append(process.pid)
    return found


def _tree(pid: int) -> list[int]:
    """A process and all its descendants."""
    found = [pid]
    for parent in found:  # the list grows during the loop
        with contextlib.suppress(OSError, ValueError):
            found += map(int, Path(f"/proc/{parent}/task/{parent}/children").read_text().split())
    return found


def _peak_mb(pid: int) -> float:
    """The peak memory of a process so far (MiB), 0 if it has ended. The ru_maxrss of an ended child would be at least
    that of this process, from which it was forked."""
    with contextlib.suppress(OSError, ValueError, IndexError):
        text = Path(f"/proc/{pid}/status").read_text()
        return int(text.partition("VmHWM:")[2].split(None, 1)[0]) / 1024
    return 0.0


def _kill(processes: list[int]) -> None:
    """Kill processes that a program left behind: they would run on while the next case is measured."""
    for pid in processes:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.kill(pid, signal.SIGKILL)


@contextlib.contextmanager
def _exchange_folder() -> Iterator[Path]:
    """A temporary folder; folders of killed processes are removed as well."""
    for left in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
        _remove_if_left(left)
    with tempfile.TemporaryDirectory(prefix=PREFIX, ignore_cleanup_errors=True) as name:
        folder = Path(name)
        with open(folder / ".new", "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # until this process ends, in any way
            (folder / ".new").rename(folder / LOCK)  # not visible to others before it is locked
            yield folder


def _remove_if_left(folder: Path) -> None:
    """Remove an exchange folder whose process has ended."""
    with contextlib.suppress(OSError):
        if folder.is_symlink() or folder.stat().st_uid != os.getuid():
            return
        with open(folder / LOCK) as lock:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(folder, ignore_errors=True)


# -- files -------------------------------------------------------------------------------------------------------------


def _frame(points: np.ndarray) -> tuple[np.ndarray, float]:
    """The centre of the box of points (n, 3), and the distance of the farthest from it."""
    center = (points.min(axis=0) + points.max(axis=0)) / 2
    return center, float(np.linalg.norm(points - center, axis=1).max()) or 1.0


def _write(cloud: PointCloud, path: Path) -> None:
    """Write a cloud; OFF and OBJ, which are mesh formats, are written here."""
    from bench.geometry.io.files import save
    from bench.geometry.io.table_writer import EXACT, lines

    plain = replace(cloud, colors=None, scalars={})
    if path.suffix not in (".off", ".obj"):
        save(plain, path)
        return
    three = " ".join([EXACT] * 3)
    normals = cloud.normals
    if path.suffix == ".obj":
        content = lines(f"v {three}", cloud.points)
        content += b"" if normals is None else lines(f"vn {three}", normals)
    else:
        table = cloud.points if normals is None else np.column_stack([cloud.points, normals])
        head = f"{'OFF' if normals is None else 'NOFF'}\n{len(cloud)} 0 0\n"
        content = head.encode() + lines(" ".join([EXACT] * table.shape[1]), table)
    path.write_bytes(content)
