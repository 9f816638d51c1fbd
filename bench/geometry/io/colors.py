"""Colours as files store them: fractions of 1, of 255 or of 65535."""

from __future__ import annotations

import numpy as np


def color_scale(triple: np.ndarray, *, named: bool = False, integers: bool = False) -> float:
    """The divisor that turns three columns (n, 3) into colours in 0..1; 0 if they are not colours.

    Eight bits that are stored in fields of sixteen are eight bits. Columns that are ``named`` colours may be constant,
    or means of several. ``integers`` says that the file stores whole numbers, of which 0 and 1 are dark.
    """
    known = triple[np.isfinite(triple).all(axis=1)]
    if not len(known) or known.min() < 0:
        return 0.0
    largest, is_whole = known.max(), bool((known == np.rint(known)).all())
    if largest <= 1 and not integers:
        return 1.0 if named or not is_whole else 0.0
    for most in (255.0, 65535.0):
        if largest <= most and (is_whole or named):
            return most
    return 0.0


def colors_of(triple: np.ndarray, *, integers: bool = False) -> np.ndarray:
    """Columns (n, 3) that are named colours, as fractions of 1, float64; values that fit no scale are unchanged."""
    return np.asarray(triple, dtype=np.float64) / (color_scale(triple, named=True, integers=integers) or 1)
