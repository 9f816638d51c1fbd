"""From a patch to the output of a level, through the levels before it."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from .bilateral import NEIGHBOURS, Nearby
from .neighbours import gather, nearest
from .unit import Units


def run_levels(
    network: Units,
    points: Tensor,
    truths: list[Tensor],
    levels: int,
    rng: np.random.Generator | None = None,
    first_trained: int = 0,
    apart: bool = False,
    recut: bool = True,
) -> tuple[Tensor, Tensor]:
    """The output of the last level for a patch, and its truth (Wang et al. 2019, section 3.1).

    Each level after the first takes as many points as the first had, those nearest a random one of the output so far,
    and half of the truth, the part nearest the same point. So the last output always has as many points as its truth.
    Gradients flow through all levels from ``first_trained`` on.

    Parameters
    ----------
    network : Units
    points : (3, b, n) tensor
        Normalised patches.
    truths : list of (3, b, n * 2**level) tensors
        In the frame of ``points``: of the last level; with ``apart``, of each level from the first to the last.
    levels : int
    rng : numpy Generator, optional
        Draws the seeds; without ``recut`` there are none.
    first_trained : int
        The levels before this one have no gradient.
    apart : bool
        Give each level the truth of the level before instead of its output.
    recut : bool
        Without it each level takes the whole output so far.

    Returns
    -------
    output, truth : (3, b, 2 n) tensors
        In the frame of ``points``; without ``recut``, of n * 2**levels points.
    """
    size = points.shape[2]
    current, before, output = points, None, points
    for level in range(levels):
        with torch.set_grad_enabled(torch.is_grad_enabled() and level >= first_trained):
            if level and not recut:
                current = output
            elif level:
                assert rng is not None  # needed to recut
                chosen = torch.from_numpy(rng.integers(output.shape[2], size=(points.shape[1], 1, 1)))
                seed = gather(output, chosen.to(output.device))[:, :, 0].detach()
                current = _around(seed, output, size)
                truths = [_around(seed, truth, truth.shape[2] // 2) for truth in truths]
            centre = current.mean(2, keepdim=True) if level else current.new_zeros(())
            radius = (current - centre).square().sum(0).amax(1).clamp_min(1e-12).sqrt()[:, None] if level else 1.0
            nearby = None
            if before is not None and network[level].skip:
                inputs, features = before
                index = nearest(current, inputs, NEIGHBOURS)
                squared = (gather(inputs, index) - current[:, :, None]).square().sum(0).detach()
                nearby = Nearby(squared, gather(features, index))
            dense, features = network[level]((current - centre) / radius, nearby)
            before = current, features
            output = dense * radius + centre
            if apart and level < levels - 1:
                output = truths[0]
                truths = truths[1:]
    return output, truths[-1] if truths else output


def _around(seed: Tensor, points: Tensor, count: int) -> Tensor:
    """The ``count`` points of (3, b, n) nearest a seed (3, b, 1) each: (3, b, count)."""
    return gather(points, nearest(seed, points, count).transpose(1, 2))[:, :, 0]
