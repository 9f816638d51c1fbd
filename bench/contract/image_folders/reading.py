"""The front door: a folder of images with cameras, or a file of views, to views in the unit ball."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...errors import BadInput
from ...geometry.cloud import Frame
from ...notices import notice
from ..views import Views
from ..views_file import load_views, npz_arrays
from .bounding import bounding_ball, check_ball
from .cameras_npz import read_cameras
from .colmap_text import read_colmap
from .photos import load_photos
from .transforms_json import read_transforms

# Files of cameras that are tried in a folder; the first that exists is used.
FILES = (
    "transforms.json",
    "transforms_train.json",
    "cameras_sphere.npz",
    "cameras.npz",
    "cameras.txt",
    "sparse/cameras.txt",
    "sparse/0/cameras.txt",
    "colmap/sparse/0/cameras.txt",
)


def read_views(path: str | Path, max_pixels: int = 0) -> tuple[Views, Frame]:
    """Views of a shape in the unit ball, and the ball in the coordinates of the file.

    Parameters
    ----------
    path : str or Path
        An ``.npz`` file of views, whose shape is in the unit ball already; a file of cameras; or a folder with one:
        ``transforms.json``, ``cameras.npz`` or ``cameras_sphere.npz``, or a COLMAP model as text.
    max_pixels : int
        Longest side of the images of a folder, which are shrunk to it; 0: as they are.

    Raises
    ------
    BadInput, UsageError
        Naming the file, what was expected of it, and what to do.
    """
    file, root = _file_of(Path(path))
    frame = None
    if file.suffix == ".json":
        photos = read_transforms(file)
    elif file.suffix == ".txt":
        photos = read_colmap(file, root)
    else:
        arrays = npz_arrays(file, "an .npz file of views (images, masks, ...) or of cameras (world_mat_0, ...)")
        if not any(name.startswith("world_mat_") for name in arrays):
            return load_views(file), Frame()
        photos, frame = read_cameras(file, arrays)
    views = _without_empty(load_photos(photos, root, max_pixels), str(root))
    if frame is None:
        frame = bounding_ball(views, str(file))
    else:
        check_ball(views, frame, str(file))
    return views.in_frame(frame), frame


def _file_of(path: Path) -> tuple[Path, Path]:
    """The file of cameras, or of views, that is meant, and the user's folder."""
    if path.exists() and not (path.is_dir() or path.is_file()):
        raise BadInput(f"{path}: is a pipe or a device; expected a folder of images with cameras, or a file of them")
    if not path.is_dir():
        if path.suffix not in (".json", ".npz") and path.name != "cameras.txt":
            raise BadInput(f"{path}: expected views: a folder of images with cameras, or an .npz file ({_wanted()})")
        parents = path.resolve().parents if path.name == "cameras.txt" else ()
        roots = [parent for parent in parents[:4] if (parent / "images").is_dir() or (parent / "image").is_dir()]
        return path, roots[0] if roots else path.parent
    found = [path / name for name in FILES if (path / name).is_file()]
    if not found:
        binary = next((path / name for name in FILES if (path / name).with_suffix(".bin").is_file()), None)
        if binary is not None:
            folder = binary.parent
            raise BadInput(
                f"{folder}: holds a binary COLMAP model; expected its text, which this makes: "
                f"colmap model_converter --input_path {folder} --output_path {folder} --output_type TXT"
            )
        raise BadInput(f"{path}: has no file of cameras; expected {_wanted()}")
    if len(found) > 1:
        others = ", ".join(str(file.relative_to(path)) for file in found[1:])
        notice(f"{path}: cameras are those of {found[0].relative_to(path)}; there is also {others}, name it to use it")
    return found[0], path


def _wanted() -> str:
    return f"one of {', '.join(FILES)}"


def _without_empty(views: Views, where: str) -> Views:
    """The views whose masks are not empty; a notice reports how many are left out."""
    shown = views.masks.any(axis=(1, 2))
    if not shown.any():
        raise BadInput(f"{where}: all masks are black; expected white where the shape is")
    if not shown.all():
        notice(f"{where}: {np.sum(~shown)} of {len(views)} masks are black; those views are left out")
        views = Views.of({name: array[shown] for name, array in views.arrays().items()})
    return views
