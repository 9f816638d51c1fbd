"""The fixed workload that times of two machines are divided by: the same in every version, and seldom disturbed."""

import itertools
from types import SimpleNamespace

import pytest

from bench.engine import yardstick


def test_the_workload_is_the_same_in_every_version():
    """Else the stored times of one version would not compare with those of the next."""
    assert yardstick._work(yardstick._points()) == pytest.approx(15354.921983, rel=1e-8)


def test_the_speed_of_the_machine_is_the_time_of_a_turn_that_was_not_interrupted(monkeypatch):
    clock, turns = [100.0], itertools.cycle([0.9, 0.002, 0.003, 0.004, 0.001])
    monkeypatch.setattr(yardstick, "time", SimpleNamespace(thread_time=lambda: clock[0]))
    monkeypatch.setattr(yardstick, "_work", lambda points: clock.append(clock.pop() + next(turns)))
    assert 0.001 <= yardstick.reference_seconds() < 0.005
