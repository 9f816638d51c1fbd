"""A coarse visual hull (Laurentini 1994): the points of a grid that lie in all masks."""

from __future__ import annotations

import numpy as np

from ...geometry.cloud import Frame
from ..views import Views

WRONG = 0.05  # share of the views that may have a hole in a mask where the shape is
KNOWN = 0.5  # share of the views that must see a point, or exclude it


def carve(views: Views, frame: Frame, cells: int) -> tuple[np.ndarray, bool]:
    """The middles of the cells of a cube around a ball that lie in all masks, but for one view in twenty.

    A cell lies in a mask if a pixel of the mask is within half its diagonal, so that thin parts stay. Where a mask ends
    before the border of its image, a cell that the view does not see is outside; where it is cut at the border, the
    view does not decide about such a cell. Cells decided by fewer than half of the views are left out.

    Parameters
    ----------
    views : Views
    frame : Frame
        The ball, in the same coordinates; the cube is as wide as the ball, and a tenth more.
    cells : int
        Along each side of the cube.

    Returns
    -------
    points : (n, 3) array
    cut : bool
        Whether they reach the sides of the cube, so that there may be more outside.
    """
    from scipy.ndimage import distance_transform_edt

    line = ((np.arange(cells) + 0.5) / cells * 2 - 1) * 1.1 * frame.radius
    x, y, z = (line + center for center in frame.center)
    half = np.sqrt(3) * 1.1 * frame.radius / cells  # half the diagonal of a cell
    known, missed = np.zeros((2, cells, cells, cells), dtype=np.int32)
    for extrinsics, intrinsics, mask in zip(views.extrinsics, views.intrinsics, views.masks, strict=True):
        across, down, depth = (
            (a * x)[:, None, None] + (b * y)[:, None] + (c * z + d) for a, b, c, d in intrinsics @ extrinsics
        )
        ahead = depth > 0
        scale = 1 / np.where(ahead, depth, 1)
        columns, rows = across * scale, down * scale
        seen = ahead & (columns >= 0) & (columns < views.width) & (rows >= 0) & (rows < views.height)
        distance = distance_transform_edt(~mask)
        reach = intrinsics[[0, 1], [0, 1]].max() * half * scale[seen] + 0.5
        outside = np.full(seen.shape, not is_cut(mask))
        outside[seen] = distance[rows[seen].astype(int), columns[seen].astype(int)] > reach
        known += seen | outside
        missed += outside
    i, j, k = np.nonzero((missed <= WRONG * len(views)) & (known >= max(2, KNOWN * len(views))))
    cut = any(((along == 0) | (along == cells - 1)).any() for along in (i, j, k))
    return np.column_stack([x[i], y[j], z[k]]), bool(cut)


def is_cut(mask: np.ndarray) -> bool:
    """Whether a mask (h, w) touches the border of its image."""
    return any(bool(side.any()) for side in (mask[0], mask[-1], mask[:, 0], mask[:, -1]))
