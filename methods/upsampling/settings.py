"""Checks of the parameters that learned upsamplers share."""

from __future__ import annotations

from typing import Any


def check_training(method: Any, scans: int = 2) -> None:
    """Refuse invalid parameters of a training.

    Parameters
    ----------
    method : a learned upsampler
    scans : int
        The least number of sensors, if it is trained on scans.

    Raises
    ------
    ValueError
        Naming the parameter and what is expected.
    """
    for name, least in (("steps", 0), ("batch", 1), ("central", 0)):
        if getattr(method, name, least) < least:
            raise ValueError(f"{name}: expected at least {least}, got {getattr(method, name)}")
    if method.points < 8:
        raise ValueError(f"points: expected at least 8, got {method.points}")
    for name in ("learning_rate", "decay", "overlap", "tolerance"):
        if hasattr(method, name) and not getattr(method, name) > 0:
            raise ValueError(f"{name}: expected a number above 0, got {getattr(method, name)}")
    for name in ("noise", "jitter", "shift", "scale"):
        if not getattr(method, name, 0) >= 0:
            raise ValueError(f"{name}: expected at least 0, got {getattr(method, name)}")
    if not getattr(method, "scale", 0) < 1:
        raise ValueError(f"scale: expected less than 1, got {method.scale}")
    if method.scans and len(method.scans) < scans:
        raise ValueError(f"scans: expected at least {scans} sensors, got {len(method.scans)}")
    if not method.scans and (not method.bases or min(method.bases) < 0):
        raise ValueError(f"bases: expected counts of points, got {method.bases}")
