"""LAS, LAZ and E57, the formats of scanners, through libraries that are optional."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from ...errors import BadInput
from ...notices import notice
from .colors import color_scale
from .raw import NO_FACES, RawGeometry

INSTALL = {"laspy": 'pip install "laspy[lazrs]"', "pye57": "pip install pye57"}
# Fields of LAS that every point has and that mean nothing if they have only one value.
LAS_SCALARS = ("intensity", "classification", "return_number", "number_of_returns", "gps_time", "point_source_id")
LAS_SCALARS += ("user_data", "scan_angle", "scan_angle_rank", "near_infrared", "nir")


def read_las(data: bytes, name: str) -> RawGeometry:
    """The points of a LAS or LAZ file, by laspy: scale and offset are applied in float64, colours are 8 or 16 bit.

    Intensity, class, time and further fields that are not the same for all points become scalars.

    Raises
    ------
    BadInput
        If laspy is not installed, with the line that installs it, or cannot read the file.
    """
    try:
        import laspy
    except ImportError:
        raise _needs("LAS and LAZ files", "laspy", name) from None
    try:
        las = laspy.read(io.BytesIO(data))
    except Exception as error:  # laspy raises errors of its own, of struct, and of its decoders written in Rust
        raise BadInput(
            f"{name}: laspy cannot read it ({_first_line(error)}); expected a LAS or LAZ file. Export it again"
        ) from None
    points = np.stack([np.asarray(axis, dtype=np.float64) for axis in (las.x, las.y, las.z)], axis=1)
    if len(points) < las.header.point_count:
        raise BadInput(
            f"{name}: ends early: its header promises {las.header.point_count:,} points, but the file holds "
            f"{len(points):,}. The file is cut off; copy or export it again"
        )
    present = set(las.point_format.dimension_names)
    colors = None
    if {"red", "green", "blue"} <= present:
        colors = _colors(np.stack([np.asarray(las[axis]) for axis in ("red", "green", "blue")], axis=1))
    extra = tuple(getattr(las.point_format, "extra_dimension_names", ()))
    scalars = {}
    for key in (*LAS_SCALARS, *extra):
        values = np.asarray(las[key], dtype=np.float64) if key in present or key in extra else None
        if values is not None and values.shape == (len(points),) and len(points) and np.ptp(values) > 0:
            scalars[key] = values
    return RawGeometry(points, NO_FACES, None, colors, scalars)


def read_e57(data: bytes, name: str) -> RawGeometry:
    """All scans of an E57 file, by pye57, moved by their poses into one coordinate system.

    Several scans have the scalar ``scan``, from 0. Points that the file marks as invalid are left out.

    Raises
    ------
    BadInput
        If pye57 is not installed, with the line that installs it, or cannot read the file.
    """
    try:
        import pye57
    except ImportError:
        raise _needs("E57 files", "pye57", name) from None
    try:
        file = pye57.E57(name)
        scans = [
            file.read_scan(k, intensity=True, colors=True, ignore_missing_fields=True, transform=True)
            for k in range(file.scan_count)
        ]
    except Exception as error:  # whatever the library in C++ below it raises
        raise BadInput(
            f"{name}: pye57 cannot read it ({_first_line(error)}); expected an E57 file. Export it again"
        ) from None
    if not scans:
        raise BadInput(f"{name}: holds no scans; expected an E57 file with points")
    if len(scans) > 1:
        notice_scans(len(scans), name)
    return _joined(scans)


def _joined(scans: list[dict[str, Any]]) -> RawGeometry:
    """The points of all scans, with what all of them have."""

    def column(key: str) -> np.ndarray:
        return np.concatenate([np.asarray(scan[key], dtype=np.float64) for scan in scans])

    keys = set.intersection(*(set(scan) for scan in scans))
    points = np.stack([column(f"cartesian{axis}") for axis in "XYZ"], axis=1)
    colors, normals = None, None
    if {"colorRed", "colorGreen", "colorBlue"} <= keys:
        colors = _colors(np.stack([column(f"color{word}") for word in ("Red", "Green", "Blue")], axis=1))
    if {"normalX", "normalY", "normalZ"} <= keys:
        normals = np.stack([column(f"normal{axis}") for axis in "XYZ"], axis=1)
    scalars = {"intensity": column("intensity")} if "intensity" in keys else {}
    if len(scans) > 1:
        scalars["scan"] = np.repeat(np.arange(len(scans)), [len(scan["cartesianX"]) for scan in scans])
    return RawGeometry(points, NO_FACES, normals, colors, scalars)


def _colors(values: np.ndarray) -> np.ndarray | None:
    """Colours in 0..1; eight bits that are stored in fields of sixteen are eight bits, and all black are none."""
    values = values.astype(np.float64)
    scale = color_scale(values, named=True, integers=bool((values == np.rint(values)).all()))
    return values / scale if scale and values.any() else None


def notice_scans(count: int, name: str) -> None:
    """Give a notice of a file, called ``name``, that has several scans."""
    notice(f"{name}: has {count} scans; all are read, moved by their poses; the scalar scan is the number of each")


def _first_line(error: Exception) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0][:200]


def _needs(what: str, library: str, name: str) -> BadInput:
    return BadInput(
        f"{name}: {what} are read by {library}, which is not installed; install it with: {INSTALL[library]}"
    )
