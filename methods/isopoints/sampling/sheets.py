"""The parts of a surface that hang together, told from points on it."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from .neighbours import nearest

NEIGHBOURS = 8  # of a point, that may be of its sheet
GAP = 4.0  # neighbours farther than this many median spacings are not


def sheets_of(points: Tensor) -> Tensor:
    """The sheet of each of the evenly spaced points (n, 3), a number from 0: connected parts of the near neighbours."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    if len(points) < 2:
        return torch.zeros(len(points), dtype=torch.long, device=points.device)
    near = nearest(points, NEIGHBOURS)
    distances = near.distances.cpu().numpy()
    linked = distances <= GAP * np.median(distances[:, 0])
    rows = np.broadcast_to(np.arange(len(points))[:, None], linked.shape)[linked]
    columns = near.rows.cpu().numpy()[linked]
    graph = coo_array((np.ones(len(rows), dtype=bool), (rows, columns)), shape=(len(points),) * 2)
    return torch.from_numpy(connected_components(graph, directed=False)[1]).long().to(points.device)
