"""The noun :class:`Views`: images of one shape, with masks, cameras and lights.

The conventions are those of OpenCV:

* **Camera axes**: x to the right, y down, z forward. The extrinsics ``[R | t]`` take a point of the world to the
  camera: ``x_camera = R @ x_world + t``. A point in front of the camera has a positive depth ``x_camera[2]``.
* **Pixels**: the intrinsics ``K`` take camera coordinates to pixels: ``K @ x_camera / x_camera[2] = (column, row, 1)``.
  Coordinates are continuous; the image is the rectangle from (0, 0) to (w, h), and the centre of the pixel in column j
  and row i is at ``(j + 0.5, i + 0.5)``.
* **Lights** are directional, in the coordinates of the world; a direction points from the surface **towards** the
  light.

This module imports numpy and nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import BadInput
from ..geometry.cloud import Frame

TOLERANCE = 1e-6  # how far R @ R.T may be from the identity, and a length from 1
FIELDS = ("images", "masks", "extrinsics", "intrinsics", "light_directions", "light_colors", "ambient")


@dataclass(frozen=True, eq=False)
class Views:
    """Images of one shape from several cameras, immutable. All images have one size.

    Parameters
    ----------
    images : (v, h, w, 3) uint8 array
        RGB, the top row first.
    masks : (v, h, w) bool array
        Whether a pixel shows the shape.
    extrinsics : (v, 3, 4) float64 array
        World to camera, ``[R | t]`` with a rotation ``R``.
    intrinsics : (3, 3) or (v, 3, 3) float64 array
        ``[[fx, s, cx], [0, fy, cy], [0, 0, 1]]`` in pixels. One matrix is repeated for all views, so the attribute
        always has the shape (v, 3, 3).
    light_directions : (v, k, 3) float64 array of unit length, or None
        The k directional lights of each view, in world coordinates, from the surface towards the light.
    light_colors : (v, k, 3) float64 array, or None
        Their RGB intensities, 0 or more.
    ambient : (v, 3) float64 array, or None
        RGB intensity of the light that comes from everywhere, 0 or more.

    Raises
    ------
    BadInput
        If an array has another shape or type, if a matrix is no rotation or no pinhole camera, or if a number is not
        finite. The message names the array, what was expected and, where one is wrong, the view.
    """

    images: np.ndarray
    masks: np.ndarray
    extrinsics: np.ndarray
    intrinsics: np.ndarray
    light_directions: np.ndarray | None = None
    light_colors: np.ndarray | None = None
    ambient: np.ndarray | None = None

    def __post_init__(self) -> None:
        self._keep("images", _image_array(self.images))
        count, height, width = self.images.shape[:3]
        self._keep("masks", _mask_array(self.masks, (count, height, width)))
        self._keep("extrinsics", _numbers("extrinsics", self.extrinsics, (count, 3, 4)))
        _check_rotations(self.extrinsics[:, :, :3])
        intrinsics = np.array(self.intrinsics, dtype=np.float64)
        if intrinsics.shape == (3, 3):
            intrinsics = np.repeat(intrinsics[None], count, axis=0)
        self._keep("intrinsics", _numbers("intrinsics", intrinsics, (count, 3, 3), also="(3, 3) or "))
        _check_intrinsics(self.intrinsics)
        if (self.light_directions is None) != (self.light_colors is None):
            raise BadInput("Views: light_directions and light_colors belong together; give both, or neither")
        if self.light_directions is not None:
            self._keep("light_directions", _numbers("light_directions", self.light_directions, (count, None, 3)))
            self._keep("light_colors", _numbers("light_colors", self.light_colors, self.light_directions.shape))
            _check_unit(self.light_directions)
            _check_intensities("light_colors", np.asarray(self.light_colors))
        if self.ambient is not None:
            self._keep("ambient", _numbers("ambient", self.ambient, (count, 3)))
            _check_intensities("ambient", self.ambient)

    def _keep(self, name: str, array: np.ndarray) -> None:
        array.setflags(write=False)
        object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return len(self.images)

    def __repr__(self) -> str:
        lights = "" if self.light_directions is None else f", {self.light_directions.shape[1]} lights each"
        return f"Views({len(self)} images of {self.width} x {self.height}{lights})"

    @property
    def height(self) -> int:
        """Of the images, in pixels."""
        return self.images.shape[1]

    @property
    def width(self) -> int:
        """Of the images, in pixels."""
        return self.images.shape[2]

    # -- as arrays -------------------------------------------------------------------------------------------------

    def arrays(self) -> dict[str, np.ndarray]:
        """All arrays by name, without those that are None; :meth:`of` makes the same views of them."""
        given = {name: getattr(self, name) for name in FIELDS}
        return {name: array for name, array in given.items() if array is not None}

    @classmethod
    def of(cls, arrays: Mapping[str, np.ndarray]) -> Views:
        """The inverse of :meth:`arrays`."""
        return cls(**{name: arrays[name] for name in FIELDS if name in arrays})

    # -- cameras ---------------------------------------------------------------------------------------------------

    @property
    def centers(self) -> np.ndarray:
        """Where the cameras stand in the world: a (v, 3) array, ``-R.T @ t``."""
        rotation, shift = self.extrinsics[:, :, :3], self.extrinsics[:, :, 3]
        return -np.einsum("vji,vj->vi", rotation, shift)

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where every view sees some points of the world.

        Parameters
        ----------
        points : (n, 3) array

        Returns
        -------
        pixels : (v, n, 2) float64 array
            Column and row, continuous: inside the image they are in [0, w) and [0, h). NaN where the depth is 0.
        depth : (v, n) float64 array
            Along the optical axis; a point with a depth of 0 or less is not in front of the camera.
        """
        points = _points(points)
        turned = _products(self.extrinsics[:, :, :3], points.T[:, None])
        camera = [part + self.extrinsics[:, axis, 3, None] for axis, part in enumerate(turned)]
        depth = camera[2]
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = np.stack([part / depth for part in _products(self.intrinsics[:, :2], camera)], axis=-1)
        pixels[depth == 0] = np.nan
        return pixels, depth

    def pixels_at(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Which pixel of every view some points of the world fall on.

        Parameters
        ----------
        points : (n, 3) array

        Returns
        -------
        rows, columns : (v, n) int64 arrays
            0 where a view does not show the point.
        shown : (v, n) bool array
            Whether the point lies in front of the camera and projects into the image; occlusion is ignored.
            ``shown & views.masks[view, rows, columns]``, with ``view = numpy.arange(v)[:, None]``, are those inside a
            mask.
        """
        pixels, depth = self.project(points)
        columns, rows = pixels[..., 0], pixels[..., 1]
        shown = (depth > 0) & (columns >= 0) & (columns < self.width) & (rows >= 0) & (rows < self.height)
        rows, columns = (np.where(shown, place, 0).astype(np.int64) for place in (rows, columns))
        return rows, columns, shown

    def unproject(self, view: int, pixels: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """The points of the world at some depths behind the pixels of one view: the inverse of :meth:`project`.

        Parameters
        ----------
        view : int
        pixels : (..., 2) array
            Column and row.
        depth : (...) array
            Along the optical axis.

        Returns
        -------
        (..., 3) float64 array
        """
        pixels, depth = np.asarray(pixels, dtype=np.float64), np.asarray(depth, dtype=np.float64)
        extrinsics = self.extrinsics[view]
        camera = self._through(view, pixels) * depth[..., None]
        return (camera - extrinsics[:, 3]) @ extrinsics[:, :3]

    def rays(self, view: int) -> tuple[np.ndarray, np.ndarray]:
        """The rays through the centres of all pixels of one view, in the coordinates of the world.

        Returns
        -------
        origins : (h, w, 3) float64 array, read-only
            The camera's centre, everywhere.
        directions : (h, w, 3) float64 array of unit length
            ``directions[views.masks[view]]`` are those that meet the shape.
        """
        columns, rows = np.meshgrid(np.arange(self.width) + 0.5, np.arange(self.height) + 0.5)
        directions = self._through(view, np.stack([columns, rows], axis=-1)) @ self.extrinsics[view, :, :3]
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        return np.broadcast_to(self.centers[view], directions.shape), directions

    def _through(self, view: int, pixels: np.ndarray) -> np.ndarray:
        """Camera coordinates (..., 3) at depth 1 behind pixels (..., 2)."""
        (fx, skew, cx), (_, fy, cy), _ = self.intrinsics[view]
        y = (pixels[..., 1] - cy) / fy
        x = (pixels[..., 0] - cx - skew * y) / fx
        return np.stack([x, y, np.ones_like(x)], axis=-1)

    def in_frame(self, frame: Frame) -> Views:
        """The same images with cameras in the coordinates of a frame: depths shrink with the shape, pixels stay."""
        rotation, shift = self.extrinsics[:, :, :3], self.extrinsics[:, :, 3]
        moved = (rotation @ np.asarray(frame.center) + shift) / frame.radius
        return Views.of(self.arrays() | {"extrinsics": np.concatenate([rotation, moved[:, :, None]], axis=2)})


# -- what is accepted --------------------------------------------------------------------------------------------------


def _image_array(values: Any) -> np.ndarray:
    images = np.array(values)  # a copy: the views own what they freeze
    if images.ndim != 4 or images.shape[3] != 3 or 0 in images.shape:
        raise BadInput(f"Views.images: expected an array of shape (views, height, width, 3), got {images.shape}")
    if images.dtype != np.uint8:
        raise BadInput(f"Views.images: expected uint8, 0 to 255, got {images.dtype}")
    return images


def _mask_array(values: Any, shape: tuple[int, int, int]) -> np.ndarray:
    masks = np.array(values)
    if masks.shape != shape:
        raise BadInput(f"Views.masks: expected an array of shape {shape} like the images, got {masks.shape}")
    if masks.dtype != np.bool_:
        raise BadInput(f"Views.masks: expected bool, got {masks.dtype}; compare with a threshold: `a > 127`")
    return masks


def _numbers(name: str, values: Any, shape: tuple[int | None, ...], also: str = "") -> np.ndarray:
    """A float64 copy of finite numbers in that shape; None in it stands for any length."""
    array = np.array(values, dtype=np.float64)
    if array.ndim != len(shape) or any(b is not None and a != b for a, b in zip(array.shape, shape, strict=True)):
        wanted = ", ".join("k" if n is None else str(n) for n in shape)
        raise BadInput(f"Views.{name}: expected an array of shape {also}({wanted}), got {array.shape}")
    wrong = ~np.isfinite(array).reshape(len(array), -1).all(axis=1)
    if wrong.any():
        raise BadInput(f"Views.{name}: view {np.argmax(wrong)} has numbers that are NaN or infinite")
    return array


def _check_rotations(rotations: np.ndarray) -> None:
    off = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    wrong = (off > TOLERANCE) | (np.linalg.det(rotations) < 0)
    if wrong.any():
        raise BadInput(
            f"Views.extrinsics: view {np.argmax(wrong)}: the first three columns are not a rotation; expected world-to-"
            "camera matrices [R | t] with R @ R.T = 1 and det(R) = 1 (x right, y down, z forward)"
        )


def _check_intrinsics(intrinsics: np.ndarray) -> None:
    below = np.stack([intrinsics[:, 1, 0], intrinsics[:, 2, 0], intrinsics[:, 2, 1], intrinsics[:, 2, 2] - 1])
    wrong = (below != 0).any(axis=0) | (intrinsics[:, 0, 0] <= 0) | (intrinsics[:, 1, 1] <= 0)
    if wrong.any():
        raise BadInput(
            f"Views.intrinsics: view {np.argmax(wrong)}: expected [[fx, s, cx], [0, fy, cy], [0, 0, 1]] in pixels, "
            "with positive focal lengths fx and fy"
        )


def _check_unit(directions: np.ndarray) -> None:
    wrong = (np.abs(np.linalg.norm(directions, axis=2) - 1) > TOLERANCE).any(axis=1)
    if wrong.any():
        raise BadInput(f"Views.light_directions: view {np.argmax(wrong)}: a direction is not of unit length")


def _check_intensities(name: str, values: np.ndarray) -> None:
    wrong = (values < 0).reshape(len(values), -1).any(axis=1)
    if wrong.any():
        raise BadInput(f"Views.{name}: view {np.argmax(wrong)}: expected intensities of 0 or more")


def _products(matrices: np.ndarray, vectors: Sequence[np.ndarray] | np.ndarray) -> list[np.ndarray]:
    """The components, each (v, n), of matrices (v, m, 3) times vectors, given by component as (v, n) or (1, n).

    That is ``einsum``, to the bit and so in its order of sums, but ten times as fast: its own loops are of length 3.
    """
    x, y, z = vectors
    return [(a[:, None] * x + c[:, None] * z) + b[:, None] * y for a, b, c in np.moveaxis(matrices, 0, -1)]


def _points(values: Any) -> np.ndarray:
    points = np.asarray(values, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise BadInput(f"Views.project: expected points of shape (n, 3), got {points.shape}")
    return points
