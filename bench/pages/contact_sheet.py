"""Images that are an input, as one small picture for a page: some of them side by side."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..contract.views import Views

MOST = 9  # images of a sheet: three by three are large enough in a panel
SIDES = (192, 128, 96, 64)  # pixels of the longer side of a tile; the first that fits
GAP = 4  # pixels between tiles
QUALITY = 80  # of WebP, which every recent browser shows


@dataclass(frozen=True)
class ContactSheet:
    """A picture with some images of a case.

    Attributes
    ----------
    data : bytes
        A file in the format WebP.
    note : str
        The number of images and their reduction.
    """

    data: bytes
    note: str


def contact_sheet(views: Views, room: float) -> ContactSheet | None:
    """Images of evenly spaced numbers in as large tiles as fit into ``room`` bytes; None if none do."""
    from PIL import Image

    chosen = np.unique(np.linspace(0, len(views) - 1, min(MOST, len(views))).round().astype(int))
    images = [Image.fromarray(np.ascontiguousarray(views.images[number])) for number in chosen]
    for side in SIDES:
        scale = min(1.0, side / max(views.width, views.height))
        size = max(1, round(views.width * scale)), max(1, round(views.height * scale))
        data = _webp([image.resize(size, Image.Resampling.LANCZOS) for image in images], size)
        if len(data) <= room:
            return ContactSheet(data, _note(len(images), views, size[0]))
    return None


def _webp(tiles: list, size: tuple[int, int]) -> bytes:
    """The tiles in rows, with gaps and unused space transparent."""
    from PIL import Image

    columns = math.ceil(math.sqrt(len(tiles)))
    rows = math.ceil(len(tiles) / columns)
    sheet = Image.new("RGBA", (columns * (size[0] + GAP) - GAP, rows * (size[1] + GAP) - GAP), (0, 0, 0, 0))
    for number, tile in enumerate(tiles):
        sheet.paste(tile, (number % columns * (size[0] + GAP), number // columns * (size[1] + GAP)))
    file = io.BytesIO()
    sheet.save(file, "WEBP", quality=QUALITY, method=4)
    return file.getvalue()


def _note(shown: int, views: Views, width: int) -> str:
    parts = [f"{shown} of {len(views)} images" if shown < len(views) else f"{shown} image{'s' * (shown > 1)}"]
    parts += [f"shown with {width} of {views.width} pixels across"] if width < views.width else []
    return ", ".join(parts)
