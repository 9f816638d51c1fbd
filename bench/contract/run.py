"""The context of a method call: :class:`Run`."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import UsageError
from ..seeds import generator, seed_words

if TYPE_CHECKING:
    import torch


CHECKPOINT_SECONDS = 60.0  # between two checkpoints of a training


@dataclass(eq=False)
class Run:
    """Passed to every method call.

    Attributes
    ----------
    seed : int
        Of the cell and the case together; equal seeds give equal results.
    device : str
        ``"cpu"`` or ``"cuda"``.
    threads : int
        How many processors the call may use. They are pinned by affinity; pass the number also to libraries with
        a thread argument.
    seconds : float
        The wall-clock limit of this call; see :meth:`seconds_left`.
    parameters : int or None
        A learned method sets it to the number of its parameters; the leaderboard shows it.
    active_parameters : int or None
        How many of them a sparse layout would store for this input, where the method has one (features of occupied
        cells, say) and papers count so; shown beside the number of all.
    notes : list of str
        Notes of the method, see :meth:`note`.
    case : str
        The id of the case; empty under ``apply``. For methods that look up what was made elsewhere.
    external : str
        A method that only returns an output made elsewhere sets this to its origin. Its row then has no times
        and no memory, since those of the look-up mean nothing.
    peak_mb : float or None
        A method that starts a program and waits for it sets this to the peak memory of the program (MiB); the row has
        it in place of the peak of this process, which is mostly libraries.
    exchanged : float
        Seconds that :meth:`exchange` took so far.
    distances_given : int
        Number of points passed to :meth:`true_distances` so far.
    weights : mapping of names to arrays, or None
        The weights of a learned method: the arrays that its ``fit`` returned, floating-point numbers as float32.
    spent : float
        In ``fit``: the seconds that this training took before it was interrupted; ``seconds`` are those that are left.
    resumed : mapping of names to arrays, or None
        In ``fit``: the arrays of the last checkpoint of this training, where it was interrupted before.

    Example
    -------
    To call a method directly, make its run:

    >>> run = Run(seed=3, threads=2)
    >>> run.rng.random() == Run(seed=3).rng.random()
    True
    >>> run.note("the cloud has no normals")
    >>> run.notes
    ['the cloud has no normals']
    """

    seed: int = 0
    device: str = "cpu"
    threads: int = 1
    seconds: float = float("inf")
    parameters: int | None = None
    active_parameters: int | None = None
    weights: Mapping[str, np.ndarray] | None = field(default=None, repr=False)
    spent: float = 0.0
    resumed: Mapping[str, np.ndarray] | None = field(default=None, repr=False)
    notes: list[str] = field(default_factory=list, init=False)
    distances_given: int = field(default=0, init=False)
    case: str = ""
    external: str = field(default="", init=False)
    peak_mb: float | None = field(default=None, init=False)
    exchanged: float = field(default=0.0, init=False)
    on_progress: Callable[[int, int], None] | None = field(default=None, repr=False)
    on_trace: Callable[..., None] | None = field(default=None, repr=False)
    on_keep: Callable[[str, Any], None] | None = field(default=None, repr=False)
    on_distances: Callable[[np.ndarray], np.ndarray] | None = field(default=None, repr=False)
    on_exchange: Callable[[], contextlib.AbstractContextManager[None]] | None = field(default=None, repr=False)
    on_log: Callable[[int, Mapping[str, float]], None] | None = field(default=None, repr=False)
    on_checkpoint: Callable[[Mapping[str, np.ndarray]], None] | None = field(default=None, repr=False)
    _started: float = field(default_factory=time.perf_counter, repr=False)
    _paused: float = field(default=0.0, repr=False)
    _stored: float = field(default_factory=time.perf_counter, repr=False)  # time of the last checkpoint
    _rng: np.random.Generator | None = field(default=None, repr=False)
    _asked: float | None = field(default=None, repr=False)  # time of the last call of time_for_more
    _longest: float = field(default=0.0, repr=False)  # between two such calls

    @property
    def rng(self) -> np.random.Generator:
        """The method's generator of random numbers; one stream for the whole call."""
        if self._rng is None:
            self._rng = generator(self.seed, "method")
        return self._rng

    def torch_generator(self) -> torch.Generator:
        """A torch generator on the run's device, seeded like :attr:`rng`."""
        import torch

        first, second = np.random.SeedSequence([*seed_words(self.seed, "method")]).generate_state(2)
        return torch.Generator(device=self.device).manual_seed(int(first) << 31 ^ int(second))

    def progress(self, done: int, total: int) -> None:
        """Report that ``done`` of ``total`` steps are done. Cheap; shown on a terminal."""
        if self.on_progress:
            self.on_progress(done, total)

    def elapsed(self) -> float:
        """Seconds of wall clock since the call began, except those off the clock: scored traces, true distances."""
        return time.perf_counter() - self._started - self._paused

    def seconds_left(self) -> float:
        """Seconds until the limit; an iterative method stops with its best state before they run out."""
        return self.seconds - self.elapsed()

    def time_for_more(self) -> bool:
        """Whether another step fits before the limit; call it before each step of a loop.

        The next step is assumed to last 1.5 times as long as the longest so far.
        """
        now = self.elapsed()
        if self._asked is not None:
            self._longest = max(self._longest, now - self._asked)
        self._asked = now
        return self.seconds - now > 1.5 * self._longest

    def log(self, step: int, **values: float) -> None:
        """One line of a training's log: ``run.log(200, loss=0.3, validation=0.01)``.

        The log is a file beside the weights; the values called ``validation`` are drawn as a curve and stored.
        """
        if self.on_log:
            self.on_log(step, values)

    def checkpoint(self, make: Callable[[], Mapping[str, np.ndarray]]) -> None:
        """Store the state of a training, so that it can resume after it was killed. Call it after every step.

        At most once a minute ``make`` is called, a function without arguments that returns, as arrays, everything that
        further steps depend on. When the same training starts again, these arrays are :attr:`resumed`. The clock is
        paused meanwhile.
        """
        now = time.perf_counter()
        if self.on_checkpoint is None or now - self._stored < CHECKPOINT_SECONDS:
            return
        try:
            self.on_checkpoint(make())
        finally:
            self._stored = time.perf_counter()
            self._paused += self._stored - now

    def trace(self, output: Any, keep: bool = False) -> None:
        """Offer an intermediate result. It is scored off the clock, for plots of error against time.

        Where it takes time to make one (a mesh of a network), offer a function without arguments: it is called off the
        clock too, and only if traces are recorded.

        With ``keep`` the result is also stored as ``trace-000``, ``trace-001``, ... where outputs are kept: see
        :meth:`keep`. The column ``trace`` lists the seconds of each file.
        """
        if self.on_trace:
            begin = time.perf_counter()  # one clock reading: later traces never have earlier times
            self.on_trace(output, begin - self._started - self._paused, **({"keep": True} if keep else {}))
            self._paused += time.perf_counter() - begin

    def keep(self, name: str, value: Any) -> None:
        """Store something beside the output: a cage, a rendered image, a field on a grid.

        It becomes ``outputs/CELL-FINGERPRINT/CASE/NAME.ply``, ``.png`` or ``.npz`` below the results folder, and the
        column ``artefacts`` lists it. Only runs with ``outputs=first`` or ``outputs=all`` store anything; elsewhere,
        and under ``detailbench apply``, the call does nothing. The clock is paused meanwhile.

        Parameters
        ----------
        name : str
            Letters, digits and ``._-``, at most 64, not beginning with a dot. A later value of a name replaces it.
        value : Trimesh, PointCloud, Views, uint8 array (h, w, 3) or (h, w), mapping of names to arrays
            Or a function without arguments that makes one of these; it is called off the clock, and only where the
            value is stored. One case stores at most 256 MB; the excess is left out, with a note.

        Raises
        ------
        ValueError
            For an invalid name or value.
        """
        from .artefacts import check_name, suffix_of

        check_name(name)
        if not callable(value):
            suffix_of(value)  # mistakes show in every run, not only in those that store
        if self.on_keep is None:
            return
        begin = time.perf_counter()
        try:
            self.on_keep(name, value)
        finally:
            self._paused += time.perf_counter() - begin

    @contextlib.contextmanager
    def exchange(self) -> Iterator[None]:
        """Inside, files are exchanged with an external program: ``with run.exchange(): save(...)``.

        Python methods receive arrays, so the clock is paused while others exchange files instead. The seconds
        are in the column ``exchange_seconds``, and count against ``limit.setup_seconds``.
        """
        begin = time.perf_counter()
        try:
            with self.on_exchange() if self.on_exchange else contextlib.nullcontext():
                yield
        finally:
            seconds = time.perf_counter() - begin
            self.exchanged += seconds
            self._paused += seconds

    def note(self, text: str) -> None:
        """Note what the reader of a result should know, such as a setting that could not be applied.

        It becomes the row's ``message``, and is shown below every leaderboard and by ``detailbench apply``.
        """
        self.notes.append(text)

    @property
    def has_truth(self) -> bool:
        """Whether there is a reference for :meth:`true_distances`."""
        return self.on_distances is not None

    def true_distances(self, points: np.ndarray) -> np.ndarray:
        """Signed distances to the surface to be found: only for methods supervised by the ground truth.

        Some published methods are not fitted to the points of a scan but to true distances of a known surface. Such a
        method is scored on its output; the number of given distances is in its row and marked in every leaderboard,
        because methods that only see the input solve a harder problem. The time does not count: those papers
        sample the distances beforehand, so the clock is paused as for :meth:`trace`. Pass many points
        at once; a call costs a few tenths of a second however few they are.

        Parameters
        ----------
        points : (n, 3) array, finite, in the frame of the case

        Returns
        -------
        (n,) float64 array
            Exact distances to the reference mesh, negative inside, in the unit of the frame: see
            :func:`bench.geometry.signed_distance.signed_distances`.

        Raises
        ------
        UsageError
            Without a reference, see :attr:`has_truth`: a method applied to a user's file has none.
        ValueError
            For points of another shape, or that are not finite.
        """
        if self.on_distances is None:
            raise UsageError(
                "true distances: there is no reference to measure them to; choose a supervision by the input's "
                "own points (one of the method's parameters: detailbench list method NAME), or run it on a dataset"
            )
        points = np.asarray(points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise ValueError(f"true_distances: expected points of shape (n, 3), got {points.shape}")
        if not np.isfinite(points).all():
            raise ValueError("true_distances: some of the points are NaN or infinite")
        begin = time.perf_counter()
        self.distances_given += len(points)
        try:
            return self.on_distances(points)
        finally:
            self._paused += time.perf_counter() - begin
