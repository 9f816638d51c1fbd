"""The largest shape that has the given silhouettes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from bench import Run, Views, register

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("method", cite="Laurentini 1994", requires=("scipy", "numba"))
@dataclass(frozen=True)
class VisualHull:
    """The visual hull: the largest shape in the unit ball that fits all masks; colours are not used.

    It is the zero of a field: the maximum over the views of the signed distance to the silhouette, from the Euclidean
    distance transform of the mask (:mod:`.carving.silhouettes`), so that its error is below a pixel. It contains every
    shape with these masks; concavities that no silhouette shows are filled. A mask that the border of its image cuts
    off does not cut the shape (``beyond``). Views with an empty mask are left out, with a note; masks without a common
    point in space are refused.
    """

    resolution: int = 160  # samples of the field along the shortest side of the shape
    beyond: Literal["auto", "keep", "carve"] = "auto"  # the border of an image; auto: keep if the mask touches it

    def __post_init__(self) -> None:
        if self.resolution < 8:
            raise ValueError(f"resolution: expected at least 8, got {self.resolution}")
        if self.beyond not in ("auto", "keep", "carve"):
            raise ValueError(f"beyond: expected auto, keep or carve, got {self.beyond!r}")

    def prepare(self) -> None:
        """Load the compiled loops, or compile them."""
        from .carving.silhouettes import load_compiled

        load_compiled()

    def multiview(self, views: Views, run: Run) -> Trimesh:
        """The hull, closed."""
        from .carving.silhouettes import Silhouettes

        return Silhouettes(views, run, self.beyond).mesh(self.resolution, run)
