"""COLMAP's text model (Schoenberger and Frahm 2016): ``cameras.txt`` and ``images.txt``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...errors import BadInput
from ...text import shortened
from .cameras import LARGEST, from_quaternion
from .lens import Lens
from .photos import Photo, Size
from .pictures import is_file

# The parameters of each model in the order of the file; f stands for fx and fy.
MODELS = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
}
MOST = 100  # characters quoted from a file
Camera = tuple[np.ndarray, Size, Lens]


def read_colmap(file: Path, root: Path) -> list[Photo]:
    """The photos of a text model.

    Parameters
    ----------
    file : Path
        ``cameras.txt``; ``images.txt`` is beside it.
    root : Path
        The user's folder; images are in its folder ``images``.

    Raises
    ------
    BadInput
        Naming the file, the line, and what was expected.
    """
    cameras = _cameras(file)
    listed = file.with_name("images.txt")
    folder = next((root / name for name in ("images", "image") if (root / name).is_dir()), root)
    lines = [(number, line.strip()) for number, line in enumerate(_text(listed).splitlines(), 1)]
    lines = [(number, line) for number, line in lines if not line.startswith("#")]
    photos, place = [], 0
    while place < len(lines):
        number, line = lines[place]
        if line:
            photos.append(_photo(f"{listed}: line {number}", line, cameras, folder))
            place += 1  # the line after it lists points of the image, or is empty
            if place < len(lines):
                _check_points(f"{listed}: line {lines[place][0]}", lines[place][1])
        place += 1
    if not photos:
        raise BadInput(f"{listed}: lists no images; expected two lines for each")
    return sorted(photos, key=lambda photo: photo.image)


def _cameras(file: Path) -> dict[str, Camera]:
    """The cameras by their ids."""
    cameras = {}
    for number, line in enumerate(_text(file).splitlines(), 1):
        words, where = line.split(), f"{file}: line {number}"
        if not words or line.lstrip().startswith("#"):
            continue
        if len(words) < 5:
            raise BadInput(
                f"{where}: expected CAMERA_ID MODEL WIDTH HEIGHT PARAMS, got {shortened(line.strip(), MOST)!r}"
            )
        if words[1] not in MODELS:
            raise BadInput(
                f"{where}: camera model {shortened(words[1], MOST)}: expected one of {', '.join(MODELS)}; undistort "
                "the images first: "
                f"colmap image_undistorter --image_path IMAGES --input_path {file.parent} --output_path OUT"
            )
        names, values = MODELS[words[1]], _numbers(words[2:], where)
        if len(values) != 2 + len(names) or values[:3].min() <= 0:
            raise BadInput(f"{where}: expected WIDTH HEIGHT {' '.join(names)} for the model {words[1]}")
        given = dict(zip(names, values[2:], strict=True))
        fx, fy = given.get("fx", given.get("f")), given.get("fy", given.get("f"))
        matrix = np.array([[fx, 0, given["cx"]], [0, fy, given["cy"]], [0, 0, 1]])
        lens = Lens(**{name: float(given.get(name, 0.0)) for name in Lens._fields})
        cameras[words[0]] = matrix, (round(values[0]), round(values[1])), lens
    return cameras


def _photo(where: str, line: str, cameras: dict[str, Camera], folder: Path) -> Photo:
    """The photo of a line ``IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME``."""
    words = line.split(maxsplit=9)
    if len(words) < 10:
        raise BadInput(f"{where}: expected IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, got {line[:80]!r}")
    pose = _numbers(words[1:8], where)
    if words[8] not in cameras:
        only = shortened(", ".join(cameras), MOST) or "none"
        raise BadInput(f"{where}: there is no camera {shortened(words[8], MOST)} in cameras.txt, only {only}")
    image = folder / words[9]
    if not is_file(image):
        shown = shortened(str(image), MOST)
        raise BadInput(f"{where}: there is no image {shown}; expected the images in a folder `images` beside the model")
    matrix, size, lens = cameras[words[8]]
    return Photo(image, matrix, from_quaternion(pose[:4], pose[4:], where), size, lens)


def _check_points(where: str, line: str) -> None:
    """Raise unless a line lists points: X Y POINT3D_ID, as often as there are."""
    words = line.split()
    if len(words) % 3 or (words and not words[-1].lstrip("-").isdigit()):
        raise BadInput(f"{where}: expected the points of the image above (X Y POINT3D_ID ...), or an empty line")


def _numbers(words: list[str], where: str) -> np.ndarray:
    try:
        values = np.array([float(word) for word in words])
    except ValueError:
        raise BadInput(f"{where}: expected numbers, got {' '.join(words)[:80]!r}") from None
    if not (np.abs(values) <= LARGEST).all():
        raise BadInput(f"{where}: has numbers that are NaN, or larger than {LARGEST:g}")
    return values


def _text(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise BadInput(f"{file}: expected the text of a COLMAP model: {error}") from None
