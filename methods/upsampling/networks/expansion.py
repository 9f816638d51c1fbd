"""Expansion of the features of a point to those of two."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from .dense_features import Pointwise


class CodeExpansion(nn.Module):
    """Each feature twice, distinguished by -1 and +1 times ``code``, through two shared layers of 128 channels.

    Notes
    -----
    50,560 parameters for 264 channels (Wang et al. 2019, section 3.2).
    """

    def __init__(self, inputs: int, code: float, generator: torch.Generator | None = None):
        super().__init__()
        self.code = code
        self.first = Pointwise(inputs + 1, 128, generator)
        self.second = Pointwise(128, 128, generator)

    def forward(self, features: Tensor) -> Tensor:
        """(inputs, b, n) to (128, b, 2 n): all first copies, then all second ones."""
        c, b, n = features.shape
        # The product with the features is the same for both copies.
        of_features, of_code = self.first.weight.split([c, 1], dim=1)
        shared = torch.addmm(self.first.bias[:, None], of_features, features.reshape(c, -1)).reshape(-1, b, n)
        step = self.code * of_code[:, :, None]
        both = torch.cat([shared - step, shared + step], dim=2)
        return F.relu(self.second(F.relu(both)))
