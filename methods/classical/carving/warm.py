"""The compiled loops, loaded before the clock starts."""

from __future__ import annotations

import numpy as np

from bench import Run, Views


def load_compiled() -> None:
    """Load the loops of space carving from the cache, or compile them."""
    from .agreement import agreement
    from .rounds import Carver
    from .silhouettes import Silhouettes
    from .voxels import Voxels

    images, masks = np.zeros((1, 8, 8, 3), dtype=np.uint8), np.ones((1, 8, 8), dtype=bool)
    camera = np.array([[[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3]]]), np.array([[8.0, 0, 4], [0, 8, 4], [0, 0, 1]])
    lights = np.array([[[0.0, 0, -1]]]), np.ones((1, 1, 3))
    for views in (Views(images, masks, *camera), Views(images, masks, *camera, *lights)):
        silhouettes = Silhouettes(views, Run())
        voxels = Voxels.over(silhouettes, 8)
        Carver(silhouettes, voxels, agreement(views, 1.0, 1), 1.0, 1).carve(voxels.hull < 0, 1, Run())
