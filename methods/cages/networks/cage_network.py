"""The networks of Neural Cages (Wang et al. 2020): a cage for a source, and the deformed cage."""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor, nn

LEAK = 0.1
Cage = Literal["predicted", "invariant", "identity"]


class Encoder(nn.Module):
    """Maps points to a code: a PointNet without normalisation. 107,392 parameters for a code of 256."""

    def __init__(self, code: int, last: nn.Module | None = None):
        super().__init__()
        self.points = nn.Sequential(nn.Linear(3, 64), nn.ReLU(), nn.Linear(64, 128), nn.ReLU(), nn.Linear(128, code))
        self.whole = nn.Sequential(nn.Linear(code, code), last or nn.LeakyReLU(LEAK))

    def forward(self, points: Tensor) -> Tensor:
        """Clouds (b, n, 3) to codes (b, code)."""
        return self.whole(self.points(points).amax(dim=1))


class Offsets(nn.Module):
    """Maps a code and the vertices of a cage to offsets of the vertices, one by one, as AtlasNet decodes patches."""

    def __init__(self, code: int, first: int, second: int):
        super().__init__()
        sizes = (code + 3, first, second)
        layers: list[nn.Module] = []
        for size, following in zip(sizes, sizes[1:], strict=False):
            layers += [nn.Linear(size, following), nn.LeakyReLU(LEAK)]
        self.layers = nn.Sequential(*layers, nn.Linear(second, 3))

    def forward(self, code: Tensor, vertices: Tensor) -> Tensor:
        """Codes (b, c) and vertices (b, n, 3) to offsets (b, n, 3)."""
        return self.layers(torch.cat([code[:, None].expand(-1, vertices.shape[1], -1), vertices], dim=2))


class AllOffsets(nn.Module):
    """Maps a code to the offsets of all vertices of one cage at once."""

    def __init__(self, code: int, vertices: int):
        super().__init__()
        self.layers = nn.Sequential(nn.Linear(code, 512), nn.LeakyReLU(LEAK), nn.Linear(512, 1024), nn.LeakyReLU(LEAK))
        self.last = nn.Linear(1024, 3 * vertices)

    def forward(self, code: Tensor, vertices: Tensor) -> Tensor:
        """Codes (b, c) to offsets (b, n, 3)."""
        return self.last(self.layers(code)).reshape(len(code), -1, 3)


class CageNetwork(nn.Module):
    """Maps source and target to a cage around the source and the deformed cage.

    Parameters
    ----------
    template : (n, 3) tensor
        The initial cage.
    code : int
        Size of the code of a shape.
    cage : ``predicted`` for each source, ``invariant`` (one that is learned), or ``identity`` (the template)
    generator : torch.Generator
        The weights are drawn from it, on the CPU.

    Notes
    -----
    577,158 parameters with a code of 256 and ``predicted``: encoder 107,392, cage 41,731, merger 262,656, deformation
    165,379. The released network stores another fold of both decoders, which has no effect.
    """

    def __init__(self, template: Tensor, code: int, cage: Cage, generator: torch.Generator | None = None):
        super().__init__()
        self.encoder = Encoder(code)
        self.caging = Offsets(code, 128, 64) if cage == "predicted" else None
        self.merger = nn.Sequential(nn.Linear(2 * code, 2 * code), nn.LeakyReLU(LEAK))
        self.deforming = Offsets(2 * code, 256, 128)
        draw_weights(self, generator)
        if cage == "invariant":
            self.template = nn.Parameter(template.clone())
        else:
            self.register_buffer("template", template.clone(), persistent=False)

    def forward(self, source: Tensor, target: Tensor) -> tuple[Tensor, Tensor]:
        """Points (b, p, 3) and (b, q, 3) to the cages and the deformed cages, (b, n, 3) each."""
        code, wanted = self.encoder(source), self.encoder(target)
        cage = self.template.expand(len(source), -1, -1)
        if self.caging is not None:
            cage = cage + self.caging(code, cage)
        return cage, cage + self.deforming(self.merger(torch.cat([code, wanted], dim=1)), cage)


class PoseNetwork(nn.Module):
    """Maps a posed target to the deformed cage of one source: the variant for characters.

    1,362,023 parameters with a code of 512 and a cage of 77 vertices.
    """

    def __init__(self, cage: Tensor, code: int, generator: torch.Generator | None = None):
        super().__init__()
        self.encoder = Encoder(code, nn.Tanh())
        self.deforming = AllOffsets(code, len(cage))
        draw_weights(self, generator)
        self.register_buffer("cage", cage.clone())  # stored with the weights, which are useless for another cage

    def forward(self, target: Tensor) -> Tensor:
        """Points (b, q, 3) to deformed cages (b, n, 3)."""
        return self.cage + self.deforming(self.encoder(target), self.cage)


def draw_weights(network: nn.Module, generator: torch.Generator | None) -> None:
    """Xavier-uniform weights, and biases of 0."""
    for layer in network.modules():
        if isinstance(layer, nn.Linear):
            nn.init.xavier_uniform_(layer.weight, generator=generator)
            nn.init.zeros_(layer.bias)
