"""The order in which images are used."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np


def views_in_turn(total: int, views: int, times: int, rng: np.random.Generator) -> Iterator[np.ndarray]:
    """``times`` choices of ``views`` of ``total`` images (of all, if there are fewer): all in turn, in random order."""
    order: list[int] = []
    count = min(views, total)
    for _ in range(times):
        while len(order) < count:
            order += rng.permutation(total).tolist()
        yield np.array(order[:count])
        order = order[count:]
