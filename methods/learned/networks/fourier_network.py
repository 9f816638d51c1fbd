"""A network of Softplus layers on Fourier features, its value and spatial gradient, with a hand-written backward pass.

    e = (x, w_k sin(2^k x), w_k cos(2^k x))_k,   h_0 = e,   h_{k+1} = softplus(W_k h_k + b_k),   f = W_L h_L + b_L

In the middle the encoded point e is concatenated to the features again. The window w opens the frequency bands one
after the other while the network is trained.
"""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor, nn

from ..training.schedules import cosine
from .sine_network import reduced_precision

SHARPNESS = 100.0  # beta of softplus(z) = log(1 + exp(beta z)) / beta


def window(t: float, bands: int, until: float) -> list[float]:
    """The weight of each band at progress ``t``: w_k = (1 - cos(pi clamp(a - k, 0, 1)))/2, a = (K - 1) t / until.

    This is the released code's: band k opens while a goes from k to k + 1, so that the last one begins to open at
    ``until`` and is open at ``until K/(K - 1)``, 0.914 for 0.8 and 8 bands.
    """
    a = (bands - 1) * t / until
    return [cosine(a - k, 0.0, 1.0) for k in range(bands)]


class FourierNetwork(nn.Module):
    """A scalar field on R^3 that begins as a sphere.

    Parameters
    ----------
    bands : int
        K frequencies 2^k, k = 0 to K - 1 (without a factor pi, as in the released code).
    hidden_layers, width : int
        Layer ``hidden_layers // 2``, counted from 0, reads the encoded point again; the one below is narrower by it.
    radius : float
        Of the sphere at the beginning.
    generator : torch.Generator
        The weights are drawn from it, on the CPU: the same on every device.
    mixed : bool
        Multiply matrices of the backward pass in reduced precision, see :class:`~.sine_network.SineNetwork`.

    Notes
    -----
    Geometric initialisation (Atzmon and Lipman 2020, Gropp et al. 2020): hidden W from N(0, 2/fan_out), b = 0; last
    W from N(sqrt(pi/fan_in), 1e-4^2), b = -radius, which makes f nearly |x| - radius. Columns that belong to sines and
    cosines are 0 in the first layer, and here also in the layer that concatenates them again: bands that have never
    been open then have no effect, and the initial field is a sphere whichever bands are open.
    """

    frequencies: Tensor
    window: Tensor

    def __init__(
        self,
        bands: int = 8,
        *,
        hidden_layers: int = 8,
        width: int = 256,
        radius: float = 0.6,
        generator: torch.Generator | None = None,
        mixed: bool = True,
    ):
        super().__init__()
        encoded = 3 * (1 + 2 * bands)
        if width <= encoded:
            raise ValueError(
                f"width: expected more than {encoded}, the encoded coordinates of {bands} bands, got {width}"
            )
        self.mixed, self.skip = mixed, hidden_layers // 2
        self.register_buffer("frequencies", 2.0 ** torch.arange(bands), persistent=False)
        # Stored with the weights: the fitted function includes this window.
        self.register_buffer("window", torch.ones(bands))
        self.weights, self.biases = nn.ParameterList(), nn.ParameterList()
        for layer in range(hidden_layers):
            fan_in = encoded if layer == 0 else width
            fan_out = width - encoded if layer + 1 == self.skip else width
            weight = torch.empty(fan_out, fan_in).normal_(0, math.sqrt(2 / fan_out), generator=generator)
            if layer in (0, self.skip):
                weight[:, fan_in - encoded + 3 :] = 0
            self.weights.append(nn.Parameter(weight))
            self.biases.append(nn.Parameter(torch.zeros(fan_out)))
        last = torch.empty(1, width).normal_(math.sqrt(math.pi / width), 1e-4, generator=generator)
        self.weights.append(nn.Parameter(last))
        self.biases.append(nn.Parameter(torch.full((1,), -radius)))

    def forward(self, x: Tensor) -> Tensor:
        """The value at x: (n, 3) -> (n,)."""
        e = h = SHARPNESS * self.encoded(x)[0]
        for k, (W, b) in enumerate(zip(self.weights[:-1], self.biases[:-1], strict=True)):
            h = _joined(h, e) if k == self.skip > 0 else h
            h = _softplus(torch.addmm(b, h, W.t(), beta=SHARPNESS))
        return torch.addmv(self.biases[-1], h, self.weights[-1][0], alpha=1 / SHARPNESS)

    def value_and_gradient(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Value (n,) and gradient by x (n, 3); both can be differentiated once, by the weights and by x."""
        e, slope = self.encoded(x)
        f, g = _ValueAndGradient.apply(e, self.skip, self.mixed, *self.weights, *self.biases)
        return f, (g * slope).unflatten(1, (-1, 3)).sum(1)

    def encoded(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """e (n, 3 + 6 K), and the derivative of each of its entries with respect to its own coordinate."""
        angles = x[:, None] * self.frequencies[:, None]
        sine, cosine = angles.sin(), angles.cos()
        w, speed = self.window[:, None], (self.window * self.frequencies)[:, None]
        e = torch.cat([x[:, None], w * sine, w * cosine], 1)
        slope = torch.cat([torch.ones_like(x)[:, None], speed * cosine, -speed * sine], 1)
        return e.flatten(1), slope.flatten(1)


def _softplus(z: Tensor) -> Tensor:
    """log(1 + exp(z)) = max(z, 0) + log(1 + exp(-|z|)); six vectorised passes: torch's softplus is not vectorised."""
    return z.abs().neg_().exp_().add_(1).log_().add_(z.clamp_min(0))


def _joined(h: Tensor, e: Tensor) -> Tensor:
    """Features and the encoded point, concatenated and scaled to the size of one of them."""
    return torch.cat([h, e], 1).mul_(math.sqrt(0.5))


class _ValueAndGradient(torch.autograd.Function):
    """f and g = df/de of the layers after the encoding.

    With B = SHARPNESS, H_k = B h_k is stored instead of h_k, so that softplus needs no scale: z_k = W_k H_k + B b_k,
    H_{k+1} = log(1 + exp z_k), and a_k = sigmoid(z_k) is the derivative of h_{k+1} by W_k h_k + b_k.
    Forward, u_k being the derivative of f by h_{k+1}, cut and scaled where e was joined:
        u_{L-1} = W_L,  s_k = u_k * a_k,  u_{k-1} = s_k W_k,  g = s_0 W_0 + what was joined.
    Backward, for given adjoints df and dg, first along g's way (upwards through the layers), then along f's
    (downwards); the derivative of a_k is B a_k (1 - a_k).
    """

    @staticmethod
    def forward(ctx: Any, e: Tensor, skip: int, mixed: bool, *parameters: Tensor) -> tuple[Tensor, Tensor]:
        layers = len(parameters) // 2
        W, b = parameters[:layers], parameters[layers:]
        E = SHARPNESS * e
        H, a = [E], []
        for k in range(layers - 1):
            if k == skip > 0:
                H[-1] = _joined(H[-1], E)
            z = torch.addmm(b[k], H[-1], W[k].t(), beta=SHARPNESS)
            H.append(_softplus(z))
            a.append(z.sigmoid_())
        f = torch.addmv(b[-1], H[-1], W[-1][0], alpha=1 / SHARPNESS)
        s, u = [a[-1] * W[-1]], []
        joined: Tensor | float = 0.0
        for k in range(layers - 2, 0, -1):
            U = s[-1] @ W[k]
            if k == skip:
                U = U.mul_(math.sqrt(0.5))
                U, joined = U[:, : -e.shape[1]], U[:, -e.shape[1] :]
            u.append(U)
            s.append(U * a[k - 1])
        g = s[-1] @ W[0] + joined
        s.reverse()
        u.reverse()
        ctx.skip, ctx.mixed, ctx.layers = skip, mixed, layers
        ctx.save_for_backward(*parameters, *H, *a, *s, *u)
        return f, g

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, df: Tensor, dg: Tensor) -> tuple[Tensor | None, ...]:
        with reduced_precision(df.device, ctx.mixed):
            return _backward(ctx, df, dg)


