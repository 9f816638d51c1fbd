"""Losses that are read back seldom, as on a GPU: none that is not finite goes unseen."""

from __future__ import annotations

import math

import pytest
import torch

from bench.methods.learned.training.losses import Losses


class Diverged(Exception):
    """With the loss and the step."""


def read(values, every, device="cpu"):
    losses = Losses(device, Diverged, every)
    for step, value in enumerate(values):
        losses.add(torch.tensor(value, requires_grad=True), step)
    return losses


@pytest.mark.parametrize("every", [1, 3, 100])
def test_the_last_loss_of_all_is_told(every):
    losses = read([4.0, 3.0, 2.0, 1.0], every)
    assert losses.read() == losses.read() == 1.0
    assert math.isnan(Losses("cpu", Diverged).read())


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_the_first_that_is_not_finite_is_named_at_the_next_reading(bad):
    values = [1.0, 1.0, bad, math.nan, 1.0]
    with pytest.raises(Diverged) as error:
        read(values, every=5)
    assert str(error.value) == str(Diverged(bad, 2))
    late = read(values, every=6)
    with pytest.raises(Diverged):
        late.read()
    assert read(values[:2], every=6).read() == 1.0


def test_on_the_cpu_each_is_read_at_once_and_elsewhere_twenty_together():
    with pytest.raises(Diverged):
        read([math.nan], every=None)
    elsewhere = read([1.0, math.nan] + 17 * [1.0], every=None, device="cuda")
    with pytest.raises(Diverged):
        elsewhere.add(torch.tensor(1.0), 19)
