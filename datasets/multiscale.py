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

    What a method does with fine detail on a coarse shape, in one dataset: rough, carved and stacked. The shapes are
    those of their families, under their ids, one of each family in turn.
    """

    def shapes(self, split: str) -> Iterator[Shape]:
        """The endless shapes of a split; ``train`` and ``test`` come from different seeds."""
        families = [_fine(family().shapes(split)) for family in FAMILIES]
        while True:
            for shapes in families:
                yield next(shapes)


def _fine(shapes: Iterator[Shape]) -> Iterator[Shape]:
    """Those that are not made without fine detail; known from their parameters, so nothing is built."""
    return (shape for shape in shapes if shape.info.get("fine", True))
