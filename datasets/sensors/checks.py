"""Checks of the sensors' parameters, with uniform messages."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def expect(holds: bool, name: str, expected: str, got: object) -> None:
    """Raise :class:`ValueError` naming a parameter unless ``holds``."""
    if not holds:
        raise ValueError(f"{name}: expected {expected}, got {got!r}")


def expect_count(name: str, value: int, least: int = 1) -> None:
    """A whole number of at least ``least``."""
    expect(isinstance(value, int) and value >= least, name, f"a whole number of at least {least}", value)


def expect_length(name: str, value: float) -> None:
    """A length or deviation: finite, 0 or more."""
    expect(0 <= value < np.inf, name, "0 or more", value)


def expect_positive(name: str, value: float) -> None:
    """Finite and above 0."""
    expect(0 < value < np.inf, name, "more than 0", value)


def expect_fraction(name: str, value: float) -> None:
    """A share of the points that leaves some of them: 0 <= value < 1."""
    expect(0 <= value < 1, name, "0 or more and less than 1", value)


def expect_choice(name: str, value: str, choices: Sequence[str]) -> None:
    """One of some words."""
    expect(value in choices, name, f"one of {', '.join(choices)}", value)


def expect_direction(name: str, value: Sequence[float] | None) -> None:
    """Three numbers that are not all 0, or None."""
    if value is not None:
        numbers = len(value) == 3 and all(isinstance(v, (int, float)) for v in value)
        expect(numbers and 0 < float(np.linalg.norm(value)) < np.inf, name, "three numbers, not all 0", value)
