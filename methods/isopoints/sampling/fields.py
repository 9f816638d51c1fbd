"""The sampled fields: functions with values and gradients."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import torch
from torch import Tensor

PART = 4096  # points that are evaluated at once: their features stay in the cache


class Differentiable(Protocol):
    """A scalar field on R^3 that reports its gradient."""

    def value_and_gradient(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Values (n,) and gradients (n, 3) at points (n, 3)."""
        ...


class ByAutograd:
    """Any function of points (n, 3) to values (n,), differentiated automatically.

    Parameters
    ----------
    function : callable
        A field of the bench, or a closed form; the value at a point must not depend on the other points.
    """

    def __init__(self, function: Callable[[Tensor], Tensor]):
        self._function = function

    def value_and_gradient(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Values (n,) and gradients (n, 3), both without a graph."""
        with torch.enable_grad():
            x = x.detach().requires_grad_()
            values = self._function(x)
            (gradient,) = torch.autograd.grad(values.sum(), x)
        return values.detach(), gradient


def differentiable(field: object) -> Differentiable:
    """The field itself, or the network that it consists of, where they report gradients; otherwise by autograd."""
    for candidate in (field, getattr(field, "network", None)):
        if hasattr(candidate, "value_and_gradient"):
            return candidate
    return ByAutograd(field)  # type: ignore[arg-type]


def evaluated(field: Differentiable, x: Tensor) -> tuple[Tensor, Tensor]:
    """Values and gradients of many points, in parts that fit a processor's cache (whole on a GPU)."""
    with torch.no_grad():
        values, gradients = zip(*(field.value_and_gradient(part) for part in _parts(x)), strict=True)
    return torch.cat(values), torch.cat(gradients)


def values_at(function: Callable[[Tensor], Tensor], x: Tensor) -> Tensor:
    """Values (n,) of a function of points (n, 3), in the same parts."""
    return torch.cat([function(part) for part in _parts(x)])


def _parts(x: Tensor) -> tuple[Tensor, ...]:
    return x.split(PART if x.device.type == "cpu" else 1 << 18)
