"""Losses that are read back rarely, as on a GPU: every loss that is not finite is detected."""

from __future__ import annotations

import math

import pytest
import torch

from bench.methods.learned.training.losses import Losses


class Diverged(Exception):
    """The error with the loss and the step."""


def read(values, every, device="cpu"):
    losses = Losses(device, Diverged, every)
    for step, value in enumerate(values):
        losses.add(torch.tensor(value, requires_grad=True), step)
    return losses


@pytest.mark.parametrize("every", [1, 3, 100])
def test_the_last_loss_is_returned(every):
    losses = read([4.0, 3.0, 2.0, 1.0], every)
    assert losses.read() == losses.read() == 1.0
    assert math.isnan(Losses("cpu", Diverged).read())


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_the_first_loss_that_is_not_finite_is_reported_at_the_next_reading(bad):
    values = [1.0, 1.0, bad, math.nan, 1.0]
    with pytest.raises(Diverged) as error:
        read(values, every=5)
    assert str(error.value) == str(Diverged(bad, 2))
    late = read(values, every=6)
    with pytest.raises(Diverged):
        late.read()
    assert read(values[:2], every=6).read() == 1.0


def test_losses_are_read_at_once_on_the_cpu_and_in_twenties_elsewhere():
    with pytest.raises(Diverged):
        read([math.nan], every=None)
    elsewhere = read([1.0, math.nan] + 17 * [1.0], every=None, device="cuda")
    with pytest.raises(Diverged):
        elsewhere.add(torch.tensor(1.0), 19)