def _backward(ctx: Any, df: Tensor, dg: Tensor) -> tuple[Tensor | None, ...]:
    layers, skip, hidden = ctx.layers, ctx.skip, ctx.layers - 1
    saved = iter(ctx.saved_tensors)
    W, _, H, a, s, u = ([next(saved) for _ in range(n)] for n in (layers, layers, layers, hidden, hidden, hidden - 1))
    encoded = dg.shape[1]
    dW: list[Tensor] = []
    db: list[Tensor] = []

    # Along g's way: ds_k = du_{k-1} W_k^T, with dg for du_{-1}; du_k = ds_k * a_k, da_k = ds_k * u_k.
    da, du = [], dg
    for k in range(hidden):
        if k == skip > 0:
            du = _joined(du, dg)
        dW.append(s[k].t() @ du)
        ds = du @ W[k].t()
        da.append(ds * (W[-1] if k == hidden - 1 else u[k]))
        du = ds.mul_(a[k])
    dW.append(du.sum(0, keepdim=True))

    # Along f's way: dz_k = a_k * (dh_{k+1} + B (1 - a_k) * da_k), dh_k = dz_k W_k. H is B h.
    dW[-1].addmm_(df[None], H[-1], alpha=1 / SHARPNESS)
    db.append(df.sum(0, keepdim=True))
    dh, de = df[:, None] * W[-1], None
    for k in range(hidden - 1, -1, -1):
        bend = da[k].addcmul_(da[k], a[k], value=-1)
        dz = dh.add_(bend, alpha=SHARPNESS).mul_(a[k])
        dW[k].addmm_(dz.t(), H[k], alpha=1 / SHARPNESS)
        db.append(dz.sum(0))
        if k > 0 or ctx.needs_input_grad[0]:
            dh = dz @ W[k]
        if k == skip > 0:
            dh = dh.mul_(math.sqrt(0.5))
            dh, de = dh[:, :-encoded], dh[:, -encoded:]
    de = None if not ctx.needs_input_grad[0] else dh if de is None else dh + de
    return (de, None, None, *dW, *reversed(db))
