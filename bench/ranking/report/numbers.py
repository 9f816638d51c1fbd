"""Numbers as a reader wants them: no more digits than the interval supports."""

from __future__ import annotations

import math
from collections.abc import Iterable


def unit_exponent(values: Iterable[float]) -> int:
    """The power of ten, a multiple of three, to take out of a column; 0 if the numbers read well as they are.

    Example
    -------
    >>> unit_exponent([0.0021, 0.0034, 0.4])
    -3
    >>> unit_exponent([0.97, 0.5])
    0
    """
    sizes = sorted(abs(v) for v in values if math.isfinite(v) and v != 0)
    if not sizes:
        return 0
    middle = sizes[(len(sizes) - 1) // 2]
    # From 0.1 to 100 of the unit: 0.72 (1e-3) rather than 720 (1e-6).
    return 0 if 0.1 <= middle < 1e5 else 3 * math.floor((math.log10(middle) + 1) / 3)


def decimals(value: float, low: float, high: float) -> int:
    """How many digits after the point: two of the interval's half width, three of the value if there is none."""
    half = (high - low) / 2
    if math.isfinite(half) and half > 0:
        wanted = 1 - math.floor(math.log10(half))
        most = 4 - _magnitude(value)  # a tiny interval does not call for ten digits
        return max(0, min(wanted, most))
    return max(0, min(2 - _magnitude(value), 4)) if value != int(value) else 0


def column_digits(intervals: Iterable[tuple[float, float, float]], exponent: int = 0) -> int:
    """Decimals for a column: those that most of its intervals support, and two digits of the smallest mean.

    Example
    -------
    >>> column_digits([(3.9, 2.8, 9.9), (4.3, 2.8, 8.0), (13.0, 5.0, 58.0)])
    1
    """
    shown = [tuple(x / 10.0**exponent for x in one) for one in intervals if math.isfinite(one[0])]
    if not shown:
        return 0
    usual = sorted(decimals(*one) for one in shown)[(len(shown) - 1) // 2]
    smallest = min((abs(mean) for mean, _, _ in shown if mean), default=1.0)
    whole = all(mean == int(mean) for mean, _, _ in shown) and usual == 0
    return usual if whole else max(usual, min(1 - _magnitude(smallest), 4))


def parts_with_interval(
    value: float, low: float, high: float, exponent: int, digits: int | None, style: str
) -> tuple[str, str]:
    """A mean with its interval as ``style`` has it, see :data:`look.INTERVALS`, and the text in a line below.

    Example
    -------
    >>> parts_with_interval(3.2, 2.1, 4.3, 0, 1, "below")
    ('3.2', '[2.1, 4.3]')
    >>> parts_with_interval(3.2, 2.1, 4.3, 0, 1, "plusminus")
    ('3.2 ± 1.1', '')
    """
    text = with_interval(value, low, high, exponent, digits)
    mean, _, interval = text.partition(" ")
    if style == "inside" or not interval:
        return text, ""
    if style == "plusminus":
        half = (high - low) / 2 / 10.0**exponent
        return f"{mean} ± {_fixed(half, decimals(value, low, high) if digits is None else digits)}", ""
    return mean, interval if style == "below" else ""


def with_interval(value: float, low: float, high: float, exponent: int = 0, digits: int | None = None) -> str:
    """``12.3 [11.0, 14.0]``; ``-`` for nothing; only the value if the interval is unknown.

    ``digits`` after the point are those that the interval supports, unless a number of them is given.

    Example
    -------
    >>> with_interval(0.01234, 0.0110, 0.0140, exponent=-3)
    '12.3 [11.0, 14.0]'
    """
    if not math.isfinite(value):
        return "-"
    value, low, high = (x / 10.0**exponent for x in (value, low, high))
    if digits is None:
        digits = decimals(value, low, high)
    if not math.isfinite(low + high):
        return _fixed(value, digits)
    return f"{_fixed(value, digits)} [{_fixed(low, digits)}, {_fixed(high, digits)}]"


def plain(value: float, exponent: int = 0, digits: int | None = None) -> str:
    """Three significant digits, or ``digits`` after the point."""
    return with_interval(value, math.nan, math.nan, exponent, digits)


def count(value: float) -> str:
    """``1.3M`` for a number of parameters; ``-`` for none."""
    if not math.isfinite(value):
        return "-"
    for size, letter in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= size:
            return f"{value / size:.3g}{letter}"
    return f"{value:.0f}"


def _magnitude(value: float) -> int:
    return math.floor(math.log10(abs(value))) if value else 0


def _fixed(value: float, digits: int) -> str:
    text = f"{value:.{digits}f}"
    return text.removeprefix("-") if float(text) == 0 else text
