"""The training loop of all fields: draws batches, makes steps, stops in time, and keeps the best state."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple, Protocol

import torch
from torch import Tensor

from bench import InvalidOutput

from .batches import Batch
from .field import Field
from .losses import Losses
from .settings import Training

WHOLE = 1 << 16  # points that pass through a network at once on a GPU
MEAN = 50  # number of states in a mean, about; at the beginning, a third of all states so far


class Sampling(Protocol):
    """A source of batches."""

    def draw(self) -> Any:
        """The next batch, of the kind that the loss of the field takes."""
        ...


class Clock(Protocol):
    """The interface of a run that a training uses."""

    def elapsed(self) -> float:
        """Seconds so far."""
        ...

    def progress(self, done: int, total: int) -> None:
        """Report that ``done`` of ``total`` are done."""
        ...


class Fit(NamedTuple):
    """The outcome of a training."""

    steps: int
    improved: bool  # whether a state was better than the initial one


class Progress:
    """The progress t of a training, from 0 to 1, over its steps, or over its time if the steps would take too long.

    As long as the steps fit into the time left, t does not depend on the clock, and the training is repeatable to the
    bit. If the speed so far implies that they will not fit, each step covers a larger part of the schedule, so that a
    schedule always runs to its end.

    Parameters
    ----------
    steps : int
    elapsed : function without arguments
        The clock, in seconds: it stands still while intermediate results are scored, or true distances are measured.
    seconds : float
        The available time, by that clock.
    """

    WARM_UP = 5  # first steps, whose speed is not typical: buffers and threads are created

    def __init__(self, steps: int, elapsed: Callable[[], float], seconds: float = math.inf):
        self._steps, self._elapsed = steps, elapsed
        self._last = elapsed()
        self._end = self._last + seconds
        self._done, self._measured, self._per_step = 0, 0, 0.0
        self.t = 0.0

    def step(self) -> None:
        """One step is done."""
        now = self._elapsed()
        seconds, self._last, left = now - self._last, now, self._end - now
        self._done += 1
        if self._done > self.WARM_UP or self.WARM_UP * seconds > left:
            self._measured += 1
            self._per_step += (seconds - self._per_step) / min(20, self._measured)
        part = 1 / self._steps
        if self._per_step > 0 and left < math.inf:
            part = max(part, (1 - self.t) * self._per_step / max(left, 1e-9))
        self.t = min(1.0, self.t + part) if left > 0 else 1.0
        if self._steps <= self._done:
            self.t = 1.0


class Diverged(InvalidOutput):
    """The training met values that are not finite."""


def fit(
    field: Field,
    sampler: Sampling,
    run: Clock,
    training: Training,
    offer: Callable[[], None] = lambda: None,
) -> Fit:
    """Fit a field; afterwards it holds its best state, its last one, or the mean of the last (``training.keep``).

    The best state is that with the least loss, as weighted at the end (t = 1), on one batch that is drawn beforehand.
    (Its points of the space are used nowhere else; those of the surface are points of the input, as in all batches.)

    Parameters
    ----------
    offer : called ``training.traces`` times, with the current field, or with the mean if that is kept

    Raises
    ------
    Diverged
        If the loss is NaN or infinite.
    """
    optimizer = field.optimizer(training)
    device = next(field.parameters()).device
    if device.type != "cpu":  # small chunks suit the caches of a processor; large ones keep a GPU busy
        training = replace(training, chunk=max(training.chunk, WHOLE))

    def diverged(loss: float, step: int) -> Diverged:
        return Diverged(
            f"the training diverged: the loss is {loss} after {step} of {training.steps} steps; "
            f"try a smaller learning_rate (it is {training.learning_rate:g})"
        )

    losses = Losses(str(device), diverged)
    progress = Progress(training.steps, run.elapsed, training.seconds)
    best = _Best(field, sampler.draw(), training.chunk) if training.keep == "best" else None
    mean = _Mean(field) if training.keep == "mean" else None
    if best:
        best.look()  # a loaded field may be better than all later states
    at_first = best.loss if best else math.inf
    steps = 0
    while progress.t < 1:
        t = training.begin + (1 - training.begin) * progress.t
        losses.add(_step(field, sampler.draw(), optimizer, t, training), steps)
        before, steps = progress.t, steps + 1
        if mean:
            mean.add()
        progress.step()
        run.progress(round(1000 * progress.t), 1000)
        if best and _passed(before, progress.t, training.checkpoints):
            losses.read()
            best.look()
        if progress.t < 1 and _passed(before, progress.t, training.traces):
            if mean:
                mean.swap()
            offer()
            if mean:
                mean.swap()
    losses.read()
    if best:
        best.restore()
    if mean:
        mean.swap()
    return Fit(steps, best is None or best.loss < at_first)


def _passed(before: float, now: float, marks: int) -> bool:
    return math.floor(before * marks) < math.floor(now * marks)


def _step(field: Field, batch: Batch, optimizer: torch.optim.Optimizer, t: float, training: Training) -> Tensor:
    """One step of the optimizer; the loss before it."""
    for group, factor in zip(optimizer.param_groups, field.rates(t), strict=True):
        group["lr"] = training.learning_rate * factor
        for parameter in group["params"]:
            parameter.requires_grad_(factor > 0)
    optimizer.zero_grad(set_to_none=True)
    loss = torch.zeros((), device=batch.x.device)
    for chunk in batch.chunks(training.chunk):
        part = field.loss(chunk, t)
        if part.requires_grad:
            part.backward()
        loss = loss + part.detach()
    if training.clip > 0:
        torch.nn.utils.clip_grad_norm_(field.parameters(), training.clip)
    optimizer.step()
    return loss


class _Best:
    """The best state so far."""

    def __init__(self, field: Field, batch: Batch, chunk: int):
        self._field, self._batch, self._chunk = field, batch, chunk
        self.loss = math.inf
        self._state: dict[str, Tensor] | None = None

    def look(self) -> None:
        """Keep the current state if it is better."""
        with torch.no_grad():
            loss = float(sum(self._field.loss(part, 1.0) for part in self._batch.chunks(self._chunk)))
        if loss < self.loss:
            self.loss, now = loss, self._field.state_dict()
            if self._state is None:
                self._state = {name: torch.empty_like(tensor) for name, tensor in now.items()}
            for name, tensor in now.items():
                self._state[name].copy_(tensor)

    def restore(self) -> None:
        """Back to the best state."""
        if self._state is not None:
            self._field.load_state_dict(self._state)
        for parameter in self._field.parameters():
            parameter.requires_grad_(True)


class _Mean:
    """The mean of the last states; the weight of earlier ones decays."""

    def __init__(self, field: Field):
        self._field, self._states = field, 0
        self._mean = [parameter.detach().clone() for parameter in field.parameters()]

    @torch.no_grad()
    def add(self) -> None:
        """Add the current state."""
        self._states += 1
        share = 1 / min(MEAN, 1 + self._states / 3)
        torch._foreach_lerp_(self._mean, list(self._field.parameters()), share)

    @torch.no_grad()
    def swap(self) -> None:
        """Exchange the field and the mean; a second call undoes this."""
        for mean, parameter in zip(self._mean, self._field.parameters(), strict=True):
            now = parameter.clone()
            parameter.copy_(mean)
            mean.copy_(now)
