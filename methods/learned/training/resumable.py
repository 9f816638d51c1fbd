"""The training loop of networks that learn from examples; it can be killed at any moment, and resumes exactly.

The random draws of a step depend only on the seed and the number of the step (:func:`step_generator`), so a checkpoint
holds the network, the optimiser, the best state and a number; on the CPU, an interrupted training ends with the same
weights, to the bit, as an uninterrupted one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
import torch
from torch import Tensor, nn

from bench import Run, UsageError

from .losses import Losses

NETWORK, OPTIMIZER, BEST = "network.", "optimizer.", "best."


def step_generator(seed: int, step: int, purpose: str = "") -> np.random.Generator:
    """The random generator of one step, the same however often the training was interrupted before."""
    return np.random.default_rng([seed, step, *purpose.encode()])


def progress(run: Run, step: int, steps: int) -> float:
    """The progress of a training before a step, from 0 to 1, for schedules.

    Measured by steps; by the clock if their number is open (``steps=0``) or the time is too short for them:
    a schedule always runs to its end. The clock includes the seconds before an interruption.
    """
    by_clock = min((run.spent + run.elapsed()) / max(run.spent + run.seconds, 1e-9), 1.0)
    by_steps = step / steps if steps else 0.0
    return by_clock if not steps or by_clock > by_steps + LATE else by_steps


LATE = 0.05  # of a training: steps that lag behind the clock by more will not finish in time


def train(
    network: nn.Module,
    loss: Callable[[int], Tensor],
    run: Run,
    *,
    steps: int,
    optimizer: torch.optim.Optimizer,
    prepare: Callable[[int], None] | None = None,
    validate: Callable[[], float] | None = None,
    every: int = 200,
    clip_value: float | None = None,
) -> dict[str, np.ndarray]:
    """Train until ``steps`` are done or the run's time is over; the weights with the best validation.

    Parameters
    ----------
    network : Module
        Its state is trained, stored and returned; the network ends in the returned state.
    loss : function of the number of a step, from 0
        A scalar tensor. All its random draws come from generators made from ``run.seed`` and that number.
    run : Run
        Gives the time left, and stores logs and checkpoints.
    steps : int
        At most; 0 for as many as the time allows. The weights of such a training, and of one whose time ends before
        its steps are done, are not reproducible to the bit.
    optimizer : Optimizer
        Over parameters of ``network``; Adam, whose state is created at the first step.
    prepare : function of the number of a step, optional
        Called before it: sets learning rates, and freezes parts of the network.
    validate : function, optional
        A number, lower is better, the same for the same state. Without it the last state is returned.
    every : int
        Steps between validations; one more takes place at the end.
    clip_value : float, optional
        Gradients are clipped to this size, entry by entry.

    Returns
    -------
    dict
        The state of the network as arrays on the CPU, by name.

    Raises
    ------
    UsageError
        If the loss is not finite, naming the step: a smaller learning rate helps. See :class:`.losses.Losses`
        for when it is raised.
    """
    state = _State(network, optimizer)
    losses = Losses(run.device, _diverged)

    def arrays(step: int) -> dict[str, np.ndarray]:
        losses.read()
        return state.arrays(step)

    step = state.resume(run.resumed) if run.resumed else 0
    while (step < steps or not steps) and (run.seconds_left() > 0 or step == 0):
        if validate and step % every == 0 and step > 0:
            losses.read()
            state.offer(validate(), step, run)
        if prepare:
            prepare(step)
        optimizer.zero_grad(set_to_none=True)
        value = loss(step)
        losses.add(value, step)
        value.backward()
        if clip_value is not None:
            nn.utils.clip_grad_value_([p for p in network.parameters() if p.grad is not None], clip_value)
        optimizer.step()
        if step % LOGGED == 0:
            run.log(step, loss=losses.read())
        step += 1
        # By the clock, the number of steps to come is estimated from those done.
        run.progress(step, steps or max(step, round(step / max(progress(run, step, steps), 1e-9))))
        run.checkpoint(partial(arrays, step))
    losses.read()
    if validate:
        state.offer(validate(), step, run)
    run.log(step, done=1)
    return state.best()


def _diverged(loss: float, step: int) -> UsageError:
    return UsageError(f"the training diverged: the loss is {loss} at step {step:,}; try a smaller learning rate")


LOGGED = 20  # steps between two lines of the log


class _State:
    """Network, optimiser, and the best state so far, as arrays and back."""

    def __init__(self, network: nn.Module, optimizer: torch.optim.Optimizer):
        self.network, self.optimizer = network, optimizer
        self.score = math.inf
        self._best: dict[str, Tensor] | None = None

    def offer(self, score: float, step: int, run: Run) -> None:
        """Keep the current state if it is the best."""
        run.log(step, validation=score)
        if score < self.score or self._best is None:
            self.score = score
            self._best = {name: tensor.detach().clone() for name, tensor in self.network.state_dict().items()}

    def best(self) -> dict[str, np.ndarray]:
        """The best state, and the network in it."""
        if self._best is not None:
            self.network.load_state_dict(self._best)
        return {name: _array(tensor) for name, tensor in self.network.state_dict().items()}

    def arrays(self, step: int) -> dict[str, np.ndarray]:
        """Everything that the steps from ``step`` on depend on."""
        arrays: dict[str, np.ndarray | np.generic] = {"step": np.int64(step), "score": np.float64(self.score)}
        arrays |= {NETWORK + name: _array(tensor) for name, tensor in self.network.state_dict().items()}
        arrays |= {BEST + name: _array(tensor) for name, tensor in (self._best or {}).items()}
        for number, state in self.optimizer.state_dict()["state"].items():
            arrays |= {f"{OPTIMIZER}{number}.{key}": _array(torch.as_tensor(value)) for key, value in state.items()}
        return {name: np.asarray(array) for name, array in arrays.items()}

    def resume(self, arrays: Mapping[str, np.ndarray]) -> int:
        """Restore a checkpoint; returns the next step."""
        device = next(self.network.parameters()).device
        self.network.load_state_dict(_tensors(arrays, NETWORK, device))
        self._best = _tensors(arrays, BEST, device) or None
        self.score = float(arrays["score"])
        state: dict[int, dict[str, Tensor]] = {}
        for name, tensor in _tensors(arrays, OPTIMIZER, torch.device("cpu")).items():
            number, _, key = name.partition(".")
            state.setdefault(int(number), {})[key] = tensor
        # The groups (rates, betas) are those of this run's optimiser: prepare() sets their variable parts.
        self.optimizer.load_state_dict({**self.optimizer.state_dict(), "state": state})
        return int(arrays["step"])


def _array(tensor: Tensor) -> np.ndarray:
    return tensor.detach().cpu().numpy().copy()


def _tensors(arrays: Mapping[str, np.ndarray], prefix: str, device: torch.device) -> dict[str, Tensor]:
    found = {name[len(prefix) :]: array for name, array in arrays.items() if name.startswith(prefix)}
    return {name: torch.from_numpy(np.array(array)).to(device) for name, array in found.items()}
