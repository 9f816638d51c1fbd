"""A laser triangulation scanner."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench import register

from .checks import expect, expect_count, expect_length, expect_positive
from .scanning import Scan, Scanner
from .scene import Scene, focal_length, see
from .views import Pose

WINDOW = 2  # number of pixels that are read on either side of a stripe
BRIGHTEST = 255  # the camera has 8 bits
DARKEST = 1e-3  # replaces the intensity 0 in a logarithm: a quarter of a step


@register("sensor", requires=("open3d",), cite="Berger et al. 2013")
@dataclass(frozen=True)
class Triangulation(Scanner):
    """A laser stripe and a camera beside it: shadows, grazing drop-out and depth noise that grows with both.

    After Berger et al. 2013, "A benchmark for surface reconstruction", per pixel instead of by rendering
    each stripe:

    - a pixel is lost where the laser, ``baseline`` to the camera's right, does not reach its point;
    - the stripe's image has the profile ``cos(angle to the laser) exp(-k^2 / (2 width^2))`` over the pixels k around
      its centre, plus Gaussian noise, quantised to 8 bits;
    - it is lost if its brightest pixel is below the threshold: the grazing drop-out;
    - a Gaussian through the brightest pixel and its two neighbours gives the centre, off by delta pixels, and with it
      the depth: ``z' = z / (1 + z delta / (focal baseline))``. Without noise and quantisation delta is 0.

    Stripes that break at depth edges are not modelled. With the defaults the depth has a
    standard deviation of about 0.0026 where the laser meets the surface head-on.
    """

    resolution: int = 128  # pixels along each side of the image, which the bounding sphere fills
    baseline: float = 0.5  # from camera to laser, relative to the bounding-sphere radius
    intensity_noise: float = 0.02  # standard deviation of a pixel's intensity, whose range is 0 to 1
    stripe_width: float = 1.0  # standard deviation of the stripe's profile, in pixels
    peak_threshold: float = 0.1  # intensity below which a stripe is not found
    quantised: bool = True  # whether intensities have 8 bits

    def __post_init__(self) -> None:
        super().__post_init__()
        expect_count("resolution", self.resolution, least=2)
        expect_positive("baseline", self.baseline)
        expect_length("intensity_noise", self.intensity_noise)
        expect(0.3 <= self.stripe_width <= 3, "stripe_width", "0.3 to 3", self.stripe_width)
        expect(0 <= self.peak_threshold < 1, "peak_threshold", "0 or more and less than 1", self.peak_threshold)

    def measure(self, scene: Scene, pose: Pose, rng: np.random.Generator) -> Scan:
        """The pixels whose stripe is lit and found."""
        view = see(scene, pose, focal_length(scene, self.distance, self.resolution), self.resolution)
        laser = pose.center + self.baseline * scene.radius * pose.axes[0]
        normals, towards_laser = scene.normals[view.faces], laser - view.points
        cosine = np.einsum("ni,ni->n", normals, towards_laser) / np.linalg.norm(towards_laser, axis=1)
        towards_camera = np.einsum("ni,ni->n", normals, pose.center - view.points)
        lit = (cosine * towards_camera > 0) & scene.sees(view.points, view.faces, laser)

        found, delta = self._peaks(np.abs(cosine[lit]), rng)
        kept = np.flatnonzero(lit)[found]
        closeness = 1 + view.depth[kept] * delta / (view.focal * self.baseline * scene.radius)
        plausible = closeness > 0.5  # a peak so far off that the depth doubles is not a measurement
        kept, closeness = kept[plausible], closeness[plausible]
        points = view.unproject(view.depth[kept] / closeness, view.pixels[kept])
        return Scan.of(pose, points, view.points[kept], view.faces[kept])

    def _peaks(self, brightness: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Which stripes (indices) of the given brightness (n,) are found, and by how many pixels each is off."""
        middle = rng.random((len(brightness), 1), dtype=np.float32) - np.float32(0.5)  # where in its pixel a stripe is
        k = np.arange(-WINDOW, WINDOW + 1, dtype=np.float32)
        seen = brightness.astype(np.float32)[:, None] * np.exp(
            (k - middle) ** 2 / np.float32(-2 * self.stripe_width**2)
        )
        seen += np.float32(self.intensity_noise) * rng.standard_normal(seen.shape, dtype=np.float32)
        np.clip(seen, 0, 1, out=seen)
        if self.quantised:
            seen = np.round(BRIGHTEST * seen) / BRIGHTEST
        brightest = 1 + seen[:, 1:-1].argmax(axis=1)  # both neighbours are in the window
        rows = np.arange(len(seen))
        found = np.flatnonzero(seen[rows, brightest] >= max(self.peak_threshold, DARKEST))
        rows, brightest = rows[found], brightest[found]
        before, at, after = (np.log(np.maximum(seen[rows, brightest + j], DARKEST)) for j in (-1, 0, 1))
        # The logarithm of a Gaussian is a parabola; with a flat or hollow top, due to noise, it has no maximum.
        bend = np.minimum(before + after - 2 * at, -1e-3)
        vertex = np.clip((before - after) / (2 * bend), -1, 1)
        return found, (k[brightest] + vertex - middle[found, 0]).astype(np.float64)
