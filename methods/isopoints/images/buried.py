"""Sheets of the zero level within the shape, which are not visible in any image."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from ..sampling.sheets import sheets_of
from .scene import Scene
from .visibility import Visible

MOST_SEEN = 0.02  # of a sheet's points may appear visible, through the gaps between discs
FRONTAL = 0.5  # cosine of ray and normal above which visibility counts: depths of slanted discs are inaccurate


@torch.no_grad()
def buried(scene: Scene, points: Tensor, normals: Tensor, seen: Visible) -> Tensor:
    """Whether points (n, 3) belong to a sheet that no view sees, although all masks contain it: (n,) bool.

    Images do not constrain a void within the shape, so it may grow; closing it does not change what they show. A sheet
    outside of a mask, or outside of all images, is not changed.

    Parameters
    ----------
    points, normals : (n, 3) tensors
        Evenly spaced; unit normals outwards.
    seen : Visible
        The points that the views of the scene see.
    """
    shown = torch.zeros(len(points), dtype=torch.bool, device=points.device)
    held = torch.ones_like(shown)
    for number in range(len(scene)):
        view = torch.full_like(shown, number, dtype=torch.long)
        place, _ = scene.project(view, points)
        rows = torch.nonzero(scene.shown(place))[:, 0]
        shown[rows] = True
        held[rows] &= scene.inside(view[rows], place[rows])
    sheet = sheets_of(points)
    visible = torch.zeros_like(shown)
    towards = F.normalize(scene.centers[seen.row] - points[seen.point], dim=1)
    visible[seen.point[(towards * normals[seen.point]).sum(1) > FRONTAL]] = True
    count = torch.bincount(sheet)
    doubt = torch.bincount(sheet[visible | ~shown | ~held], minlength=len(count))
    return (doubt <= MOST_SEEN * count)[sheet]
