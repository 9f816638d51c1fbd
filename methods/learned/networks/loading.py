"""A network with the weights of a run."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import torch
from torch import nn

from bench import Run

N = TypeVar("N", bound=nn.Module)


def loaded(network: N, run: Run) -> N:
    """The network with the run's weights, on its device; reports the number of parameters to the run."""
    run.parameters = sum(parameter.numel() for parameter in network.parameters())
    assert run.weights is not None  # a method that learns from examples always has them
    network.load_state_dict({name: torch.from_numpy(np.array(array)) for name, array in run.weights.items()})
    return network.to(run.device).eval().requires_grad_(False)
