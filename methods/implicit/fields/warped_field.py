"""D-SDF: a field evaluated at points displaced by a second network."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ..losses.oriented import OrientedLoss
from .supervised_field import SupervisedField


class ReluNetwork(nn.Module):
    """ReLU layers on the positional encoding (x, sin(2^k x), cos(2^k x))_k, k = 0 to bands - 1, with a skip connection.

    As in NeRF and D-NeRF, the encoding is concatenated to the output of layer ``layers // 2 + 1`` (the fifth of eight),
    and the output is linear. Weights and biases come from U(+-1/sqrt(fan_in)), a linear layer's default.
    """

    frequencies: Tensor

    def __init__(
        self,
        outputs: int,
        *,
        bands: int = 10,
        layers: int = 8,
        width: int = 256,
        generator: torch.Generator | None = None,
    ):
        super().__init__()
        encoded = 3 * (1 + 2 * bands)
        self.joined = layers // 2 + 1  # the layer that reads the encoding again
        self.register_buffer("frequencies", 2.0 ** torch.arange(bands), persistent=False)
        self.weights, self.biases = nn.ParameterList(), nn.ParameterList()
        for layer in range(layers + 1):
            fan_in = encoded if layer == 0 else width + encoded * (layer == self.joined)
            fan_out = outputs if layer == layers else width
            bound = 1 / math.sqrt(fan_in)
            for shape, into in (((fan_out, fan_in), self.weights), ((fan_out,), self.biases)):
                into.append(nn.Parameter(torch.empty(shape).uniform_(-bound, bound, generator=generator)))

    def forward(self, x: Tensor) -> Tensor:
        """(n, 3) -> (n, outputs)."""
        angles = x[:, None] * self.frequencies[:, None]
        e = h = torch.cat([x[:, None], angles.sin(), angles.cos()], 1).flatten(1)
        last = len(self.weights) - 1
        for k, (W, b) in enumerate(zip(self.weights, self.biases, strict=True)):
            h = F.linear(torch.cat([e, h], 1) if k == self.joined else h, W, b)
            h = h if k == last else h.relu_()
        return h


class WarpedField(SupervisedField):
    """f^(x) = f(x + Delta(x)), Delta in R^3, unbounded."""

    def __init__(self, loss: OrientedLoss, base: ReluNetwork, warp: ReluNetwork):
        super().__init__(loss)
        self.base, self.warp = base, warp

    def forward(self, x: Tensor) -> Tensor:
        """f^ at (n, 3) points."""
        return self.base(x + self.warp(x))[:, 0]

    def value_and_gradient(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """f^ (n,) and its gradient (n, 3), by automatic differentiation; differentiable by the parameters."""
        wanted = torch.is_grad_enabled()
        with torch.enable_grad():
            x = x.detach().requires_grad_()
            f = self(x)
            (gradient,) = torch.autograd.grad(f.sum(), x, create_graph=wanted)
        return (f, gradient) if wanted else (f.detach(), gradient)
