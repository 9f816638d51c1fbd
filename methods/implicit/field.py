"""What is fitted: a scalar field with parameters."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor, nn

from bench import BadInput

from .sampling import Batch

if TYPE_CHECKING:
    from .fitting import Training


class Field(nn.Module):
    """Base of all fields. ``t`` is the progress of the training, from 0 to 1.

    A new one has :meth:`forward`, the values at points, and :meth:`loss`, and whatever of the rest it needs.
    """

    def loss(self, batch: Batch, t: float) -> Tensor:
        """The loss over ``batch``, divided by the points of the whole step."""
        raise NotImplementedError

    def groups(self) -> Sequence[list[nn.Parameter]]:
        """Parameters that share a learning rate."""
        return [list(self.parameters())]

    def rates(self, t: float) -> Sequence[float]:
        """The factor of the learning rate of each group; parameters whose factor is 0 stay as they are."""
        return [1.0]

    def optimizer(self, training: Training) -> torch.optim.Optimizer:
        """What makes the steps; its groups are those of :meth:`groups`, and their rates are set before each step."""
        groups = [{"params": parameters, "lr": 0.0} for parameters in self.groups()]
        return torch.optim.Adam(groups, lr=training.learning_rate, betas=training.betas, fused=True)

    def count(self) -> int:
        """How many parameters there are."""
        return sum(p.numel() for p in self.parameters())

    @torch.no_grad()
    def values(self, points: np.ndarray) -> np.ndarray:
        """The field at (n, 3) points, as the mesher asks for it: float64 (n,)."""
        device = next(self.parameters()).device
        x = torch.as_tensor(np.asarray(points, dtype=np.float32), device=device)
        return torch.cat([self(part) for part in x.split(PART)]).double().cpu().numpy()


PART = 4096  # points that are evaluated at once: their features stay in the cache


def save(field: Field, path: str | Path, **facts: str) -> None:
    """Write the parameters, and ``facts`` in words, to a safetensors file."""
    from safetensors.torch import save_file

    tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in field.state_dict().items()}
    save_file(tensors, str(path), {"format": "pt", **facts})


def load(field: Field, path: str | Path) -> None:
    """Read parameters that :func:`save` wrote into a field of the same form.

    Raises
    ------
    BadInput
        Naming the file, if it cannot be read or belongs to another network.
    """
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    try:
        tensors = load_file(str(path))
    except (OSError, SafetensorError) as error:
        raise BadInput(f"{path}: expected a safetensors file that this method saved ({error})") from error
    mine = field.state_dict()
    differing = sorted(name for name in {*mine, *tensors} if _shape(mine, name) != _shape(tensors, name))
    if differing:
        name = differing[0]
        raise BadInput(
            f"{path}: belongs to another network: {name} is {_shape(tensors, name) or 'missing'} there and "
            f"{_shape(mine, name) or 'missing'} here; give the method the parameters that it was saved with"
        )
    field.load_state_dict(tensors)


def _shape(tensors: dict[str, Tensor], name: str) -> tuple[int, ...] | None:
    return tuple(tensors[name].shape) if name in tensors else None
