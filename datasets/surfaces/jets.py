"""Jets: a function of (u, v) with its exact derivatives up to third order, carried through arithmetic.

So a surface that is written once, as a formula, has closed-form tangents and curvatures. A jet is the truncated Taylor
polynomial ``sum of c_ij du^i dv^j over i + j <= order`` at each of n places; products truncate, and a function of one
variable is composed by its own Taylor polynomial.
"""

from __future__ import annotations

from math import factorial

import numpy as np

TERMS = [(total - j, j) for total in range(4) for j in range(total + 1)]  # (i, j) of du^i dv^j, by total degree
_INDEX = {term: k for k, term in enumerate(TERMS)}
_COUNTS = (1, 3, 6, 10)  # of terms up to each order
_PRODUCTS = [[(a, b, _INDEX[i + k, j + m]) for a, (i, j) in enumerate(TERMS) for b, (k, m) in enumerate(TERMS)
              if i + j + k + m <= order] for order in range(4)]  # fmt: skip
NEAR_ZERO = 1e-12  # derivatives of |x|^p that are infinite at 0 are evaluated here instead


class Jet:
    """Taylor coefficients ``c`` (terms, ..., n) of a scalar (..., = nothing) or of a vector (..., = 3) function."""

    __slots__ = ("c",)
    __array_ufunc__ = None  # numpy must leave array * jet to the jet

    def __init__(self, c: np.ndarray):
        self.c = c

    @staticmethod
    def variables(u: np.ndarray, v: np.ndarray, order: int) -> tuple[Jet, Jet]:
        """The functions u and v themselves at (u, v), two (n,) arrays."""
        jets = []
        for k, values in enumerate((u, v)):
            c = np.zeros((_COUNTS[order], len(values)))
            c[0] = values
            if order:
                c[1 + k] = 1
            jets.append(Jet(c))
        return jets[0], jets[1]

    @property
    def order(self) -> int:
        """The highest total degree that is known."""
        return _COUNTS.index(len(self.c))

    @property
    def value(self) -> np.ndarray:
        """The function itself, (..., n)."""
        return self.c[0]

    def truncate(self, order: int) -> Jet:
        """The same function, known to a lower order."""
        return Jet(self.c[: _COUNTS[order]])

    def derivative(self, k: int) -> Jet:
        """The partial derivative by u (k = 0) or by v (k = 1), of one order less."""
        rows = []
        for i, j in TERMS[: _COUNTS[self.order - 1]]:
            raised = (i + 1, j) if k == 0 else (i, j + 1)
            rows.append(raised[k] * self.c[_INDEX[raised]])
        return Jet(np.stack(rows))

    def __getitem__(self, k: int) -> Jet:
        return Jet(self.c[:, k])

    def __add__(self, other: Jet | float | np.ndarray) -> Jet:
        if isinstance(other, Jet):
            terms = min(len(self.c), len(other.c))
            return Jet(self.c[:terms] + other.c[:terms])
        first = self.c[0] + other
        c = np.empty((len(self.c), *first.shape))
        c[0], c[1:] = first, self.c[1:]
        return Jet(c)

    __radd__ = __add__

    def __neg__(self) -> Jet:
        return Jet(-self.c)

    def __sub__(self, other: Jet | float | np.ndarray) -> Jet:
        return self + (-other)

    def __rsub__(self, other: float | np.ndarray) -> Jet:
        return -self + other

    def __mul__(self, other: Jet | float | np.ndarray) -> Jet:
        if not isinstance(other, Jet):
            return Jet(self.c * other)
        order = min(self.order, other.order)
        shape = np.broadcast_shapes(self.c.shape[1:], other.c.shape[1:])
        c = np.zeros((_COUNTS[order], *shape))
        for a, b, k in _PRODUCTS[order]:
            c[k] += self.c[a] * other.c[b]
        return Jet(c)

    __rmul__ = __mul__

    def __truediv__(self, other: Jet | float) -> Jet:
        return self * (other**-1.0 if isinstance(other, Jet) else 1 / other)

    def __rtruediv__(self, other: float) -> Jet:
        return other * self**-1.0

    def __pow__(self, p: float) -> Jet:
        """x^p of a positive function (of any function, where p is a whole number >= 0)."""
        return self.compose(*(_binomial(p, k) * self.c[0] ** (p - k) if _binomial(p, k) else 0.0 * self.c[0]
                              for k in range(self.order + 1)))  # fmt: skip

    def compose(self, *taylor: np.ndarray) -> Jet:
        """f(self), where ``taylor`` holds f, f', f''/2, f'''/6 at the values of self, as many as its order needs."""
        rest = Jet(np.concatenate([np.zeros_like(self.c[:1]), self.c[1:]]))
        result = Jet(np.zeros_like(self.c)) + taylor[self.order]
        for k in range(self.order - 1, -1, -1):
            result = result * rest + taylor[k]
        return result


def _binomial(p: float, k: int) -> float:
    return float(np.prod([(p - m) / (m + 1) for m in range(k)]))


def sin(x: Jet) -> Jet:
    """The sine."""
    s, c = np.sin(x.value), np.cos(x.value)
    return x.compose(s, c, -s / 2, -c / 6)


def cos(x: Jet) -> Jet:
    """The cosine."""
    s, c = np.sin(x.value), np.cos(x.value)
    return x.compose(c, -s, -c / 2, s / 6)


def exp(x: Jet) -> Jet:
    """The exponential."""
    e = np.exp(x.value)
    return x.compose(e, e, e / 2, e / 6)


def abs_power(x: Jet, p: float) -> Jet:
    """|x|^p for p >= 1."""
    size, sign = np.abs(x.value), np.where(x.value < 0, -1.0, 1.0)
    safe = np.maximum(size, NEAR_ZERO)
    higher = (_binomial(p, k) * safe ** (p - k) * sign**k for k in range(1, x.order + 1))
    return x.compose(size**p, *higher)


def smooth_step(x: Jet) -> Jet:
    """0 for x <= 0, 1 for x >= 1, between them ``35 x^4 - 84 x^5 + 70 x^6 - 20 x^7``: three continuous derivatives."""
    inside = (x.value > 0) & (x.value < 1)
    polynomial = np.polynomial.Polynomial([0, 0, 0, 0, 35, -84, 70, -20])
    t = np.clip(x.value, 0, 1)
    return x.compose(
        *(np.where(inside | (k == 0), polynomial.deriv(k)(t) if k else polynomial(t), 0.0) / factorial(k)
          for k in range(x.order + 1))
    )  # fmt: skip


def stack(x: Jet | float, y: Jet | float, z: Jet | float) -> Jet:
    """The vector function (x, y, z); at least one of the three is a jet."""
    terms = min(len(part.c) for part in (x, y, z) if isinstance(part, Jet))
    like = next(part for part in (x, y, z) if isinstance(part, Jet))
    parts = [part if isinstance(part, Jet) else Jet(np.zeros_like(like.c)) + part for part in (x, y, z)]
    return Jet(np.stack([part.c[:terms] for part in parts], axis=1))


def dot(a: Jet, b: Jet) -> Jet:
    """The inner product of two vector functions."""
    return Jet((a * b).c.sum(axis=1))


def cross(a: Jet, b: Jet) -> Jet:
    """The cross product of two vector functions."""
    return stack(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def normalize(a: Jet) -> Jet:
    """The unit vector along a vector function without zeros."""
    return a * dot(a, a) ** -0.5


def unit_normal(x: Jet) -> Jet:
    """``x_u`` cross ``x_v`` over its length, of one order less than the surface x."""
    return normalize(cross(x.derivative(0), x.derivative(1)))
