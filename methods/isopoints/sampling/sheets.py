"""The connected components of a surface, found from points on it."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from .neighbours import nearest

NEIGHBOURS = 8  # of a point, that may belong to its sheet
GAP = 4.0  # neighbours farther than this many median spacings do not


def sheets_of(points: Tensor) -> Tensor:
    """The sheet of each of the evenly spaced points (n, 3), a number from 0: connected parts of the near neighbours."""
    if len(points) < 2:
        return torch.zeros(len(points), dtype=torch.long, device=points.device)
    near = nearest(points, NEIGHBOURS)
    return connected(near.rows, near.distances <= GAP * near.distances[:, 0].median())


def connected(near: Tensor, linked: Tensor) -> Tensor:
    """The component of each of n points, a number from 0, from their neighbours (n, k) and which of them are linked."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    rows, columns = torch.nonzero(linked)[:, 0].cpu().numpy(), near[linked].cpu().numpy()
    graph = coo_array((np.ones(len(rows), dtype=bool), (rows, columns)), shape=(len(near),) * 2)
    return torch.from_numpy(connected_components(graph, directed=False)[1]).long().to(near.device)
