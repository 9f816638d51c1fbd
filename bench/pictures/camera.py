"""The camera of a figure: one direction for all tiles, parallel rays, and a window that the tiles of a row share."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..errors import UsageError

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
MARGIN = 1.06  # of a window, beyond what it shows


@dataclass(frozen=True)
class Camera:
    """The viewpoint of a figure.

    Parameters
    ----------
    azimuth, elevation : float
        Degrees: around the upward axis, and above the ground. With z upward, azimuth 0 looks from the side of +x,
        90 from +y, -90 from the front.
    zoom : float
        2 shows half as much.
    up : str
        Which axis points upward.
    """

    azimuth: float = -52.0
    elevation: float = 24.0
    zoom: float = 1.0
    up: str = "z"

    @classmethod
    def of(cls, text: str | None, up: str = "z") -> Camera:
        """From a text of the command line, ``AZIMUTH,ELEVATION`` or ``AZIMUTH,ELEVATION,ZOOM``.

        Raises
        ------
        UsageError
            For anything else.
        """
        try:
            values = [float(part) for part in text.split(",")] if text else []
        except ValueError:
            values = [np.nan]
        fine = len(values) in (0, 2, 3) and np.isfinite(values).all()
        if not fine or (len(values) > 1 and abs(values[1]) > 90) or (len(values) > 2 and values[2] <= 0):
            raise UsageError(
                f"--camera {text}: expected AZIMUTH,ELEVATION in degrees, and ZOOM above 0 if wanted, like -52,24 or "
                "30,10,1.5; the elevation is between -90 and 90"
            )
        return cls(**dict(zip(("azimuth", "elevation", "zoom"), values, strict=False)), up=up)

    @property
    def axes(self) -> np.ndarray:
        """(3, 3) array: unit vectors to the right, upward, and towards the eye, in rows."""
        azimuth, elevation = np.radians([self.azimuth, self.elevation])
        upward = np.array(AXES[self.up])
        east = np.roll(upward, 1)
        north = np.cross(upward, east)
        level = np.cos(azimuth) * east + np.sin(azimuth) * north
        eye = np.cos(elevation) * level + np.sin(elevation) * upward
        right = np.cross(upward, level)
        return np.stack([right, np.cross(eye, right), eye])

    def project(self, points: np.ndarray) -> np.ndarray:
        """(n, 3) array: to the right, upward and towards the eye, in the unit of ``points`` (n, 3)."""
        return np.asarray(points) @ self.axes.T

    def window(self, shapes: Iterable[np.ndarray]) -> Window:
        """The smallest window, with a margin, that shows all points of some (n, 3) arrays."""
        flat = [self.project(points)[:, :2] for points in shapes if len(points)]
        if not flat:
            return Window((0.0, 0.0), (1.0, 1.0))
        low = np.min([points.min(axis=0) for points in flat], axis=0)
        high = np.max([points.max(axis=0) for points in flat], axis=0)
        half = np.maximum((high - low) / 2 * MARGIN, 1e-6) / self.zoom
        return Window(tuple((low + high) / 2), tuple(half))


@dataclass(frozen=True)
class Window:
    """A rectangle of the image plane of a camera, in radii."""

    center: tuple[float, float]
    half: tuple[float, float]  # its width and height, halved

    def with_aspect(self, aspect: float) -> Window:
        """The smallest window around this one whose height is ``aspect`` times its width."""
        width = max(self.half[0], self.half[1] / aspect)
        return Window(self.center, (width, width * aspect))

    def share(self, points: np.ndarray) -> np.ndarray:
        """Where (n, 2) or (n, 3) projected points are in the window: (n, 2), 0..1 to the right and upward."""
        return (np.asarray(points)[:, :2] - self.center) / (2 * np.asarray(self.half)) + 0.5
