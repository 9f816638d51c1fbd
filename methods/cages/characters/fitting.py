"""The cage of a template fitted to another character, by landmarks (Eq. 5.7 and 5.8)."""

from __future__ import annotations

import numpy as np
import torch

from bench import Run

from ..coordinates.mean_value import mean_value_coordinates

BETAS = (0.5, 0.9)  # of Adam, as released
STEPS = 600  # released: 3,000 to 8,000
RATE = 2e-3  # of Adam, in halves of the template's longest edge
LAPLACIAN = 0.05  # weight of Eq. 5.8 (released: 0.05 and 0.1)
ENOUGH = 1e-9  # the loss at which the fit ends


def fitted(
    cage: np.ndarray,
    faces: np.ndarray,
    there: np.ndarray,
    here: np.ndarray,
    run: Run,
    *,
    steps: int,
    learning_rate: float,
    laplacian: float,
) -> np.ndarray:
    """The cage (n, 3) in which landmarks ``here`` (l, 3) have the coordinates of ``there`` (l, 3) in ``cage``.

    Minimises the mean squared difference of the coordinates, and ``laplacian`` times that of the lengths of the cage's
    cotangent Laplacian, whose weights are those of the cage before. The rate halves after each two fifths of the steps.
    """
    from bench.geometry.laplacian import cotangent_laplacian

    start = torch.from_numpy(cage)
    wanted = mean_value_coordinates(torch.from_numpy(there)[None], start[None], faces, run.threads)
    operator = torch.from_numpy(cotangent_laplacian(cage, faces).toarray())  # dense: a cage is small
    smooth = (operator @ start).norm(dim=1)
    moved = start.clone().requires_grad_(True)
    optimizer = torch.optim.Adam([moved], learning_rate, betas=BETAS)
    places = torch.from_numpy(here)[None]
    best, least = cage, np.inf
    for step in range(steps):
        if not run.time_for_more():
            break
        for group in optimizer.param_groups:
            group["lr"] = learning_rate * 0.5 ** (step // max(1, int(0.4 * steps)))
        optimizer.zero_grad()
        weights = mean_value_coordinates(places, moved[None], faces, run.threads)
        loss = (weights - wanted).square().mean()
        loss = loss + laplacian * ((operator @ moved).norm(dim=1) - smooth).square().mean()
        if loss.item() < least:
            best, least = moved.detach().numpy().copy(), loss.item()
        if least < ENOUGH:
            break
        loss.backward()
        optimizer.step()
    return best
