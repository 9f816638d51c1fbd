"""The compiled loops, loaded before the clock starts."""

from __future__ import annotations

import numpy as np


def load_compiled() -> None:
    """Load the loops from the cache, or compile them."""
    from ..renderer.camera import Camera
    from .losses import Weighting, loss_of
    from .rendering import render
    from .state import State

    camera = Camera.looking_at(np.array([0.0, 0, -2]), np.zeros(3), np.array([0.0, 1, 0]), 8.0, 8, 8)
    state = State(np.zeros((1, 3)), np.array([[0.0, 0, -1]]), 0.5, 0.9)
    rendered = render(state.surfels(), np.ones((1, 3)), camera)
    mask = np.ones((8, 8), dtype=bool)
    rendered.back(loss_of(rendered.maps, np.zeros((8, 8, 3)), mask, camera, Weighting(1.0, 1.0, 1.0))[1])
