"""The networks of KeypointDeformer (Jakab et al. 2021): keypoints of shapes, and their influence on cages."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from ..losses.planes import EXACT
from ..meshes.shrunk_cages import shrunk_cage
from .cage_network import LEAK, Encoder, draw_weights


class Keyed(NamedTuple):
    """The cages and keypoints of sources, and the deformed cages."""

    cage: Tensor
    """(b, n, 3)"""
    moved: Tensor
    """(b, n, 3): the deformed cage"""
    keypoints: Tensor
    """(b, k, 3): of the sources"""
    wanted: Tensor
    """(b, k, 3): of the targets"""
    offset: Tensor
    """(b, k, n): the offset of the canonical influence for each source"""


class KeypointNetwork(nn.Module):
    """Keypoints of source and target, and the cage of the source, which follows their differences.

    Parameters
    ----------
    directions : (n, 3) tensor
        Unit vectors, the vertices of a round cage.
    faces : (f, 3) int64 tensor
        Of that cage.
    keypoints : int
        k, of a shape; they are ordered, so that each of a source corresponds to one of the target.
    code : int
        Size of the code of a shape.
    gap : float
        Between a shape and its cage, see :func:`..meshes.shrunk_cages.shrunk_cage`.
    influenced : int
        The nearest vertices of the cage that a keypoint moves; 0 for all.
    generator : torch.Generator
        The weights are drawn from it, on the CPU.

    Notes
    -----
    485,652 parameters with 12 keypoints, a code of 256 and a cage of 42 vertices: two encoders of 107,392, keypoints
    75,044, offsets of the influence 195,320, canonical influence 504. All influences start at 0: sources do not move.
    """

    directions: Tensor
    faces: Tensor

    def __init__(
        self,
        directions: Tensor,
        faces: Tensor,
        keypoints: int,
        code: int,
        gap: float,
        influenced: int,
        generator: torch.Generator | None = None,
    ):
        super().__init__()
        self._gap, self._influenced = gap, influenced
        self.encoder, self.source_encoder = Encoder(code), Encoder(code)
        self.pointing = _layers(code, 3 * keypoints)
        self.offsets = _layers(code, keypoints * len(directions))
        draw_weights(self, generator)
        last = self.offsets[-1]
        assert isinstance(last, nn.Linear)
        nn.init.zeros_(last.weight)
        self.influence = nn.Parameter(torch.zeros(keypoints, len(directions)))
        self.register_buffer("directions", directions.clone(), persistent=False)
        self.register_buffer("faces", faces.clone(), persistent=False)

    def forward(self, source: Tensor, target: Tensor) -> Keyed:
        """The deformation of points (b, p, 3) to points (b, q, 3)."""
        return self.follow(source, self.keypoints(source), self.keypoints(target))

    def keypoints(self, points: Tensor) -> Tensor:
        """Points (b, p, 3) to keypoints (b, k, 3)."""
        return self.pointing(self.encoder(points)).reshape(len(points), -1, 3)

    def follow(self, source: Tensor, keypoints: Tensor, wanted: Tensor) -> Keyed:
        """Move the cages of sources (b, p, 3), with keypoints (b, k, 3), towards the ``wanted`` keypoints."""
        cage = shrunk_cage(self.directions, self.faces, source, self._gap)
        offset = self.offsets(self.source_encoder(source)).reshape(len(source), *self.influence.shape)
        influence = (self.influence + offset) * self._near(keypoints, cage)
        moved = cage + influence.transpose(1, 2) @ (wanted - keypoints)
        return Keyed(cage, moved, keypoints, wanted, offset)

    def _near(self, keypoints: Tensor, cage: Tensor) -> Tensor:
        """1 where a keypoint may move a vertex, otherwise 0: (b, k, n)."""
        count = self._influenced or cage.shape[1]
        with torch.no_grad():
            apart = torch.cdist(keypoints, cage, compute_mode=EXACT)
            nearest = apart.topk(min(count, cage.shape[1]), dim=2, largest=False).indices
            return torch.zeros_like(self.influence).expand(len(cage), -1, -1).scatter(2, nearest, 1.0)


def _layers(code: int, numbers: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(code, code), nn.LeakyReLU(LEAK), nn.Linear(code, numbers))
