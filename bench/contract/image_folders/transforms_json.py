"""``transforms.json``: cameras as instant-ngp, nerfstudio and the synthetic set of NeRF have them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import BadInput, did_you_mean
from ...text import shortened
from .cameras import LARGEST, from_opengl
from .lens import Lens
from .photos import Photo
from .pictures import SUFFIXES, image_size, is_file

PINHOLES = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "perspective")
LEAST = 1e-6  # of a focal length in pixels, and of an angle
MOST = 300  # characters quoted from a file
UNDISTORT = "undistort the images first, for instance by `colmap image_undistorter`"


def read_transforms(file: Path) -> list[Photo]:
    """The photos of a ``transforms.json``.

    Each frame has ``file_path``, relative to the file and with or without its ending, and ``transform_matrix``, camera
    to world with the axes of OpenGL: x to the right, y up, z backward. The focal length is ``fl_x`` (and ``fl_y``) in
    pixels or ``camera_angle_x``; ``cx``, ``cy``, ``w``, ``h`` and the distortion ``k1 k2 k3 p1 p2`` may be there, for
    all frames or in each. ``mask_path`` names the mask.

    Raises
    ------
    BadInput
        Naming the file, the frame, and what was expected.
    """
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:  # the last for thousands of nested brackets
        raise BadInput(f"{file}: expected a JSON file of cameras: {shortened(str(error), MOST)}") from None
    frames = content.get("frames") if isinstance(content, dict) else None
    if not isinstance(frames, list) or not frames or not all(isinstance(frame, dict) for frame in frames):
        raise BadInput(f"{file}: expected a list `frames` with an entry for each image")
    return [_photo(file, f"{file}: frames[{place}]", content | frame) for place, frame in enumerate(frames)]


def _photo(file: Path, where: str, entry: Mapping[str, Any]) -> Photo:
    """One frame, with the values common to all filled in."""
    _check_model(entry, where)
    image = _image(file.parent, entry.get("file_path"), where)
    matrix = _array(entry, "transform_matrix", where)
    if matrix.shape not in ((4, 4), (3, 4)):
        raise BadInput(f"{where}: expected a transform_matrix of 4 rows of 4 numbers, got shape {matrix.shape}")
    mask = None
    if entry.get("mask_path"):
        mask = file.parent / str(entry["mask_path"]).replace("\\", "/")
        if not is_file(mask):
            raise BadInput(f"{where}: mask_path: there is no file {shortened(str(mask), MOST)}")
    width, height = image_size(image)
    size = round(_number(entry, "w", width, where)), round(_number(entry, "h", height, where))
    if min(size) < 1:
        raise BadInput(f"{where}: expected w and h of 1 or more, got {size[0]} and {size[1]}")
    return Photo(
        image=image,
        mask=mask,
        intrinsics=_intrinsics(entry, size, where),
        extrinsics=from_opengl(matrix, f"{where}: transform_matrix"),
        size=size,
        lens=Lens(**{name: _number(entry, name, 0.0, where) for name in Lens._fields}),
    )


def _check_model(entry: Mapping[str, Any], where: str) -> None:
    model = entry.get("camera_model", "PINHOLE")
    if model not in PINHOLES or entry.get("is_fisheye") or _number(entry, "k4", 0.0, where):
        name = "k4" if model in PINHOLES and not entry.get("is_fisheye") else "fisheye" if model in PINHOLES else model
        name = shortened(str(name), MOST)
        raise BadInput(f"{where}: camera model {name}: expected one of {', '.join(PINHOLES)} without k4; {UNDISTORT}")


def _intrinsics(entry: Mapping[str, Any], size: tuple[int, int], where: str) -> np.ndarray:
    focal = [_focal(entry, axis, length, where) for axis, length in zip("xy", size, strict=True)]
    fx = focal[0] or focal[1]
    if not fx:
        raise BadInput(f"{where}: has no focal length; expected fl_x in pixels or camera_angle_x in radians")
    cx, cy = _number(entry, "cx", size[0] / 2, where), _number(entry, "cy", size[1] / 2, where)
    return np.array([[fx, 0, cx], [0, focal[1] or fx, cy], [0, 0, 1]])


def _focal(entry: Mapping[str, Any], axis: str, length: int, where: str) -> float:
    """In pixels, from either of its keys; 0 without both."""
    focal = _number(entry, f"fl_{axis}", 0.0, where)
    angle = _number(entry, f"camera_angle_{axis}", 0.0, where)
    if focal < 0 or 0 < focal < LEAST or not 0 <= angle < math.pi or 0 < angle < LEAST:
        raise BadInput(f"{where}: expected fl_{axis} above 0, or camera_angle_{axis} between 0 and pi (radians)")
    return focal or (length / 2 / math.tan(angle / 2) if angle else 0.0)


def _number(entry: Mapping[str, Any], name: str, default: float, where: str) -> float:
    value = entry.get(name)
    if value is None:
        return float(default)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= LARGEST:
        got = shortened(repr(value), MOST)  # which may be finite, but too large to compute with
        raise BadInput(f"{where}: {name}: expected a finite number of at most {LARGEST:g}, got {got}")
    return float(value)


def _array(entry: Mapping[str, Any], name: str, where: str) -> np.ndarray:
    try:
        array = np.array(entry[name], dtype=np.float64)
    except KeyError:
        raise BadInput(f"{where}: has no {name}. {did_you_mean(name, entry)}") from None
    except (TypeError, ValueError, OverflowError):
        raise BadInput(f"{where}: {name}: expected rows of numbers") from None
    if not (np.abs(array) <= LARGEST).all():
        raise BadInput(f"{where}: {name}: has numbers that are NaN, or larger than {LARGEST:g}")
    return array


def _image(folder: Path, name: Any, where: str) -> Path:
    """The file that ``file_path`` means: as given, or with an image suffix."""
    if not isinstance(name, str) or not name:
        raise BadInput(f"{where}: expected a file_path, the image relative to {folder}")
    path = folder / name.replace("\\", "/")
    endings = ("", *SUFFIXES, *(suffix.upper() for suffix in SUFFIXES))
    for ending in endings:
        if is_file(found := path.with_name(path.name + ending)):
            return found
    shown = shortened(str(path), MOST)
    raise BadInput(f"{where}: there is no image {shown}; expected it there, or with one of {' '.join(SUFFIXES)} added")
