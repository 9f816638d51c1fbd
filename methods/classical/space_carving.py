"""Voxels of the visual hull, carved until the views agree on the colours of the remaining ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench import Run, Views, register

if TYPE_CHECKING:
    from trimesh import Trimesh


@register("method", cite="Kutulakos and Seitz 2000", requires=("scipy", "skimage", "numba"))
@dataclass(frozen=True)
class SpaceCarving:
    """Space carving: voxels of the visual hull are taken from its surface until the views agree on those left.

    In rounds, every voxel of the surface is looked up in the images of the views that see it, by depth buffers of the
    surface. It is carved if the views disagree. Under known lights they agree if one unit normal explains the
    colours, by diffuse shading ``ambient + sum_k max(0, n . l_k) color_k``; a view is explained if a pixel within
    ``reach`` is, as in the approximate space carving of Kutulakos (2000), and ``share`` of the views have to be.
    Without lights, they agree if the standard deviation of the colours is below the tolerance, as in voxel colouring
    (Seitz and Dyer 1999). Unlike there, a voxel that is the last one at some pixel of a mask is kept: so the masks stay
    reproduced, and carving does not continue along a sharp edge. Flat parts of one colour are a limitation: a voxel in
    front of a plane agrees in all views.

    The surface has the precision of the hull's field where nothing was carved, and of smoothed voxels elsewhere. If the
    carved shape has less than ``least_left`` of the hull's volume, the colours do not fit (other lights, a shiny
    surface), and the hull is returned, with a note.
    """

    cells: int = 128  # voxels along the longest side of the hull; memory grows with the cube
    tolerance: float = 0.04  # RMS error of a colour, 0 to 1, up to which views agree
    share: float = 0.9  # of the views of a voxel that have to agree, the best ones
    reach: int = 1  # pixels around the voxel's own in which a view may show its colour
    views: int = 2  # that must see a voxel before it may be carved
    rounds: int = 500  # at most; carving ends when no voxel is removed
    least_left: float = 0.02  # share of the hull's volume; if less remains, the hull is returned

    def __post_init__(self) -> None:
        for name, least in (("cells", 8), ("reach", 0), ("views", 2), ("rounds", 0)):
            if getattr(self, name) < least:
                raise ValueError(f"{name}: expected at least {least}, got {getattr(self, name)}")
        if self.cells > 1024:
            raise ValueError(f"cells: expected at most 1024, got {self.cells}: their number is cubed")
        if not self.tolerance >= 0:
            raise ValueError(f"tolerance: expected at least 0, got {self.tolerance}")
        if not 0 < self.share <= 1:
            raise ValueError(f"share: expected above 0 and at most 1, got {self.share}")
        if not 0 <= self.least_left <= 1:
            raise ValueError(f"least_left: expected 0 to 1, got {self.least_left}")

    def prepare(self) -> None:
        """Load the compiled loops, or compile them."""
        from .carving.warm import load_compiled

        load_compiled()

    def multiview(self, views: Views, run: Run) -> Trimesh:
        """A closed mesh."""
        from .carving.agreement import agreement
        from .carving.rounds import Carver
        from .carving.silhouettes import Silhouettes
        from .carving.surface import surface
        from .carving.voxels import Voxels

        silhouettes = Silhouettes(views, run)
        voxels = Voxels.over(silhouettes, self.cells)
        hull = voxels.hull < 0
        error = agreement(silhouettes.views, self.share, self.reach)
        carver = Carver(silhouettes, voxels, error, self.tolerance, self.views)
        filled = carver.carve(hull, self.rounds, run)
        if (left := filled.sum() / hull.sum()) < self.least_left:
            run.note(
                f"space_carving: the colours leave {left:.1%} of the visual hull, which is returned instead; try a "
                f"higher tolerance than {self.tolerance:g}"
            )
            filled = hull
        return surface(voxels, filled)
