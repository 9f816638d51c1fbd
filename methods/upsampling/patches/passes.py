"""A network of a fixed ratio, applied patch by patch as often as a ratio requires."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from bench import Run

from .cut import Cutting, cut
from .whole import in_patches

TOGETHER = 1 << 13  # points of the patches in one call of the network


def in_passes(
    points: np.ndarray,
    ratio: int,
    times: int,
    size: int,
    overlap: float,
    network: Callable[[Tensor], Tensor],
    run: Run,
    central: int = 0,
    used: Callable[[int], int] = lambda n: n,
    cutting: Cutting = cut,
) -> np.ndarray:
    """Upsample a cloud by ``ratio``, with a network that returns ``times`` as many points.

    Passes are repeated until there are enough points; in between, and at the end, a cloud with more than the
    exact count is thinned by farthest points.

    Parameters
    ----------
    points : (m, 3) array
    ratio : int, >= 1
    times : int, >= 2
    size : int
        Points of a patch.
    overlap : float
        Patches that a point is in, on average.
    network : function
        (3, b, n) float32 tensor of normalised patches, nearest the seed first, to (3, b, times * u).
    run : Run
    central : int
        The number of patches whose copies of a point count; 0 for all. See :func:`.whole.in_patches`.
    used : function
        Gives the number u of points of a patch of n that are upsampled, those nearest the seed.
    cutting : function
        Cuts the patches.

    Returns
    -------
    (ratio * m, 3) float64 array
    """
    m, grown = len(points), 1
    while True:
        last = grown * times >= ratio
        count = m * (ratio if last else grown * times)

        def upsample(patches: np.ndarray) -> np.ndarray:
            return _applied(network, patches, run.device)

        part = used(min(size, len(points)))
        points = in_patches(points, size, overlap, upsample, count, central, part, cutting)
        grown *= times
        run.progress(min(grown, ratio), ratio)
        if last:
            return points


@torch.no_grad()
def _applied(network: Callable[[Tensor], Tensor], patches: np.ndarray, device: str) -> np.ndarray:
    given = torch.from_numpy(patches.transpose(2, 0, 1).astype(np.float32)).to(device)
    parts = given.split(max(1, TOGETHER // patches.shape[1]), dim=1)
    return torch.cat([network(part.contiguous()) for part in parts], dim=1).permute(1, 2, 0).double().cpu().numpy()
