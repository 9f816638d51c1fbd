"""Sine networks with a condition: by FiLM, as in pi-GAN, or as further inputs."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from .sine_network import SineNetwork


class FilmNetwork(nn.Module):
    """A scalar function of a number f, conditioned on a vector c that a mapping network turns into modulations.

        h_i = sin((w + w/2 gamma_i) (W_i h_{i-1} + b_i) + beta_i),   h_0 = f

    The thesis (4.1.1) has the layer (1 + gamma/2) (W h + b) + beta; the released code, followed here, multiplies it by
    w except for the phase beta, which would otherwise turn thirty times as fast as the network's output.

    Parameters
    ----------
    condition : int
        Dimensions of c.
    width, layers : int
        Of the sine layers; the mapping network has three layers of the same width before its last.
    omega : float
    gain : float
        Of the weights of the mapping network's last layer at the beginning. pi-GAN and the released code have 0.25.
    generator : torch.Generator
        The weights are drawn from it, on the CPU.

    Notes
    -----
    Initialisation as in pi-GAN: the mapping network (Softplus) by Kaiming's normal with a slope of 0.2; the sine
    layers and the output from U(+-sqrt(6/width)/25), the first layer from U(+-1). For a condition of 19 numbers there
    are 76,416 parameters in the mapping network, and 18,913 in the other.
    """

    def __init__(
        self,
        condition: int = 19,
        *,
        width: int = 96,
        layers: int = 3,
        omega: float = 30.0,
        gain: float = 0.25,
        generator: torch.Generator | None = None,
    ):
        super().__init__()
        self.omega = float(omega)
        sizes = [condition, width, width, width, 2 * layers * width]
        mapping = [nn.Linear(*pair) for pair in zip(sizes, sizes[1:], strict=False)]
        sines = [nn.Linear(width if i else 1, width) for i in range(layers)]
        self.mapping, self.layers = nn.ModuleList(mapping), nn.ModuleList(sines)
        self.last = nn.Linear(width, 1)
        self._draw(mapping, sines, gain, generator)

    @torch.no_grad()
    def _draw(
        self, mapping: list[nn.Linear], sines: list[nn.Linear], gain: float, generator: torch.Generator | None
    ) -> None:
        def uniform(tensor: Tensor, bound: float) -> None:
            tensor.uniform_(-bound, bound, generator=generator)

        for layer in mapping:
            layer.weight.normal_(0, math.sqrt(2 / (1 + 0.2**2) / layer.in_features), generator=generator)
            uniform(layer.bias, 1 / math.sqrt(layer.in_features))
        mapping[-1].weight.mul_(gain)
        for layer in (*sines, self.last):
            uniform(layer.weight, 1.0 if layer is sines[0] else math.sqrt(6 / layer.in_features) / 25)
            uniform(layer.bias, 1 / math.sqrt(layer.in_features))

    def forward(self, c: Tensor, f: Tensor) -> Tensor:
        """The value (n,) for conditions (n, condition) and numbers (n,)."""
        for layer in self.mapping[:-1]:
            c = F.softplus(layer(c))
        gamma, beta = self.mapping[-1](c).chunk(2, dim=1)
        frequencies = (self.omega + self.omega / 2 * gamma).chunk(len(self.layers), dim=1)
        phases = beta.chunk(len(self.layers), dim=1)
        h = f[:, None]
        for layer, frequency, phase in zip(self.layers, frequencies, phases, strict=True):
            h = torch.sin(torch.addcmul(phase, frequency, layer(h)))
        return self.last(h)[:, 0]


class JoinedNetwork(nn.Module):
    """The same without mapping network and FiLM, for figure 4.11: one sine network of c and f side by side."""

    def __init__(
        self,
        condition: int = 19,
        *,
        width: int = 96,
        omega: float = 30.0,
        generator: torch.Generator | None = None,
    ):
        super().__init__()
        self.network = SineNetwork(omega, hidden_layers=3, width=width, generator=generator, inputs=condition + 1)

    def forward(self, c: Tensor, f: Tensor) -> Tensor:
        """The value (n,) for conditions (n, condition) and numbers (n,)."""
        return self.network(torch.cat([c, f[:, None]], dim=1))
