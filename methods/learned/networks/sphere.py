"""Networks initialised as a sphere: "optional for our training but critical for baseline SIRENs" (thesis 4.1.2).

Random sine networks have zero levels all over the box, and Eq. 4.4 does not distinguish inside from outside; one that
is initialised as a sphere has one surface, outside positive. The thesis trains it beforehand; so do we, once: the
forms of three layers that its tables use are shipped, in half precision, beside this file (made again by
``python -m bench.methods.learned.networks.sphere``). Any other is made when it is first needed, off the clock, and
cached in the user's folder; this takes minutes if it is wide or of high frequency.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
from pathlib import Path
from typing import Any

import torch

from .shipped import sphere_file
from .sine_network import SineNetwork

BATCH = 2048
STEPS_PER_OMEGA, RATE_TIMES_OMEGA = 50, 3e-3  # the higher the frequency, the smaller the weights, and so the steps
# omega, layers behind the first, width: IDF's base and SIREN-3, and the base of a transfer; not SIREN-7, of 0.9 MB each
FORMS = ((15.0, 3, 256), (30.0, 3, 256), (40.0, 3, 256), (60.0, 3, 256), (5.0, 3, 96), (30.0, 3, 128))
RADIUS = 0.5

_of_this_process: dict[tuple[float, int, int, float], dict[str, torch.Tensor]] = {}


def begin_as_sphere(network: SineNetwork, radius: float = RADIUS) -> None:
    """Replace a network's weights by those of the signed distance |x| - radius; leave them for a radius of 0.

    The weights depend only on the network's form and on the radius, not on its previous weights. A shipped or cached
    sphere is scaled and stored in float16: the rounding of initial weights does not matter, but they must be the same
    whether the sphere is new or cached.
    """
    if radius:
        _assign(network, keep(network.omega, len(network.weights) - 2, len(network.weights[0]), radius))


def keep(omega: float, hidden_layers: int, width: int, radius: float = RADIUS) -> dict[str, torch.Tensor]:
    """The weights of a sphere: shipped, cached, or made and cached, in the user's cache and in this process."""
    form = (omega, hidden_layers, width, radius)
    if form not in _of_this_process:
        shipped = sphere_file(*form)
        like = SineNetwork(omega, hidden_layers=hidden_layers, width=width, generator=torch.Generator()).state_dict()
        found = _load(shipped, like) or _load(_cache() / shipped.name, like)
        if not found:
            found = make(*form)
            _keep(found, _cache() / shipped.name)
        _of_this_process[form] = found
    return _of_this_process[form]


def base_and_detail(omega: float, omega_detail: float, radius: float, **form: Any) -> tuple[SineNetwork, SineNetwork]:
    """Two networks of one form, of low and of high frequency; the first is initialised as a sphere."""
    base, detail = SineNetwork(omega, **form), SineNetwork(omega_detail, **form)
    begin_as_sphere(base, radius)
    return base, detail


def make(omega: float, hidden_layers: int, width: int, radius: float) -> dict[str, torch.Tensor]:
    """Weights, in float16, of a network fitted to |x| - radius: value, direction and length of the gradient.

    The loss is that of the released recipe, mean |f - (|x| - r)| + mean(1 - cos(grad f, x)) + mean ||grad f| - 1|, on
    uniform points of the box.
    """
    generator = torch.Generator().manual_seed(0)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # so that machines of the same kind make the same one
    try:
        network = SineNetwork(omega, hidden_layers=hidden_layers, width=width, generator=generator, mixed=False)
        optimizer = torch.optim.Adam(network.parameters())
        steps, rate = max(500, round(STEPS_PER_OMEGA * omega)), RATE_TIMES_OMEGA / omega
        for step in range(steps):
            optimizer.param_groups[0]["lr"] = rate * (1 - step / steps)
            x = torch.rand(BATCH, 3, generator=generator) * 2 - 1
            f, gradient = network.value_and_gradient(x)
            distance = torch.linalg.vector_norm(x, dim=1)
            loss = (f - (distance - radius)).abs().mean()
            loss = loss + (1 - torch.cosine_similarity(gradient, x)).mean()
            loss = loss + (torch.linalg.vector_norm(gradient, dim=1) - 1).abs().mean()
            optimizer.zero_grad(set_to_none=True)
            loss.backward()
            optimizer.step()
    finally:
        torch.set_num_threads(threads)
    return {name: tensor.detach().half() for name, tensor in network.state_dict().items()}


def _assign(network: SineNetwork, weights: dict[str, torch.Tensor]) -> None:
    network.load_state_dict({name: tensor.float() for name, tensor in weights.items()})


def _load(path: Path, like: dict[str, torch.Tensor]) -> dict[str, torch.Tensor] | None:
    """The weights in a file; None if it is missing or damaged: they are then made again."""
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    try:
        found = load_file(str(path)) if path.is_file() else {}
    except (OSError, SafetensorError):
        return None
    shapes = {name: tensor.shape for name, tensor in found.items()}
    return found if shapes == {name: tensor.shape for name, tensor in like.items()} else None


def _cache() -> Path:
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "detailbench" / f"spheres-torch{torch.__version__}"


def _keep(weights: dict[str, torch.Tensor], path: Path) -> None:
    """Write a sphere; if that is not possible it is made again next time."""
    from safetensors.torch import save_file

    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent) as folder:
            save_file(weights, str(Path(folder) / path.name), {"format": "pt"})
            os.replace(Path(folder) / path.name, path)


if __name__ == "__main__":
    for form in FORMS:
        _keep(make(*form, RADIUS), sphere_file(*form, RADIUS))
