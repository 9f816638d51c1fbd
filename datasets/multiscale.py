"""Shapes with detail on several scales, from several families."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from bench import Shape, register

from .fbm import Fbm
from .fractals import Fractals
from .reliefs import Reliefs

FAMILIES = (Fbm, Reliefs, Fractals)


@register("dataset", requires=("igl", "manifold3d", "scipy", "trimesh"))
@dataclass(frozen=True)
class Multiscale:
    """Shapes with detail on several scales: the rough of `fbm`, the fine of `reliefs`, and `fractals`.

    One dataset to test how a method treats fine detail on a coarse shape: rough, carved and stacked. The shapes and ids
    are those of the families, one of each family in turn.
    """

    def shapes(self, split: str) -> Iterator[Shape]:
        """The endless shapes of a split; ``train`` and ``test`` come from different seeds."""
        families = [_fine(family().shapes(split)) for family in FAMILIES]
        while True:
            for shapes in families:
                yield next(shapes)


def _fine(shapes: Iterator[Shape]) -> Iterator[Shape]:
    """The shapes that have fine detail; their parameters show it, so nothing is built."""
    return (shape for shape in shapes if shape.info.get("fine", True))
