"""Checks of the parameters that learned denoisers share."""

from __future__ import annotations

from typing import Any


def check_training(method: Any) -> None:
    """Refuse invalid parameters of a training.

    Raises
    ------
    ValueError
        Naming the parameter and what is expected.
    """
    for name, least in (("steps", 0), ("batch", 1), ("points", 8)):
        if getattr(method, name) < least:
            raise ValueError(f"{name}: expected at least {least}, got {getattr(method, name)}")
    for name in ("learning_rate", "decay"):
        if not getattr(method, name) > 0:
            raise ValueError(f"{name}: expected a number above 0, got {getattr(method, name)}")
    if not 0 < method.noise[0] <= method.noise[1]:
        raise ValueError(f"noise: expected two numbers above 0, the smaller first, got {method.noise}")
    if not method.bases or min(method.bases) < 8 or list(method.bases) != sorted(method.bases):
        raise ValueError(f"bases: expected counts of at least 8 points, the smallest first, got {method.bases}")
