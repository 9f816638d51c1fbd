"""Seeding the global generators of random numbers."""

from __future__ import annotations

import random
import sys

import numpy as np


def seed_globals(seed: int) -> None:
    """Seed the global generators: our code never draws from them, but a method may, and must be repeatable."""
    random.seed(seed)
    np.random.seed(seed)  # noqa: NPY002
    if "torch" in sys.modules:
        sys.modules["torch"].manual_seed(seed)
    if "open3d" in sys.modules:
        sys.modules["open3d"].utility.random.seed(seed % 2**31)  # it takes no larger ones
