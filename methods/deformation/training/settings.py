"""Checks of the parameters that learned deformers share."""

from __future__ import annotations

from typing import Any

from .pairs import COUNT

MOST = COUNT // 2  # points: a training has two samples of each shape


def check_training(method: Any) -> None:
    """Refuse invalid parameters of a training.

    Raises
    ------
    ValueError
        Naming the parameter and what is expected.
    """
    if not 8 <= method.points <= MOST:
        raise ValueError(f"points: expected 8 to {MOST}, got {method.points}")
    for name, least in (("steps", 0), ("batch", 1)):
        if getattr(method, name) < least:
            raise ValueError(f"{name}: expected at least {least}, got {getattr(method, name)}")
    for name in ("learning_rate", "decay"):
        if not getattr(method, name) > 0:
            raise ValueError(f"{name}: expected a number above 0, got {getattr(method, name)}")
    if not 0 < getattr(method, "width", 1.0) <= 1:
        raise ValueError(f"width: expected a number above 0, up to 1, got {method.width}")
    if not 0 <= method.scale < 1:
        raise ValueError(f"scale: expected 0 or more, below 1, got {method.scale}")
    if not 0 <= method.strangers <= 1:
        raise ValueError(f"strangers: expected a share, 0 to 1, got {method.strangers}")


def check_weights(method: Any, names: tuple[str, ...]) -> None:
    """Refuse weights of terms below 0; raises :class:`ValueError`, naming the weight."""
    for name in names:
        if not getattr(method, name) >= 0:
            raise ValueError(f"{name}: expected at least 0, got {getattr(method, name)}")
