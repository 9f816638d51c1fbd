"""The ball that holds a shape, from its masks and cameras."""

from __future__ import annotations

import numpy as np

from ...errors import BadInput
from ...geometry.cloud import Frame
from ...notices import notice
from ..views import Views
from .carving import carve, is_cut

MARGIN = 1.05  # of the ball around what is carved
COARSE, FINE = 32, 64  # cells along each side of the grid, until the ball no longer changes, and in the last round
ROUNDS = 8  # of carving at most; two or three are usual
WRONG_AXES = (
    "cameras and masks disagree. The usual reason is another convention of axes: transforms.json has camera-to-world "
    "matrices with x right, y up, z backward (OpenGL), world_mat and COLMAP have world-to-camera ones with x right, "
    "y down, z forward (OpenCV). Masks in another order than the images, or black on the shape, look the same"
)


def bounding_ball(views: Views, source: str) -> Frame:
    """A ball that holds the shape, about 5 % larger than need be.

    Its centre is at first the point nearest to all rays through the middles of the masks, its radius the largest
    distance of a pixel of a mask from that centre, both at the same depth: a high quantile over the views whose masks
    end before the border of the image. A coarse grid in a larger cube is then carved by all masks, the ball is put
    around what is left, and both are done again until the ball no longer changes much.

    Parameters
    ----------
    views : Views
        In any coordinates.
    source : str
        The file of the cameras, for messages.

    Raises
    ------
    BadInput
        If the rays do not meet in front of the cameras, or nothing lies in all masks.
    """
    _check_masks(views, source)
    border = sum(map(is_cut, views.masks))
    if 2 * border > len(views):
        notice(
            f"{source}: {border} of {len(views)} masks touch the border of their images, so the ball that holds the "
            "shape is a guess; what lies outside it may be missing"
        )
    center = _center(views, source)
    frame = Frame(_place(center), 1.25 * _radius(views, center))
    for _ in range(ROUNDS):
        before = frame
        frame, cut = _around(carve(views, before, COARSE), before, COARSE, source)
        if not cut and frame.radius > 0.8 * before.radius:
            break
    ball, _ = _around(carve(views, frame, FINE), frame, FINE, source)
    return Frame(ball.center, MARGIN * ball.radius)


def _place(point: np.ndarray) -> tuple[float, float, float]:
    x, y, z = map(float, point)
    return x, y, z


def _around(carved: tuple[np.ndarray, bool], before: Frame, cells: int, source: str) -> tuple[Frame, bool]:
    """The ball around the part of a ball that is left; enlarged by half if the shape may continue outside."""
    points, cut = carved
    if not len(points):
        raise BadInput(f"{source}: no point lies in all masks: {WRONG_AXES}")
    if len(points) == 1:
        return Frame(_place(points[0]), 2 * before.radius / cells), cut
    ball = Frame.of(points)
    return Frame(ball.center, ball.radius * (1.5 if cut else 1.0)), cut


def check_ball(views: Views, frame: Frame, source: str) -> None:
    """Raise :class:`BadInput` unless something in a given ball lies in all masks."""
    _check_masks(views, source)
    if not len(carve(views, frame, COARSE)[0]):
        raise BadInput(
            f"{source}: no point of the ball around {np.round(frame.center, 4).tolist()} with the radius "
            f"{frame.radius:.4g}, where it says that the shape is, lies in all masks: {WRONG_AXES}"
        )


def _check_masks(views: Views, source: str) -> None:
    if len(views) < 2:
        raise BadInput(f"{source}: expected at least two images whose masks show the shape, got {len(views)}")
    corners = views.masks[:, [0, 0, -1, -1], [0, -1, 0, -1]].all(axis=1)
    if corners.mean() > 0.9:
        raise BadInput(
            f"{source}: {corners.sum()} of {len(views)} masks cover all four corners of their images; expected white "
            "on the shape and black around it. Are the masks inverted?"
        )


def _center(views: Views, source: str) -> np.ndarray:
    """The point (3,) nearest to the rays through the middles of the masks; rays far from it have less weight."""
    middles = np.array([np.argwhere(mask).mean(axis=0)[::-1] + 0.5 for mask in views.masks])
    ahead = np.array([views.unproject(view, middles[view], np.asarray(1.0)) for view in range(len(views))])
    directions = ahead - views.centers
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]  # projects onto the plane across a ray
    weights, center = np.ones(len(views)), np.zeros(3)
    for _ in range(10):
        matrix = np.einsum("v,vij->ij", weights, across)
        if np.linalg.eigvalsh(matrix)[0] < 1e-4 * weights.sum():
            raise BadInput(f"{source}: all cameras look in one direction; expected views from several sides")
        center = np.linalg.solve(matrix, np.einsum("v,vij,vj->i", weights, across, views.centers))
        missed = np.linalg.norm(np.einsum("vij,vj->vi", across, center - views.centers), axis=1)
        weights = 1 / np.maximum(missed, max(float(np.median(missed)), 1e-12))
    behind = int((views.project(center[None])[1] <= 0).sum())
    if 2 * behind > len(views):
        raise BadInput(f"{source}: the shape is behind {behind} of {len(views)} cameras: {WRONG_AXES}")
    return center


def _radius(views: Views, center: np.ndarray) -> float:
    """A high quantile over the views of the largest distance of a mask's pixel from the centre, at its depth."""
    depth = views.project(center[None])[1][:, 0]
    whole = [view for view in range(len(views)) if depth[view] > 0 and not is_cut(views.masks[view])]
    seen = whole if len(whole) >= 3 else [view for view in range(len(views)) if depth[view] > 0]
    return float(np.quantile([_reach(views, view, center, depth[view]) for view in seen], 0.9))


def _reach(views: Views, view: int, center: np.ndarray, depth: float) -> float:
    pixels = np.argwhere(views.masks[view])[:, ::-1] + 0.5
    points = views.unproject(view, pixels, np.full(len(pixels), depth))
    return float(np.linalg.norm(points - center, axis=1).max())
