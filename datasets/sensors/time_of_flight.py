"""A time-of-flight camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import register

from .checks import expect, expect_count, expect_length
from .scanning import Scan, Scanner, survives_grazing
from .scene import Scene, View, focal_length, see
from .views import Pose


@register("sensor", requires=("open3d",), cite="BlenSor: Gschwandtner et al. 2011")
@dataclass(frozen=True)
class TimeOfFlight(Scanner):
    """A time-of-flight camera: noise along the ray, and flying pixels at depth edges.

    Where a pixel's range differs from that of one of its four neighbours by more than ``edge``, the pixel may see both
    surfaces: with probability ``flying`` its range becomes ``a r + (1 - a) r'``, a uniform in 0..1 and r' the range
    of the neighbour that differs most. All ranges then get Gaussian noise (BlenSor's is 4 mm). Pixels at grazing angles
    are lost: all below the cosine 0.05, none above 0.2. Multipath interference is not modelled.
    """

    resolution: int = 64  # pixels along each side of the image, which the bounding sphere fills
    noise: float = 0.005  # standard deviation along the ray, relative to the bounding-sphere radius
    flying: float = 0.5  # probability that a pixel at a depth edge is a flying pixel
    edge: float = 0.05  # least difference of two ranges at a depth edge, relative to the bounding-sphere radius

    def __post_init__(self) -> None:
        super().__post_init__()
        expect_count("resolution", self.resolution, least=2)
        expect_length("noise", self.noise)
        expect(0 <= self.flying <= 1, "flying", "0 to 1", self.flying)
        expect_length("edge", self.edge)

    def measure(self, scene: Scene, pose: Pose, rng: np.random.Generator) -> Scan:
        """The pixels that have a range."""
        view = see(scene, pose, focal_length(scene, self.distance, self.resolution), self.resolution)
        rays = view.points - pose.center
        distance = np.linalg.norm(rays, axis=1)
        other = _opposite(view, distance)
        flies = (np.abs(other - distance) > self.edge * scene.radius) & (rng.random(len(distance)) < self.flying)
        share = np.where(flies, rng.random(len(distance)), 1.0)
        measured = share * distance + (1 - share) * other
        measured = measured + self.noise * scene.radius * rng.normal(size=len(distance))
        kept = survives_grazing(view.cosine, 0.05, 0.2, rng)
        points = pose.center + rays * (measured / distance)[:, None]
        return Scan.of(pose, points[kept], view.points[kept], view.faces[kept])


def _opposite(view: View, distance: np.ndarray) -> np.ndarray:
    """For each pixel, the range of the one of its four neighbours that differs most, else its own: an (n,) array."""
    width = view.width
    image = np.full((width + 2, width + 2), np.nan)  # with an empty border
    row, column = np.divmod(view.index, width)
    image[row + 1, column + 1] = distance
    other = distance.copy()
    for down, right in ((0, 1), (1, 0), (0, -1), (-1, 0)):
        neighbour = image[row + 1 + down, column + 1 + right]
        farther = np.abs(neighbour - distance) > np.abs(other - distance)  # never where it is NaN
        other[farther] = neighbour[farther]
    return other
