"""The sine network (SIREN), its value and its spatial gradient, with a backward pass written by hand.

    h_1 = sin(w (W_0 x + b_0)),   h_{k+1} = sin(w (W_k h_k + b_k)),   f = W_L h_L + b_L

Every loss of this family needs f and its gradient, and their derivatives with respect to the weights. Automatic
differentiation builds a graph of some sixty nodes for them, with a temporary for each; written by hand, the pass is
eighteen matrix products for three hidden layers, each written where the next reads it. Two thirds of them belong to
the backward pass, whose rounding is far below the noise of a batch: there, and only there, a processor may multiply
in bfloat16 (or a GPU in TF32).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch
from torch import Tensor, nn


class SineNetwork(nn.Module):
    """A scalar field on R^3: sine layers of one frequency, and a linear layer on top.

    Parameters
    ----------
    omega : float
        The frequency w, the same in all layers.
    hidden_layers : int
        Sine layers after the first one: 3 makes the four sine layers of the thesis.
    width : int
    generator : torch.Generator
        The weights are drawn from it, on the CPU: the same on every device.
    inputs : int
        Dimensions of x.
    mixed : bool
        Multiply matrices of the backward pass in reduced precision if the hardware does that faster; the forward
        pass, and so every value and every gradient that a loss sees, is in full float32.

    Notes
    -----
    Initialisation of Sitzmann et al. 2020: first W from U(+-1/inputs), all others, the last too, from
    U(+-sqrt(6/width)/w); biases from U(+-1/sqrt(fan_in)), the default of a linear layer, as in both released codes.
    """

    def __init__(
        self,
        omega: float,
        *,
        hidden_layers: int = 3,
        width: int = 256,
        generator: torch.Generator | None = None,
        inputs: int = 3,
        mixed: bool = True,
    ):
        super().__init__()
        self.omega, self.mixed = float(omega), mixed
        sizes = [inputs, *[width] * (hidden_layers + 1), 1]
        self.weights = nn.ParameterList()
        self.biases = nn.ParameterList()
        for layer, (fan_in, fan_out) in enumerate(zip(sizes, sizes[1:], strict=False)):
            bound = 1 / fan_in if layer == 0 else math.sqrt(6 / fan_in) / omega
            self.weights.append(_uniform((fan_out, fan_in), bound, generator))
            self.biases.append(_uniform((fan_out,), 1 / math.sqrt(fan_in), generator))

    def forward(self, x: Tensor) -> Tensor:
        """The value at x: (n, inputs) -> (n,)."""
        h, *_ = self._features(x)
        return torch.addmv(self.biases[-1], h, self.weights[-1][0])

    def _features(self, x: Tensor) -> tuple[Tensor, ...]:
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            x = torch.addmm(bias, x, weight.t(), beta=self.omega, alpha=self.omega).sin()
        return (x,)

    def value_and_gradient(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Value (n,) and gradient by x (n, inputs); both can be differentiated once, by the weights and by x."""
        return _ValueAndGradient.apply(x, self.omega, self.mixed, *self.weights, *self.biases)


def _uniform(shape: tuple[int, ...], bound: float, generator: torch.Generator | None) -> nn.Parameter:
    return nn.Parameter(torch.empty(shape).uniform_(-bound, bound, generator=generator))


@contextmanager
def reduced_precision(device: torch.device, wanted: bool = True) -> Iterator[None]:
    """Products of float32 matrices in bfloat16 (CPU) or TF32 (GPU), summed in float32, where the hardware has them."""
    before = torch.get_float32_matmul_precision()
    if wanted:
        torch.set_float32_matmul_precision("medium" if device.type == "cpu" else "high")
    try:
        yield
    finally:
        torch.set_float32_matmul_precision(before)


class _ValueAndGradient(torch.autograd.Function):
    """f and g = df/dx of a sine network.

    Forward, with a_k = w cos(w z_k), the derivative of h_k by z_k:
        u_L = W_L,  s_k = u_k * a_k,  u_{k-1} = s_k W_{k-1},  g = s_1 W_0.
    Backward, for given adjoints df and dg, first along g's way (upwards through the layers), then along f's
    (downwards); da_k/dz_k = -w^2 h_k.
    """

    @staticmethod
    def forward(ctx: Any, x: Tensor, omega: float, mixed: bool, *parameters: Tensor) -> tuple[Tensor, Tensor]:
        layers = len(parameters) // 2
        W, b = parameters[:layers], parameters[layers:]
        h, a = [x], []
        for k in range(layers - 1):
            z = torch.addmm(b[k], h[-1], W[k].t(), beta=omega, alpha=omega)
            a.append(z.cos().mul_(omega))
            h.append(z.sin_())
        f = torch.addmv(b[-1], h[-1], W[-1][0])
        s = [a[-1] * W[-1]]
        u: list[Tensor] = []  # u[k], below the top
        for k in range(layers - 2, 0, -1):
            u.append(s[-1] @ W[k])
            s.append(u[-1] * a[k - 1])
        g = s[-1] @ W[0]
        s.reverse()
        u.reverse()
        ctx.omega, ctx.mixed, ctx.layers = omega, mixed, layers
        ctx.save_for_backward(*parameters, *h, *a, *s, *u)
        return f, g

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, df: Tensor, dg: Tensor) -> tuple[Tensor | None, ...]:
        with reduced_precision(df.device, ctx.mixed):
            return _backward(ctx, df, dg)


def _backward(ctx: Any, df: Tensor, dg: Tensor) -> tuple[Tensor | None, ...]:
    omega, layers = ctx.omega, ctx.layers
    saved = ctx.saved_tensors
    W, saved = saved[:layers], saved[2 * layers :]
    h, saved = saved[:layers], saved[layers:]
    a, saved = saved[: layers - 1], saved[layers - 1 :]
    s, u = saved[: layers - 1], saved[layers - 1 :]
    by_weights = any(ctx.needs_input_grad[3 : 3 + layers])
    dW: list[Tensor | None] = [None] * layers
    db: list[Tensor | None] = [None] * layers
    along_g: list[Tensor] = []  # the part of dW that comes through g, below the top first

    # Along g's way: ds_1 = dg W_0^T, du_k = ds_k * a_k, ds_{k+1} = du_k W_k^T.
    if by_weights:
        along_g.append(s[0].t() @ dg)
    ds = dg @ W[0].t()
    da = []
    for k in range(layers - 1):
        top = k == layers - 2
        da.append(ds * (W[-1] if top else u[k]))
        du = ds.mul_(a[k])
        if top:
            if by_weights:
                along_g.append(du.sum(0, keepdim=True))
            break
        if by_weights:
            along_g.append(s[k + 1].t() @ du)
        ds = du @ W[k + 1].t()

    # Along f's way: dz_k = dh_k * a_k - w^2 h_k * da_k.
    if by_weights:
        dW[-1] = torch.addmm(along_g.pop(), df[None], h[-1])
        db[-1] = df.sum(0, keepdim=True)
    dh = df[:, None] * W[-1]
    for k in range(layers - 2, -1, -1):
        dz = dh.mul_(a[k]).addcmul_(da[k], h[k + 1], value=-(omega**2))
        # a holds the derivative by the unscaled sum, so dz is the adjoint of W h + b.
        if by_weights:
            dW[k] = torch.addmm(along_g.pop(), dz.t(), h[k])
            db[k] = dz.sum(0)
        if k > 0 or ctx.needs_input_grad[0]:
            dh = dz @ W[k]
    return (dh if ctx.needs_input_grad[0] else None, None, None, *dW, *db)
