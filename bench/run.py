"""What a method may need from outside: :class:`Run`."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from .seeds import generator, seed_words

if TYPE_CHECKING:
    import torch


@dataclass(eq=False)
class Run:
    """Handed to every method call.

    Attributes
    ----------
    seed : int
        Of the cell and the case together; equal seeds give equal results.
    device : str
        ``"cpu"`` or ``"cuda"``.
    threads : int
        How many processors the call may use. They are pinned by affinity; libraries with a thread argument should
        be given it all the same.
    seconds : float
        The wall-clock limit of this call; see :meth:`seconds_left`.
    parameters : int or None
        A learned method sets it to the number of its parameters; the leaderboard shows it.
    """

    seed: int = 0
    device: str = "cpu"
    threads: int = 1
    seconds: float = float("inf")
    parameters: int | None = None
    on_progress: Callable[[int, int], None] | None = field(default=None, repr=False)
    on_trace: Callable[[Any, float], None] | None = field(default=None, repr=False)
    _started: float = field(default_factory=time.perf_counter, repr=False)
    _paused: float = field(default=0.0, repr=False)
    _rng: np.random.Generator | None = field(default=None, repr=False)

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
        """Say that ``done`` of ``total`` steps are done. Cheap; shown where somebody looks."""
        if self.on_progress:
            self.on_progress(done, total)

    def elapsed(self) -> float:
        """Seconds of wall clock since the call began, without what was spent scoring traces."""
        return time.perf_counter() - self._started - self._paused

    def seconds_left(self) -> float:
        """Seconds until the limit; an iterative method stops with its best state before they are gone."""
        return self.seconds - self.elapsed()

    def trace(self, output: Any) -> None:
        """Offer an intermediate result. It is scored off the clock, for plots of error against time."""
        if self.on_trace:
            begin = time.perf_counter()
            self.on_trace(output, self.elapsed())
            self._paused += time.perf_counter() - begin
