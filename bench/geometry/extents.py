"""Whether two sets of points can be in the same coordinates: the message if their units or places differ."""

from __future__ import annotations

import numpy as np

UNLIKE = 10.0  # extents that differ by more are not of the same object
# The likely meanings of a factor, if the larger numbers are in the smaller unit; within NEAR of it.
FACTORS = {
    1000: "millimetres against metres",
    100: "centimetres against metres",
    25.4: "millimetres against inches",
    39.37: "inches against metres",
    304.8: "millimetres against feet",
    30.48: "centimetres against feet",
    12: "inches against feet",
}
NEAR = 0.1


def unlike(points: np.ndarray, name: str, others: np.ndarray, other: str) -> str:
    """The message if two sets of points, (n, 3) and (m, 3), have very different sizes or places.

    Sizes are those of the boxes of the inner 90 % along each axis, which some far points do not move.
    """
    if not (len(points) and len(others)):
        return ""
    said = _sizes(points, name, others, other)
    apart = (points.min(axis=0) > others.max(axis=0)) | (points.max(axis=0) < others.min(axis=0))
    if apart.any():
        said.append(f"the boxes of {name} and {other} do not overlap; are they in the same coordinates?")
    return "; ".join(said)


def _sizes(points: np.ndarray, name: str, others: np.ndarray, other: str) -> list[str]:
    inner = (np.quantile(p, (0.05, 0.95), axis=0) for p in (points, others))
    size, other_size = (float(np.linalg.norm(high - low)) for low, high in inner)
    if not (size > 0 and other_size > 0):
        return []
    factor = max(size, other_size) / min(size, other_size)
    if factor <= UNLIKE:
        return []
    large, small = (name, other) if size > other_size else (other, name)
    likely = min(FACTORS, key=lambda known: abs(factor / known - 1))
    guess = f" ({FACTORS[likely]}?)" if abs(factor / likely - 1) < NEAR else ""
    shown = f"{factor:,.0f}" if factor >= 100 else f"{factor:.3g}"
    return [f"{large} is about {shown} times as large as {small}{guess}; expected both in the same units: scale one"]
