"""Runs for tests of trainings: one that keeps its log, and one that is killed and goes on."""

from __future__ import annotations

from bench import Run


class Logged(Run):
    """A run that keeps its log."""

    def log(self, step, **numbers):
        self.lines = [*getattr(self, "lines", []), (step, numbers)]

    def losses(self):
        return [numbers["loss"] for _, numbers in self.lines if "loss" in numbers]


class Killed(Exception):
    """Somebody stopped the training."""


class Dying(Logged):
    """A run that stores each checkpoint, and is killed at one of them."""

    def __init__(self, at: int, **more):
        super().__init__(**more)
        self.at, self.stored, self.count = at, None, 0

    def checkpoint(self, make):
        self.stored, self.count = make(), self.count + 1
        if self.count == self.at:
            raise Killed


def killed_and_resumed(method, examples, at: int):
    """The weights of a training that was killed after ``at`` steps and went on."""
    run = Dying(at, seed=3)
    try:
        method.fit(examples, run)
    except Killed:
        again = Logged(seed=3)
        again.resumed = run.stored
        return method.fit(examples, again)
    raise AssertionError("the training ended before it was killed")
