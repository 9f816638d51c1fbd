"""Colours as files store them: fractions of 1, of 255 or of 65535."""

from __future__ import annotations

import numpy as np


def between_0_and_1(colors: np.ndarray, whole: bool = False) -> np.ndarray:
    """Colours (n, 3) as fractions of 1, float64.

    Whole numbers up to 255, or up to 65535, are fractions of these; ``whole`` says that the file stores whole numbers,
    of which 0 and 1 are dark. Where all are 0 or 1 otherwise, they are fractions of 1. What fits nothing stays.
    """
    colors = np.asarray(colors, dtype=np.float64)
    most = colors.max(initial=0.0)
    if not (whole or most > 1) or not (colors.min(initial=0.0) >= 0 and (colors == np.rint(colors)).all()):
        return colors
    return colors / next((full for full in (255, 65535) if most <= full), 1)
