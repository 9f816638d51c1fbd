"""The compiled loops, loaded before the clock starts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..raster.scene import Drawn, Scene


def load_compiled(draw: Callable[[Scene], Drawn]) -> None:
    """Load the loops of a renderer from the cache, or compile them."""
    screen = np.array([[1.0, 1, 2], [6, 2, 2], [2, 6, 2]])
    scene = Scene(screen, np.array([[0, 1, 2]]), np.ones((1, 3)), 8, 8, 3.0)
    draw(scene).backward(np.ones((8, 8, 4)))
