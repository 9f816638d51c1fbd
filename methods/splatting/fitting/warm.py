"""The compiled loops, loaded before the clock starts."""

from __future__ import annotations

import numpy as np


def load_compiled() -> None:
    """Load the loops of the renderer and of the regularisers from the cache, or compile them."""
    from ..regularisers.settings import Regularity
    from ..regularisers.terms import Neighbours
    from ..renderer.camera import Camera
    from ..renderer.drawn import draw
    from ..renderer.settings import Drawing

    camera = Camera.looking_at(np.array([0.0, 0, -2]), np.zeros(3), np.array([0.0, 1, 0]), 8.0, 8, 8)
    points = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.1, 0.1, 0]])
    normals = np.tile([0.0, 0, -1], (4, 1))
    for gradient in ("dss", "rbf"):
        drawn = draw(points, normals, np.ones((4, 3)), 0.1, camera, Drawing(gradient=gradient))
        drawn.position_gradient(-np.ones((8, 8, 3)))
        drawn.attribute_gradient(np.ones((8, 8, 3)))
    around = Neighbours(points, Regularity(neighbours=3))
    around.repulsion(points, normals, np.zeros(4))
    around.projected(points, normals, np.zeros(4))
