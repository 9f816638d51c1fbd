"""``cameras.npz``: cameras as DTU's images have them in IDR (Yariv et al. 2020) and NeuS (Wang et al. 2021)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ...errors import BadInput
from ...geometry.cloud import Frame
from .cameras import LARGEST, decomposed, nearest_rotation
from .masks import FOLDERS
from .photos import Photo
from .pictures import image_size, pictures_in

IMAGES = ("image", "images", "rgb")
# These files count pixels by their centres: (0, 0) is the centre of the first one, which is (0.5, 0.5) here.
HALF = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])


def read_cameras(file: Path, arrays: Mapping[str, np.ndarray]) -> tuple[list[Photo], Frame | None]:
    """The photos of a ``cameras.npz``, which has these arrays, and the ball of the shape if it is stored.

    ``world_mat_i`` is the projection ``K [R | t]`` of the i-th image of the folder ``image``, sorted by name, as (3, 4)
    or (4, 4); ``scale_mat_0`` takes the unit ball, which has the shape in it, to the world.

    Raises
    ------
    BadInput
        Naming the file and what was expected of it.
    """
    names = [name for name in arrays if re.fullmatch("world_mat_[0-9]{1,9}", name)]
    names.sort(key=lambda name: int(name[10:]))
    images = _folder(file.parent, IMAGES)
    if images is None:
        raise BadInput(f"{file.parent}: expected a folder {' or '.join(IMAGES)} with the images of {file.name}")
    paths = pictures_in(images)
    if len(paths) != len(names):
        raise BadInput(f"{images}: has {len(paths)} images, but {file} has {len(names)} cameras world_mat_0, ...")
    masks = _masks(file.parent, paths)
    photos = [
        _photo(file, name, arrays[name], image, mask) for name, image, mask in zip(names, paths, masks, strict=True)
    ]
    return photos, _frame(file, arrays)


def _photo(file: Path, name: str, matrix: np.ndarray, image: Path, mask: Path | None) -> Photo:
    where = f"{file}: {name}"
    _check_matrix(matrix, where)
    intrinsics, extrinsics = decomposed(matrix[:3].astype(np.float64), where)
    size = image_size(image)
    if intrinsics[0, 0] < 0.05 * max(size):
        raise BadInput(
            f"{where}: its focal length is {intrinsics[0, 0]:.3g} pixels in an image {size[0]} pixels wide; expected a "
            "projection K [R | t] to pixels. Where K is in camera_mat_i, multiply the two"
        )
    return Photo(image, HALF @ intrinsics, extrinsics, size, mask=mask)


def _check_matrix(matrix: np.ndarray, where: str) -> None:
    if matrix.shape not in ((3, 4), (4, 4)) or matrix.dtype.kind not in "fiu":
        raise BadInput(f"{where}: expected 3 or 4 rows of 4 finite numbers, got shape {matrix.shape} of {matrix.dtype}")
    if not (np.abs(matrix) <= LARGEST).all():
        raise BadInput(f"{where}: has numbers that are NaN, or larger than {LARGEST:g}")


def _masks(root: Path, images: list[Path]) -> list[Path | None]:
    """The mask of each image: by its name, or in the order of names; None where there is no folder of masks."""
    folder = _folder(root, FOLDERS)
    if folder is None:
        return [None] * len(images)
    paths = pictures_in(folder)
    named = {path.stem: path for path in paths}
    if all(image.stem in named for image in images):
        return [named[image.stem] for image in images]
    if len(paths) != len(images):
        raise BadInput(f"{folder}: has {len(paths)} masks for {len(images)} images; expected one for each")
    return list(paths)


def _frame(file: Path, arrays: Mapping[str, np.ndarray]) -> Frame | None:
    """The ball that ``scale_mat_0`` gives."""
    if "scale_mat_0" not in arrays:
        return None
    matrix, where = arrays["scale_mat_0"], f"{file}: scale_mat_0"
    _check_matrix(matrix, where)
    matrix = matrix.astype(np.float64)
    others = [name for name in arrays if re.fullmatch("scale_mat_[0-9]{1,9}", name)]
    for name in others:
        _check_matrix(arrays[name], f"{file}: {name}")
    if not all(arrays[name].shape == matrix.shape and np.allclose(arrays[name], matrix) for name in others):
        raise BadInput(f"{file}: expected one scale_mat for all images; they differ")
    nearest_rotation(matrix[:3, :3], where)  # a ball stays a ball
    x, y, z = map(float, matrix[:3, 3])
    return Frame((x, y, z), float(np.linalg.det(matrix[:3, :3]) ** (1 / 3)))


def _folder(root: Path, names: tuple[str, ...]) -> Path | None:
    return next((root / name for name in names if (root / name).is_dir()), None)
