"""Clouds as text: one point a line, with a line of names if there is more than coordinates and normals."""

from __future__ import annotations

import numpy as np

from ..cloud import PointCloud
from .colors import color_scale
from .columns import names_for

PIECE = 100_000  # rows that are written at once
WHOLE, EXACT = "%d", "%.17g"  # 17 digits bring back the very same float64


def write_xyz(cloud: PointCloud) -> bytes:
    """Numbers with blanks between them; with colours or scalars a first line names the columns: ``# x y z r g b``."""
    names, forms, table = _columns(cloud)
    named = cloud.colors is not None or bool(cloud.scalars)
    return (f"# {' '.join(names)}\n" if named else "").encode() + lines(" ".join(forms), table)


def write_csv(cloud: PointCloud) -> bytes:
    """Numbers with commas between them, below a line of names: ``x,y,z,nx,ny,nz,r,g,b,intensity``."""
    names, forms, table = _columns(cloud)
    return f"{','.join(names)}\n".encode() + lines(",".join(forms), table)


def lines(form: str, table: np.ndarray) -> bytes:
    """A line of this form for each row of a table (n, c)."""
    pieces = (table[k : k + PIECE] for k in range(0, len(table), PIECE))
    return b"".join((f"{form}\n" * len(piece) % tuple(piece.ravel().tolist())).encode("ascii") for piece in pieces)


def _columns(cloud: PointCloud) -> tuple[list[str], list[str], np.ndarray]:
    """Names, forms and values of the columns."""
    names, forms, blocks = ["x", "y", "z"], [EXACT] * 3, [cloud.points]
    if cloud.normals is not None:
        names, forms, blocks = [*names, "nx", "ny", "nz"], [*forms, *[EXACT] * 3], [*blocks, cloud.normals]
    if cloud.colors is not None:
        colors, form = _colors(cloud.colors)
        names, forms, blocks = [*names, "r", "g", "b"], [*forms, *[form] * 3], [*blocks, colors]
    names += names_for(cloud.scalars, names)
    forms += [EXACT] * len(cloud.scalars)
    return names, forms, np.column_stack([*blocks, *cloud.scalars.values()])


def _colors(colors: np.ndarray) -> tuple[np.ndarray, str]:
    """Colours as whole numbers of 8 or 16 bits, if that is what they are, otherwise as they are, from 0 to 1."""
    for scale in (255, 65535):
        whole = np.rint(colors * scale)
        if np.abs(colors * scale - whole).max(initial=0) < 1e-9 and color_scale(whole, named=True) == scale:
            return whole, WHOLE
    return colors, EXACT
